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

/// What may never be: each query finds nothing.
const NEVER: [(&str, &str); 18] = [
    ("a broken reference", "select * from pragma_foreign_key_check"),
    ("a damaged page", "select * from pragma_integrity_check where integrity_check <> 'ok'"),
    (
        "a batch without all its events",
        "select * from batch b where accepted + duplicates <>
        (select count(*) from batch_event be where be.batch_id = b.batch_id)",
    ),
    (
        "a batch without all its rejections",
        "select * from batch b where rejected <>
        (select count(*) from rejection r where r.batch_id = b.batch_id)",
    ),
    (
        "an event that its batch does not hold",
        "select * from event e where not exists
        (select 1 from batch_event be where be.event_id = e.event_id and be.batch_id = e.batch_id)",
    ),
    (
        "an event claimed by no task under way",
        "select * from event e where e.state = 'claimed' and not exists
        (select 1 from task_event te join task t using (task_id) where te.event_id = e.event_id
         and t.state in ('queued', 'running'))",
    ),
    (
        "an event of a task under way that is not claimed",
        "select * from task t join task_event te using (task_id)
        join event e using (event_id) where t.state in ('queued', 'running') and e.state <> 'claimed'",
    ),
    (
        "an event that a version learned and that waits",
        "select * from version v join task_event te using (task_id)
        join event e using (event_id) where e.state = 'pending'",
    ),
    (
        "a checkpoint of a task that ended",
        "select * from checkpoint join task t using (task_id)
        where t.state not in ('queued', 'running')",
    ),
    (
        "two running tasks of a model",
        "select model_id from task where state = 'running'
        group by model_id having count(*) > 1",
    ),
    (
        "a version without its weights",
        "select * from version v where not exists
        (select 1 from weights w where w.model_id = v.model_id and w.version = v.version) and not exists
        (select 1 from pruned p where p.model_id = v.model_id and p.version = v.version)",
    ),
    ("a pruned version with weights", "select * from pruned join weights using (model_id, version)"),
    (
        "a version without its evaluation",
        "select * from version v where not exists
        (select 1 from version_regime r where r.model_id = v.model_id and r.version = v.version
         and r.regime = v.regime and r.learned_version = v.version and r.test_events > 0)",
    ),
    (
        "a version whose task did not end with it",
        "select * from version v left join task t using (task_id)
        where t.state is not 'succeeded' or t.version is not v.version",
    ),
    (
        "a task that succeeded without a version",
        "select * from task t where state = 'succeeded' and kind = 'learn' and not exists
        (select 1 from version v where v.task_id = t.task_id and v.version = t.version)",
    ),
    (
        "a pointer that history does not know",
        "select * from model m where exists (select 1 from version v
        where v.model_id = m.model_id) and (live_version is not
        (select live from history h where h.model_id = m.model_id order by history_id desc limit 1)
        or not exists (select 1 from version v where v.model_id = m.model_id and v.version = m.live_version)
        or m.head_version is null and not exists (select 1 from replay) or m.head_version is not null
        and not exists (select 1 from version v where v.model_id = m.model_id and v.version = m.head_version))",
    ),
    (
        "content of a batch that is erased",
        "select * from batch b join batch_event be using (batch_id) join event e using (event_id)
        where b.erased_at is not null and e.state = 'retracted' and (length(e.arrays) > 0 or e.name <> '')",
    ),
    (
        "a gap in the history",
        "select * from (select from_live, lag(live) over
        (partition by model_id order by history_id) as before from history) where from_live is not before",
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
