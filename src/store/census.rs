//! How many there are of what, for the metrics.

use sqlx::{Row, query};

use super::column::count;
use super::{Store, StoreError};

/// A model and its queue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelCensus {
    /// Its row id.
    pub model_id: i64,
    /// Its name.
    pub name: String,
    /// The version that serves.
    pub live: Option<i64>,
    /// Whether it learned what was retracted later.
    pub live_tainted: bool,
    /// Sources that are held.
    pub held_sources: u64,
    /// Tasks that wait.
    pub queued: u64,
    /// Tasks that run.
    pub running: u64,
}

impl Store {
    /// Every model with its live version and the length of its queue.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn model_census(&self) -> Result<Vec<ModelCensus>, StoreError> {
        let rows = query(
            "select m.model_id, m.name, m.live_version,
                    exists (select 1 from taint x where x.model_id = m.model_id and x.version = m.live_version) as live_tainted,
                    (select count(*) from source s where s.model_id = m.model_id and s.held_at is not null) as held_sources,
                    (select count(*) from task t where t.model_id = m.model_id and t.state in ('queued', 'running')
                         and t.state = 'queued') as queued,
                    (select count(*) from task t where t.model_id = m.model_id and t.state in ('queued', 'running')
                         and t.state = 'running') as running
             from model m order by m.model_id",
        )
        .fetch_all(&self.readers)
        .await?;
        rows.iter()
            .map(|row| {
                Ok(ModelCensus {
                    model_id: row.try_get("model_id")?,
                    name: row.try_get("name")?,
                    live: row.try_get("live_version")?,
                    live_tainted: row.try_get("live_tainted")?,
                    held_sources: count(row, "held_sources")?,
                    queued: count(row, "queued")?,
                    running: count(row, "running")?,
                })
            })
            .collect()
    }

    /// Row ids of tasks and their models: those that wait or run, and all that are newer than task `after`.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn unended_tasks(&self, after: i64) -> Result<Vec<(i64, i64)>, StoreError> {
        let rows = query(
            "select task_id, model_id from task indexed by task_active where state in ('queued', 'running')
             union select task_id, model_id from task where task_id > ? order by task_id",
        )
        .bind(after)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("task_id")?, row.try_get("model_id")?))).collect()
    }

    /// The greatest id a task has; 0 without tasks.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn last_task(&self) -> Result<i64, StoreError> {
        let row = query("select coalesce(max(task_id), 0) as last from task").fetch_one(&self.readers).await?;
        Ok(row.try_get("last")?)
    }
}
