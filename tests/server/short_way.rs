//! Predictions are recognised before the router, by a name that is written plainly. Written otherwise, the router finds them.

use reqwest::{Method, RequestBuilder};
use serde_json::json;

use crate::support::events::{events, window};
use crate::support::server::{Answer, Server};

/// What a client may compare of an answer to the same request under another path.
fn told(mut answer: Answer) -> (u16, String, Vec<(String, String)>) {
    if let Some(problem) = answer.body.as_object_mut() {
        problem.remove("instance");
        problem.remove("request_id");
    }
    for varying in ["date", "content-length", "x-request-id"] {
        answer.headers.remove(varying).unwrap_or_else(|| panic!("no {varying}: {}", answer.text));
    }
    // Whether the connection is kept depends on how much of a refused body had already come. Without it the order is another.
    answer.headers.remove("connection");
    let headers = answer.headers.iter().map(|(name, value)| (name.to_string(), value.to_str().unwrap().to_owned()));
    let mut headers: Vec<_> = headers.collect();
    headers.sort();
    (answer.status, answer.body.to_string(), headers)
}

#[tokio::test]
async fn a_prediction_is_answered_as_the_router_would() {
    let server = Server::start_with("[server]\njson_body_bytes = 20000").await;
    server.learn("default", "fast", &events("e", 12, 10.0)).await;
    let good = json!({"windows": [window(5, 9.0), window(5, 11.0)]}).to_string();
    let json = |request: RequestBuilder| request.header("content-type", "application/json");
    // A little too long: a client that is still sending when the server closes may find no answer.
    let many = json!({"windows": vec![window(5, 9.0); 250]}).to_string();
    assert!(many.len() > 20_000);
    let short = json!({"windows": [window(4, 9.0)]}).to_string();
    let unknown = json!({"windows": [window(5, 9.0)], "version": 9}).to_string();
    let chunks = |body: &str| {
        let chunks: Vec<_> = body.as_bytes().chunks(7).map(|chunk| Ok::<_, std::io::Error>(chunk.to_vec())).collect();
        reqwest::Body::wrap_stream(futures_util::stream::iter(chunks))
    };
    let cases: [(u16, &dyn Fn(RequestBuilder) -> RequestBuilder); 10] = [
        (200, &|request| json(request).body(good.clone())),
        (200, &|request| json(request).body(chunks(&good))),
        (406, &|request| json(request).header("accept", "text/html").body(good.clone())),
        (415, &|request| request.body(good.clone())),
        (413, &|request| json(request).body(many.clone())),
        (413, &|request| json(request).body(chunks(&many))),
        (400, &|request| json(request).body("{")),
        (400, &|request| json(request)),
        (422, &|request| json(request).body(short.clone())),
        (404, &|request| json(request).body(unknown.clone())),
    ];
    for (at, (status, ask)) in cases.into_iter().enumerate() {
        let both = ["default", "d%65fault"]
            .map(|model| server.send(ask(server.request(Method::POST, &format!("/v1/models/{model}/predict")))));
        let [plain, routed] = both;
        let (plain, routed) = (told(plain.await), told(routed.await));
        assert_eq!(plain, routed, "case {at}");
        assert_eq!(plain.0, status, "case {at}: {}", plain.1);
    }
    for (model, status) in [("default", 200), ("nobody", 404), ("", 404), ("a/b", 404)] {
        let path = format!("/v1/models/{model}/predict");
        let request = json(server.request(Method::POST, &path)).header("x-request-id", "mine-1");
        let answer = server.send(request.body(good.clone())).await.expect(status);
        assert_eq!(answer.header("x-request-id"), "mine-1");
        if status != 200 {
            assert_eq!((&answer["request_id"], &answer["instance"]), (&json!("mine-1"), &json!(path)));
        }
    }
    server.get("/v1/models/default/predict").await.expect_problem(405, "method_not_allowed");
    let metrics = server.get("/metrics").await.text;
    let counted = r#"headway_http_requests_total{route="/v1/models/{model}/predict",method="POST",status="200"} 5"#;
    assert!(metrics.contains(counted), "{metrics}");
    server.stop().await;
}
