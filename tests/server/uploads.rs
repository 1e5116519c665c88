use std::fmt::Write;
use std::io::Write as _;
use std::sync::Arc;

use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use reqwest::Method;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::support::events::events;
use crate::support::server::{Answer, Server};

const PATH: &str = "/v1/models/default/batches";

pub(crate) async fn send(server: &Server, options: &str, kind: &str, encoding: Option<&str>, body: Vec<u8>) -> Answer {
    let mut request = server.request(Method::POST, &format!("{PATH}{options}")).header("content-type", kind);
    if let Some(encoding) = encoding {
        request = request.header("content-encoding", encoding);
    }
    server.send(request.body(body)).await
}

pub(crate) fn ndjson(events: &[Value]) -> Vec<u8> {
    events.iter().flat_map(|event| format!("{event}\n").into_bytes()).collect()
}

fn numbers(event: &Value, member: &str) -> Vec<f64> {
    event[member].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The rows of these events under the column names of `preset=follownet`.
pub(crate) fn follownet_csv(events: &[Value]) -> Vec<u8> {
    let mut text = "event_id,t,spacing,sv_speed,lv_speed,rel_speed\n".to_owned();
    for event in events {
        let id = event["event_id"].as_str().unwrap();
        let [spacing, follower, leader] =
            ["spacing_m", "follower_speed_mps", "leader_speed_mps"].map(|m| numbers(event, m));
        for t in 0..spacing.len() {
            let (s, v, l) = (spacing[t], follower[t], leader[t]);
            writeln!(text, "{id},{:.1},{s},{v},{l},{}", t as f64 * 0.1, l - v).unwrap();
        }
    }
    text.into_bytes()
}

pub(crate) fn parquet(events: &[Value]) -> Vec<u8> {
    let schema = "message rows { required binary event_id (utf8); required double spacing_m; \
                  required double follower_speed_mps; required double leader_speed_mps; }";
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let mut bytes = Vec::new();
    let mut writer =
        SerializedFileWriter::new(&mut bytes, schema, Arc::new(WriterProperties::builder().build())).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let ids: Vec<ByteArray> = events
        .iter()
        .flat_map(|event| vec![ByteArray::from(event["event_id"].as_str().unwrap()); numbers(event, "spacing_m").len()])
        .collect();
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<ByteArrayType>().write_batch(&ids, None, None).unwrap();
    column.close().unwrap();
    for member in ["spacing_m", "follower_speed_mps", "leader_speed_mps"] {
        let values: Vec<f64> = events.iter().flat_map(|event| numbers(event, member)).collect();
        let mut column = group.next_column().unwrap().unwrap();
        column.typed::<DoubleType>().write_batch(&values, None, None).unwrap();
        column.close().unwrap();
    }
    group.close().unwrap();
    writer.close().unwrap();
    bytes
}

pub(crate) fn gzip(body: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(body).unwrap();
    encoder.finish().unwrap()
}

#[tokio::test]
async fn every_format_and_encoding_says_the_same() {
    let server = Server::start().await;
    let events = events("e", 4, 10.0);
    let json = serde_json::to_vec(&json!({"events": events})).unwrap();
    let lines = ndjson(&events);
    let zstd = zstd::encode_all(&lines[..], 1).unwrap();
    let (csv, parquet) = (follownet_csv(&events), parquet(&events));
    for (model, options, kind, encoding, body) in [
        ("a", "", "application/json", None, json.clone()),
        ("b", "", "application/json; charset=utf-8", Some("gzip"), gzip(&json)),
        ("c", "", "application/x-ndjson", None, lines.clone()),
        ("d", "", "application/x-ndjson", Some("zstd"), zstd),
        ("e", "?preset=follownet", "text/csv", None, csv),
        ("f", "?dt_s=0.1", "application/vnd.apache.parquet", None, parquet),
    ] {
        server.post("/v1/models", &json!({"model": model, "method": "naive"})).await.expect(201);
        let path = format!("/v1/models/{model}/batches{options}");
        let mut request = server.request(Method::POST, &path).header("content-type", kind);
        if let Some(encoding) = encoding {
            request = request.header("content-encoding", encoding);
        }
        let answer = server.send(request.body(body)).await.expect(201);
        assert_eq!((&answer["accepted"], &answer["rejected_count"]), (&json!(4), &json!(0)), "{}", answer.text);
        assert_eq!(answer["summary"]["steps"], 160);
        assert_eq!(answer["task_ids"], json!([]));
    }
    server.stop().await;
}

#[tokio::test]
async fn bad_events_are_listed_and_good_ones_are_kept() {
    let server = Server::start().await;
    let mut events = events("e", 4, 10.0);
    events[1]["spacing_m"][7] = json!(-1.0);
    events[3]["follower_speed_mps"][0] = json!("fast");
    let answer = server.upload("default", "?source=site&regime=fast", &events).await.expect(201);
    assert_eq!((&answer["accepted"], &answer["rejected_count"]), (&json!(2), &json!(2)));
    let rejected = answer["rejected"].as_array().unwrap();
    assert_eq!((&rejected[0]["index"], &rejected[0]["event_id"]), (&json!(1), &json!("e-1")));
    assert!(rejected[0]["pointer"].as_str().unwrap().starts_with("/events/1"), "{}", rejected[0]);
    let batch = answer["batch_id"].as_str().unwrap();
    assert_eq!(answer.header("location"), format!("{PATH}/{batch}"));
    let kept = server.get(&format!("{PATH}/{batch}/rejections?page_size=1")).await.expect(200);
    assert_eq!(kept["rejections"], json!([rejected[0]]));
    let token = kept["next_page_token"].as_str().unwrap();
    let rest = server.get(&format!("{PATH}/{batch}/rejections?page_token={token}")).await.expect(200);
    assert_eq!((&rest["rejections"], &rest["next_page_token"]), (&json!([rejected[1]]), &json!(null)));
    server.stop().await;
}

#[tokio::test]
async fn a_batch_without_a_good_event_is_refused_and_kept_for_inspection() {
    let server = Server::start().await;
    let mut events = events("e", 2, 10.0);
    events[0]["spacing_m"][7] = json!(-1.0);
    events[1]["colour"] = json!("red");
    let answer = server.upload("default", "", &events).await.expect_problem(422, "no_event_accepted");
    assert_eq!((&answer["accepted"], &answer["rejected_count"]), (&json!(0), &json!(2)));
    assert!(answer["rejected"][1]["detail"].as_str().unwrap().contains("colour"), "{}", answer.text);
    let batch = answer["batch_id"].as_str().unwrap();
    let read = server.get(&format!("{PATH}/{batch}")).await.expect(200);
    assert_eq!(
        (&read["accepted"], &read["rejected_count"], &read["events"]["pending"]),
        (&json!(0), &json!(2), &json!(0))
    );
    server.upload("default", "", &[]).await.expect_problem(422, "no_event_accepted");
    server.stop().await;
}

#[tokio::test]
async fn a_malformed_line_or_row_is_named() {
    let server = Server::start().await;
    let mut body = ndjson(&events("e", 2, 10.0));
    body.extend_from_slice(b"{oops}\n");
    let answer = send(&server, "", "application/x-ndjson", None, body).await.expect(201);
    assert_eq!((&answer["accepted"], &answer["rejected"][0]["line"]), (&json!(2), &json!(3)));
    let csv = String::from_utf8(follownet_csv(&events("f", 2, 10.0))).unwrap();
    let csv = csv.replacen("f-0,1.0,", "f-0,1.0,x", 1);
    let answer = send(&server, "?preset=follownet", "text/csv", None, csv.into_bytes()).await.expect(201);
    assert_eq!((&answer["accepted"], &answer["rejected"][0]["row"]), (&json!(1), &json!(11)), "{}", answer.text);
    server.stop().await;
}

#[tokio::test]
async fn a_recording_of_a_road_becomes_events_and_says_what_was_dropped() {
    let server = Server::start().await;
    let (ngsim, xml, csv): (&[u8], &[u8], &[u8]) = (
        include_bytes!("../golden/scenes/ngsim.csv.gz"),
        include_bytes!("../golden/scenes/fcd.xml.gz"),
        include_bytes!("../golden/scenes/fcd.csv.gz"),
    );
    let send = async |options: &str, kind: &str, body: &[u8], status| {
        send(&server, options, kind, Some("gzip"), body.to_vec()).await.expect(status)
    };
    let answer = send("?preset=ngsim&regime=slow", "text/csv", ngsim, 201).await;
    assert_eq!((&answer["accepted"], &answer["rejected_count"]), (&json!(7), &json!(0)), "{}", answer.text);
    let extraction = &answer["summary"]["extraction"];
    assert_eq!(
        (&extraction["rows"], &extraction["events"], &extraction["vehicles"]),
        (&json!(2268), &json!(7), &json!(9))
    );
    let dropped: u64 = extraction["dropped_steps"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(dropped + answer["summary"]["steps"].as_u64().unwrap(), 2268);
    let kept = server.get(&format!("{PATH}/{}", answer["batch_id"].as_str().unwrap())).await.expect(200);
    assert_eq!(&kept["summary"]["extraction"], extraction);
    let answer = send("", "text/xml", xml, 201).await;
    assert_eq!((&answer["accepted"], &answer["summary"]["extraction"]["events"]), (&json!(6), &json!(6)));
    let answer = send("?preset=fcd", "text/csv", csv, 201).await;
    assert_eq!((&answer["accepted"], &answer["duplicates"]), (&json!(0), &json!(6)));
    let answer = send("?preset=fcd&min_duration_s=5&max_duration_s=20", "application/xml", xml, 201).await;
    assert!(answer["accepted"].as_u64() > Some(10), "{}", answer.text);
    assert!(answer["summary"]["extraction"]["cut"]["too_long"].as_u64() > Some(0), "{}", answer.text);
    for (options, kind) in [
        ("?min_duration_s=5", "text/csv"),
        ("?preset=ngsim&spacing=front&leader_length_m=4", "text/csv"),
        ("?dt_s=0.1", "application/xml"),
        ("?min_duration_s=61", "application/xml"),
        ("?max_spacing_m=-1", "application/xml"),
    ] {
        send(options, kind, ngsim, 422).await;
    }
    server.stop().await;
}

#[tokio::test]
async fn a_body_that_is_cut_or_broken_stores_nothing() {
    let server = Server::start().await;
    let events = events("e", 4, 10.0);
    let json = serde_json::to_vec(&json!({"events": events})).unwrap();
    let lines = ndjson(&events);
    let (zipped, parquet) = (gzip(&lines), parquet(&events));
    for (kind, encoding, body, status) in [
        ("application/json", None, json[..json.len() - 10].to_vec(), 400),
        ("application/x-ndjson", Some("gzip"), zipped[..zipped.len() / 2].to_vec(), 400),
        ("application/x-ndjson", Some("gzip"), lines.clone(), 400),
        ("application/vnd.apache.parquet", None, parquet[..parquet.len() - 10].to_vec(), 400),
        ("application/json", None, br#"{"events": 3}"#.to_vec(), 422),
        ("application/json", None, br#"{"events": [], "colour": 1}"#.to_vec(), 422),
        ("application/x-npy", None, vec![], 400),
        ("application/x-npy", None, b"\x93NUMPY\x01\0".to_vec(), 400),
        ("application/xml", None, b"<fcd-export><timestep time='0'>".to_vec(), 400),
        ("application/xml", None, b"<!DOCTYPE a><fcd-export/>".to_vec(), 400),
        ("application/xml", None, b"<tripinfos/>".to_vec(), 422),
        ("image/png", None, vec![], 415),
        ("application/json", Some("br"), json.clone(), 415),
    ] {
        send(&server, "", kind, encoding, body).await.expect(status);
    }
    assert_eq!(server.get(PATH).await.expect(200)["batches"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn follownets_arrays_are_taken_as_numpy_writes_them() {
    let server = Server::start().await;
    let golden = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/npy");
    let read = |name: &str| std::fs::read(golden.join(name)).unwrap();
    let send = |options, body| send(&server, options, "application/x-npy", None, body);
    let first = send("?preset=follownet&source=waymo", read("saved-numpy2.npy")).await.expect(201);
    assert_eq!((&first["accepted"], &first["rejected_count"]), (&json!(3), &json!(0)), "{}", first.text);
    assert_eq!(first["summary"]["steps"], 39);
    for same in ["saved-numpy1.npy", "arrays-5-numpy2.npy", "scalars-2-numpy1.npy", "singles-4-numpy2.npy"] {
        assert_eq!(send("", read(same)).await.expect(201)["duplicates"], 3, "{same}");
    }
    assert_eq!(send("?dt_s=0.12", read("saved-numpy2.npy")).await.expect(201)["accepted"], 3);
    send("?preset=ngsim", read("saved-numpy2.npy")).await.expect_problem(422, "invalid_body");
    server.stop().await;
}

#[tokio::test]
async fn an_unusable_option_is_named() {
    let server = Server::start().await;
    let events = events("e", 1, 10.0);
    for option in [
        "?colour=red",
        "?dt_s=0",
        "?dt_s=NaN",
        "?spacing=front",
        "?preset=mine",
        "?regime=a%20b",
        "?leader_length_m=-1",
    ] {
        server.upload("default", option, &events).await.expect_problem(422, "invalid_query");
    }
    server.upload("default", "?spacing=front&leader_length_m=4.5", &events).await.expect(201);
    server.stop().await;
}

#[tokio::test]
async fn an_upload_beyond_the_limit_is_refused_however_it_comes() {
    let server = Server::start_with("[ingest]\nmax_body_bytes = 1000").await;
    let events = events("e", 4, 10.0);
    server.upload("default", "", &events).await.expect_problem(413, "body_too_large");
    let chunks = futures_util::stream::iter(vec![Ok::<_, std::io::Error>(ndjson(&events))]);
    let request = server.request(Method::POST, PATH).header("content-type", "application/x-ndjson");
    let answer = server.send(request.body(reqwest::Body::wrap_stream(chunks))).await;
    answer.expect_problem(413, "body_too_large");
    server.stop().await;
}

#[tokio::test]
async fn duplicates_are_counted_and_stored_once_per_model() {
    let server = Server::start().await;
    let events = events("e", 3, 10.0);
    server.upload("default", "", &events).await.expect(201);
    let again = server.upload("default", "", &events).await.expect(201);
    assert_eq!((&again["accepted"], &again["duplicates"]), (&json!(0), &json!(3)));
    server.post("/v1/models", &json!({"model": "other", "method": "naive"})).await.expect(201);
    assert_eq!(server.upload("other", "", &events).await.expect(201)["accepted"], 3);
    server.stop().await;
}

#[tokio::test]
async fn an_upload_sent_again_under_its_key_is_stored_once() {
    let server = Server::start().await;
    let body = json!({"events": events("e", 3, 10.0)});
    let first = server.post_with_key(PATH, "k", &body).await.expect(201);
    let again = server.post_with_key(PATH, "k", &body).await.expect(201);
    assert_eq!((&again.text, again.header("location")), (&first.text, first.header("location")));
    let other = json!({"events": events("f", 3, 10.0)});
    server.post_with_key(PATH, "k", &other).await.expect_problem(422, "idempotency_mismatch");
    let refused = json!({"events": []});
    let first = server.post_with_key(PATH, "k2", &refused).await.expect(422);
    let again = server.post_with_key(PATH, "k2", &refused).await.expect(422);
    assert_eq!((&again.text, again.header("idempotency-replayed")), (&first.text, "true"));
    assert_eq!(server.get(PATH).await["batches"].as_array().unwrap().len(), 2);
    server.stop().await;
}

#[tokio::test]
async fn a_full_house_asks_to_come_back() {
    let server = Server::start_with("[server]\nconcurrent_uploads = 1").await;
    let mut slow = tokio::net::TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap();
    let head = "POST /v1/models/default/batches HTTP/1.1\r\nhost: x\r\ncontent-type: application/x-ndjson\r\n\
                content-length: 1\r\nexpect: 100-continue\r\nconnection: close\r\n\r\n";
    slow.write_all(head.as_bytes()).await.unwrap();
    // The server asks for the body once the upload has its place.
    let mut asked = [0; 25];
    slow.read_exact(&mut asked).await.unwrap();
    assert_eq!(&asked, b"HTTP/1.1 100 Continue\r\n\r\n");
    let refused = server.upload("default", "", &events("e", 1, 10.0)).await;
    assert_eq!(refused.expect_problem(503, "busy").header("retry-after"), "1");
    slow.write_all(b"{").await.unwrap();
    let mut answer = String::new();
    slow.read_to_string(&mut answer).await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    server.upload("default", "", &events("e", 1, 10.0)).await.expect(201);
    server.stop().await;
}
