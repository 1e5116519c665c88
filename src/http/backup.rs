//! `/v1/backup`: copies of the database, in a folder that the settings name.

use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use serde_json::{Value, json};
use tokio::runtime::Handle;

use super::AppState;
use super::answer::Answer;
use super::idempotency::Repeatable;
use super::problem::{Code, Problem};
use crate::scheduler::step_back;
use crate::store::backup::{Backup, note};
use crate::store::{Actor, StoreError};

fn body(backup: &Backup) -> Value {
    json!({"name": backup.name, "bytes": backup.bytes, "created_at": backup.created_at.to_string()})
}

/// `GET /v1/backup`
pub(super) async fn list(State(app): State<Arc<AppState>>) -> Result<Answer, Problem> {
    let backups = app.backup.list()?;
    let listed: Vec<_> = backups.iter().map(body).collect();
    Ok(Answer::ok(&json!({"backups": listed, "next_page_token": null})))
}

/// `POST /v1/backup`. Nothing of the request but its key tells it from another.
pub(super) async fn create(
    State(app): State<Arc<AppState>>,
    by: Actor,
    request: Repeatable,
) -> Result<Answer, Problem> {
    const SAME: [u8; 32] = [0; 32];
    if let Some(answer) = request.recall(SAME).await? {
        return Ok(answer);
    }
    if !app.backup.is_on() {
        return Err(Code::NoBackupFolder.because("the server's settings name no folder for backups, backup.folder"));
    }
    let busy = |_| Problem::busy(Code::Busy, "a backup is being taken");
    let _slot = app.backup_slot.try_acquire().map_err(busy)?;
    let backup = take(&app).await?;
    let answer = Answer::json(StatusCode::CREATED, &body(&backup));
    let noting = async {
        let mut tx = app.store.begin_for(&by).await?;
        note(&mut tx, &backup).await?;
        request.keep(&mut tx, SAME, &answer).await?;
        tx.commit().await
    };
    if let Err(error) = noting.await {
        // A copy that nobody can be said to have taken is none.
        app.backup.discard(&backup)?;
        return Err(error.into());
    }
    app.backup.trim()?;
    tracing::info!(name = backup.name, bytes = backup.bytes, "a backup was taken");
    Ok(answer)
}

/// Takes one, on a thread that steps back.
async fn take(app: &Arc<AppState>) -> Result<Backup, Problem> {
    let (niceness, taker) = (app.scheduler.niceness(), Arc::clone(app));
    let taking = tokio::task::spawn_blocking(move || {
        step_back(niceness);
        Handle::current().block_on(taker.backup.take(&taker.store))
    });
    match taking.await.map_err(Problem::internal)? {
        Err(StoreError::Unsound(found)) => {
            for fault in found.faults.iter().take(10) {
                tracing::error!(check = fault.check, place = fault.place, detail = fault.detail, "not backed up");
            }
            Err(Code::Corrupt
                .because(format!("a backup would hold {} faults; `headway verify` lists them", found.faults_in_all())))
        }
        taken => Ok(taken?),
    }
}
