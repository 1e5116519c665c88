//! `/v1/backup`: copies of the database, in a folder that the settings name.

use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use serde_json::{Value, json};
use tokio::runtime::Handle;

use super::AppState;
use super::answer::Answer;
use super::problem::{Code, Problem};
use crate::scheduler::step_back;
use crate::store::StoreError;
use crate::store::backup::Backup;

fn body(backup: &Backup) -> Value {
    json!({"name": backup.name, "bytes": backup.bytes, "created_at": backup.created_at.to_string()})
}

/// `GET /v1/backup`
pub(super) async fn list(State(app): State<Arc<AppState>>) -> Result<Answer, Problem> {
    let backups = app.backup.list()?;
    let listed: Vec<_> = backups.iter().map(body).collect();
    Ok(Answer::ok(&json!({"backups": listed, "next_page_token": null})))
}

/// `POST /v1/backup`
pub(super) async fn create(State(app): State<Arc<AppState>>) -> Result<Answer, Problem> {
    if !app.backup.is_on() {
        return Err(Code::NoBackupFolder.because("the server's settings name no folder for backups, backup.folder"));
    }
    let busy = |_| Problem::busy(Code::Busy, "a backup is being taken");
    let slot = Arc::clone(&app.backup_slot).try_acquire_owned().map_err(busy)?;
    let niceness = app.scheduler.niceness();
    let taking = tokio::task::spawn_blocking(move || {
        let _slot = slot;
        step_back(niceness);
        Handle::current().block_on(app.backup.take(&app.store))
    });
    let taken = taking.await.map_err(Problem::internal)?;
    match taken {
        Ok(backup) => {
            tracing::info!(name = backup.name, bytes = backup.bytes, "a backup was taken");
            Ok(Answer::json(StatusCode::CREATED, &body(&backup)))
        }
        Err(StoreError::Unsound(found)) => {
            for fault in found.faults.iter().take(10) {
                tracing::error!(check = fault.check, place = fault.place, detail = fault.detail, "not backed up");
            }
            Err(Code::Corrupt
                .because(format!("a backup would hold {} faults; `headway verify` lists them", found.faults_in_all())))
        }
        Err(error) => Err(error.into()),
    }
}
