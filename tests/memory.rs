//! How much memory the real binary takes: `VmHWM`, the most it ever had resident.
//!
//! Small by default. As large as promised, and with the default network:
//! `HEADWAY_MEMORY_EVENTS=20000 HEADWAY_MEMORY_BODY_BYTES=1100000000 cargo test --release --test memory -- --nocapture --test-threads 1`.
//! `HEADWAY_MEMORY_STEPS` sets the length of the events to train on, `HEADWAY_MEMORY_THREADS` the threads.

#![allow(clippy::unwrap_used, reason = "what a test expects, said in the shortest way")]
#![allow(clippy::print_stdout, reason = "a test tells its seed and what it measured")]

#[allow(dead_code, reason = "each test binary uses a part")]
#[path = "support/process.rs"]
mod process;

use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::Arc;
use std::time::Duration;

use flate2::Compression;
use flate2::write::GzEncoder;
use parquet::basic::ZstdLevel;
use parquet::column::writer::ColumnWriter;
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use process::{Home, Process};
use reqwest::{Body, Method};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

const STEPS: u64 = 150;
const BATCHES: &str = "/v1/models/default/batches?regime=fast";
const MIB: u64 = 1 << 20;

fn variable(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number")))
}

/// The most memory the process had resident so far, bytes; none where the system does not say.
fn peak(process: &Process) -> Option<u64> {
    if !cfg!(target_os = "linux") {
        println!("left out: only Linux has /proc/PID/status, which says how much memory a process had");
        return None;
    }
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.pid())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    Some(line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() * 1024)
}

/// One event as a line, with the digits and blanks of Python's `json.dumps`; other numbers give other events.
fn line(number: u64, steps: u64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "small")]
    let phase = number as f64 * 0.7;
    #[expect(clippy::cast_precision_loss, reason = "small")]
    let wave = |step: u64, phase: f64| 14.0 + (0.1 * step as f64 + phase).sin();
    let leader: Vec<f64> = (0..steps).map(|step| wave(step, phase)).collect();
    let follower: Vec<f64> = (0..steps).map(|step| wave(step, phase - 0.6)).collect();
    let mut spacing = vec![20.0 + phase % 3.0];
    for (leader, follower) in leader.windows(2).zip(follower.windows(2)) {
        let closing = f64::midpoint(leader[0], leader[1]) - f64::midpoint(follower[0], follower[1]);
        spacing.push(spacing[spacing.len() - 1] + 0.1 * closing);
    }
    let mut line = format!("{{\"event_id\": \"made-up-{number}\", \"dt_s\": 0.1");
    for (name, values) in [("spacing_m", spacing), ("follower_speed_mps", follower), ("leader_speed_mps", leader)] {
        let digits: Vec<_> = values.iter().map(f64::to_string).collect();
        write!(line, ", \"{name}\": [{}]", digits.join(", ")).unwrap();
    }
    line + "}\n"
}

/// Some lines at a time, so that the client holds nothing either.
fn parts(first: u64, events: u64, steps: u64) -> impl Iterator<Item = Vec<u8>> {
    const AT_ONCE: u64 = 50;
    (first..first + events).step_by(50).map(move |from| {
        (from..(from + AT_ONCE).min(first + events)).map(|number| line(number, steps)).collect::<String>().into_bytes()
    })
}

/// A gzip body may have several members.
fn gzip(part: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(part).unwrap();
    encoder.finish().unwrap()
}

async fn upload(process: &Process, encoding: &str, parts: impl Iterator<Item = Vec<u8>> + Send + 'static) -> Value {
    let body = Body::wrap_stream(futures_util::stream::iter(parts.map(Ok::<_, std::io::Error>)));
    let request = process.request(Method::POST, BATCHES).header("content-type", "application/x-ndjson");
    process.send(request.header("content-encoding", encoding).body(body)).await.expect(201)
}

#[tokio::test]
async fn uploading_events_and_training_on_them_does_not_hold_them_several_times_over() {
    let promised = variable("HEADWAY_MEMORY_EVENTS");
    let events = promised.unwrap_or(8000);
    let small = ["model.hidden=6", "model.horizon=5"];
    let network = if promised.is_some() { &[][..] } else { &small };
    let settings = ["model.schedule=manual", "model.epochs=1", "log.filter=warn"];
    let (steps, threads) =
        (variable("HEADWAY_MEMORY_STEPS").unwrap_or(STEPS), variable("HEADWAY_MEMORY_THREADS").unwrap_or(1));
    let threaded = format!("training.training_threads={threads}");
    let home = Home::new(&[&settings[..], &[&threaded], network].concat());
    let process = home.start();
    let Some(idle) = peak(&process) else { return };
    let half = events / 2;
    let mut accepted = upload(&process, "identity", parts(0, half, steps)).await["accepted"].as_u64().unwrap();
    let plain = peak(&process).unwrap();
    accepted += upload(&process, "gzip", parts(half, events - half, steps).map(|part| gzip(&part))).await["accepted"]
        .as_u64()
        .unwrap();
    assert_eq!(accepted, events);
    let uploaded = peak(&process).unwrap();
    process.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let ended = process.end_of("t1").await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    let trained = peak(&process).unwrap();
    println!(
        "{events} events of {steps} steps, {threads} threads: {} MiB idle, {} after the first half as plain NDJSON, {} after the second \
         with gzip, {} after training",
        idle / MIB,
        plain / MIB,
        uploaded / MIB,
        trained / MIB
    );
    // Three times what is stored, and what does not grow with it: caches, and the network's states on each thread.
    let stored = events * steps * 12;
    let fixed = if promised.is_some() { 64 + 200 * threads } else { 24 };
    assert!(trained - idle < 3 * stored + fixed * MIB, "{stored} bytes of events are held several times over");
    assert!(trained < 1024 * MIB);
}

#[tokio::test]
async fn a_long_upload_takes_no_more_memory_than_a_short_one() {
    let promised = variable("HEADWAY_MEMORY_BODY_BYTES");
    let bytes = promised.unwrap_or(64 * MIB);
    let small = ["ingest.buffer_bytes=2097152"];
    let buffer = if promised.is_some() { &[][..] } else { &small };
    let home = Home::new(&[&["model.schedule=manual", "log.filter=warn"][..], buffer].concat());
    let process = home.start();
    let Some(idle) = peak(&process) else { return };
    let events = bytes.div_ceil(line(1000, STEPS).len() as u64);
    let began = std::time::Instant::now();
    let answer = upload(&process, "identity", parts(0, events, STEPS)).await;
    assert_eq!(answer["accepted"], events, "{}", answer["rejected"][0]);
    let batch = process.get("/v1/models/default/batches/b1").await;
    let uploaded = peak(&process).unwrap();
    println!(
        "{} bytes in {:.1} s: {} MiB idle, {} after",
        batch["body_bytes"],
        began.elapsed().as_secs_f64(),
        idle / MIB,
        uploaded / MIB
    );
    let limit = if promised.is_some() { 128 * MIB } else { bytes / 3 };
    assert!(uploaded - idle < limit, "a body of {bytes} bytes is held");
}

#[tokio::test]
async fn a_small_body_that_grows_does_not_take_memory_as_it_grows() {
    let home = Home::new(&["model.schedule=manual", "log.filter=warn", "ingest.limits.max_page_bytes=1000000"]);
    let process = home.start();
    let Some(idle) = peak(&process) else { return };
    let send = async |kind: &str, encoding: &str, body: Vec<u8>| {
        let request = process.request(Method::POST, &format!("{BATCHES}&dt_s=0.1")).header("content-type", kind);
        let reply = process.send(request.header("content-encoding", encoding).body(body)).await;
        (reply.status, peak(&process).unwrap() - idle)
    };
    // Events of one row with ids of a megabyte, which are not kept, but were to tell whether one comes again.
    let mut ids = zstd::Encoder::new(Vec::new(), 3).unwrap();
    ids.write_all(b"event_id,spacing_m,follower_speed_mps,leader_speed_mps\n").unwrap();
    for number in 0..200 {
        ids.write_all(format!("{number}{},9,1,1\n", "x".repeat(1_000_000)).as_bytes()).unwrap();
    }
    let (status, grown) = send("text/csv", "zstd", ids.finish().unwrap()).await;
    println!("200 MB of ids: {} MiB", grown / MIB);
    assert_eq!(status, 422);
    assert!(grown < 24 * MIB, "{} MiB for 200 MB of ids", grown / MIB);
    let body = one_page_a_column(2_000_000);
    let told = format!("{} bytes of Parquet with pages of 16 MB", body.len());
    let (status, grown) = send("application/vnd.apache.parquet", "identity", body).await;
    println!("{told}: {} MiB", grown / MIB);
    assert_eq!(status, 413);
    assert!(grown < 24 * MIB, "{} MiB for {told}", grown / MIB);
    process.get("/readyz").await;
}

#[tokio::test]
async fn a_connection_takes_no_more_memory_than_its_head_may_be_long() {
    const CONNECTIONS: u64 = 300;
    const HEAD_BYTES: u64 = 65_536;
    const PATIENCE: Duration = Duration::from_mins(1);
    let home = Home::new(&["model.schedule=manual", "log.filter=warn", &format!("server.head_bytes={HEAD_BYTES}")]);
    let process = home.start();
    let Some(idle) = peak(&process) else { return };
    let mut open = Vec::new();
    for _ in 0..CONNECTIONS {
        let mut stream = TcpStream::connect(process.url.trim_start_matches("http://")).await.unwrap();
        stream.write_all(format!("GET /healthz HTTP/1.1\r\nx: {}", "y".repeat(60_000)).as_bytes()).await.unwrap();
        open.push(stream);
    }
    let nearly = peak(&process).unwrap() - idle;
    for stream in &mut open {
        let more = "y".repeat(240_000);
        // A server that has heard enough hangs up, and may tear up what it said on who is still sending.
        let _ = timeout(PATIENCE, stream.write_all(more.as_bytes())).await.expect("it is read or refused");
        let mut said = String::new();
        let read = timeout(PATIENCE, stream.read_to_string(&mut said)).await.expect("the server hangs up");
        assert!(said.starts_with("HTTP/1.1 431 ") || read.is_err(), "{said}");
    }
    let most = peak(&process).unwrap() - idle;
    println!(
        "{CONNECTIONS} heads of 60,000 bytes: {} KiB each, at most {} KiB",
        nearly / CONNECTIONS / 1024,
        most / CONNECTIONS / 1024
    );
    assert!(most < CONNECTIONS * 2 * HEAD_BYTES + 4 * MIB, "{} KiB for each connection", most / CONNECTIONS / 1024);
}

/// A Parquet file of so many zeros in each column, in one page.
fn one_page_a_column(rows: usize) -> Vec<u8> {
    let schema = "message rows { required int64 event_id; required double spacing_m; \
                  required double follower_speed_mps; required double leader_speed_mps; }";
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let properties = WriterProperties::builder()
        .set_compression(parquet::basic::Compression::ZSTD(ZstdLevel::default()))
        .set_dictionary_enabled(false)
        .set_data_page_size_limit(usize::MAX)
        .set_data_page_row_count_limit(usize::MAX)
        .build();
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties)).unwrap();
    let mut group = writer.next_row_group().unwrap();
    while let Some(mut column) = group.next_column().unwrap() {
        if let ColumnWriter::Int64ColumnWriter(ids) = column.untyped() {
            ids.write_batch(&vec![0; rows], None, None).unwrap();
        } else {
            column.typed::<DoubleType>().write_batch(&vec![0.0; rows], None, None).unwrap();
        }
        column.close().unwrap();
    }
    group.close().unwrap();
    writer.close().unwrap();
    bytes
}
