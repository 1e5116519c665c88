use headway::car_following::TrafficRegime;
use reqwest::Method;
use serde_json::{Value, json};

use crate::SETTINGS;
use crate::plan::{Plan, Written};
use crate::process::{Home, Process};
use crate::remains::Remains;
use crate::traffic::lines;

const MODEL: &str = "/v1/models/default";

/// What was retracted, in the order of upload.
const RETRACTED: TrafficRegime = TrafficRegime::ALL[0];

/// A server that has learned these regimes, one version each.
async fn with_versions(checkpoint_s: &str, regimes: &[TrafficRegime]) -> (Home, Process) {
    let checkpoint = format!("training.checkpoint_s={checkpoint_s}");
    let further = ["model.schedule=manual", "model.epochs=12", &checkpoint];
    let home = Home::new(&[&SETTINGS[..], &further].concat());
    let process = home.start();
    for regime in regimes {
        let path = format!("{MODEL}/batches?regime={}", regime.as_str());
        let upload = process.request(Method::POST, &path).header("content-type", "application/x-ndjson");
        process.send(upload.body(lines(*regime, 1, 36).concat())).await.expect(201);
    }
    process.post(&format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
    for task in 1..=regimes.len() {
        assert_eq!(process.end_of(&format!("t{task}")).await["state"], "succeeded");
    }
    (home, process)
}

/// What must come out the same: weights, anchors as far as they are shown, and how the head drives.
async fn outcome(process: &Process, versions: &[i64]) -> Vec<Value> {
    let mut outcome = Vec::new();
    for version in versions {
        let path = format!("{MODEL}/versions/{version}");
        let made = process.get(&path).await;
        let shown =
            ["stage", "regime", "weights_sha256", "events", "events_sha256", "scaling", "importance", "tainted"];
        outcome.extend(shown.iter().map(|member| made[member].clone()));
        outcome.push(process.get(&format!("{path}/evaluation")).await["measures"].clone());
    }
    outcome
}

/// What the deaths came upon.
#[derive(Debug, Default)]
struct Tally {
    not_retracted: u32,
    retracted: u32,
    in_a_part: u32,
    between: u32,
    ended: u32,
}

/// Kills the process while it retracts, and up to `kills` times while it replays.
async fn disturbed(plan: &mut Plan, checkpoint_s: &str, kills: u32, expected: &[Value], tally: &mut Tally) -> u32 {
    let (home, mut process) = with_versions(checkpoint_s, &TrafficRegime::ALL).await;
    let retract = |process: &Process| process.request(Method::DELETE, &format!("{MODEL}/batches/b1?erase=true")).send();
    // Whether it is answered does not matter: it is asked again.
    let unwritten = Written::now(&home.database());
    let asked = tokio::spawn(retract(&process));
    let moment = plan.below(3);
    while !asked.is_finished() && (moment == 2 || moment == 1 && Written::now(&home.database()) == unwritten) {
        tokio::task::yield_now().await;
    }
    process.kill();
    let _ = asked.await.unwrap();
    let mut killed = 1;
    let mut remains = Remains::of(&home).await;
    remains.check().await;
    *if remains.count("replay").await == 0 { &mut tally.not_retracted } else { &mut tally.retracted } += 1;
    remains.close().await;
    process = home.start();
    let answer = retract(&process).await.unwrap();
    assert!([200, 202].contains(&answer.status().as_u16()));
    let path = format!("{MODEL}/tasks/t4");
    let mut floor = 0.0;
    while killed < kills {
        let target = floor + (1.0 - floor) * plan.share();
        let shown = loop {
            let shown = process.get(&path).await;
            let progress = shown["progress"].as_f64().unwrap();
            if progress >= target || shown["state"] == "succeeded" {
                break shown;
            }
        };
        process.kill();
        killed += 1;
        let mut remains = Remains::of(&home).await;
        remains.check().await;
        let mut running = false;
        for part in [5, 6] {
            running |= remains.task(part).await.0 == "running";
        }
        let (state, _) = remains.task(4).await;
        remains.close().await;
        process = home.start();
        if state == "succeeded" {
            tally.ended += 1;
            break;
        }
        *if running { &mut tally.in_a_part } else { &mut tally.between } += 1;
        floor = shown["progress"].as_f64().unwrap();
    }
    let ended = process.end_of("t4").await;
    assert_eq!(
        (&ended["state"], &ended["kind"], &ended["version"]),
        (&json!("succeeded"), &json!("replay"), &json!(5))
    );
    let model = process.get(MODEL).await;
    assert_eq!((&model["live"], &model["head"]), (&json!(5), &json!(5)));
    assert_eq!(outcome(&process, &[4, 5]).await, expected);
    while process.get(&format!("{MODEL}/batches/b1")).await["erased_at"].is_null() {}
    process.kill();
    let mut remains = Remains::of(&home).await;
    remains.check().await;
    remains.close().await;
    killed
}

#[tokio::test]
async fn a_replay_goes_on_where_it_was_and_ends_with_the_bits_of_a_model_that_never_saw_the_batch() {
    let left: Vec<_> = TrafficRegime::ALL.into_iter().filter(|regime| *regime != RETRACTED).collect();
    let (_home, process) = with_versions("1000.0", &left).await;
    let expected = outcome(&process, &[1, 2]).await;
    drop(process);
    let (mut plan, mut tally) = (Plan::new(6), Tally::default());
    let mut left = plan.kills;
    for checkpoint_s in ["0.0", "0.02", "1000.0"].iter().cycle() {
        if left == 0 {
            break;
        }
        left -= disturbed(&mut plan, checkpoint_s, left.min(6), &expected, &mut tally).await;
    }
    println!("{tally:?}");
}
