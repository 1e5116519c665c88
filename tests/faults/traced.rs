use std::fs;

use headway::car_following::TrafficRegime;
use reqwest::Method;
use serde_json::json;

use crate::SETTINGS;
use crate::preloaded::library;
use crate::process::Home;
use crate::traffic::lines;

#[tokio::test]
async fn an_answer_comes_after_the_sync_of_what_it_acknowledges() {
    const UPLOADS: u64 = 20;
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace");
    let mut home = Home::new(&SETTINGS);
    home.set_variable("LD_PRELOAD", library(folder.path(), "traced.c").to_str().unwrap());
    home.set_variable("TRACED_LOG", trace.to_str().unwrap());
    let process = home.start();
    // Nothing is written but for the one client.
    process.post("/v1/models/default/pause", &json!({})).await.expect(200);
    fs::write(&trace, "").unwrap();
    for number in 0..UPLOADS {
        let request = process.request(Method::POST, "/v1/models/default/batches?regime=fast");
        let body = lines(TrafficRegime::Fast, number, 20).concat();
        process.send(request.header("content-type", "application/x-ndjson").body(body)).await.expect(201);
    }
    process.post("/v1/models", &json!({"model": "other", "method": "ewc"})).await.expect(201);
    process.post("/v1/models/other/pause", &json!({})).await.expect(200);

    let trace = fs::read_to_string(&trace).unwrap();
    let (mut answers, mut since) = (0, Vec::new());
    for line in trace.lines() {
        match line {
            "written" | "synced" => since.push(line),
            status => {
                assert!(since.contains(&"written"), "{status} for what was not written:\n{trace}");
                assert_eq!(since.last(), Some(&"synced"), "{status} before the sync:\n{trace}");
                (answers, since) = (answers + 1, Vec::new());
            }
        }
    }
    assert_eq!(answers, UPLOADS + 2);
}
