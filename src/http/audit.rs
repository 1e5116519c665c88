//! `/v1/audit`: who changed what, and when.

use std::sync::Arc;

use axum::extract::State;
use serde::Deserialize;
use serde_json::{Value, json};

use super::answer::Answer;
use super::path::find_model;
use super::problem::Problem;
use super::query::{Page, Query};
use super::{AppState, ServerSettings};
use crate::store::audit::AuditEntry;

/// The query of the log.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    model: Option<String>,
    page_size: Option<u32>,
    page_token: Option<String>,
}

impl Wanted {
    /// The page that is wanted.
    pub(super) fn page(&self, settings: &ServerSettings) -> Result<Page, Problem> {
        Page::new(self.page_size, self.page_token.as_deref(), settings)
    }
}

fn body(entry: &AuditEntry) -> Value {
    json!({
        "audit_id": format!("a{}", entry.audit_id),
        "at": entry.at.to_string(),
        "actor": entry.actor,
        "action": entry.action,
        "model": entry.model,
        "resource": entry.resource,
        "request_id": entry.request_id,
        "detail": entry.detail,
    })
}

/// `GET /v1/audit`
pub(super) async fn list(State(app): State<Arc<AppState>>, Query(wanted): Query<Wanted>) -> Result<Answer, Problem> {
    let page = wanted.page(&app.settings)?;
    let model_id = match wanted.model {
        Some(name) => Some(find_model(&app, &name).await?.model_id),
        None => None,
    };
    let entries = app.store.audit(model_id, page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("audit", entries, |entry| entry.audit_id, body)))
}
