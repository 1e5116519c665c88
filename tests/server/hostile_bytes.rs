//! Honest uploads with bytes changed, dropped and put in at random. `HEADWAY_MUTATIONS` chooses how many of each kind,
//! `HEADWAY_MUTATION_SEED` which.

#![allow(clippy::print_stdout, reason = "a test tells its seed and what it found")]

use std::sync::Arc;
use std::time::Duration;

use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reqwest::Method;
use serde_json::json;
use tokio::time::timeout;

use crate::hostile::{CSV, JSON, LINES, PARQUET, still_well};
use crate::support::events::{event, events, window};
use crate::support::server::Server;
use crate::uploads::{follownet_csv, gzip, ndjson, parquet as parquet_file};

/// What answers at all answers far sooner.
const LONG: Duration = Duration::from_mins(1);

fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// `bytes` with one to four faults.
fn mutated(bytes: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..random.random_range(1..=4) {
        let at = random.random_range(0..bytes.len());
        let length = random.random_range(1..=8.min(bytes.len() - at));
        match random.random_range(0..6) {
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = random.random(),
            2 => drop(bytes.drain(at..at + length)),
            3 => bytes.insert(at, random.random()),
            4 => {
                let again = bytes[at..at + length].to_vec();
                bytes.splice(at..at, again);
            }
            // Numbers and lengths are at the end of Parquet files, and their greatest value is in many a byte.
            _ => {
                let at = bytes.len() - 1 - random.random_range(0..bytes.len().min(600));
                bytes[at] = *[0, 0x7f, 0x80, 0xff].get(random.random_range(0..4)).unwrap();
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

#[tokio::test]
async fn whatever_is_changed_in_a_body_it_is_taken_or_refused() {
    let (count, seed) = (variable("HEADWAY_MUTATIONS", 300), variable("HEADWAY_MUTATION_SEED", 1));
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 12.0)).await;
    let honest = events("m", 3, 11.0);
    let bodies = [
        ("batches", JSON, "identity", json!({"events": honest}).to_string().into_bytes()),
        ("batches", LINES, "identity", ndjson(&honest)),
        ("batches", LINES, "gzip", gzip(&ndjson(&honest))),
        ("batches", LINES, "zstd", zstd::encode_all(&ndjson(&honest)[..], 3).unwrap()),
        ("batches?preset=follownet", CSV, "identity", follownet_csv(&honest)),
        ("batches?dt_s=0.1", PARQUET, "identity", parquet_file(&honest)),
        ("predict", JSON, "identity", json!({"windows": [window(5, 11.0), window(5, 9.0)]}).to_string().into_bytes()),
        ("tasks", JSON, "identity", json!({"batches": ["b99"], "regime": "fast"}).to_string().into_bytes()),
    ];
    for (path, kind, encoding, body) in &bodies {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut refused = 0;
        for number in 0..count {
            let request = server.request(Method::POST, &format!("/v1/models/default/{path}"));
            let request = request.header("content-type", *kind).header("content-encoding", *encoding);
            let answering = server.send(request.body(mutated(body, &mut random)));
            let answer = timeout(LONG, answering)
                .await
                .unwrap_or_else(|_| panic!("{path} {kind} {encoding}: seed {seed}, mutation {number}"));
            let expected = (200..300).contains(&answer.status) || (400..500).contains(&answer.status);
            assert!(expected, "{path} {kind} {encoding}, seed {seed}, mutation {number}: {}", answer.text);
            refused += u64::from(answer.status >= 400);
        }
        println!("{path} {kind} {encoding}: {refused} of {count} refused, seed {seed}");
        assert!(refused > 0);
    }
    server.get("/readyz").await.expect(200);
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn a_parquet_file_that_is_cut_or_whose_footer_lies_is_refused() {
    let server = Server::start().await;
    let whole = parquet_file(&events("p", 3, 11.0));
    let send = async |body: Vec<u8>| crate::uploads::send(&server, "?dt_s=0.1", PARQUET, None, body).await;
    for cut in (0..whole.len()).step_by(whole.len() / 100) {
        let answer = send(whole[..cut].to_vec()).await;
        assert!((400..500).contains(&answer.status), "{}", answer.text);
        let answer = send([&whole[..cut], &whole[whole.len() - 8..]].concat()).await;
        assert!((400..500).contains(&answer.status), "{}", answer.text);
    }
    for length in [0, 1, 100, whole.len() as u32 + 1, i32::MAX as u32, i32::MAX as u32 + 1, u32::MAX] {
        let mut lying = whole.clone();
        let at = lying.len() - 8;
        lying[at..at + 4].copy_from_slice(&length.to_le_bytes());
        let answer = send(lying).await;
        assert!((400..500).contains(&answer.status), "{length}: {}", answer.text);
    }
    send(whole).await.expect(201);
    server.stop().await;
}

/// Rows of one event under these columns' types, all numbers of which are 1 but for `odd` in the midst of spacing.
fn typed_rows(number: &str, rows: usize, odd: f64) -> Vec<u8> {
    let schema = format!(
        "message rows {{ required int32 event_id; required {number} spacing_m; \
         required {number} follower_speed_mps; required {number} leader_speed_mps; }}"
    );
    let schema = Arc::new(parse_message_type(&schema).unwrap());
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, Arc::default()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let (mut values, mut at) = (vec![1.0; rows], 0);
    while let Some(mut column) = group.next_column().unwrap() {
        // Spacing is the second column.
        at += 1;
        values[rows / 2] = if at == 2 { odd } else { 1.0 };
        match column.untyped() {
            ColumnWriter::Int32ColumnWriter(ids) => ids.write_batch(&vec![7; rows], None, None).unwrap(),
            ColumnWriter::FloatColumnWriter(column) => {
                let narrow: Vec<f32> = values.iter().map(|&value| value as f32).collect();
                column.write_batch(&narrow, None, None).unwrap()
            }
            ColumnWriter::DoubleColumnWriter(column) => column.write_batch(&values, None, None).unwrap(),
            ColumnWriter::ByteArrayColumnWriter(texts) => {
                texts.write_batch(&vec![ByteArray::from("1"); rows], None, None).unwrap()
            }
            _ => unreachable!("no other types are asked for"),
        };
        column.close().unwrap();
    }
    group.close().unwrap();
    writer.close().unwrap();
    bytes
}

#[tokio::test]
async fn parquet_columns_of_numbers_that_are_none_of_text_or_without_end_are_refused() {
    let server = Server::start().await;
    let send = async |body: Vec<u8>| {
        let answer = timeout(LONG, crate::uploads::send(&server, "?dt_s=0.1", PARQUET, None, body)).await;
        answer.expect("an answer")
    };
    send(typed_rows("float", 40, 1.0)).await.expect(201);
    for number in ["float", "double"] {
        for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e30] {
            let answer = send(typed_rows(number, 40, odd)).await.expect_problem(422, "no_event_accepted");
            assert_eq!(answer["rejected_count"], 1, "{number} {odd}");
        }
    }
    send(typed_rows("binary", 40, 1.0)).await.expect_problem(422, "invalid_body");
    let answer = send(typed_rows("double", 1_000_000, 1.0)).await.expect_problem(422, "no_event_accepted");
    assert_eq!(answer["rejected"][0]["code"], "too_many_steps");
    still_well(&server, "after").await;
    server.stop().await;
}

/// As Thrift's compact protocol writes it.
fn varint(number: u64) -> Vec<u8> {
    let (mut left, mut bytes) = (2 * number, Vec::new());
    while left >= 0x80 {
        bytes.push((left & 0x7f) as u8 | 0x80);
        left >>= 7;
    }
    bytes.push(left as u8);
    bytes
}

/// A file of `rows` rows whose footer says it has `said`.
fn lying_rows(rows: u64, said: u64) -> Vec<u8> {
    let whole = typed_rows("double", usize::try_from(rows).unwrap(), 1.0);
    let end = whole.len() - 8;
    let begin = end - u32::from_le_bytes(*whole[end..].first_chunk().unwrap()) as usize;
    let (mut rest, mut footer, old) = (&whole[begin..end], Vec::new(), varint(rows));
    let mut found = 0;
    while let Some((&byte, after)) = rest.split_first() {
        if let Some(after) = rest.strip_prefix(&old[..]) {
            footer.extend(varint(said));
            (rest, found) = (after, found + 1);
        } else {
            footer.push(byte);
            rest = after;
        }
    }
    // Of the file, of its one row group, and values of four columns.
    assert!(found >= 6, "{found}");
    let length = u32::try_from(footer.len()).unwrap().to_le_bytes();
    [&whole[..begin], &footer, &length, b"PAR1"].concat()
}

#[tokio::test]
async fn row_groups_that_claim_billions_of_rows_are_refused() {
    let server = Server::start().await;
    for (said, status) in [(1_000_003, 422), (2_000_000, 400), (200_000_000, 400), (4_000_000_000, 413), (1 << 60, 413)]
    {
        let body = lying_rows(1_000_003, said);
        let answer = timeout(LONG, crate::uploads::send(&server, "?dt_s=0.1", PARQUET, None, body)).await;
        answer.expect("an answer").expect(status);
    }
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn many_tiny_events_and_a_giant_one_are_bounded() {
    let limits = "[ingest.limits]\nmax_events = 20_000\nmax_event_bytes = 100_000\nmax_steps = 1000";
    let server = Server::start_with(limits).await;
    let tiny = |count: usize| -> Vec<u8> {
        (0..count)
            .flat_map(|n| format!("{{\"event_id\":\"{n}\",\"dt_s\":0.1,\"spacing_m\":[9,9],\"follower_speed_mps\":[1,1],\"leader_speed_mps\":[1,1]}}\n").into_bytes())
            .collect()
    };
    let send = async |kind: &str, body: Vec<u8>| crate::uploads::send(&server, "", kind, None, body).await;
    let answer = send(LINES, tiny(20_000)).await.expect_problem(422, "no_event_accepted");
    assert_eq!((&answer["rejected_count"], answer["rejected"].as_array().unwrap().len()), (&json!(20_000), 1000));
    send(LINES, tiny(20_001)).await.expect_problem(413, "body_too_large");
    send(LINES, tiny(1_000_000)).await.expect_problem(413, "body_too_large");
    let giant = |steps: usize| {
        let mut giant = event("giant", 12.0, "train");
        for member in ["spacing_m", "follower_speed_mps", "leader_speed_mps"] {
            giant[member] = json!(vec![10; steps]);
        }
        giant
    };
    for steps in [1001, 10_000] {
        for (kind, body) in
            [(LINES, ndjson(&[giant(steps)])), (JSON, json!({"events": [giant(steps)]}).to_string().into_bytes())]
        {
            let answer = send(kind, body).await.expect_problem(422, "no_event_accepted");
            assert_eq!(answer["rejected"][0]["code"], "too_many_steps");
        }
    }
    for (kind, body) in
        [(LINES, ndjson(&[giant(1_000_000)])), (JSON, json!({"events": [giant(1_000_000)]}).to_string().into_bytes())]
    {
        send(kind, body).await.expect_problem(413, "body_too_large");
    }
    let rows =
        [&b"event_id,spacing_m,follower_speed_mps,leader_speed_mps\n"[..], &b"a,9,1,1\n".repeat(1_000_000)].concat();
    let answer =
        crate::uploads::send(&server, "?dt_s=0.1", CSV, None, rows).await.expect_problem(422, "no_event_accepted");
    assert_eq!(answer["rejected"][0]["code"], "too_many_steps");
    still_well(&server, "after").await;
    server.stop().await;
}
