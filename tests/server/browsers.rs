use reqwest::Method;
use serde_json::json;

use crate::support::events::window;
use crate::support::server::Server;

const HEADERS: [(&str, &str); 4] = [
    ("x-content-type-options", "nosniff"),
    ("cache-control", "no-store"),
    ("content-security-policy", "default-src 'none'; frame-ancestors 'none'"),
    ("strict-transport-security", ""),
];

#[tokio::test]
async fn every_answer_tells_browsers_to_leave_it_alone() {
    let server = Server::start().await;
    let predict = json!({"windows": [window(5, 9.0)]});
    for answer in [
        server.get("/healthz").await,
        server.get("/v1/models").await,
        server.get("/nowhere").await,
        server.post("/v1/models/default/predict", &predict).await,
        server.post("/v1/models/d%65fault/predict", &predict).await,
    ] {
        for (name, value) in HEADERS {
            assert_eq!(answer.header(name), value, "{name}: {}", answer.text);
        }
        assert_eq!(answer.header("access-control-allow-origin"), "");
    }
    server.stop().await;
}

#[tokio::test]
async fn no_page_may_use_the_interface_unless_its_origin_is_named() {
    let closed = Server::start().await;
    let open = Server::start_with("[server]\ncors_origins = [\"https://good.example\"]").await;
    let body = json!({"windows": [window(5, 9.0)]});
    for (server, origin, allowed) in [
        (&closed, "https://good.example", ""),
        (&open, "https://good.example", "https://good.example"),
        (&open, "https://good.example.evil.example", ""),
        (&open, "null", ""),
    ] {
        let answer = server.send(server.request(Method::GET, "/v1/models").header("origin", origin)).await.expect(200);
        assert_eq!(answer.header("access-control-allow-origin"), allowed, "{origin}");
        let predict = server.request(Method::POST, "/v1/models/default/predict").header("origin", origin).json(&body);
        assert_eq!(server.send(predict).await.header("access-control-allow-origin"), allowed, "{origin}");
        let asked = reqwest::Client::new()
            .request(Method::OPTIONS, format!("{}/v1/models/default/predict", server.url))
            .header("origin", origin)
            .header("access-control-request-method", "POST")
            .header("access-control-request-headers", "authorization,content-type");
        let answer = asked.send().await.unwrap();
        let told = answer.headers().get("access-control-allow-origin").map_or("", |it| it.to_str().unwrap());
        assert_eq!(told, allowed, "{origin}");
    }
    closed.stop().await;
    open.stop().await;
}
