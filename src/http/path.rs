//! Names and ids in paths: what cannot be one is not found.

use std::sync::Arc;

use axum::extract::{FromRequestParts, MatchedPath, RawPathParams};
use axum::http::request::Parts;

use super::AppState;
use super::problem::{Code, Problem};
use crate::access::KeyId;
use crate::lineage::{Model, ModelName};

/// The model a path names.
#[derive(Debug)]
pub(super) struct ModelAt(pub Model);

/// The name of a model that need not be there.
#[derive(Debug)]
pub(super) struct NewModelAt(pub ModelName);

/// The key id a path names: sixteen hexadecimal digits.
#[derive(Debug, Clone, Copy)]
pub(super) struct KeyAt(pub KeyId);

/// The batch id a path names: `b12`.
#[derive(Debug, Clone, Copy)]
pub(super) struct BatchAt(pub i64);

/// The task id a path names: `t7`.
#[derive(Debug, Clone, Copy)]
pub(super) struct TaskAt(pub i64);

/// The source a path names, as uploads do.
#[derive(Debug)]
pub(super) struct SourceAt(pub String);

/// The file of the viewer a path names.
#[derive(Debug)]
pub(super) struct FileAt(pub String);

/// The kind of problem a path names.
#[derive(Debug, Clone, Copy)]
pub(super) struct CodeAt(pub Code);

/// The version a path names: `3`.
#[derive(Debug, Clone, Copy)]
pub(super) struct VersionAt(pub i64);

/// The version a path names, where it names one.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaybeVersionAt(pub Option<i64>);

impl FromRequestParts<Arc<AppState>> for MaybeVersionAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<AppState>) -> Result<Self, Problem> {
        let names_one = parts.extensions.get::<MatchedPath>().is_some_and(|path| path.as_str().contains("{version}"));
        if !names_one {
            return Ok(Self(None));
        }
        VersionAt::from_request_parts(parts, app).await.map(|VersionAt(version)| Self(Some(version)))
    }
}

impl FromRequestParts<Arc<AppState>> for ModelAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<AppState>) -> Result<Self, Problem> {
        let name = parameter(parts, "model").await?;
        find_model(app, &name).await.map(Self)
    }
}

impl<S: Sync> FromRequestParts<S> for NewModelAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let name = parameter(parts, "model").await?;
        let cannot_be =
            |why: &dyn std::fmt::Display| Code::ModelNotFound.because(format!("{name:?} is no name: {why}"));
        ModelName::parse(&name).map(Self).map_err(|error| cannot_be(&error))
    }
}

impl FromRequestParts<Arc<AppState>> for SourceAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &Arc<AppState>) -> Result<Self, Problem> {
        parameter(parts, "source").await.map(Self)
    }
}

impl<S: Sync> FromRequestParts<S> for FileAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        parameter(parts, "file").await.map(Self)
    }
}

impl<S: Sync> FromRequestParts<S> for CodeAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let name = parameter(parts, "code").await?;
        let missing = || Code::NotFound.because(format!("no problem is called {name:?}"));
        Code::named(&name).map(Self).ok_or_else(missing)
    }
}

/// The model called `name`, which need not be well formed.
///
/// # Errors
/// 404 when there is none.
pub(super) async fn find_model(app: &AppState, name: &str) -> Result<Model, Problem> {
    let missing = || Code::ModelNotFound.because(format!("no model is called {name:?}"));
    let name = ModelName::parse(name).map_err(|_| missing())?;
    app.store.model(&name).await?.ok_or_else(missing)
}

/// The model a path names, where all that matters is what of it serves: found without the database once something does.
#[derive(Debug)]
pub(super) struct ServedAt {
    pub(super) model_id: i64,
    pub(super) name: String,
}

impl FromRequestParts<Arc<AppState>> for ServedAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<AppState>) -> Result<Self, Problem> {
        Self::find(app, parameter(parts, "model").await?).await
    }
}

impl ServedAt {
    /// The model called `name`, which need not be well formed.
    ///
    /// # Errors
    /// 404 when there is none.
    pub(super) async fn find(app: &AppState, name: String) -> Result<Self, Problem> {
        let model_id = match app.predictor.serving(&name) {
            Some(model_id) => model_id,
            None => find_model(app, &name).await?.model_id,
        };
        Ok(Self { model_id, name })
    }
}

impl FromRequestParts<Arc<AppState>> for KeyAt {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &Arc<AppState>) -> Result<Self, Problem> {
        let text = parameter(parts, "key_id").await?;
        KeyId::parse(&text).map(Self).ok_or_else(|| Code::KeyNotFound.because(format!("{text:?} is none")))
    }
}

macro_rules! id_at {
    ($type:ident, $parameter:literal, $letter:literal, $code:ident) => {
        impl FromRequestParts<Arc<AppState>> for $type {
            type Rejection = Problem;

            async fn from_request_parts(parts: &mut Parts, _: &Arc<AppState>) -> Result<Self, Problem> {
                let text = parameter(parts, $parameter).await?;
                parse_id($letter, &text).map(Self).ok_or_else(|| Code::$code.because(format!("{text:?} is none")))
            }
        }
    };
}

id_at!(BatchAt, "batch_id", "b", BatchNotFound);
id_at!(TaskAt, "task_id", "t", TaskNotFound);
id_at!(VersionAt, "version", "", VersionNotFound);

/// The name of a model in a path, as its handler will read it; what it cannot read names none.
pub(super) async fn model_named(parts: &mut Parts) -> String {
    parameter(parts, "model").await.unwrap_or_default()
}

async fn parameter(parts: &mut Parts, name: &str) -> Result<String, Problem> {
    let parameters = RawPathParams::from_request_parts(parts, &())
        .await
        .map_err(|_| Code::NotFound.because("the path is not UTF-8"))?;
    let found = parameters.iter().find(|(key, _)| *key == name).map(|(_, value)| value.to_owned());
    found.ok_or_else(|| Problem::internal(format!("the route has no {name}")))
}

/// The row behind `letter` and digits, written as this server writes it.
#[must_use]
pub(super) fn parse_id(letter: &str, text: &str) -> Option<i64> {
    let digits = text.strip_prefix(letter)?;
    let canonical = digits.bytes().all(|b| b.is_ascii_digit()) && !digits.starts_with('0');
    digits.parse().ok().filter(|_| canonical)
}

/// A batch's id on the wire.
#[must_use]
pub(super) fn batch_id(row: i64) -> String {
    format!("b{row}")
}

/// A task's id on the wire.
#[must_use]
pub(super) fn task_id(row: i64) -> String {
    format!("t{row}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_has_one_spelling() {
        assert_eq!(parse_id("b", &batch_id(12)), Some(12));
        assert_eq!(parse_id("t", &task_id(7)), Some(7));
        assert_eq!(parse_id("", "3"), Some(3));
        for bad in ["b", "b0", "b012", "b-1", "b+1", "12", "t12", "b99999999999999999999", "b1x"] {
            assert_eq!(parse_id("b", bad), None, "{bad}");
        }
    }
}
