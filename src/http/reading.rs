//! What the interface reads of a request, by itself: without a server, a model or a database. What was read is told in
//! words, so that two readings can be compared; what is refused is told by its code.

use axum::http::HeaderMap;
use jiff::Timestamp;
use serde::de::DeserializeOwned;

use super::accept::acceptable;
use super::body::{parse, refuse_declared_excess};
use super::context::{REQUEST_ID, is_sane};
use super::evaluate;
use super::events_body::{kind, option_problem};
use super::gate::bearer;
use super::keys::{NewKey, Revocation};
use super::models::{Change, NewModel};
use super::predict::{PredictBody, SimulateBody};
use super::problem::{Code, Problem};
use super::query::{PageQuery, Query};
use super::serving::{Promotion, Rollback};
use super::tasks::{NewTask, Wait, wish};
use super::versions::Note;
use super::{ServerSettings, audit, batches, etag, idempotency, path, v2};
use crate::access::Token;
use crate::car_following::ExtractionSettings;
use crate::driver::Window;
use crate::formats::Format;
use crate::ingest::UploadOptions;
use crate::lineage::ModelSettings;

/// Calls with a JSON body, but for those that predict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Call {
    /// `POST /v1/models`
    CreateModel,
    /// `POST …/tasks`
    CreateTask,
    /// `POST …/promote`
    Promote,
    /// `POST …/rollback`
    Rollback,
    /// `POST /v1/keys`
    CreateKey,
    /// `PATCH …/versions/{version}`
    Annotate,
    /// `PATCH /v1/models/{model}`
    ChangeModel,
}

impl Call {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::CreateModel,
        Self::CreateTask,
        Self::Promote,
        Self::Rollback,
        Self::CreateKey,
        Self::Annotate,
        Self::ChangeModel,
    ];
}

/// What the body of a call says, of a server where models have these settings unless they say otherwise.
///
/// # Errors
/// The code of the problem that the call would answer.
pub fn body(call: Call, bytes: &[u8], defaults: &ModelSettings) -> Result<String, Code> {
    fn told<T: DeserializeOwned, X: std::fmt::Debug>(
        bytes: &[u8],
        understand: impl FnOnce(T) -> Result<X, Problem>,
    ) -> Result<String, Code> {
        parse(bytes).and_then(understand).map(|said| format!("{said:?}")).map_err(|problem| problem.code())
    }
    match call {
        Call::CreateModel => told(bytes, |new: NewModel| Ok((new.settings(defaults)?, new))),
        Call::CreateTask => told(bytes, |new: NewTask| wish(defaults, new)),
        Call::Promote => told(bytes, |promotion: Promotion| promotion.wish().map(|wish| format!("{wish:?}"))),
        Call::Rollback => told(bytes, |rollback: Rollback| rollback.wish().map(|wish| format!("{wish:?}"))),
        Call::CreateKey => told(bytes, |new: NewKey| new.wish(Timestamp::UNIX_EPOCH)),
        Call::Annotate => told(bytes, Note::text),
        Call::ChangeModel => told(bytes, Change::retention),
    }
}

/// The windows in the body of a prediction, for a version of this horizon.
///
/// # Errors
/// The code of the problem that the call would answer.
pub fn windows(bytes: &[u8], horizon: usize, settings: &ServerSettings) -> Result<Vec<Window>, Code> {
    let read = |body: PredictBody| {
        body.check_count(settings)?;
        body.windows(horizon, settings)
    };
    parse(bytes).and_then(read).map_err(|problem| problem.code())
}

/// The window and the leader's speeds in the body of a simulation, for a version of this horizon.
///
/// # Errors
/// The code of the problem that the call would answer.
pub fn simulation(bytes: &[u8], horizon: usize, settings: &ServerSettings) -> Result<(Window, Vec<f32>), Code> {
    let read = |body: SimulateBody| {
        body.check_count(settings)?;
        body.start(horizon, settings)
    };
    parse(bytes).and_then(read).map_err(|problem| problem.code())
}

/// The numbers in the body of an inference, and whether they are a vehicle's newest step, not windows; the header says how
/// long the JSON before the bytes is.
///
/// # Errors
/// The code of the problem that the call would answer.
pub fn inference(headers: &HeaderMap, bytes: &[u8]) -> Result<(Vec<f32>, bool), Code> {
    let told = |request: v2::Request| match request.input {
        v2::Input::Windows { elements, .. } => (elements, false),
        v2::Input::Step { step, .. } => (step.to_vec(), true),
    };
    v2::understood(headers, bytes).map(told).map_err(|problem| problem.code())
}

/// Whose query it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// A list's.
    Page,
    /// `GET /v1/audit`
    Audit,
    /// `POST …/batches`
    Upload,
    /// `POST …/evaluate`
    Evaluation,
    /// `GET …/tasks/{task_id}`
    Task,
    /// `DELETE …/batches/{batch_id}`
    Retraction,
    /// `DELETE /v1/keys/{key_id}`
    Revocation,
}

impl Asked {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Page, Self::Audit, Self::Upload, Self::Evaluation, Self::Task, Self::Retraction, Self::Revocation];
}

/// What a query says.
///
/// # Errors
/// The code of the problem that the call would answer.
pub fn query(asked: Asked, text: &str, settings: &ServerSettings) -> Result<String, Code> {
    const MOST_VERSIONS: usize = 8;
    let read = || -> Result<String, Problem> {
        Ok(match asked {
            Asked::Page => format!("{:?}", Query::<PageQuery>::parse(text)?.page(settings)?),
            Asked::Audit => format!("{:?}", Query::<audit::Wanted>::parse(text)?.page(settings)?),
            Asked::Upload => upload(&Query::parse(text)?)?,
            Asked::Evaluation => {
                let (asked, options) = evaluate::query(text)?;
                format!("{:?} {}", asked.names(MOST_VERSIONS)?, upload(&options)?)
            }
            Asked::Task => format!("{:?}", Query::<Wait>::parse(text)?.patience(settings)?),
            Asked::Retraction => format!("{:?}", Query::<batches::Retraction>::parse(text)?),
            Asked::Revocation => format!("{:?}", Query::<Revocation>::parse(text)?),
        })
    };
    read().map_err(|problem| problem.code())
}

fn upload(options: &UploadOptions) -> Result<String, Problem> {
    let conversion = options.conversion(Format::Csv).map_err(|error| option_problem(&error))?;
    let extraction = options.extraction(Format::Csv, &ExtractionSettings::default());
    let extraction = extraction.map_err(|error| option_problem(&error))?;
    Ok(format!("{options:?} {conversion:?} {extraction:?}"))
}

/// What the headers of an upload say: what its body is, who sends it, and whether it may be sent again.
///
/// # Errors
/// The code of the problem that the call would answer.
pub fn headers(headers: &HeaderMap, revision: &str, max_bytes: u64) -> Result<String, Code> {
    let read = || -> Result<String, Problem> {
        acceptable(headers, "/v1/models/{model}/batches")?;
        let (key, kind) = (idempotency::key(headers)?, kind(headers)?);
        refuse_declared_excess(headers, max_bytes)?;
        let token = bearer(headers).and_then(Token::parse);
        let named = headers.get(REQUEST_ID).is_some_and(|id| is_sane(id.as_bytes()));
        Ok(format!("{kind:?} {key:?} {token:?} {named} {}", etag::is_meant(headers, revision)))
    };
    read().map_err(|problem| problem.code())
}

/// The row that an id in a path names, behind its letter.
#[must_use]
pub fn id(letter: &str, text: &str) -> Option<i64> {
    path::parse_id(letter, text)
}
