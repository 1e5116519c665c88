use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use headway::store::verify::verify;
use serde_json::{Value, json};
use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Row, query};
use tempfile::TempDir;

use crate::lived::{Lived, WAITING, execute};
use crate::support::events::window;
use crate::support::server::Server;

static MIGRATIONS: Migrator = sqlx::migrate!("./migrations");

pub(crate) fn schemas() -> Vec<i64> {
    MIGRATIONS.iter().map(|migration| migration.version).collect()
}

/// A database whose rows can be compared with those of another one.
struct Beside {
    connection: SqliteConnection,
}

impl Beside {
    /// The database at `path`, made when it is not there, and `other` as `other`.
    async fn open(path: &Path, other: &Path) -> Self {
        let options = SqliteConnectOptions::new().filename(path).create_if_missing(true).foreign_keys(false);
        let mut connection = options.connect().await.unwrap();
        query("attach ? as other").bind(other.to_str().unwrap()).execute(&mut connection).await.unwrap();
        Self { connection }
    }

    /// Every table of both, with the columns that both have.
    async fn tables(&mut self) -> Vec<(String, String)> {
        let rows = query(
            "select t.name, group_concat('\"' || c.name || '\"') as columns
             from main.sqlite_schema t, pragma_table_info(t.name, 'main') c
             where t.type = 'table' and t.name not like 'sqlite_%' and t.name <> '_sqlx_migrations'
                 and c.name in (select name from pragma_table_info(t.name, 'other')) group by t.name",
        )
        .fetch_all(&mut self.connection)
        .await
        .unwrap();
        rows.iter().map(|row| (row.get("name"), row.get("columns"))).collect()
    }

    async fn execute(&mut self, statement: String) {
        query(AssertSqlSafe(statement)).execute(&mut self.connection).await.unwrap();
    }

    async fn count(&mut self, rows: &str) -> i64 {
        let statement = AssertSqlSafe(format!("select count(*) from ({rows})"));
        query(statement).fetch_one(&mut self.connection).await.unwrap().get(0)
    }
}

/// A database of an earlier schema, with the rows of `current`; its tables and their columns.
pub(crate) async fn as_of(schema: i64, current: &Path) -> (TempDir, Vec<(String, String)>) {
    let directory = tempfile::tempdir().unwrap();
    let mut old = Beside::open(&directory.path().join("headway.db"), current).await;
    let mut migrations = sqlx::migrate!("./migrations");
    let until = migrations.migrations.iter().filter(|migration| migration.version <= schema);
    migrations.migrations = until.cloned().collect::<Vec<_>>().into();
    migrations.run(&mut old.connection).await.unwrap();
    let tables = old.tables().await;
    for (table, columns) in &tables {
        // A migration may have put rows there.
        old.execute(format!("delete from main.{table}")).await;
        old.execute(format!("insert into main.{table} ({columns}) select {columns} from other.{table}")).await;
    }
    old.connection.close().await.unwrap();
    (directory, tables)
}

/// Tables of which rows differ, in these columns.
async fn differing(one: &Path, other: &Path, tables: &[(String, String)]) -> BTreeSet<String> {
    let mut both = Beside::open(one, other).await;
    let mut differing = BTreeSet::new();
    for (table, columns) in tables {
        for (here, there) in [("main", "other"), ("other", "main")] {
            let missing = format!("select {columns} from {here}.{table} except select {columns} from {there}.{table}");
            if both.count(&missing).await > 0 {
                differing.insert(table.clone());
            }
        }
    }
    both.connection.close().await.unwrap();
    differing
}

/// Tables in which nothing is.
async fn empty(database: &Path, tables: &[(String, String)]) -> BTreeSet<String> {
    let mut looked_at = Beside::open(database, database).await;
    let mut empty = BTreeSet::new();
    for (table, _) in tables {
        if looked_at.count(&format!("select * from main.{table}")).await == 0 {
            empty.insert(table.clone());
        }
    }
    looked_at.connection.close().await.unwrap();
    empty
}

/// Copies what is in a database, be it in its file or in the write-ahead log.
async fn copy(database: &Path, to: &Path) {
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    query("vacuum into ?").bind(to.to_str().unwrap()).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
}

/// What the live versions answer, and what the task that waits comes to.
async fn go_on(lived: Lived) -> (TempDir, Vec<Value>) {
    let server = lived.start("").await;
    let mut seen = Vec::new();
    for model in ["default", "joint"] {
        let windows = json!({"windows": [window(5, 9.0), window(5, 14.0)]});
        seen.push(server.post(&format!("/v1/models/{model}/predict"), &windows).await.expect(200).body);
        let mut evaluation = server.get(&format!("/v1/models/{model}/versions/2/evaluation")).await.expect(200).body;
        for task in evaluation["tasks"].as_array_mut().unwrap() {
            // The first schema knew nothing of it.
            task["served"].take();
        }
        seen.push(evaluation);
    }
    server.post("/v1/models/default/resume", &json!({})).await.expect(200);
    let ended = server.end_of("default", WAITING).await;
    assert_eq!(ended["state"], "succeeded", "{}", ended.text);
    let version = server.get("/v1/models/default/versions/3").await.expect(200);
    seen.push(version["weights_sha256"].clone());
    seen.push(server.get("/v1/models/default/versions/3/evaluation").await.expect(200).body);
    (server.stop().await, seen)
}

/// Backups beside the database.
fn backups(directory: &TempDir) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.to_str().unwrap().ends_with(".backup")).collect()
}

#[tokio::test]
async fn a_database_of_every_earlier_schema_keeps_its_rows_and_bits_and_goes_on_learning() {
    assert!(schemas().len() >= 4);
    for schema in schemas() {
        let current = Lived::until(schema).await;
        let (kept, key) = (current.directory.path().join("kept.db"), current.key.clone());
        copy(&current.database(), &kept).await;
        let (current, expected) = go_on(current).await;
        assert_eq!(backups(&current), [] as [PathBuf; 0], "nothing was migrated");
        let (directory, tables) = as_of(schema, &kept).await;
        let database = directory.path().join("headway.db");
        assert_eq!(empty(&database, &tables).await, BTreeSet::new(), "schema {schema}");
        let directory = Server::start_in(directory, "").await.stop().await;
        assert_eq!(differing(&database, &kept, &tables).await, BTreeSet::new(), "schema {schema}");
        let (directory, seen) = go_on(Lived { directory, key }).await;
        assert_eq!(seen, expected, "schema {schema}");
        let found = verify(&database, &|_| ()).await.unwrap();
        assert!(found.is_sound(), "schema {schema}: {:#?}", found.faults);
        let taken = backups(&directory);
        assert_eq!(taken.len(), usize::from(Some(&schema) != schemas().last()), "schema {schema}: {taken:?}");
        for backup in taken {
            assert!(backup.to_str().unwrap().contains(&format!("headway.db.schema-{schema}.")), "{backup:?}");
            let found = verify(&backup, &|_| ()).await.unwrap();
            assert!(found.is_sound() && found.schema == schema, "schema {schema}: {:#?}", found.faults);
            assert_eq!(differing(&backup, &kept, &tables).await, BTreeSet::new(), "schema {schema}");
        }
    }
}

/// What a server that does not start says.
fn refused(database: &Path) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    let output = command.args(["--listen", "127.0.0.1:0", "--database"]).arg(database).output().unwrap();
    assert!(!output.status.success());
    String::from_utf8(output.stderr).unwrap()
}

#[tokio::test]
async fn nothing_is_migrated_without_a_backup_unless_the_settings_say_so() {
    let current = Lived::until(1).await;
    let (old, _) = as_of(1, &current.database()).await;
    // So long a name that the backup's would be too long.
    let database = old.path().join("n".repeat(240));
    copy(&old.path().join("headway.db"), &database).await;
    let told = refused(&database);
    assert!(told.contains("cannot write"), "{told}");
    assert_eq!(verify(&database, &|_| ()).await.unwrap().schema, 1, "it is as it was");
    let settings = "[database]\nbackup_before_migration = false";
    let old = Server::start_in(old, settings).await.stop().await;
    assert_eq!(backups(&old), [] as [PathBuf; 0]);
    assert_eq!(verify(&old.path().join("headway.db"), &|_| ()).await.unwrap().schema, schemas().pop().unwrap());
}

#[tokio::test]
async fn a_database_of_a_newer_release_is_refused_by_name_of_both_schemas() {
    let newer = Lived::until(1).await;
    let database = newer.database();
    execute(&database, "insert into _sqlx_migrations values (9999, 'later', '2027-01-01', 1, x'00', 0)").await;
    let told = refused(&database);
    let newest = schemas().pop().unwrap().to_string();
    assert!(told.contains("9999") && told.contains(&newest), "{told}");
}
