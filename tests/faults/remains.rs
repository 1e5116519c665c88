use std::fs;

use headway::store::verify::verify;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Row, SqliteConnection, query};
use tempfile::TempDir;

use crate::process::Home;

/// A copy of the database as a dead process left it, so that looking at it mends nothing.
pub(crate) struct Remains {
    connection: SqliteConnection,
    copy: TempDir,
}

/// What may never be and `headway verify` does not know, because here it is known what was done: each query finds nothing.
const NEVER: [(&str, &str); 6] = [
    (
        "an event that a version learned and that waits",
        "select * from version v join task_event te using (task_id)
        join event e using (event_id) where e.state = 'pending'",
    ),
    ("a pruned version with weights", "select * from pruned join weights using (model_id, version)"),
    (
        "a version without an evaluation on test events",
        "select * from version v where task_id is not null and not exists
        (select 1 from version_regime r where r.model_id = v.model_id and r.version = v.version
         and r.regime = v.regime and r.learned_version = v.version and r.test_events > 0)",
    ),
    (
        "a version that no task made and no file brought, or that is not whole",
        "select * from version v where task_id is null and (promotion ->> 'reason' not like 'imported: %' or not exists
        (select 1 from version_regime r join weights using (model_id, version) where r.model_id = v.model_id
         and r.version = v.version and r.regime = v.regime and r.learned_version = v.version))",
    ),
    (
        "a model that learned and has neither head nor live",
        "select * from model m where exists (select 1 from version v where v.model_id = m.model_id)
        and (live_version is null or head_version is null and not exists (select 1 from replay))",
    ),
    (
        "content of a batch that is erased",
        "select * from batch b join batch_event be using (batch_id) join event e using (event_id)
        where b.erased_at is not null and e.state = 'retracted' and (length(e.arrays) > 0 or e.name <> '')",
    ),
];

impl Remains {
    pub(crate) async fn of(home: &Home) -> Self {
        let copy = tempfile::tempdir().unwrap();
        for name in ["headway.db", "headway.db-wal"] {
            if home.path().join(name).exists() {
                fs::copy(home.path().join(name), copy.path().join(name)).unwrap();
            }
        }
        let options = SqliteConnectOptions::new().filename(copy.path().join("headway.db"));
        Self { connection: options.connect().await.unwrap(), copy }
    }

    /// Panics with what is wrong.
    pub(crate) async fn check(&mut self) {
        for (what, statement) in NEVER {
            let found = query(statement).fetch_all(&mut self.connection).await.unwrap();
            assert!(found.is_empty(), "{what}, {} times", found.len());
        }
        let found = verify(&self.copy.path().join("headway.db"), &|_| ()).await.unwrap();
        assert!(found.is_sound(), "{:?}", found.faults);
    }

    pub(crate) async fn count(&mut self, table: &str) -> usize {
        let statement = AssertSqlSafe(format!("select count(*) from {table}"));
        let row = query(statement).fetch_one(&mut self.connection).await.unwrap();
        usize::try_from(row.get::<i64, _>(0)).unwrap()
    }

    /// The share done at the checkpoint of this task; 0 where there is none.
    pub(crate) async fn checkpointed(&mut self, task_id: i64) -> f64 {
        let row = query("select share from checkpoint where task_id = ?").bind(task_id);
        let row = row.fetch_optional(&mut self.connection).await.unwrap();
        row.map_or(0.0, |row| row.get(0))
    }

    /// State and attempt of this task.
    pub(crate) async fn task(&mut self, task_id: i64) -> (String, i64) {
        let row = query("select state, attempt from task where task_id = ?").bind(task_id);
        let row = row.fetch_one(&mut self.connection).await.unwrap();
        (row.get(0), row.get(1))
    }

    pub(crate) async fn close(self) {
        self.connection.close().await.unwrap();
    }
}
