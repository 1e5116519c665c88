//! A database in a temporary directory, filled by hand, for the tests of the store and of what stands on it.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::selection::{Selection, TaskRequest, create_tasks};
use super::{Store, StoreSettings};
use crate::car_following::Event;
use crate::consolidation::Method;
use crate::lineage::{ModelSettings, RegimeName};

/// The moment everything in a fixture happens at.
pub(crate) fn now() -> Timestamp {
    "2026-01-01T00:00:00Z".parse().unwrap()
}

/// Of a database in this directory.
pub(crate) fn settings(directory: &tempfile::TempDir) -> StoreSettings {
    StoreSettings {
        path: directory.path().join("headway.db"),
        readers: 2,
        busy_timeout_s: 5.0,
        writer_wait_s: 5.0,
        log_bytes: 1 << 26,
        log_wait_s: 0.2,
        statement_cache: 64,
        audit_entries: 1000,
        corrupt_versions: 1000,
        backup_before_migration: true,
    }
}

/// A store and the directory it lives in.
pub(crate) struct Fixture {
    pub(crate) store: std::sync::Arc<Store>,
    directory: tempfile::TempDir,
}

/// An event whose content is told by `mark`, at 10 Hz, 12 steps.
pub(crate) fn event(mark: u16) -> Event {
    let spacing = 20.0 + f32::from(mark) / 100.0;
    Event::new(0.1, vec![spacing; 12], vec![10.0; 12], vec![10.0; 12])
}

impl Fixture {
    pub(crate) async fn new() -> Self {
        Self::within(tempfile::tempdir().unwrap()).await
    }

    /// In a directory that may hold a database already.
    pub(crate) async fn within(directory: tempfile::TempDir) -> Self {
        let store = std::sync::Arc::new(Store::open(&settings(&directory)).await.unwrap());
        Self { store, directory }
    }

    /// With other settings than usual.
    pub(crate) async fn set(set: impl FnOnce(StoreSettings) -> StoreSettings) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let store = std::sync::Arc::new(Store::open(&set(settings(&directory))).await.unwrap());
        Self { store, directory }
    }

    /// The same database, opened anew.
    pub(crate) async fn reopened(self) -> Self {
        self.store.close().await;
        drop(self.store);
        let store = std::sync::Arc::new(Store::open(&settings(&self.directory)).await.unwrap());
        Self { store, directory: self.directory }
    }

    pub(crate) async fn model(&self, name: &str, method: Method, settings: &ModelSettings) -> i64 {
        let mut transaction = self.store.begin().await.unwrap();
        let row =
            query("insert into model (name, method, settings, created_at) values (?, ?, ?, ?) returning model_id")
                .bind(name)
                .bind(method.as_str())
                .bind(serde_json::to_string(settings).unwrap())
                .bind(now().to_string())
                .fetch_one(&mut *transaction)
                .await
                .unwrap();
        transaction.commit().await.unwrap();
        row.get("model_id")
    }

    /// A batch of pending events `marks` of a regime: of every ten, seven train, one validates and two test.
    pub(crate) async fn batch(&self, model_id: i64, regime: &str, marks: std::ops::Range<u16>) -> i64 {
        let mut transaction = self.store.begin().await.unwrap();
        let row = query(
            "insert into batch (model_id, content_type, body_sha256, body_bytes, accepted, duplicates, rejected, summary,
                 created_at) values (?, 'application/json', x'', 0, ?, 0, 0, '{}', ?) returning batch_id",
        )
        .bind(model_id)
        .bind(i64::from(marks.end - marks.start))
        .bind(now().to_string())
        .fetch_one(&mut *transaction)
        .await
        .unwrap();
        let batch_id: i64 = row.get("batch_id");
        for (ordinal, mark) in marks.enumerate() {
            let event = event(mark);
            let split = match ordinal % 10 {
                0..7 => "train",
                7 => "validation",
                _ => "test",
            };
            let row = query(
                "insert into event (model_id, content_sha256, batch_id, name, split, regime, state, dt_s, steps,
                     mean_speed_mps, arrived_at, arrays) values (?, ?, ?, ?, ?, ?, 'pending', ?, ?, ?, ?, ?)
                 on conflict (model_id, content_sha256) do update set name = name returning event_id",
            )
            .bind(model_id)
            .bind(&event.content_sha256()[..])
            .bind(batch_id)
            .bind(format!("e{mark}"))
            .bind(split)
            .bind(regime)
            .bind(event.dt_s())
            .bind(i64::try_from(event.steps()).unwrap())
            .bind(event.mean_speed_mps())
            .bind(format!("{:.6}", now()))
            .bind(event.to_bytes())
            .fetch_one(&mut *transaction)
            .await
            .unwrap();
            query("insert into batch_event (batch_id, ordinal, event_id, duplicate) values (?, ?, ?, 0)")
                .bind(batch_id)
                .bind(i64::try_from(ordinal).unwrap())
                .bind(row.get::<i64, _>("event_id"))
                .execute(&mut *transaction)
                .await
                .unwrap();
        }
        transaction.commit().await.unwrap();
        batch_id
    }

    /// Tasks of named batches.
    pub(crate) async fn tasks_of(&self, model_id: i64, batches: &[i64]) -> Vec<i64> {
        self.tasks_as(model_id, Selection::Batches { batches: batches.to_vec(), regime: None }).await
    }

    /// Tasks of everything that waits.
    pub(crate) async fn tasks_of_pending(&self, model_id: i64) -> Vec<i64> {
        self.tasks_as(model_id, Selection::Pending { regime: None }).await
    }

    pub(crate) async fn tasks_as(&self, model_id: i64, selection: Selection) -> Vec<i64> {
        let request = TaskRequest { selection, mean_speed_mps: None, settings: serde_json::Value::Null };
        let mut transaction = self.store.begin().await.unwrap();
        let tasks = create_tasks(&mut transaction, model_id, &request, now()).await.unwrap().unwrap();
        transaction.commit().await.unwrap();
        tasks
    }

    pub(crate) async fn set_paused(&self, model_id: i64, paused: bool) {
        let mut transaction = self.store.begin().await.unwrap();
        query("update model set paused = ? where model_id = ?")
            .bind(paused)
            .bind(model_id)
            .execute(&mut *transaction)
            .await
            .unwrap();
        transaction.commit().await.unwrap();
    }

    /// The whole queue as text: pointers, tasks, versions, and events by batch and state.
    pub(crate) async fn picture(&self, model_id: i64) -> String {
        let mut lines = Vec::new();
        for statement in PICTURE {
            let rows = query(statement).bind(model_id).fetch_all(&self.store.readers).await.unwrap();
            lines.extend(rows.iter().map(|row| row.get::<String, _>(0)));
        }
        lines.join("\n")
    }

    /// Rows in every table, for tests of what a task costs.
    pub(crate) async fn rows(&self) -> i64 {
        query(
            "select (select count(*) from task) + (select count(*) from version) + (select count(*) from weights)
             + (select count(*) from anchor) + (select count(*) from reservoir) + (select count(*) from version_regime)
             + (select count(*) from history) + (select count(*) from checkpoint) + (select count(*) from task_batch)
             + (select count(*) from task_event)",
        )
        .fetch_one(&self.store.readers)
        .await
        .unwrap()
        .get(0)
    }

    /// Any statement, for tests that break something.
    pub(crate) async fn execute(&self, statement: &'static str) {
        let mut transaction = self.store.begin().await.unwrap();
        query(statement).execute(&mut *transaction).await.unwrap();
        transaction.commit().await.unwrap();
    }
}

/// The regime of this name.
pub(crate) fn regime(name: &str) -> RegimeName {
    RegimeName::parse(name).unwrap()
}

const PICTURE: [&str; 4] = [
    "select format('live %s head %s', coalesce(live_version, '-'), coalesce(head_version, '-')) from model
     where model_id = ?",
    "select format('task %d %s %s stage %s parent %s version %s attempt %d%s', task_id, regime, state,
         coalesce(stage, '-'), coalesce(parent_version, '-'), coalesce(version, '-'), attempt,
         coalesce(' error ' || error_code, '')) from task where model_id = ? order by task_id",
    "select format('version %d parent %s stage %d %s', version, coalesce(parent, '-'), stage, regime) from version
     where model_id = ? order by version",
    "select format('batch %d %s', batch_id, group_concat(state || ' ' || n, ', ')) from
         (select batch_id, state, count(*) as n from event where model_id = ? group by batch_id, state order by 1, 2)
     group by batch_id order by batch_id",
];
