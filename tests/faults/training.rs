use headway::car_following::TrafficRegime;
use reqwest::Method;
use serde_json::{Value, json};

use crate::SETTINGS;
use crate::plan::Plan;
use crate::process::{Home, Process};
use crate::remains::Remains;
use crate::traffic::lines;

const EVENTS: usize = 36;
const EPOCHS: u64 = 20;
const MINIBATCH: u64 = 8;

/// What is disturbed.
#[derive(Clone, Copy)]
struct Case {
    /// Beside those of every test.
    settings: &'static [&'static str],
    /// The task whose process is the first to die.
    from: i64,
}

/// A server with two tasks in line, and further settings.
async fn with_tasks(checkpoint_s: &str, further: &[&str]) -> (Home, Process) {
    let (epochs, checkpoint) = (format!("model.epochs={EPOCHS}"), format!("training.checkpoint_s={checkpoint_s}"));
    let schedule = [&["model.schedule=manual", &epochs, &checkpoint], further].concat();
    let home = Home::new(&[&SETTINGS[..], &schedule].concat());
    let process = home.start();
    for regime in [TrafficRegime::Fast, TrafficRegime::Slow] {
        let path = format!("/v1/models/default/batches?regime={}", regime.as_str());
        let upload = process.request(Method::POST, &path).header("content-type", "application/x-ndjson");
        process.send(upload.body(lines(regime, 1, EVENTS).concat())).await.expect(201);
    }
    let asked = process.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(asked["task_ids"], json!(["t1", "t2"]));
    (home, process)
}

/// Everything that must come out the same, however often the process died.
async fn outcome(process: &Process) -> Vec<Value> {
    let mut outcome = Vec::new();
    for version in [1, 2] {
        let ended = process.end_of(&format!("t{version}")).await;
        assert_eq!((&ended["state"], &ended["version"]), (&json!("succeeded"), &json!(version)), "{ended}");
        let path = format!("/v1/models/default/versions/{version}");
        let mut made = process.get(&path).await;
        made["created_at"].take();
        outcome.extend([made, process.get(&format!("{path}/evaluation")).await]);
        let window = json!({"follower_speed_mps": [9, 9, 9, 9, 9], "leader_speed_mps": [8, 8, 8, 8, 8],
            "spacing_m": [14, 13.9, 13.8, 13.7, 13.6]});
        let ask = json!({"version": version, "windows": [window]});
        outcome.push(process.post("/v1/models/default/predict", &ask).await.expect(200));
    }
    let model = process.get("/v1/models/default").await;
    assert_eq!((&model["live"], &model["head"]), (&json!(2), &json!(2)));
    let history = process.list("/v1/models/default/history", "history").await;
    let moves: Vec<_> = history.iter().map(|entry| (&entry["from"], &entry["live"])).collect();
    assert_eq!(moves, [(&json!(null), &json!(1)), (&json!(1), &json!(2))]);
    outcome
}

/// What was last seen of a task that is under way.
struct Seen {
    task: i64,
    progress: f64,
    ended: bool,
}

/// Watches `task` until it runs and has done `share` of its updates, or has ended. It may never show less than `floor`.
async fn watch(process: &Process, task: i64, share: f64, floor: f64) -> Seen {
    loop {
        let shown = process.get(&format!("/v1/models/default/tasks/t{task}")).await;
        let (state, progress) = (shown["state"].as_str().unwrap(), shown["progress"].as_f64().unwrap());
        assert!(progress >= floor, "{progress} is less than the checkpoint's {floor}");
        let ended = !matches!(state, "queued" | "running");
        if ended || (state == "running" && progress >= share) {
            return Seen { task, progress, ended };
        }
    }
}

/// What the deaths came upon.
#[derive(Debug, Default)]
struct Tally {
    checkpointed: u32,
    not_yet_checkpointed: u32,
    ended_unseen: u32,
    between_tasks: u32,
}

/// Kills the process at up to `kills` moments of the two tasks, and compares what comes out.
async fn disturbed(
    plan: &mut Plan,
    checkpoint_s: &str,
    case: Case,
    kills: u32,
    expected: &[Value],
    tally: &mut Tally,
) -> u32 {
    let (home, mut process) = with_tasks(checkpoint_s, case.settings).await;
    for quiet in 1..case.from {
        process.end_of(&format!("t{quiet}")).await;
    }
    let (mut task, mut floor, mut killed) = (case.from, 0.0, 0);
    while task <= 2 && killed < kills {
        // The beginning, anywhere, the end.
        let share = [0.0, floor + (1.0 - floor) * plan.share(), 1.0][plan.below(3)];
        let seen = watch(&process, task, share, floor).await;
        process.kill();
        killed += 1;
        let mut remains = Remains::of(&home).await;
        remains.check().await;
        let (state, attempt) = remains.task(task).await;
        floor = remains.checkpointed(task).await;
        if checkpoint_s == "0.0" && state == "running" {
            check_redone(&seen, floor, expected);
        }
        remains.close().await;
        *match (state.as_str(), seen.ended) {
            ("running", false) if floor > 0.0 => &mut tally.checkpointed,
            ("running", false) => &mut tally.not_yet_checkpointed,
            ("succeeded", false) => &mut tally.ended_unseen,
            ("succeeded", true) => &mut tally.between_tasks,
            wrong => panic!("stored, and seen to have ended: {wrong:?}"),
        } += 1;
        process = home.start();
        if state == "running" {
            // It goes on by itself, under a new attempt.
            watch(&process, task, 0.0, floor).await;
            let resumed = process.get(&format!("/v1/models/default/tasks/t{task}")).await;
            assert_eq!(resumed["attempt"], attempt + 1, "{resumed}");
        } else {
            (task, floor) = (task + 1, 0.0);
        }
    }
    assert_eq!(outcome(&process).await, expected);
    killed
}

/// With a checkpoint after every update, no more than the one under way is done again.
fn check_redone(seen: &Seen, checkpointed: f64, expected: &[Value]) {
    let version = &expected[3 * usize::try_from(seen.task - 1).unwrap()];
    // A search learns the stage without a penalty, with five strengths, and once more.
    let stages = if version["strength_search"].is_null() { 1 } else { 7 };
    let updates = version["events"].as_u64().unwrap().div_ceil(MINIBATCH) * EPOCHS * stages;
    #[expect(clippy::cast_precision_loss, reason = "small")]
    let redone = (seen.progress - checkpointed) * updates as f64;
    assert!(redone < 1.5, "{redone} updates are done again");
}

async fn all_disturbed(mut plan: Plan, case: Case) {
    let (_home, process) = with_tasks("1000.0", case.settings).await;
    let expected = outcome(&process).await;
    drop(process);
    let (mut left, mut tally) = (plan.kills, Tally::default());
    for checkpoint_s in ["0.0", "0.02", "1000.0"].iter().cycle() {
        if left == 0 {
            break;
        }
        let kills = left.min(plan.kills.div_ceil(3)).min(6);
        left -= disturbed(&mut plan, checkpoint_s, case, kills, &expected, &mut tally).await;
    }
    println!("{tally:?}");
}

#[tokio::test]
async fn a_task_goes_on_from_its_checkpoint_and_ends_with_the_same_bits_however_often_the_process_dies() {
    all_disturbed(Plan::new(3), Case { settings: &[], from: 1 }).await;
}

#[tokio::test]
async fn a_search_for_a_strength_goes_on_and_finds_the_same_however_often_the_process_dies() {
    all_disturbed(Plan::new(5), Case { settings: &["model.strength=auto"], from: 2 }).await;
}
