use headway::car_following::ExtractionSettings;
use headway::formats::{BodyKind, Encoding, Format, FormatLimits, Preset, decode};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::RowAccessor;
use reqwest::Method;
use reqwest::header::ACCEPT;
use serde_json::{Value, json};

use crate::artifact::download;
use crate::lived::execute;
use crate::support::command::headway;
use crate::support::events::{event, events, window};
use crate::support::server::Server;

const BATCHES: &str = "/v1/models/default/batches";
const TYPES: [(&str, &str); 3] =
    [("ndjson", "application/x-ndjson"), ("csv", "text/csv"), ("parquet", "application/vnd.apache.parquet")];

/// Ids of the events in a file.
fn ids(body: &[u8], format: &str) -> Vec<String> {
    let format = match format {
        "ndjson" => Format::Ndjson,
        "csv" => Format::Csv,
        _ => Format::Parquet,
    };
    let mut file = tempfile::tempfile().unwrap();
    std::io::Write::write_all(&mut file, body).unwrap();
    let kind = BodyKind { format, encoding: Encoding::Identity, preset: Preset::Headway };
    let (limits, mut ids) = (FormatLimits::default(), Vec::new());
    decode(file, kind, &limits, &ExtractionSettings::default(), &mut |event| {
        ids.push(event.unwrap().event_id);
        std::ops::ControlFlow::Continue(())
    })
    .unwrap();
    ids
}

async fn file(server: &Server, batch: &str, format: &str) -> Vec<u8> {
    download(server, &format!("{BATCHES}/{batch}/events?format={format}")).await.1
}

async fn upload(server: &Server, model: &str, kind: &str, body: Vec<u8>) -> Value {
    let request = server.request(Method::POST, &format!("/v1/models/{model}/batches")).header("content-type", kind);
    server.send(request.body(body)).await.expect(201).body
}

#[tokio::test]
async fn what_a_batch_holds_comes_back_as_an_upload_takes_it() {
    let server = Server::start().await;
    let mut sent: Vec<_> = (0..70).map(|i| event(&format!("e\"{i},"), 10.0, "train")).collect();
    for (i, event) in sent.iter_mut().enumerate() {
        event["source"] = if i % 3 == 0 { json!(null) } else { json!("a, \"b\"\nc") };
        event["run"] = json!(format!("run-{}", i / 9));
    }
    sent.push(sent[4].clone());
    let first = server.upload("default", "", &sent).await.expect(201);
    assert_eq!((&first["accepted"], &first["duplicates"]), (&json!(70), &json!(1)), "{}", first.text);
    for (format, kind) in TYPES {
        let path = format!("{BATCHES}/b1/events");
        let by_accept = server.request(Method::GET, &path).header(ACCEPT, kind).send().await.unwrap();
        assert_eq!((by_accept.status().as_u16(), &by_accept.headers()["content-type"]), (200, &kind.parse().unwrap()));
        let name = format!("attachment; filename=\"default-b1.{format}\"");
        assert_eq!(by_accept.headers()["content-disposition"], name);
        let (by_accept, by_name) = (by_accept.bytes().await.unwrap(), file(&server, "b1", format).await);
        assert!(by_accept == by_name, "{format}");
        assert_eq!(ids(&by_name, format).len(), 70, "{format}");
        let again = upload(&server, "default", kind, by_name.clone()).await;
        assert_eq!((&again["accepted"], &again["duplicates"]), (&json!(0), &json!(70)), "{format}: {again}");
        // In another model each is what it was in the first, with all that was said of it.
        server.post("/v1/models", &json!({"model": format, "method": "naive"})).await.expect(201);
        let elsewhere = upload(&server, format, kind, by_name).await;
        assert_eq!(elsewhere["accepted"], 70, "{format}: {elsewhere}");
        let batch = format!("/v1/models/{format}/batches/{}/events", elsewhere["batch_id"].as_str().unwrap());
        let (_, lines) = download(&server, &batch).await;
        let kept = String::from_utf8(file(&server, "b1", "ndjson").await).unwrap();
        assert_eq!(String::from_utf8(lines).unwrap(), kept, "{format}");
    }
    let none = server.request(Method::GET, &format!("{BATCHES}/b1/events")).header(ACCEPT, "image/png");
    server.send(none).await.expect_problem(406, "not_acceptable");
    server.get(&format!("{BATCHES}/b1/events?format=xml")).await.expect_problem(422, "invalid_query");
    server.get(&format!("{BATCHES}/b99/events")).await.expect_problem(404, "batch_not_found");
    server.stop().await;
}

#[tokio::test]
async fn events_of_one_name_are_told_apart_in_tables() {
    let server = Server::start().await;
    let named = |content: &str| {
        let mut event = event(content, 10.0, "train");
        event["event_id"] = json!("same");
        event
    };
    let sent: Vec<_> = ["a", "b", "c"].map(named).into();
    server.upload("default", "", &sent).await.expect(201);
    for (format, expected) in [("ndjson", ["same", "same", "same"]), ("csv", ["same", "same#2", "same#3"])] {
        assert_eq!(ids(&file(&server, "b1", format).await, format), expected);
    }
    assert_eq!(upload(&server, "default", "text/csv", file(&server, "b1", "csv").await).await["duplicates"], 3);
    server.stop().await;
}

#[tokio::test]
async fn what_was_taken_back_is_not_handed_out() {
    let server = Server::start().await;
    let (one, two) = (events("a", 4, 10.0), events("b", 4, 10.0));
    server.upload("default", "", &one).await.expect(201);
    server.upload("default", "", &[&two[..], &one[..1]].concat()).await.expect(201);
    server.send(server.request(Method::DELETE, &format!("{BATCHES}/b1"))).await.expect(200);
    // The other batch holds the first of them, too.
    for (format, _) in TYPES {
        assert_eq!(ids(&file(&server, "b1", format).await, format), ["a-0"], "{format}");
        assert_eq!(ids(&file(&server, "b2", format).await, format).len(), 5, "{format}");
    }
    server.send(server.request(Method::DELETE, &format!("{BATCHES}/b2"))).await.expect(200);
    for (format, _) in TYPES {
        assert_eq!(ids(&file(&server, "b1", format).await, format), [""; 0], "{format}");
    }
    server.stop().await;
}

#[tokio::test]
async fn an_event_that_is_not_what_was_uploaded_is_not_handed_out() {
    let server = Server::start().await;
    server.upload("default", "", &events("a", 4, 10.0)).await.expect(201);
    let database = server.directory.path().join("headway.db");
    execute(&database, "update event set arrays = zeroblob(length(arrays)) where name = 'a-2'").await;
    for (format, _) in TYPES {
        let path = format!("{BATCHES}/b1/events?format={format}");
        server.get(&path).await.expect_problem(409, "corrupt");
    }
    server.stop().await;
}

#[tokio::test]
async fn an_evaluation_is_a_row_a_regime() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 16.0)).await;
    server.learn("default", "slow", &events("f", 8, 6.0)).await;
    let path = "/v1/models/default/versions/2/evaluation";
    let told = server.get(path).await.expect(200);
    let (headers, csv) = download(&server, &format!("{path}?format=csv")).await;
    assert_eq!(headers["content-type"], "text/csv");
    assert_eq!(headers["content-disposition"], "attachment; filename=\"default-v2-evaluation.csv\"");
    let csv = String::from_utf8(csv).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 3);
    for (row, regime) in rows[1..].iter().zip(told["tasks"].as_array().unwrap()) {
        for (name, cell) in rows[0].iter().zip(row) {
            let served = name.strip_prefix("served_").map(|name| &regime["served"][name]);
            let expected = match served.unwrap_or(&regime[*name]) {
                Value::Null => String::new(),
                Value::String(text) => text.clone(),
                number => number.to_string(),
            };
            assert_eq!(*cell, expected, "{name}");
        }
    }
    let (_, bytes) = download(&server, &format!("{path}?format=parquet")).await;
    let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
    let regimes: Vec<_> =
        reader.get_row_iter(None).unwrap().map(|row| row.unwrap().get_string(0).unwrap().clone()).collect();
    assert_eq!(json!(regimes), json!(["fast", "slow"]));
    server.get(&format!("{path}?format=ndjson")).await.expect_problem(422, "invalid_query");
    server.stop().await;
}

#[tokio::test]
async fn predictions_are_a_row_a_window_where_a_table_is_asked_for() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 16.0)).await;
    let body = json!({"windows": [window(5, 14.0), window(5, 60.0)]});
    let ask = |accept| server.request(Method::POST, "/v1/models/default/predict").header(ACCEPT, accept).json(&body);
    let told = server.send(ask("application/json")).await.expect(200);
    let csv = server.send(ask("text/csv")).await.expect(200);
    let rows: Vec<Vec<&str>> = csv.text.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows[0], ["window", "accel_mps2", "raw_accel_mps2", "flags"]);
    assert_eq!(csv.header("content-disposition"), "attachment; filename=\"default-v1-predictions.csv\"");
    for (at, (row, prediction)) in rows[1..].iter().zip(told["predictions"].as_array().unwrap()).enumerate() {
        assert_eq!(row[0], at.to_string());
        for (cell, member) in [(row[1], "accel_mps2"), (row[2], "raw_accel_mps2")] {
            let expected: f32 = serde_json::from_value(prediction[member].clone()).unwrap();
            assert_eq!(cell.parse::<f32>().unwrap(), expected);
        }
        let flags: Vec<String> = serde_json::from_value(prediction["flags"].clone()).unwrap();
        assert_eq!(row[3], flags.join(";"));
    }
    let parquet = ask("application/vnd.apache.parquet").send().await.unwrap().bytes().await.unwrap();
    let reader = SerializedFileReader::new(parquet).unwrap();
    assert_eq!(reader.metadata().file_metadata().num_rows(), 2);
    server.send(ask("image/png")).await.expect_problem(406, "not_acceptable");
    server.stop().await;
}

#[tokio::test]
async fn the_command_line_writes_what_a_server_hands_out_and_what_a_database_holds_alike() {
    let mut server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 16.0)).await;
    server.close_gate().await;
    let folder = tempfile::tempdir().unwrap();
    let (url, key) = (server.url.clone(), server.key.clone().unwrap());
    let path = |name: &str| folder.path().join(name).display().to_string();
    let run = |arguments: Vec<String>| async move {
        let told = move || {
            let arguments: Vec<_> = std::iter::once("export").chain(arguments.iter().map(String::as_str)).collect();
            headway(&arguments)
        };
        tokio::task::spawn_blocking(told).await.unwrap()
    };
    let asked = |what: &[&str], out: &str| -> Vec<String> {
        let rest = ["--out", out, "--server", &url, "--key", &key, "--json"];
        what.iter().chain(&rest).map(|part| (*part).to_owned()).collect()
    };
    let of_server = async |route: &str| {
        let request = server.request(Method::GET, &format!("/v1/models/default/{route}")).bearer_auth(&key);
        request.send().await.unwrap().bytes().await.unwrap().to_vec()
    };
    for (what, name, route) in [
        (&["events", "--batch", "b1"][..], "b1.ndjson", "batches/b1/events"),
        (&["events", "--batch", "b1"], "b1.csv", "batches/b1/events?format=csv"),
        (&["events", "--batch", "b1"], "b1.parquet", "batches/b1/events?format=parquet"),
        (&["evaluation", "--version", "1"], "v1.json", "versions/1/evaluation"),
        (&["evaluation", "--version", "1"], "v1.csv", "versions/1/evaluation?format=csv"),
        (&["version", "--version", "1"], "v1.onnx", "versions/1/artifact?format=onnx"),
        (&["version", "--version", "1"], "v1.safetensors", "versions/1/artifact?format=safetensors"),
    ] {
        let output = run(asked(what, &path(name))).await;
        assert!(output.success, "{name}: {}", output.err);
        let (kept, told) = (std::fs::read(path(name)).unwrap(), serde_json::from_str::<Value>(&output.out).unwrap());
        assert_eq!((told["bytes"].as_u64(), &told["file"]), (Some(kept.len() as u64), &json!(path(name))));
        assert!(kept == of_server(route).await, "{name}");
    }
    // What cannot be had leaves no file.
    for (what, name, why) in [
        (&["events", "--batch", "b9"][..], "b9.csv", "no batch b9"),
        (&["events", "--batch", "b1"], "b1.xml", ".ndjson, .csv, .parquet"),
        (&["version", "--version", "9"], "v9.onnx", "no version 9"),
    ] {
        let output = run(asked(what, &path(name))).await;
        let told = &output.err;
        assert!(!output.success && told.contains(why), "{name}: {told}");
        assert!(!std::path::Path::new(&path(name)).exists());
    }
    let directory = server.stop().await;
    let database = directory.path().join("headway.db").display().to_string();
    for (what, name) in [
        (&["events", "--batch", "b1"], "b1.ndjson"),
        (&["events", "--batch", "b1"], "b1.csv"),
        (&["events", "--batch", "b1"], "b1.parquet"),
        (&["evaluation", "--version", "1"], "v1.json"),
        (&["evaluation", "--version", "1"], "v1.csv"),
        (&["version", "--version", "1"], "v1.onnx"),
        (&["version", "--version", "1"], "v1.safetensors"),
    ] {
        let out = path(&format!("local-{name}"));
        let arguments = [&what[..], &["--out", &out, "--database", &database]].concat();
        let output = run(arguments.into_iter().map(str::to_owned).collect()).await;
        assert!(output.success, "{}", output.err);
        assert!(std::fs::read(&out).unwrap() == std::fs::read(path(name)).unwrap(), "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 14);
}
