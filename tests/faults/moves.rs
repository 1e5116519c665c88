use std::time::{Duration, Instant};

use headway::car_following::TrafficRegime;
use reqwest::Method;
use serde_json::{Value, json};

use crate::SETTINGS;
use crate::plan::{Plan, Written, kill_at};
use crate::process::{Home, Process};
use crate::remains::Remains;
use crate::traffic::lines;
use crate::wire::Wire;

pub(crate) const MODEL: &str = "/v1/models/default";

/// A server with three versions, the third live; paused, so that tasks wait.
pub(crate) async fn with_versions(home: &Home) -> Process {
    let process = home.start();
    for regime in TrafficRegime::ALL {
        let path = format!("{MODEL}/batches?regime={}", regime.as_str());
        let upload = process.request(Method::POST, &path).header("content-type", "application/x-ndjson");
        process.send(upload.body(lines(regime, 1, 24).concat())).await.expect(201);
    }
    process.post(&format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(process.end_of("t3").await["state"], "succeeded");
    process.post(&format!("{MODEL}/pause"), &json!({})).await.expect(200);
    process
}

/// What each version predicts, and at last what the live one does.
pub(crate) async fn predictions(process: &Process) -> (Vec<Value>, Value) {
    let window = json!({"follower_speed_mps": [9, 9, 9, 9, 9], "leader_speed_mps": [8, 8, 8, 8, 8],
        "spacing_m": [14, 13.9, 13.8, 13.7, 13.6]});
    let mut named = Vec::new();
    for version in 1..=3 {
        let ask = json!({"version": version, "windows": [window]});
        named.push(process.post(&format!("{MODEL}/predict"), &ask).await.expect(200));
    }
    (named, process.post(&format!("{MODEL}/predict"), &json!({"windows": [window]})).await.expect(200))
}

/// Where the model stands: live, head, and how often live moved.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stand {
    live: i64,
    head: i64,
    moves: usize,
}

impl Stand {
    /// Panics unless the model, its history and what it serves agree.
    async fn of(process: &Process, versions: &[Value]) -> Self {
        let model = process.get(MODEL).await;
        let (live, head) = (model["live"].as_i64().unwrap(), model["head"].as_i64().unwrap());
        let history = process.list(&format!("{MODEL}/history"), "history").await;
        let last = history.last().unwrap();
        assert_eq!((&last["live"], &last["head"]), (&json!(live), &json!(head)));
        let (named, served) = predictions(process).await;
        assert_eq!(named, versions, "a version predicts other bits than before");
        assert_eq!(served, versions[usize::try_from(live - 1).unwrap()]);
        Self { live, head, moves: history.len() }
    }
}

/// A promotion or a rollback, to be made once.
struct Move {
    path: &'static str,
    key: String,
    version: i64,
}

impl Move {
    fn draw(number: u32, plan: &mut Plan) -> Self {
        let path = ["/v1/models/default/promote", "/v1/models/default/rollback"][plan.below(2)];
        Self { path, key: format!("move-{number}"), version: [1, 2, 3][plan.below(3)] }
    }

    fn is_rollback(&self) -> bool {
        self.path.ends_with("rollback")
    }

    fn body(&self) -> Value {
        json!({"version": self.version, "reason": self.key})
    }

    fn after(&self, before: Stand) -> Stand {
        let head = if self.is_rollback() { self.version } else { before.head };
        Stand { live: self.version, head, moves: before.moves + 1 }
    }
}

/// How many tasks wait.
async fn waiting(process: &Process) -> usize {
    let tasks = process.list(&format!("{MODEL}/tasks"), "tasks").await;
    tasks.iter().filter(|task| task["state"] == "queued").count()
}

/// Asks for something to learn that the paused model leaves in line, when nothing waits.
async fn fill_line(process: &Process) {
    if waiting(process).await == 0 {
        process.post(&format!("{MODEL}/tasks"), &json!({"batches": ["b1"]})).await.expect(202);
    }
}

/// What the deaths came upon.
#[derive(Debug, Default)]
struct Tally {
    not_made: u32,
    made_unanswered: u32,
    answered: u32,
}

#[tokio::test]
async fn a_promotion_or_rollback_is_made_once_and_whole_or_not_at_all_whenever_the_process_dies() {
    let (mut plan, mut tally) = (Plan::new(4), Tally::default());
    let home = Home::new(&[&SETTINGS[..], &["model.schedule=manual", "model.epochs=1"]].concat());
    let mut process = with_versions(&home).await;
    let (versions, _) = predictions(&process).await;
    let mut stand = Stand::of(&process, &versions).await;
    let mut usual = Duration::from_millis(5);
    for kill in 1..=plan.kills {
        fill_line(&process).await;
        let wish = Move::draw(kill, &mut plan);
        let expected = wish.after(stand);
        let moment = plan.moment(usual);
        let unwritten = Written::now(&home.database());
        let wire = Wire::post(&process, wish.path, &wish.key, &wish.body());
        let answered = kill_at(moment, &mut process, wire, &unwritten);
        let mut remains = Remains::of(&home).await;
        remains.check().await;
        remains.close().await;
        process = home.start();
        let found = Stand::of(&process, &versions).await;
        *match &answered {
            None if found == stand => &mut tally.not_made,
            None if found == expected => &mut tally.made_unanswered,
            Some(_) if found == expected => &mut tally.answered,
            answered => panic!("{answered:?}, and {found:?} after {stand:?}: {moment:?}"),
        } += 1;
        let cancels = found == expected && wish.is_rollback();
        assert_eq!(waiting(&process).await, usize::from(!cancels), "a rollback cancels what waits, with it");
        // A client that does not know what became of its wish sends it again; and again.
        let sent = Instant::now();
        let again = process.post_with_key(wish.path, &wish.key, &wish.body()).await;
        usual = if found == stand { sent.elapsed() } else { usual };
        again.expect(200);
        assert!(answered.is_none_or(|answered| answered == again), "the answer is another one than before");
        assert_eq!(process.post_with_key(wish.path, &wish.key, &wish.body()).await, again);
        stand = Stand::of(&process, &versions).await;
        assert_eq!(stand, expected);
    }
    println!("{tally:?}");
}
