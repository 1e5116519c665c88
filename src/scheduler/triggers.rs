//! Schedules by age: regimes whose oldest event has waited long enough. Those by count fire within the upload.

use jiff::Timestamp;

use crate::store::{Store, StoreError, model, selection};

/// Makes the tasks that are due, of every model. The write lock is taken only when there is one.
///
/// # Errors
/// When the database cannot be read or written.
pub(super) async fn create_due(store: &Store, now: Timestamp) -> Result<Vec<i64>, StoreError> {
    let mut due = Vec::new();
    for model_id in store.models_waiting().await? {
        let schedule = store.model_by_id(model_id).await?.settings.schedule;
        if store.is_any_due(model_id, schedule, now).await? {
            due.push(model_id);
        }
    }
    let mut tasks = Vec::new();
    for model_id in due {
        let mut transaction = store.begin().await?;
        let schedule = model::get(&mut transaction, model_id).await?.settings.schedule;
        tasks.extend(selection::create_due(&mut transaction, model_id, schedule, now).await?);
        transaction.commit().await?;
    }
    Ok(tasks)
}
