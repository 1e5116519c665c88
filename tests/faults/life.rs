use headway::artifact::{layers, weights_data};
use headway::car_following::TrafficRegime;
use headway::lstm::Layout;
use reqwest::Method;
use serde_json::{Value, json};

use crate::process::{Home, Process, Reply};
use crate::remains::Remains;
use crate::traffic::lines;
use crate::unsynced::Disk;

const MODEL: &str = "/v1/models/site";

/// The key that does everything.
pub(crate) const KEY: &str = "hw_0123456789abcdef_AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA";

/// A setting that lets every server of this home know the key.
pub(crate) fn let_in(home: &mut Home) {
    let path = home.path().join("key");
    std::fs::write(&path, KEY).unwrap();
    home.set(&format!("access.key_file={}", path.display()));
    home.set(&format!("backup.folder={}", home.path().join("backups").display()));
}

/// A server that dies now and then, and a client that sends again what was not answered.
pub(crate) struct Life<'a> {
    home: &'a Home,
    /// Where the power goes with the process.
    disk: Option<&'a Disk>,
    process: Process,
    /// The fail points of the next process, once this one has died.
    next: Box<dyn FnMut() -> String + Send + 'a>,
    keys: u32,
}

impl<'a> Life<'a> {
    /// Begins one on an empty database. `next` is asked for the fail points of each process, and knows that the one before
    /// died at those it gave.
    pub(crate) async fn begin(
        home: &'a Home,
        disk: Option<&'a Disk>,
        mut next: impl FnMut() -> String + Send + 'a,
    ) -> Self {
        let process = match home.start_failing(&next()) {
            Some(process) => process,
            None => restarted(home, disk, &mut next).await,
        };
        Self { home, disk, process, next: Box::new(next), keys: 0 }
    }

    /// Everything that changes a database, in an order in which its outcome does not depend on when anything is done.
    pub(crate) async fn live(mut self) -> Vec<Value> {
        let settings = json!({"hidden": 6, "horizon": 5, "minibatch": 8, "epochs": 1, "promotion": "auto",
            "test_reservoir": 20, "schedule": "manual"});
        self.create("/v1/models", &json!({"model": "site", "method": "ewc", "settings": settings}), 201).await;
        self.upload(TrafficRegime::Fast, 1, "").await;
        self.learn(&json!({"batches": ["b1"]}), "succeeded").await;
        self.upload(TrafficRegime::Slow, 1, "").await;
        self.learn(&json!({"batches": ["b2"]}), "succeeded").await;
        self.create(&format!("{MODEL}/promote"), &json!({"version": 1, "reason": "try"}), 200).await;
        self.send(Method::PATCH, &format!("{MODEL}/versions/1"), &json!({"note": "kept"}), 200).await;
        self.create(&format!("{MODEL}/rollback"), &json!({"version": 1, "reason": "forgot"}), 200).await;
        self.upload(TrafficRegime::Middle, 1, "").await;
        self.send(Method::DELETE, &format!("{MODEL}/batches/b3"), &json!({}), 200).await;
        self.learn(&json!({"batches": ["b2"]}), "succeeded").await;
        self.upload(TrafficRegime::Middle, 2, "test").await;
        self.learn(&json!({"batches": ["b4"]}), "failed").await;
        self.cancel_held().await;
        self.cancel_running().await;
        self.unlearn().await;
        self.erase().await;
        self.release_source().await;
        self.prune().await;
        self.bring().await;
        self.change_keys().await;
        self.create("/v1/backup", &json!({}), 201).await;
        self.copy().await;
        self.outcome().await
    }

    /// A batch is retracted that the head's line has learned, and a later stage is learned again.
    async fn unlearn(&mut self) {
        self.upload(TrafficRegime::Fast, 3, "").await;
        self.learn(&json!({"batches": ["b5"]}), "succeeded").await;
        let path = format!("{MODEL}/batches/b2");
        let answer = self.ask(|process| process.request(Method::DELETE, &path)).await;
        assert!([200, 202].contains(&answer.status), "{}", answer.text);
        let tasks = self.get(&format!("{MODEL}/tasks?page_size=1000")).await;
        for task in tasks["tasks"].as_array().unwrap() {
            let path = format!("{MODEL}/tasks/{}?wait_s=60", task["task_id"].as_str().unwrap());
            while ["queued", "running"].contains(&self.get(&path).await["state"].as_str().unwrap()) {}
        }
    }

    /// What the retracted batch brought is erased.
    async fn erase(&mut self) {
        self.send(Method::DELETE, &format!("{MODEL}/batches/b3?erase=true"), &json!({}), 200).await;
        while self.get(&format!("{MODEL}/batches/b3")).await["erased_at"].is_null() {}
    }

    async fn release_source(&mut self) {
        let path = format!("{MODEL}/sources/track/release");
        self.send(Method::POST, &path, &json!({}), 200).await;
    }

    /// Another model keeps neither its events nor more than one version.
    async fn prune(&mut self) {
        let settings = json!({"hidden": 4, "horizon": 5, "minibatch": 8, "epochs": 1, "promotion": "auto",
            "schedule": "manual"});
        self.create("/v1/models", &json!({"model": "brief", "method": "naive", "settings": settings}), 201).await;
        let change = json!({"retention": {"events_s": 0, "versions": 1}});
        self.send(Method::PATCH, "/v1/models/brief", &change, 200).await;
        for (regime, batch) in TrafficRegime::ALL.into_iter().zip(["b6", "b7", "b8"]) {
            self.upload_to("/v1/models/brief", regime, 1, "").await;
            let created = self.create("/v1/models/brief/tasks", &json!({"batches": [batch]}), 202).await;
            let task = created["task_id"].as_str().unwrap();
            self.ended(&format!("/v1/models/brief/tasks/{task}"), "succeeded").await;
        }
        while self.get("/v1/models/brief/versions/1").await["pruned"] != true {}
        while self.get("/v1/models/brief/batches/b8").await["pruned_events"] == 0 {}
    }

    /// A network that was trained elsewhere becomes a version.
    async fn bring(&mut self) {
        let settings = json!({"preset": "paper", "hidden": 4, "horizon": 5});
        self.create("/v1/models", &json!({"model": "brought", "method": "naive", "settings": settings}), 201).await;
        let key = self.key();
        let answer = self.ask(|process| {
            let request = process.request(Method::POST, "/v1/models/brought/versions").body(network());
            request.header("content-type", "application/octet-stream").header("idempotency-key", &key)
        });
        assert_eq!(answer.await.expect(201)["version"], 1);
        let versions = self.get("/v1/models/brought/versions").await;
        assert_eq!(versions["versions"].as_array().unwrap().len(), 1);
    }

    async fn change_keys(&mut self) {
        let made = self.create("/v1/keys", &json!({"scopes": ["predict"]}), 201).await;
        let path = format!("/v1/keys/{}", made["key_id"].as_str().unwrap());
        self.send(Method::DELETE, &path, &json!({}), 200).await;
    }

    /// A model is forked, put into an archive, and taken in from it.
    async fn copy(&mut self) {
        let from = json!({"model": "fork", "method": "ewc", "from": {"model": "site", "version": 1}});
        self.create("/v1/models", &from, 201).await;
        let archive = self.bytes("/v1/models/fork/archive").await;
        let key = self.key();
        let sent = |process: &Process| {
            let request = process.request(Method::POST, "/v1/models/moved/archive").header("idempotency-key", &key);
            request.header("content-type", "application/vnd.sqlite3").body(archive.clone())
        };
        self.ask(sent).await.expect(201);
    }

    /// The whole of a file; a process that dies while it gives it is asked again.
    async fn bytes(&mut self, path: &str) -> Vec<u8> {
        loop {
            let asked = self.process.request(Method::GET, path).bearer_auth(KEY).send().await;
            if let Ok(answer) = asked {
                assert_eq!(answer.status(), 200);
                if let Ok(bytes) = answer.bytes().await {
                    return bytes.to_vec();
                }
            }
            self.process.expect_death(self.home);
            self.process = restarted(self.home, self.disk, &mut self.next).await;
        }
    }

    /// A running task is held, and then cancelled.
    async fn cancel_held(&mut self) {
        let task = self.long_task().await;
        self.running(&task).await;
        self.send(Method::POST, &format!("{MODEL}/pause"), &json!({}), 200).await;
        while self.get(&task).await["state"] == "running" {}
        self.cancel(&task).await;
        self.send(Method::POST, &format!("{MODEL}/resume"), &json!({}), 200).await;
    }

    async fn cancel_running(&mut self) {
        let task = self.long_task().await;
        self.running(&task).await;
        self.cancel(&task).await;
        self.ended(&task, "cancelled").await;
    }

    async fn cancel(&mut self, task: &str) {
        let path = format!("{task}/cancel");
        let answer = self.ask(|process| process.request(Method::POST, &path).json(&json!({}))).await;
        // A wish that came true before the process died is answered that the task has ended.
        assert!([200, 202, 409].contains(&answer.status), "{}", answer.text);
    }

    /// A task that nobody lives to see the end of.
    async fn long_task(&mut self) -> String {
        let wish = json!({"batches": ["b1"], "settings": {"epochs": 1000, "minibatch": 1}});
        let created = self.create(&format!("{MODEL}/tasks"), &wish, 202).await;
        format!("{MODEL}/tasks/{}", created["task_id"].as_str().unwrap())
    }

    async fn running(&mut self, task: &str) {
        loop {
            let now = self.get(task).await;
            if now["state"] == "running" && now["progress"].as_f64().unwrap() > 0.0 {
                return;
            }
            assert!(["queued", "running"].contains(&now["state"].as_str().unwrap()), "{now}");
        }
    }

    async fn learn(&mut self, wish: &Value, state: &str) {
        let created = self.create(&format!("{MODEL}/tasks"), wish, 202).await;
        self.ended(&format!("{MODEL}/tasks/{}", created["task_id"].as_str().unwrap()), state).await;
    }

    async fn ended(&mut self, task: &str, state: &str) {
        loop {
            let now = self.get(&format!("{task}?wait_s=60")).await;
            if !matches!(now["state"].as_str().unwrap(), "queued" | "running") {
                assert_eq!(now["state"], state, "{now}");
                return;
            }
        }
    }

    async fn upload(&mut self, regime: TrafficRegime, seed: u64, split: &str) {
        self.upload_to(MODEL, regime, seed, split).await;
    }

    async fn upload_to(&mut self, model: &str, regime: TrafficRegime, seed: u64, split: &str) {
        let mut body = lines(regime, seed, 24).concat();
        if !split.is_empty() {
            body = body.replace("{\"dt_s\"", &format!("{{\"split\":\"{split}\",\"dt_s\""));
        }
        let (path, key) = (format!("{model}/batches?regime={}&source=track", regime.as_str()), self.key());
        let answer = self.ask(|process| {
            let request = process.request(Method::POST, &path).header("content-type", "application/x-ndjson");
            request.header("idempotency-key", &key).body(body.clone())
        });
        let answer = answer.await.expect(201);
        assert_eq!(answer["accepted"], 24, "{answer}");
    }

    /// Sends a wish that must come true once.
    async fn create(&mut self, path: &str, wish: &Value, status: u16) -> Value {
        let key = self.key();
        self.ask(|process| process.request(Method::POST, path).header("idempotency-key", &key).json(wish))
            .await
            .expect(status)
    }

    /// Sends a wish that may come true several times.
    async fn send(&mut self, method: Method, path: &str, wish: &Value, status: u16) {
        self.ask(|process| process.request(method.clone(), path).json(wish)).await.expect(status);
    }

    async fn get(&mut self, path: &str) -> Value {
        self.ask(|process| process.request(Method::GET, path)).await.expect(200)
    }

    fn key(&mut self) -> String {
        self.keys += 1;
        format!("wish-{}", self.keys)
    }

    /// The reply of a process that lives long enough to give it.
    async fn ask(&mut self, request: impl Fn(&Process) -> reqwest::RequestBuilder) -> Reply {
        loop {
            if let Ok(reply) = self.process.try_send(request(&self.process).bearer_auth(KEY)).await {
                return reply;
            }
            self.process.expect_death(self.home);
            self.process = restarted(self.home, self.disk, &mut self.next).await;
        }
    }

    /// Everything that must come out the same, however often the process died.
    async fn outcome(&mut self) -> Vec<Value> {
        let mut outcome = Vec::new();
        for plural in ["batches", "tasks", "versions", "history"] {
            let mut page = self.get(&format!("{MODEL}/{plural}?page_size=1000")).await;
            for entry in page[plural].as_array_mut().unwrap() {
                for name in [
                    "created_at",
                    "started_at",
                    "ended_at",
                    "retracted_at",
                    "erase_asked_at",
                    "erased_at",
                    "at",
                    "attempt",
                    "progress",
                ] {
                    entry.as_object_mut().unwrap().remove(name);
                }
                outcome.push(entry.take());
            }
        }
        for version in 1..=3 {
            outcome.push(self.get(&format!("{MODEL}/versions/{version}/evaluation")).await);
            let window = json!({"follower_speed_mps": [9, 9, 9, 9, 9], "leader_speed_mps": [8, 8, 8, 8, 8],
                "spacing_m": [14, 13.9, 13.8, 13.7, 13.6]});
            let ask = json!({"version": version, "windows": [window]});
            outcome.push(
                self.ask(|process| process.request(Method::POST, &format!("{MODEL}/predict")).json(&ask))
                    .await
                    .expect(200),
            );
        }
        let mut model = self.get(MODEL).await;
        model["created_at"].take();
        outcome.push(model);
        outcome
    }
}

/// A network of four hidden units, as torch would save it.
fn network() -> Vec<u8> {
    let layout = Layout { hidden: 4, inputs: 4 };
    let scaling = json!({"mean": [8, 8, 0, 14], "spread": [4, 4, 1, 6]}).to_string();
    let mut header = json!({"__metadata__": {"scaling": scaling, "accel_limit_mps2": "4"}});
    let mut end = 0;
    for layer in layers(layout) {
        let biases = if layer.range == layout.bias() { vec![layer.name, "lstm.bias_hh_l0"] } else { vec![layer.name] };
        for name in biases {
            let begin = end;
            end += 4 * layer.range.len();
            header[name] = json!({"dtype": "F32", "shape": layer.shape, "data_offsets": [begin, end]});
        }
    }
    let header = header.to_string();
    let weights = weights_data(layout, &vec![0.01; layout.len()]);
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &weights].concat()
}

/// A process that serves, after one that died.
async fn restarted(home: &Home, disk: Option<&Disk>, next: &mut (impl FnMut() -> String + ?Sized)) -> Process {
    loop {
        if let Some(disk) = disk {
            disk.lose_unsynced(home);
        }
        let mut remains = Remains::of(home).await;
        remains.check().await;
        remains.close().await;
        if let Some(process) = home.start_failing(&next()) {
            return process;
        }
    }
}
