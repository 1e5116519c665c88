//! What was answered, and what a person is told of a refusal.

use anyhow::Context;
use axum::body::Body;
use http_body_util::BodyExt;
use hyper::Response;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::http::Code;

/// Most reasons of a problem that are told.
const REASONS: usize = 3;

/// An answer, read to its end.
pub(super) struct Answer {
    pub(super) status: u16,
    /// The status with its reason.
    pub(super) shown: String,
    pub(super) is_success: bool,
    /// Null where it is no JSON.
    pub(super) body: Value,
}

/// Why something was refused, and what helps.
#[derive(Debug, thiserror::Error)]
#[error("{told}")]
pub(in crate::cli) struct Refusal {
    pub(in crate::cli) code: String,
    told: String,
}

/// What is read of a problem.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Problem {
    code: String,
    title: String,
    detail: String,
    errors: Vec<Reason>,
    rejected: Vec<Reason>,
}

#[derive(Debug, Deserialize)]
struct Reason {
    code: String,
    detail: String,
}

impl Answer {
    pub(super) async fn of(response: Response<Body>) -> anyhow::Result<Self> {
        let status = response.status();
        let bytes = response.into_body().collect().await.context("the answer broke off")?.to_bytes();
        let (is_success, shown) = (status.is_success(), status.to_string());
        Ok(Self { status: status.into(), shown, is_success, body: serde_json::from_slice(&bytes).unwrap_or_default() })
    }

    pub(super) fn read<T: DeserializeOwned>(self, path: &str) -> anyhow::Result<T> {
        let shown = self.body.to_string();
        serde_json::from_value(self.body).with_context(|| format!("{path} answered {shown}"))
    }

    /// Why it was refused, and what to do about it.
    pub(super) fn refusal(&self) -> Refusal {
        let problem: Problem = serde_json::from_value(self.body.clone()).unwrap_or_default();
        Refusal { told: problem.told(), code: problem.code }
    }
}

impl Problem {
    /// What and why in one line, and in a second one what helps.
    fn told(&self) -> String {
        let reasons = self.errors.iter().chain(&self.rejected).take(REASONS);
        let reasons: Vec<_> = reasons.map(|reason| format!("; {}: {}", reason.code, reason.detail)).collect();
        let remedy = Code::named(&self.code).map_or_else(String::new, |code| format!("\n{}", code.remedy()));
        format!("{}: {}{}{remedy}", self.title, self.detail, reasons.concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_is_told_with_its_first_reasons_and_what_helps() {
        let reason = |code: &str| Reason { code: code.to_owned(), detail: "d".to_owned() };
        let problem = Problem {
            code: "model_not_found".to_owned(),
            title: "Title".to_owned(),
            detail: "detail".to_owned(),
            errors: vec![reason("a")],
            rejected: vec![reason("b"), reason("c"), reason("e")],
        };
        let told = problem.told();
        assert_eq!(told.lines().next(), Some("Title: detail; a: d; b: d; c: d"));
        assert_eq!(told.lines().nth(1), Some(Code::ModelNotFound.remedy()));
        assert_eq!(Problem { code: "of a later server".to_owned(), ..problem }.told().lines().count(), 1);
    }
}
