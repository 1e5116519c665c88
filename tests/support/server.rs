//! The real server on a free port of 127.0.0.1, with a database of its own.

use std::net::SocketAddr;
use std::path::Path;

use headway::config::{Config, Layer};
use reqwest::header::{AUTHORIZATION, CONTENT_TYPE, HeaderMap, HeaderValue};
use reqwest::{Method, RequestBuilder};
use serde_json::Value;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use super::contract;

/// Small and quick: what a test does not care about.
const TEST_SETTINGS: &str = r#"
[model]
hidden = 6
horizon = 5
epochs = 1
minibatch = 8
schedule = "manual"
promotion = "auto"
[training]
training_threads = 1
checkpoint_s = 0.05
trigger_interval_s = 0.2
[upkeep]
interval_s = 0.1
spare_pages = 0
[log]
filter = "warn"
"#;

/// A running server.
pub(crate) struct Server {
    pub url: String,
    client: reqwest::Client,
    stop: Option<oneshot::Sender<()>>,
    serving: JoinHandle<anyhow::Result<()>>,
    settings: String,
    /// Sent with every request that does not bring its own.
    pub key: Option<String>,
    pub directory: TempDir,
}

/// An answer that kept to the contract.
#[derive(Debug, Clone)]
pub(crate) struct Answer {
    pub status: u16,
    pub headers: HeaderMap,
    pub text: String,
    /// The body where it is JSON, else null.
    pub body: Value,
}

impl Answer {
    /// This answer, when its status is `status`.
    #[track_caller]
    pub(crate) fn expect(self, status: u16) -> Self {
        assert_eq!(self.status, status, "{}", self.text);
        self
    }

    /// This answer, when it is a problem with this status and code.
    #[track_caller]
    pub(crate) fn expect_problem(self, status: u16, code: &str) -> Self {
        let answer = self.expect(status);
        assert_eq!(answer.body["code"], code, "{}", answer.text);
        answer
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }
}

impl std::ops::Index<&str> for Answer {
    type Output = Value;
    fn index(&self, member: &str) -> &Value {
        &self.body[member]
    }
}

impl Server {
    /// A new server with the settings of tests.
    pub(crate) async fn start() -> Self {
        Self::start_with("").await
    }

    /// A new server with further settings, as TOML.
    pub(crate) async fn start_with(settings: &str) -> Self {
        Self::start_in(tempfile::tempdir().unwrap(), settings).await
    }

    /// A server with further settings on what `directory` holds.
    pub(crate) async fn start_in(directory: TempDir, settings: &str) -> Self {
        let config = config(directory.path(), settings);
        let _ = headway::telemetry::start_logging(&config.log);
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (stop, stopped) = oneshot::channel();
        let (ready, address) = oneshot::channel::<SocketAddr>();
        let serving = tokio::spawn(headway::app::serve(
            listener,
            config,
            move |address| {
                ready.send(address).unwrap();
                Ok(())
            },
            async {
                let _ = stopped.await;
            },
        ));
        let Ok(address) = address.await else { panic!("the server did not start: {:?}", serving.await) };
        Self {
            url: format!("http://{address}"),
            client: reqwest::Client::new(),
            stop: Some(stop),
            serving,
            settings: settings.to_owned(),
            key: None,
            directory,
        }
    }

    /// Tells the server to stop and waits until it has.
    pub(crate) async fn stop(mut self) -> TempDir {
        self.tell_to_stop();
        self.serving.await.unwrap().unwrap();
        self.directory
    }

    /// Tells the server to stop.
    pub(crate) fn tell_to_stop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(());
        }
    }

    /// Stops and starts again on the same database.
    pub(crate) async fn restart(self) -> Self {
        let (settings, key) = (self.settings.clone(), self.key.clone());
        Self { key, ..Self::start_in(self.stop().await, &settings).await }
    }

    /// Makes a key, and gives it whole.
    pub(crate) async fn make_key(&self, wish: &Value) -> String {
        self.post("/v1/keys", wish).await.expect(201)["key"].as_str().unwrap().to_owned()
    }

    /// Makes the first key, an admin's, which is sent from then on.
    pub(crate) async fn close_gate(&mut self) {
        self.key = Some(self.make_key(&serde_json::json!({"scopes": ["admin"]})).await);
    }

    pub(crate) fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.client.request(method, format!("{}{path}", self.url))
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.send(self.request(Method::GET, path)).await
    }

    pub(crate) async fn post(&self, path: &str, body: &Value) -> Answer {
        self.send(self.request(Method::POST, path).json(body)).await
    }

    pub(crate) async fn post_with_key(&self, path: &str, key: &str, body: &Value) -> Answer {
        self.send(self.request(Method::POST, path).header("idempotency-key", key).json(body)).await
    }

    /// Sends a request and holds the answer to the contract.
    pub(crate) async fn send(&self, request: RequestBuilder) -> Answer {
        let mut request = request.build().unwrap();
        if let Some(key) = &self.key {
            let bearer = HeaderValue::from_str(&format!("Bearer {key}")).unwrap();
            request.headers_mut().entry(AUTHORIZATION).or_insert(bearer);
        }
        let (method, path) = (request.method().to_string(), request.url().path().to_owned());
        let response = self.client.execute(request).await.unwrap();
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let text = response.text().await.unwrap();
        let content_type = headers.get(CONTENT_TYPE).map_or("", |value| value.to_str().unwrap());
        contract::check(&method, &path, status, content_type, &text);
        assert!(headers.contains_key("x-request-id"), "{method} {path} has no request id");
        let body = serde_json::from_str(&text).unwrap_or(Value::Null);
        Answer { status, headers, text, body }
    }

    /// Uploads events as JSON and returns the answer.
    pub(crate) async fn upload(&self, model: &str, options: &str, events: &[Value]) -> Answer {
        self.post(&format!("/v1/models/{model}/batches{options}"), &serde_json::json!({"events": events})).await
    }

    /// The task at a final state.
    pub(crate) async fn end_of(&self, model: &str, task_id: &str) -> Answer {
        loop {
            let task = self.get(&format!("/v1/models/{model}/tasks/{task_id}?wait_s=60")).await.expect(200);
            if !matches!(task["state"].as_str().unwrap(), "queued" | "running") {
                return task;
            }
        }
    }

    /// Uploads these events under `regime`, learns them, and gives the version.
    pub(crate) async fn learn(&self, model: &str, regime: &str, events: &[Value]) -> i64 {
        self.upload(model, &format!("?regime={regime}"), events).await.expect(201);
        let wish = serde_json::json!({"batches": "pending", "regime": regime});
        let task = self.post(&format!("/v1/models/{model}/tasks"), &wish).await.expect(202);
        let ended = self.end_of(model, task["task_id"].as_str().unwrap()).await;
        assert_eq!(ended["state"], "succeeded", "{}", ended.text);
        ended["version"].as_i64().unwrap()
    }
}

fn config(directory: &Path, settings: &str) -> Config {
    let database = directory.join("headway.db");
    Config::resolve([
        Layer::text("tests", TEST_SETTINGS).unwrap(),
        Layer::text("this test", settings).unwrap(),
        Layer::string("tests", "database.path", database.to_str().unwrap()),
    ])
    .unwrap()
}
