use std::fs;
use std::time::Instant;

use headway::car_following::TrafficRegime;
use reqwest::Method;
use serde_json::{Value, json};

use crate::SETTINGS;
use crate::plan::{Plan, Written, kill_at};
use crate::process::{Home, Process, Reply};
use crate::remains::Remains;
use crate::traffic::lines;
use crate::wire::{Answer, Wire};

const PATH: &str = "/v1/models/default/batches?regime=fast";

/// An upload: new events, and some that the one before it brought.
struct Upload {
    key: String,
    lines: Vec<String>,
    new: usize,
}

impl Upload {
    fn draw(number: u64, plan: &mut Plan, before: Option<&Upload>) -> Self {
        let mut lines = lines(TrafficRegime::ALL[plan.below(3)], number, 10 + plan.below(60));
        let new = lines.len();
        lines.extend(before.into_iter().flat_map(|before| before.lines[..5].iter().cloned()));
        Self { key: format!("upload-{number}"), lines, new }
    }

    /// Sends the first `count` lines.
    fn begin(&self, process: &Process, count: usize) -> Wire {
        let mut wire = Wire::upload(process, PATH, &self.key);
        self.lines[..count].iter().for_each(|line| wire.chunk(line.as_bytes()));
        wire
    }

    async fn send(&self, process: &Process) -> Reply {
        let request = process.request(Method::POST, PATH).header("idempotency-key", &self.key);
        process.send(request.header("content-type", "application/x-ndjson").body(self.lines.concat())).await
    }

    /// Panics unless this answer counts every event of it.
    fn check(&self, answer: &Reply) -> Value {
        let body = answer.expect(201);
        let counts = (&body["accepted"], &body["duplicates"], &body["rejected_count"]);
        assert_eq!(counts, (&json!(self.new), &json!(self.lines.len() - self.new), &json!(0)), "{}", answer.text);
        body["batch_id"].clone()
    }
}

/// What the deaths came upon.
#[derive(Debug, Default)]
struct Tally {
    half_sent: u32,
    not_stored: u32,
    stored_unanswered: u32,
    answered: u32,
}

#[tokio::test]
async fn an_upload_is_there_whole_and_once_or_not_at_all_whenever_the_process_dies() {
    const KILLS_OF_A_DATABASE: u32 = 50;
    let (mut plan, mut tally) = (Plan::new(1), Tally::default());
    let mut left = plan.kills;
    while left > 0 {
        let kills = left.min(KILLS_OF_A_DATABASE);
        kill_uploads(&mut plan, kills, &mut tally).await;
        left -= kills;
    }
    println!("{tally:?}");
}

async fn kill_uploads(plan: &mut Plan, kills: u32, tally: &mut Tally) {
    // An upload makes its task in its own transaction.
    let home = Home::new(&[&SETTINGS[..], &["model.schedule.min_events=1"]].concat());
    let mut process = home.start();
    process.post("/v1/models/default/pause", &json!({})).await.expect(200);
    let first = Upload::draw(0, plan, None);
    let wire = first.begin(&process, first.lines.len());
    let usual = first_answer(wire, &first);
    let mut uploads = vec![first];
    for kill in 1..=kills {
        let upload = Upload::draw(kill.into(), plan, uploads.last());
        let half = plan.below(3) == 0;
        let answered = if half {
            kill_half_sent(plan, &mut process, &upload);
            None
        } else {
            let (mut wire, unwritten) = (upload.begin(&process, upload.lines.len()), Written::now(&home.database()));
            wire.finish();
            kill_at(plan.moment(usual), &mut process, wire, &unwritten)
        };
        let stored = stored_uploads(&home).await.checked_sub(uploads.len());
        let stored = stored.expect("what was answered before this upload is there");
        *match (half, stored, &answered) {
            (true, 0, _) => &mut tally.half_sent,
            (false, 0, None) => &mut tally.not_stored,
            (false, 1, None) => &mut tally.stored_unanswered,
            (false, 1, Some(_)) => &mut tally.answered,
            wrong => panic!("half sent, stored, answered: {wrong:?}"),
        } += 1;
        process = home.start();
        repeat(&process, &upload, answered.as_ref()).await;
        uploads.push(upload);
        assert_eq!(stored_uploads(&home).await, uploads.len(), "an upload that was repeated is there twice");
    }
    check_all(&process, &uploads).await;
}

fn kill_half_sent(plan: &mut Plan, process: &mut Process, upload: &Upload) {
    let sent = 1 + plan.below(upload.lines.len() - 1);
    let wire = upload.begin(process, sent);
    process.kill();
    assert_eq!(wire.answer(), None, "half an upload was answered");
}

/// How long an answer takes that nothing disturbs.
fn first_answer(mut wire: Wire, upload: &Upload) -> std::time::Duration {
    let sent = Instant::now();
    wire.finish();
    upload.check(&wire.answer().unwrap());
    sent.elapsed()
}

/// How many uploads the database holds; panics when it holds parts of one, or a spooled body was left.
async fn stored_uploads(home: &Home) -> usize {
    let mut remains = Remains::of(home).await;
    remains.check().await;
    let stored = remains.count("batch").await;
    for table in ["idempotency", "task"] {
        assert_eq!(remains.count(table).await, stored, "{table}");
    }
    remains.close().await;
    assert_eq!(fs::read_dir(home.path().join("spool")).unwrap().count(), 0, "a spooled body was left");
    stored
}

/// A client that does not know what became of its upload sends it again; and again.
async fn repeat(process: &Process, upload: &Upload, answered: Option<&Answer>) {
    let again = upload.send(process).await;
    upload.check(&again);
    if let Some(answered) = answered {
        assert_eq!(again, *answered, "the answer is another one than before");
    }
    assert_eq!(upload.send(process).await, again);
}

/// Panics unless the server lists these uploads and no other, each with all its events and its task.
async fn check_all(process: &Process, uploads: &[Upload]) {
    let batches = process.list("/v1/models/default/batches", "batches").await;
    let tasks = process.list("/v1/models/default/tasks", "tasks").await;
    assert_eq!((batches.len(), tasks.len()), (uploads.len(), uploads.len()));
    for (upload, (batch, task)) in uploads.iter().zip(batches.iter().zip(&tasks)) {
        let id = upload.check(&upload.send(process).await);
        assert_eq!((&id, &task["batches"]), (&batch["batch_id"], &json!([id])));
        let read = process.get(&format!("/v1/models/default/batches/{}", id.as_str().unwrap())).await;
        assert_eq!(read["events"]["pending"], upload.lines.len(), "{read}");
    }
}
