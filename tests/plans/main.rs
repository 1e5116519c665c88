//! No statement of the store reads a table that grows, whole or into a sort, where it does not have to.
//!
//! One server is led through everything that it does, and the statements that its database is given are listened to. First,
//! every piece of SQL in `src/store` must be among them: a new statement that nobody leads the server to fails here. Then
//! `SQLite` tells how it would answer each of them, and what reads or sorts more than it looks up is in a list, with the
//! reason why it may.

#![expect(clippy::unwrap_used, reason = "what a test expects, said in the shortest way")]

/// What the server is led through.
mod life;
/// Statements that the database is given.
mod listener;
#[allow(dead_code, reason = "the words of the code are not looked at here")]
#[path = "../shape/source.rs"]
mod source;
#[path = "../support/mod.rs"]
mod support;

use std::collections::BTreeSet;
use std::path::Path;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Row, query};

/// Tables that grow with the history. Models do not, and checkpoints are those of running tasks.
const GROWING: [&str; 20] = [
    "event",
    "batch",
    "batch_event",
    "rejection",
    "task",
    "task_batch",
    "task_event",
    "version",
    "weights",
    "version_note",
    "anchor",
    "reservoir",
    "version_regime",
    "history",
    "replay",
    "source",
    "pruned",
    "taint",
    "idempotency",
    "audit",
];

const A_TASK: &str = "sorts the events of one task";
const A_BATCH: &str = "sorts the events of the batches that were named";
const WAITING: &str = "sorts regimes that wait";
const A_LINE: &str = "sorts the events of a line, of which the method learns or samples";
const A_RESERVOIR: &str = "sorts a test reservoir, which is bounded, and a task's test events";
const TO_ERASE: &str = "reads batches whose content is to go";
const QUEUED: &str = "reads the queue: of tasks that wait or run";
const A_COPY: &str = "numbers the rows of one copy, or joins them to their old ids";
const UNSEALED: &str = "reads rows that are not sealed yet: those of one transaction";

/// A part of a statement, the beginning of a line of its plan, and why it may be there.
const ALLOWED: &[(&str, &str, &str)] = &[
    ("insert into task_batch", "USE TEMP B-TREE", A_TASK),
    ("insert or ignore into task_batch", "USE TEMP B-TREE", A_TASK),
    ("from task_event te join event e using (event_id) where te.task_id = ?", "USE TEMP B-TREE", A_TASK),
    ("insert into task_event (task_id, event_id) select distinct", "USE TEMP B-TREE", A_BATCH),
    ("(select distinct event_id from batch_event where batch_id = ?)", "USE TEMP B-TREE", A_BATCH),
    ("from json_each(?) named", "USE TEMP B-TREE", A_BATCH),
    ("from event where event_id in ( select value from json_each(?)", "U", A_RESERVOIR),
    ("from event where event_id in (select value from json_each(?))", "USE TEMP B-TREE", A_RESERVOIR),
    ("with recursive line", "USE TEMP B-TREE", A_LINE),
    ("with recursive line", "UNION USING TEMP B-TREE", A_LINE),
    ("with recursive waiting", "USE TEMP B-TREE", WAITING),
    ("select regime, min(event_id) as first from event", "USE TEMP B-TREE", WAITING),
    ("where t.state in ('queued', 'running') and m.paused = 0", "SCAN t USING INDEX task_active", QUEUED),
    ("where t.state in ('queued', 'running') and m.paused = 0", "USE TEMP B-TREE", QUEUED),
    ("from batch where erase_asked_at is not null", "SCAN batch USING INDEX batch_to_erase", TO_ERASE),
    ("from task indexed by task_active", "SCAN task USING INDEX task_active", QUEUED),
    ("from task indexed by task_active", "USE TEMP B-TREE", QUEUED),
    ("update task set state = 'queued'", "SCAN task USING INDEX task_active", QUEUED),
    ("insert into chosen_", "USE TEMP B-TREE", A_COPY),
    ("insert into chosen_batch", "UNION USING TEMP B-TREE", A_COPY),
    ("cross join chosen_event e on e.old = i.value", "USE TEMP B-TREE", A_RESERVOIR),
    ("from version indexed by version_unsealed", "SCAN version USING INDEX version_unsealed", UNSEALED),
    (
        "from version_regime indexed by version_regime_unsealed",
        "SCAN version_regime USING INDEX version_regime_unsealed",
        UNSEALED,
    ),
    ("from reservoir indexed by reservoir_unsealed", "SCAN reservoir USING INDEX reservoir_unsealed", UNSEALED),
];

/// With single blanks, as it is compared.
fn plain(sql: &str) -> String {
    sql.replace("\\\n", " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Every piece of SQL that the store's code holds, with its place.
fn written() -> Vec<(String, String)> {
    written_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src/store"))
}

fn written_in(folder: &Path) -> Vec<(String, String)> {
    const WORDS: [&str; 8] = ["select", "insert", "delete", "update", "where", "from", "returning", "values"];
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // `verify` reads whole tables, and so does who looks at a file that somebody sent: that is what it is for, and no server
        // does it to a database that it serves.
        if path.is_dir() && path.ends_with("copy") {
            found.extend(written_in(&path));
        }
        if path.is_dir() || path.ends_with("schema.rs") || path.ends_with("backup.rs") || path.ends_with("examine.rs") {
            continue;
        }
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name == "fixture.rs" || name == "error.rs" || name.ends_with("_tests.rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        for (line, literal) in source::Source::scan(code).strings {
            let literal = plain(&literal);
            let words: Vec<_> = literal.split(' ').collect();
            // Prose has such words too, but does not begin with one and has no signs.
            let sql = WORDS.contains(&words[0]) || words.contains(&"=") || words.contains(&"?");
            if sql && words.iter().any(|word| WORDS.contains(word)) {
                found.push((format!("{name}:{line}"), literal));
            }
        }
    }
    found
}

async fn plan(connection: &mut SqliteConnection, statement: &str) -> Vec<String> {
    let rows = query(AssertSqlSafe(format!("explain query plan {statement}"))).fetch_all(connection).await.unwrap();
    rows.iter().map(|row| row.get("detail")).collect()
}

/// Whether a step of a plan reads all of a table that grows, or sorts what it has read.
fn reads_much(statement: &str, step: &str) -> bool {
    if step.contains("TEMP B-TREE") || step.contains("AUTOMATIC") {
        return true;
    }
    let Some(scanned) = step.strip_prefix("SCAN ").and_then(|rest| rest.split(' ').next()) else { return false };
    let words: Vec<_> = statement.split([' ', '(', ')', ',']).filter(|word| !word.is_empty()).collect();
    let named = |name: &str| {
        words.windows(3).any(|it| it[0] == name && (it[1] == scanned || it[1] == "as" && it[2] == scanned))
    };
    // Children of a new parent are planned for, to find those that waited for it; none can, so they are never read.
    let is_foreign_key = statement.starts_with("insert into") && !words.contains(&scanned);
    GROWING.iter().any(|table| *table == scanned || named(table)) && !is_foreign_key
}

#[tokio::test]
async fn statements_look_up_what_they_read() {
    listener::start();
    let directory = life::lead().await;
    let heard: BTreeSet<String> = listener::heard().iter().map(|statement| plain(statement)).collect();
    let unheard: Vec<_> = written().into_iter().filter(|(_, sql)| !heard.iter().any(|one| one.contains(sql))).collect();
    assert!(unheard.is_empty(), "lead the server to these too: {unheard:#?}");
    let options = SqliteConnectOptions::new().filename(directory.path().join("headway.db"));
    let mut connection = options.connect().await.unwrap();
    // What the connection that writes has beside the tables, and what a copy within one database sees.
    let copied = include_str!("../../src/store/copy/origin.sql").replace("ORIGIN", "main");
    for beside in [include_str!("../../src/store/audit.sql"), &copied] {
        sqlx::raw_sql(AssertSqlSafe(beside.to_owned())).execute(&mut connection).await.unwrap();
    }
    let (mut wrong, mut used) = (BTreeSet::new(), BTreeSet::new());
    for statement in &heard {
        for step in plan(&mut connection, statement).await.into_iter().filter(|step| reads_much(statement, step)) {
            let allowed = |(part, begin, _): &(&str, &str, &str)| statement.contains(part) && step.starts_with(begin);
            match ALLOWED.iter().position(allowed) {
                Some(entry) => drop(used.insert(entry)),
                None => drop(wrong.insert(format!("{step}: {statement}"))),
            }
        }
    }
    assert!(wrong.is_empty(), "these read more than they look up: {wrong:#?}");
    let idle: Vec<_> = (0..ALLOWED.len()).filter(|entry| !used.contains(entry)).map(|entry| ALLOWED[entry]).collect();
    assert!(idle.is_empty(), "these need not be allowed: {idle:#?}");
}
