//! Every kind of problem: one code, one status, one title, one remedy each.

use std::borrow::Cow;

use axum::http::StatusCode;
use axum::http::header::HeaderMap;
use serde_json::Map;

use super::{Contents, Problem};

/// The table: of each kind its name here and on the wire, its status, its title, and what to do about it.
macro_rules! codes {
    ($($code:ident $name:literal $status:ident $title:literal $remedy:literal)*) => {
        /// Stable names of problems; the wire's `code`.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Code {
            $(#[doc = $title] $code,)*
        }

        impl Code {
            /// Every code, in the order of the table.
            pub const ALL: &[Self] = &[$(Self::$code,)*];

            /// Name on the wire, status, title.
            #[must_use]
            pub fn row(self) -> (&'static str, StatusCode, &'static str) {
                match self {
                    $(Self::$code => ($name, StatusCode::$status, $title),)*
                }
            }

            /// What to do about it.
            #[must_use]
            pub fn remedy(self) -> &'static str {
                match self {
                    $(Self::$code => $remedy,)*
                }
            }
        }
    };
}

codes! {
    MalformedJson "malformed_json" BAD_REQUEST "The body is not JSON"
        "Send one JSON value in UTF-8, and nothing behind it; the detail says at which line and column reading ended."
    TruncatedBody "truncated_body" BAD_REQUEST "The body ended too early"
        "The connection or the compressed stream ended before the body did. Nothing was stored: send all of it again."
    MalformedBody "malformed_body" BAD_REQUEST "The body cannot be decoded"
        "The bytes are not of the format that Content-Type and Content-Encoding name. Check both headers, and the file where the detail points."
    MalformedHeader "malformed_header" BAD_REQUEST "A header has an unusable value"
        "Send the header in the form that the detail names, or leave it out."
    Unauthenticated "unauthenticated" UNAUTHORIZED "A key is needed"
        "Send `Authorization: Bearer hw_…` with an active key; `headway keys create` makes one on the server's machine, POST /v1/keys elsewhere."
    KeyExpired "key_expired" UNAUTHORIZED "The key has expired"
        "Ask whoever manages keys for a new one: POST /v1/keys."
    KeyRevoked "key_revoked" UNAUTHORIZED "The key was revoked"
        "Ask whoever manages keys for a new one: POST /v1/keys."
    InsufficientScope "insufficient_scope" FORBIDDEN "The key does not have the scope"
        "Use a key with the scope that the member `scope` names; `admin` has all of them."
    ModelForbidden "model_forbidden" FORBIDDEN "The key is for other models"
        "Use a key that is not limited to other models; what concerns the whole server takes one without a limit."
    ForeignPage "foreign_page" FORBIDDEN "A page from elsewhere asks"
        "A web page of another origin tried to change something. Name its origin in server.cors_origins, or make keys."
    NotFound "not_found" NOT_FOUND "There is nothing at this path"
        "Check the path against /openapi.json; a model, batch or version that is missing has a code of its own."
    ModelNotFound "model_not_found" NOT_FOUND "There is no such model"
        "GET /v1/models lists the models; POST /v1/models makes one."
    BatchNotFound "batch_not_found" NOT_FOUND "The model has no such batch"
        "GET …/batches lists the model's batches; ids belong to one model."
    TaskNotFound "task_not_found" NOT_FOUND "The model has no such task"
        "GET …/tasks lists the model's tasks; ids belong to one model."
    VersionNotFound "version_not_found" NOT_FOUND "The model has no such version"
        "GET …/versions lists the model's versions."
    KeyNotFound "key_not_found" NOT_FOUND "There is no such key"
        "GET /v1/keys lists the keys; the id is the part of a key between the first and the second underscore."
    SourceNotFound "source_not_found" NOT_FOUND "The model knows no such source"
        "GET …/sources lists the sources that the model has had events of."
    MethodNotAllowed "method_not_allowed" METHOD_NOT_ALLOWED "The path has no such method"
        "The `Allow` header names the methods of this path."
    NotAcceptable "not_acceptable" NOT_ACCEPTABLE "No acceptable representation"
        "Accept what the detail names, or `*/*`."
    BodyTimeout "body_timeout" REQUEST_TIMEOUT "The body did not arrive in time"
        "Send the body without pauses longer than server.body_idle_s and faster than server.body_bytes_per_s; smaller batches help on a slow line."
    ModelExists "model_exists" CONFLICT "The model's name is taken"
        "Choose another name, or use the model that is there."
    VersionTainted "version_tainted" CONFLICT "The version learned what was retracted"
        "Promote the version that the replay made in its place, or say `\"force\": true`."
    VersionPruned "version_pruned" GONE "The version's weights were not kept"
        "Retention did not keep its weights: choose another version, or a backup from before; …/settings retention says what is kept."
    EventsPruned "events_pruned" CONFLICT "Events that are needed were not kept"
        "What was learned cannot be undone without the events that it was learned from: roll back to a version before it."
    NothingPending "nothing_pending" CONFLICT "No event waits to be learned"
        "Upload events first, or name batches: those that were learned or set aside train again only when they are named."
    TaskEnded "task_ended" CONFLICT "The task has ended"
        "What has ended cannot be cancelled; roll back to undo what it made."
    TasksUnderWay "tasks_under_way" CONFLICT "Tasks of the model are queued or running"
        "Wait for the model's tasks to end, or cancel them; then send the same request again."
    MethodNeedsEvents "method_needs_events" CONFLICT "The method learns from stored events"
        "joint and replay… learn from what their line has learned, which a file of weights does not bring. Import into a model of another method."
    NoLiveVersion "no_live_version" CONFLICT "The model has no live version"
        "Let the model learn a batch, or promote a version: POST …/promote."
    NothingToDistil "nothing_to_distil" CONFLICT "No event is left to distil by"
        "Events that the version learned from tell behind which leaders it drives; they were retracted or not kept. Export safetensors or onnx, which need none."
    NoParentVersion "no_parent_version" CONFLICT "There is no version to roll back to"
        "Name the version to roll back to."
    Corrupt "corrupt" CONFLICT "What this needs is not what was stored"
        "What is stored is not what was written. `headway verify` tells what; roll back to a good version, or restore a backup."
    AdminKeyFirst "admin_key_first" CONFLICT "There is no active admin key"
        "Make a key with the scope `admin` first."
    LastAdminKey "last_admin_key" CONFLICT "It is the last active admin key"
        "Make another admin's key first, or say `?force=true` and manage keys with the command line from then on."
    TooManyKeys "too_many_keys" CONFLICT "The server keeps no more keys"
        "Revoke keys that nobody uses, or raise access.max_keys."
    NoBackupFolder "no_backup_folder" CONFLICT "The server keeps no backups"
        "Set backup.folder to a folder that the server may write."
    IdempotencyInFlight "idempotency_in_flight" CONFLICT "A request with this Idempotency-Key is being answered"
        "The first request with this key is still being answered: wait as long as Retry-After says, and send the same again."
    PreconditionFailed "precondition_failed" PRECONDITION_FAILED "The model has changed"
        "The model has changed since its ETag was read: read it again, and decide again."
    BodyTooLarge "body_too_large" PAYLOAD_TOO_LARGE "The body is too large"
        "Send less at once: several batches, or fewer windows; the detail names the limit, and limits are settings."
    UnsupportedMediaType "unsupported_media_type" UNSUPPORTED_MEDIA_TYPE "The body's type is not supported"
        "Send one of the content types or encodings that the detail names."
    InvalidBody "invalid_body" UNPROCESSABLE_ENTITY "The body is not what this call takes"
        "`errors` says of each place what is wrong there, and what would be right."
    InvalidArchive "invalid_archive" UNPROCESSABLE_ENTITY "The file is no archive that can be taken in"
        "Send the bytes that GET …/archive gave, of a release that is no newer than this one; the detail says what is wrong with these."
    InvalidQuery "invalid_query" UNPROCESSABLE_ENTITY "A query parameter is unusable"
        "`errors` names the parameter, and what would be right."
    InvalidSettings "invalid_settings" UNPROCESSABLE_ENTITY "A setting is unusable"
        "`errors` names the setting; the ranges are in /openapi.json, and src/default.toml explains each."
    NoEventAccepted "no_event_accepted" UNPROCESSABLE_ENTITY "No event was accepted"
        "`rejected` says of each event why: units, physics or form. The batch is kept as a list of rejections."
    BatchRetracted "batch_retracted" CONFLICT "The batch was retracted"
        "Name other batches, or upload its events anew."
    IdempotencyMismatch "idempotency_mismatch" UNPROCESSABLE_ENTITY "The Idempotency-Key belongs to another request"
        "Use a new Idempotency-Key for another request."
    RateLimited "rate_limited" TOO_MANY_REQUESTS "The key asks too often"
        "Wait as long as Retry-After says; fewer and larger requests help, or a key with a limit of its own."
    Internal "internal" INTERNAL_SERVER_ERROR "Something went wrong here"
        "Send the request id to whoever runs the server: the log has the cause under it. The same request may be sent again."
    Busy "busy" SERVICE_UNAVAILABLE "Too many requests of this kind at once"
        "Come again as soon as Retry-After says; how many are taken at once is a setting."
    DatabaseBusy "database_busy" SERVICE_UNAVAILABLE "Other changes keep the database busy for too long"
        "Nothing was changed. Send the same again after Retry-After."
    StorageFull "storage_full" INSUFFICIENT_STORAGE "There is no room to store anything"
        "Nothing was changed, and predictions go on. Make room on the server's disk, or let retention keep less; then send the same again."
    DatabaseReadOnly "database_read_only" SERVICE_UNAVAILABLE "The database cannot be written"
        "Nothing was changed, and predictions go on. Let the server write its database's folder again."
    ShuttingDown "shutting_down" SERVICE_UNAVAILABLE "The server is going down"
        "Send the same to the server that takes its place, or to this one when it is back."
    NotReady "not_ready" SERVICE_UNAVAILABLE "The server cannot serve everything yet"
        "Versions are still being loaded, or none can be: /readyz and the log tell which."
}

impl Code {
    /// The code of this name on the wire.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|code| code.row().0 == name)
    }

    /// A problem of this kind.
    #[must_use]
    pub fn because(self, detail: impl Into<Cow<'static, str>>) -> Problem {
        Problem(Box::new(Contents {
            code: self,
            detail: detail.into(),
            errors: Vec::new(),
            extensions: Map::new(),
            headers: HeaderMap::new(),
            cause: None,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_code_has_a_name_and_a_remedy_of_its_own() {
        let names: BTreeSet<_> = Code::ALL.iter().map(|code| code.row().0).collect();
        assert_eq!(names.len(), Code::ALL.len());
        for &code in Code::ALL {
            assert_eq!(Code::named(code.row().0), Some(code));
            let remedy = code.remedy();
            assert!(remedy.len() > 20 && remedy.ends_with('.'), "{remedy}");
        }
        assert_eq!(Code::named("odd"), None);
    }
}
