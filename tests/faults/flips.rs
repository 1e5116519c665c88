use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use headway::car_following::TrafficRegime;
use headway::store::verify::verify;
use reqwest::Method;
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, query};

use crate::SETTINGS;
use crate::full::window;
use crate::plan::{Plan, variable};
use crate::process::{Home, Process, Reply};
use crate::traffic::lines;

const MODEL: &str = "/v1/models/default";
const DEFAULT_FLIPS: u64 = 24;

/// What a server that nobody damaged answers.
#[derive(Debug, Default)]
struct Known {
    /// What each version predicts, by its number.
    predicted: BTreeMap<i64, Value>,
    evaluated: BTreeMap<i64, Value>,
    /// The weights of the version that is learned last.
    learned: Value,
}

/// A database with two versions and a batch that waits, as a server left it that was killed.
async fn prepared(home: &Home) -> Known {
    let process = home.start();
    for (task, regime) in ["t1", "t2"].into_iter().zip(TrafficRegime::ALL) {
        upload(&process, regime).await;
        process.post(&format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
        assert_eq!(process.end_of(task).await["state"], "succeeded");
    }
    upload(&process, TrafficRegime::ALL[2]).await;
    let mut known = Known::default();
    for version in [1, 2] {
        known.predicted.insert(version, predict(&process, Some(version)).await.expect(200));
        known.evaluated.insert(version, evaluation(&process, version).await.expect(200));
    }
    known
}

async fn upload(process: &Process, regime: TrafficRegime) {
    let request = process.request(Method::POST, &format!("{MODEL}/batches?regime={}", regime.as_str()));
    let request = request.header("content-type", "application/x-ndjson").body(lines(regime, 1, 24).concat());
    process.send(request).await.expect(201);
}

/// Nothing takes for ever.
async fn ask(process: &Process, request: reqwest::RequestBuilder) -> Reply {
    tokio::time::timeout(Duration::from_mins(2), process.send(request)).await.expect("an answer")
}

async fn predict(process: &Process, version: Option<i64>) -> Reply {
    let body = json!({"version": version, "windows": [window()]});
    ask(process, process.request(Method::POST, &format!("{MODEL}/predict")).json(&body)).await
}

async fn evaluation(process: &Process, version: i64) -> Reply {
    ask(process, process.request(Method::GET, &format!("{MODEL}/versions/{version}/evaluation"))).await
}

/// Learns the batch that waits. The weights' digest; else why there are none.
async fn learn(process: &Process) -> Result<Value, String> {
    let wish = process.request(Method::POST, &format!("{MODEL}/tasks")).json(&json!({"batches": ["b3"]}));
    let created = ask(process, wish).await;
    if created.status != 202 {
        return Err(created.text);
    }
    let task = created.expect(202)["task_id"].as_str().unwrap().to_owned();
    let mut last = String::new();
    for _ in 0..6 {
        let read = ask(process, process.request(Method::GET, &format!("{MODEL}/tasks/{task}?wait_s=10"))).await;
        last.clone_from(&read.text);
        if read.status != 200 {
            break;
        }
        let task = read.expect(200);
        match task["state"].as_str().unwrap() {
            "queued" | "running" => {}
            "succeeded" => {
                let version = process.request(Method::GET, &format!("{MODEL}/versions/{}", task["version"]));
                let version = ask(process, version).await;
                let is_there = version.status == 200;
                return if is_there { Ok(version.expect(200)["weights_sha256"].clone()) } else { Err(version.text) };
            }
            _ => break,
        }
    }
    Err(last)
}

/// A copy of the database of another home.
fn copied(from: &Home, settings: &[&str]) -> Home {
    let home = Home::new(settings);
    fs::copy(from.database(), home.database()).unwrap();
    home
}

fn log_of(home: &Home) -> PathBuf {
    home.database().with_extension("db-wal")
}

/// What is done to a file.
#[derive(Debug, Clone, Copy)]
enum Damage {
    /// A bit of a byte.
    Flip { at: usize, bit: usize },
    /// Nothing is left from here on.
    Cut { at: usize },
}

impl Damage {
    fn draw(plan: &mut Plan, bytes: usize) -> Self {
        let at = plan.below(bytes);
        if plan.below(10) == 0 { Self::Cut { at } } else { Self::Flip { at, bit: plan.below(8) } }
    }

    fn happen(self, path: &Path) {
        match self {
            Self::Flip { at, bit } => {
                let file = File::options().read(true).write(true).open(path).unwrap();
                let mut byte = [0];
                file.read_exact_at(&mut byte, at as u64).unwrap();
                file.write_all_at(&[byte[0] ^ 1 << bit], at as u64).unwrap();
            }
            Self::Cut { at } => File::options().write(true).open(path).unwrap().set_len(at as u64).unwrap(),
        }
    }
}

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    /// A process that was to serve it said so, and ended.
    Refused,
    /// `headway verify` says so.
    Reported,
    /// Nothing that is served or learned is other than it was.
    Harmless,
    /// It happened while the server ran, which answered some of it with errors and wrote it anew before it was looked at.
    Healed,
}

async fn is_sound(database: &Path) -> bool {
    verify(database, &|_| ()).await.is_ok_and(|found| found.is_sound())
}

/// What a damaged server did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Done {
    /// Everything that was asked, and right.
    Right,
    /// Some of it, and that right.
    Less,
    /// It learned from fewer events: a row may be damaged so that it does not look like one that waits.
    LearnedOther,
}

impl Known {
    /// Panics where a prediction or an evaluation is neither an error nor right.
    async fn judge(&self, process: &Process) -> Done {
        let mut all = true;
        for (&version, expected) in &self.predicted {
            for reply in [predict(process, Some(version)).await, predict(process, None).await] {
                all &= reply.status == 200;
                if reply.status == 200 {
                    let reply = reply.expect(200);
                    let expected = if reply["version"] == version { expected } else { self.of(&reply) };
                    assert_eq!(reply, *expected);
                }
            }
            let reply = evaluation(process, version).await;
            all &= reply.status == 200;
            if reply.status == 200 {
                assert_eq!(reply.expect(200), self.evaluated[&version]);
            }
        }
        match learn(process).await {
            Ok(weights) if weights != self.learned => Done::LearnedOther,
            Ok(_) if all => Done::Right,
            _ => Done::Less,
        }
    }

    fn of(&self, reply: &Value) -> &Value {
        let version = reply["version"].as_i64().unwrap();
        self.predicted.get(&version).unwrap_or_else(|| panic!("no version {version} was learned"))
    }

    /// The database is damaged before the server starts.
    async fn before_a_start(&self, home: &Home, damage: Damage) -> Outcome {
        damage.happen(&home.database());
        let sound = is_sound(&home.database()).await;
        let Some(process) = home.start_or_refuse() else { return Outcome::Refused };
        let done = self.judge(&process).await;
        assert!(done == Done::Right || !sound, "nothing is reported: {done:?}: {}", home.log());
        if sound { Outcome::Harmless } else { Outcome::Reported }
    }

    /// The database is damaged under a server that runs.
    async fn under_a_server(&self, home: &Home, damage: Damage) -> Outcome {
        let mut process = home.start();
        damage.happen(&home.database());
        let done = self.judge(&process).await;
        process.kill();
        match (is_sound(&home.database()).await, done) {
            (false, _) => Outcome::Reported,
            (true, Done::Right) => Outcome::Harmless,
            (true, Done::Less) => Outcome::Healed,
            (true, Done::LearnedOther) => panic!("nothing is reported, and something else was learned"),
        }
    }
}

#[tokio::test]
async fn whatever_bit_of_a_database_is_flipped_no_wrong_answer_is_given() {
    let settings = [&SETTINGS[..], &["model.schedule=manual", "model.epochs=1"]].concat();
    let origin = Home::new(&settings);
    let mut known = prepared(&origin).await;
    fold(&origin).await;
    known.learned = learn(&copied(&origin, &settings).start()).await.unwrap();
    let (mut plan, mut outcomes) = (Plan::new(9), BTreeMap::new());
    let flips = variable("HEADWAY_FLIPS").unwrap_or(DEFAULT_FLIPS);
    let bytes = usize::try_from(fs::metadata(origin.database()).unwrap().len()).unwrap();
    for flip in 0..flips {
        let (home, damage) = (copied(&origin, &settings), Damage::draw(&mut plan, bytes));
        println!("{flip}: {damage:?}");
        let outcome = if flip % 3 == 2 {
            known.under_a_server(&home, damage).await
        } else {
            known.before_a_start(&home, damage).await
        };
        assert!(!home.log().contains("panicked"), "{}", home.log());
        *outcomes.entry((flip % 3 == 2, outcome)).or_insert(0) += 1;
    }
    println!("HEADWAY_FLIPS={flips}, under a server or not: {outcomes:?}");
    assert!(outcomes.keys().any(|(_, outcome)| matches!(outcome, Outcome::Refused | Outcome::Reported)));
}

#[tokio::test]
async fn a_log_with_a_flipped_bit_is_refused_or_lost_the_last_two_changes_at_most() {
    let settings = [&SETTINGS[..], &["model.schedule=manual", "model.epochs=1"]].concat();
    let origin = Home::new(&settings);
    let known = prepared(&origin).await;
    let bytes = usize::try_from(fs::metadata(log_of(&origin)).unwrap().len()).unwrap();
    let (mut plan, mut refused) = (Plan::new(10), 0);
    let flips = variable("HEADWAY_FLIPS").unwrap_or(DEFAULT_FLIPS).div_ceil(3);
    for _ in 0..flips {
        let home = copied(&origin, &settings);
        fs::copy(log_of(&origin), log_of(&home)).unwrap();
        // How the frames are to be read stands in the first bytes.
        let damage = Damage::Flip { at: 12 + plan.below(bytes - 12), bit: plan.below(8) };
        damage.happen(&log_of(&home));
        let sound = is_sound(&home.database()).await;
        let Some(process) = home.start_or_refuse() else {
            assert!(!sound && home.log().contains("acknowledged changes"), "{}", home.log());
            refused += 1;
            continue;
        };
        let batches = process.list(&format!("{MODEL}/batches"), "batches").await.len();
        assert!(batches >= 2, "{damage:?} lost an upload that was not among the last changes");
        let reply = predict(&process, Some(1)).await.expect(200);
        assert_eq!(reply, known.predicted[&1], "{damage:?}");
    }
    println!("of {flips} flips in a log {refused} were refused");
    assert!(refused > 0);
}

/// One file holds everything from then on.
async fn fold(home: &Home) {
    let mut connection = SqliteConnectOptions::new().filename(home.database()).connect().await.unwrap();
    query("pragma wal_checkpoint(truncate)").fetch_all(&mut connection).await.unwrap();
    connection.close().await.unwrap();
}
