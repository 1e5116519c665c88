use headway::access::{Issued, KeyWish, Scope, Scopes};
use headway::config::{Config, Layer};
use headway::store::{Store, keys};
use jiff::{SignedDuration, Timestamp};
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::support::contract;
use crate::support::events::{events, window};
use crate::support::server::{Answer, Server};

/// A key that expired a minute ago, in the database of a server that is still to start, beside an admin key.
async fn expired_key(directory: &TempDir) -> [String; 2] {
    let path = directory.path().join("headway.db");
    let config = Config::resolve([Layer::string("test", "database.path", path.to_str().unwrap())]).unwrap();
    let store = Store::open(&config.database).await.unwrap();
    let then = Timestamp::now() - SignedDuration::from_mins(2);
    let [admin, expired] = [None, Some(then + SignedDuration::from_mins(1))].map(|expires_at| KeyWish {
        scopes: Scopes::from_iter([Scope::Admin]),
        expires_at,
        ..KeyWish::default()
    });
    let mut made = Vec::new();
    let mut transaction = store.begin().await.unwrap();
    for wish in [admin, expired] {
        let issued = Issued::draw().unwrap();
        keys::create(&mut transaction, &issued, &wish, 9, then).await.unwrap().unwrap();
        made.push(issued.reveal().to_owned());
    }
    transaction.commit().await.unwrap();
    store.close().await;
    made.try_into().unwrap()
}

/// What may stand in `Authorization`; a server must not be confused by any of it.
fn strangers(expired: &str, revoked: &str) -> Vec<(&'static str, Vec<String>)> {
    let foreign = Issued::draw().unwrap();
    let forged = format!("{}{}", &revoked[..20], &foreign.reveal()[20..]);
    let bearer = |key: &str| vec![format!("Bearer {key}")];
    vec![
        ("no key", vec![]),
        ("an empty header", vec![String::new()]),
        ("a scheme alone", vec!["Bearer".to_owned()]),
        ("a scheme and a blank", vec!["Bearer ".to_owned()]),
        ("something short", bearer("x")),
        ("a key without scheme", vec![foreign.reveal().to_owned()]),
        ("another scheme", vec![format!("Basic {}", foreign.reveal())]),
        ("a cut key", bearer(&foreign.reveal()[..62])),
        ("a long key", bearer(&"hw_0".repeat(1000))),
        ("a key of nobody's", bearer(foreign.reveal())),
        ("the name of a key with another secret", bearer(&forged)),
        ("two keys", [bearer(foreign.reveal()), bearer(expired)].concat()),
        ("an expired key", bearer(expired)),
        ("a revoked key", bearer(revoked)),
    ]
}

/// Whether it is well, and what it is: whoever may connect may know.
const OPEN: [&str; 11] = [
    "/healthz",
    "/readyz",
    "/openapi.json",
    "/openapi.yaml",
    "/docs",
    "/docs/{file}",
    "/problems",
    "/problems/{code}",
    "/v2",
    "/v2/health/live",
    "/v2/health/ready",
];

async fn ask(server: &Server, method: &str, path: &str, authorization: &[String]) -> Answer {
    let mut headers = HeaderMap::new();
    for value in authorization {
        headers.append(AUTHORIZATION, HeaderValue::from_str(value).unwrap());
    }
    server.send(server.request(method.parse().unwrap(), path).header("accept", "*/*").headers(headers)).await
}

/// The scope that an operation of the contract needs: none for those that need nothing, null for any key.
fn needed(operation: &Value) -> Option<Value> {
    let security = operation.get("security").unwrap_or(&contract::document()["security"]);
    security.get(0).map(|first| first["key"].get(0).cloned().unwrap_or(Value::Null))
}

#[tokio::test]
async fn no_route_of_the_contract_lets_anybody_in_who_may_not() {
    let directory = tempfile::tempdir().unwrap();
    let [admin, expired] = expired_key(&directory).await;
    let mut server = Server::start_in(directory, "").await;
    server.key = Some(admin.clone());
    let revoked = server.make_key(&json!({"scopes": ["admin"]})).await;
    server.send(server.request(reqwest::Method::DELETE, &format!("/v1/keys/{}", &revoked[3..19]))).await.expect(200);
    server.key = None;
    let asked = json!({"scopes": ["predict", "ingest", "train"], "models": ["elsewhere"]});
    let as_admin = |wish: Value| {
        let request = server.request(reqwest::Method::POST, "/v1/keys").bearer_auth(&admin).json(&wish);
        async { server.send(request).await.expect(201)["key"].as_str().unwrap().to_owned() }
    };
    let elsewhere = as_admin(asked).await;
    let mut scoped = Vec::new();
    for scope in ["predict", "ingest", "train", "admin"] {
        scoped.push((scope, as_admin(json!({"scopes": [scope]})).await));
    }
    let (mut refused, mut let_in) = (0, 0);
    for (template, method, operation) in contract::operations() {
        let path = contract::filled(template, "default");
        let Some(scope) = needed(operation) else {
            assert!(OPEN.contains(&template), "{template} needs no key");
            assert_eq!(ask(&server, &method, &path, &[]).await.status, 200, "{template}");
            continue;
        };
        for (who, authorization) in strangers(&expired, &revoked) {
            let answer = ask(&server, &method, &path, &authorization).await;
            assert_eq!(answer.status, 401, "{method} {template} with {who}: {}", answer.text);
            assert!(answer.header("www-authenticate").starts_with("Bearer"), "{method} {template} with {who}");
            let code = match who {
                "an expired key" => "key_expired",
                "a revoked key" => "key_revoked",
                _ => "unauthenticated",
            };
            assert!(answer.text.contains(code), "{method} {template} with {who}: {}", answer.text);
            refused += 1;
        }
        for (own, key) in &scoped {
            let answer = ask(&server, &method, &path, &[format!("Bearer {key}")]).await;
            if scope.is_null() || scope == *own || *own == "admin" {
                assert!(![401, 403].contains(&answer.status), "{method} {template} with {own}: {}", answer.text);
                let_in += 1;
            } else {
                assert_eq!(answer.status, 403, "{method} {template} with {own}: {}", answer.text);
                assert!(answer.text.contains("insufficient_scope"), "{}", answer.text);
                assert!(template.starts_with("/v2") || answer["scope"] == scope, "{}", answer.text);
                refused += 1;
            }
        }
        let answer = ask(&server, &method, &path, &[format!("Bearer {elsewhere}")]).await;
        if (template, method.as_str()) == ("/v1/models", "GET") {
            assert_eq!(answer.expect(200)["models"], json!([]), "a list shows what the key is for");
        } else if template == "/v2/repository/index" {
            assert_eq!(answer.expect(200).body, json!([]), "so does an index");
        } else {
            assert_eq!(answer.status, 403, "{method} {template} with a key of another model: {}", answer.text);
            refused += 1;
        }
    }
    assert!(refused > 400 && let_in > 40, "{refused} refused, {let_in} let in");
    server.stop().await;
}

#[tokio::test]
async fn a_path_is_not_written_around_the_gate() {
    let mut server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 10.0)).await;
    server.close_gate().await;
    let elsewhere = server.make_key(&json!({"scopes": ["predict", "train"], "models": ["elsewhere"]})).await;
    let here = server.make_key(&json!({"scopes": ["predict"], "models": ["default"]})).await;
    server.key = None;
    let body = json!({"windows": [window(5, 9.0)]});
    for model in ["default", "d%65fault", "%64%65%66%61%75%6C%74"] {
        let path = format!("/v1/models/{model}/predict");
        let ask = |key: Option<&str>| {
            let request = server.request(reqwest::Method::POST, &path).json(&body);
            server.send(if let Some(key) = key { request.bearer_auth(key) } else { request })
        };
        ask(None).await.expect_problem(401, "unauthenticated");
        ask(Some(&elsewhere)).await.expect_problem(403, "model_forbidden");
        ask(Some(&here)).await.expect(200);
    }
    for path in
        ["/v1/models/", "/V1/models", "/v1/models/default/../default", "/v1/keys/", "/v1", "/", "/v1/models/a/b"]
    {
        for method in ["GET", "POST", "HEAD", "OPTIONS", "PUT", "TRACE"] {
            let request =
                raw(&server, &format!("{method} {path} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n")).await;
            assert!(request.starts_with("HTTP/1.1 401 "), "{method} {path}: {request}");
        }
    }
    server.stop().await;
}

/// What is answered to these bytes, until the server closes.
async fn raw(server: &Server, request: &str) -> String {
    let mut stream = TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap();
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.unwrap();
    String::from_utf8(answer).unwrap()
}

#[tokio::test]
async fn a_request_is_refused_before_its_body_is_read() {
    let mut server = Server::start().await;
    server.close_gate().await;
    for path in ["/v1/models/default/batches", "/v1/models/default/predict", "/v1/keys"] {
        // The body that is announced never comes.
        let head = "host: x\r\nconnection: close\r\ncontent-type: application/json\r\ncontent-length: 1000\r\n\r\n{";
        let answer = raw(&server, &format!("POST {path} HTTP/1.1\r\n{head}")).await;
        assert!(answer.starts_with("HTTP/1.1 401 "), "{path}: {answer}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_limited_key_sees_its_models_alone() {
    let mut server = Server::start().await;
    for model in ["a", "b", "c"] {
        server.post("/v1/models", &json!({"model": model, "method": "ewc"})).await.expect(201);
    }
    server.close_gate().await;
    let limited = server.make_key(&json!({"scopes": ["train"], "models": ["c", "a", "none"]})).await;
    server.key = Some(limited);
    let first = server.get("/v1/models?page_size=1").await.expect(200);
    assert_eq!(first["models"][0]["model"], "a");
    let token = first["next_page_token"].as_str().unwrap();
    let second = server.get(&format!("/v1/models?page_size=1&page_token={token}")).await.expect(200);
    assert_eq!((&second["models"][0]["model"], &second["next_page_token"]), (&json!("c"), &Value::Null));
    server.get("/v1/models/a").await.expect(200);
    // Whether there is such a model is not told either.
    server.get("/v1/models/b").await.expect_problem(403, "model_forbidden");
    server.get("/v1/models/nobody").await.expect_problem(403, "model_forbidden");
    server.get("/v1/models/none").await.expect_problem(404, "model_not_found");
    server.get("/metrics").await.expect_problem(403, "model_forbidden");
    let wish = json!({"model": "d", "method": "ewc"});
    server.post("/v1/models", &wish).await.expect_problem(403, "model_forbidden");
    server.stop().await;
}

#[tokio::test]
async fn a_stored_answer_is_replayed_to_the_key_that_got_it_alone() {
    let mut server = Server::start().await;
    let wish = |model: &str| json!({"model": model, "method": "ewc"});
    server.post_with_key("/v1/models", "k", &wish("a")).await.expect(201);
    server.close_gate().await;
    let admin = server.key.clone().unwrap();
    let other = server.make_key(&json!({"scopes": ["train"]})).await;
    // Another caller's request under the same key is another request: it is done, and neither replayed nor refused.
    server.post_with_key("/v1/models", "k", &wish("b")).await.expect(201);
    server.key = Some(other);
    server.post_with_key("/v1/models", "k", &wish("b")).await.expect_problem(409, "model_exists");
    server.post_with_key("/v1/models", "k", &wish("c")).await.expect(201);
    server.key = Some(admin);
    let again = server.post_with_key("/v1/models", "k", &wish("b")).await.expect(201);
    assert_eq!((again.header("idempotency-replayed"), &again["model"]), ("true", &json!("b")));
    server.stop().await;
}

#[tokio::test]
async fn the_history_names_the_key_that_moved_a_version() {
    let mut server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 10.0)).await;
    let promote = json!({"version": 1, "reason": "r"});
    server.post("/v1/models/default/promote", &promote).await.expect(200);
    server.close_gate().await;
    server.post("/v1/models/default/promote", &promote).await.expect(200);
    let history = server.get("/v1/models/default/history").await;
    let actors: Vec<_> = history["history"].as_array().unwrap().iter().map(|entry| &entry["actor"]).collect();
    assert_eq!(actors, ["policy", "local", &server.key.as_ref().unwrap()[3..19]]);
    server.stop().await;
}

#[tokio::test]
async fn a_key_that_asks_too_often_is_told_how_long_to_wait() {
    let limits = "[access]\nrate_window_s = 86400\nrate_requests = 3\nrate_predictions = 2";
    let mut server = Server::start_with(limits).await;
    for _ in 0..5 {
        let free = server.get("/v1/models").await.expect(200);
        assert_eq!(free.header("ratelimit"), "", "without keys nothing is counted");
    }
    server.close_gate().await;
    let other = server.make_key(&json!({"scopes": ["predict"]})).await;
    let mut told = Vec::new();
    for _ in 0..2 {
        let answer = server.get("/v1/models/nobody").await.expect(404);
        assert_eq!(answer.header("ratelimit-policy"), r#""default";q=3;w=86400"#);
        told.push(answer.header("ratelimit").to_owned());
    }
    assert_eq!(told, [r#""default";r=1;t=57600"#, r#""default";r=0;t=86400"#]);
    let refused = server.get("/v1/models").await.expect_problem(429, "rate_limited");
    assert_eq!(refused.header("ratelimit-policy"), r#""default";q=3;w=86400"#);
    assert_eq!(refused.header("ratelimit"), r#""default";r=0;t=86400"#);
    let wait_s: u32 = refused.header("retry-after").parse().unwrap();
    assert!((1..=28_800).contains(&wait_s), "{wait_s}");
    // Predictions are counted apart, and both ways to them together; another key for itself; health checks never.
    let body = json!({"windows": [window(5, 9.0)]});
    server.post("/v1/models/default/predict", &body).await.expect(409);
    server.post("/v1/models/d%65fault/predict", &body).await.expect(409);
    for path in ["/v1/models/default/predict", "/v1/models/d%65fault/predict"] {
        let refused = server.post(path, &body).await.expect_problem(429, "rate_limited");
        assert_eq!(refused.header("ratelimit"), r#""predict";r=0;t=86400"#);
    }
    server.get("/healthz").await.expect(200);
    server.key = Some(other);
    server.get("/v1/models").await.expect(200);
    server.post("/v1/models/default/predict", &body).await.expect(409);
    server.stop().await;
}
