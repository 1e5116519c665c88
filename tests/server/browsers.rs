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

#[tokio::test]
async fn a_page_from_elsewhere_changes_nothing_on_a_server_without_keys() {
    let mut server = Server::start_with("[server]\ncors_origins = [\"https://good.example\"]").await;
    let own = server.url.clone();
    let ask = |server: &Server, method: Method, origin: &str| {
        server.request(method, "/v1/models/default/pause").header("origin", origin)
    };
    for foreign in ["https://evil.example", "null", "http://127.0.0.1:1", "", "127.0.0.1"] {
        server.send(ask(&server, Method::POST, foreign)).await.expect_problem(403, "foreign_page");
    }
    let predict = json!({"windows": [window(5, 9.0)]});
    for model in ["default", "d%65fault"] {
        let request = server.request(Method::POST, &format!("/v1/models/{model}/predict")).json(&predict);
        server.send(request.header("origin", "null")).await.expect_problem(409, "no_live_version");
    }
    for origin in [own.as_str(), "https://good.example"] {
        server.send(ask(&server, Method::POST, origin)).await.expect(200);
    }
    // With keys a browser has nothing to send by itself.
    server.close_gate().await;
    server.send(ask(&server, Method::POST, "https://evil.example")).await.expect(200);
    server.key = None;
    server.send(ask(&server, Method::POST, "https://evil.example")).await.expect_problem(401, "unauthenticated");
    server.stop().await;
}
