//! Where a running task goes on after its process died.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::column::{digest, sha256, stored_time};
use super::{Part, Purpose, Store, StoreError};

impl Store {
    /// Replaces the task's checkpoint, if the task is still running. A task that gets on is not what ends its process:
    /// crashes are counted anew from here.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn save_checkpoint(
        &self,
        task_id: i64,
        share: f64,
        state: &[u8],
        now: Timestamp,
    ) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        transaction.is_for(Purpose::TaskCheckpointed);
        query(
            "insert or replace into checkpoint (task_id, saved_at, share, state, state_sha256)
             select task_id, ?, ?, ?, ? from task where task_id = ? and state = 'running'",
        )
        .bind(stored_time(now))
        .bind(share)
        .bind(state)
        .bind(&sha256(&[state])[..])
        .bind(task_id)
        .execute(&mut *transaction)
        .await?;
        query("update task set crashes = 0 where task_id = ? and state = 'running' and crashes > 0")
            .bind(task_id)
            .execute(&mut *transaction)
            .await?;
        transaction.commit().await
    }

    /// The task's checkpoint, if it has one.
    ///
    /// # Errors
    /// When the database cannot be read, or what it holds is not what was saved.
    pub async fn checkpoint(&self, task_id: i64) -> Result<Option<Vec<u8>>, StoreError> {
        let row = query("select state, state_sha256 from checkpoint where task_id = ?")
            .bind(task_id)
            .fetch_optional(&self.readers)
            .await?;
        let Some(row) = row else { return Ok(None) };
        let state: Vec<u8> = row.try_get("state")?;
        if sha256(&[&state]) != digest(&row, "state_sha256")? {
            let detail = format!("the checkpoint of task t{task_id} is corrupt: its digest does not match");
            return Err(StoreError::corrupt(Part::Checkpoint, detail));
        }
        Ok(Some(state))
    }
}
