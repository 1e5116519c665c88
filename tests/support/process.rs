//! The real binary as a child process on a database of its own, and a client for it.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use reqwest::{Method, RequestBuilder};
use serde_json::Value;
use tempfile::TempDir;

/// What ends a process at a fail point.
const SIGABRT: i32 = 6;

/// A directory with a database, and the settings of every process that serves it.
pub(crate) struct Home {
    directory: TempDir,
    settings: Vec<String>,
    variables: Vec<(String, String)>,
}

impl Home {
    /// An empty one; settings as `section.key=value`.
    pub(crate) fn new(settings: &[&str]) -> Self {
        let directory = tempfile::tempdir().unwrap();
        fs::create_dir(directory.path().join("spool")).unwrap();
        let mut settings: Vec<String> = settings.iter().map(|&setting| setting.to_owned()).collect();
        settings.push(format!("ingest.spool_folder={}", directory.path().join("spool").display()));
        Self { directory, settings, variables: Vec::new() }
    }

    /// One more setting of every process.
    pub(crate) fn set(&mut self, setting: &str) {
        self.settings.push(setting.to_owned());
    }

    /// Of the environment of every process.
    pub(crate) fn set_variable(&mut self, name: &str, value: &str) {
        self.variables.push((name.to_owned(), value.to_owned()));
    }

    pub(crate) fn path(&self) -> &Path {
        self.directory.path()
    }

    pub(crate) fn database(&self) -> PathBuf {
        self.path().join("headway.db")
    }

    /// Starts a process that says on its stdout when it serves. Variables of the caller's are no settings of it.
    pub(crate) fn spawn(&self) -> Child {
        self.spawn_with("")
    }

    /// Starts a process with these fail points, and waits until it serves; none when it died before.
    pub(crate) fn start_failing(&self, points: &str) -> Option<Process> {
        match serving(self.spawn_with(points)) {
            Ok(process) => Some(process),
            Err(mut child) => {
                assert_eq!(child.wait().unwrap().signal(), Some(SIGABRT), "{}", self.log());
                None
            }
        }
    }

    /// Starts a process and waits until it serves; none when it ends by itself instead, with an error.
    pub(crate) fn start_or_refuse(&self) -> Option<Process> {
        match serving(self.spawn()) {
            Ok(process) => Some(process),
            Err(mut child) => {
                assert_eq!(child.wait().unwrap().code(), Some(1), "{}", self.log());
                None
            }
        }
    }

    /// What all processes said on stderr.
    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.path().join("log")).unwrap()
    }

    fn spawn_with(&self, points: &str) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
        for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("HEADWAY_")) {
            command.env_remove(name);
        }
        command.env("FAILPOINTS", points).envs(self.variables.iter().map(|(name, value)| (name, value)));
        command.args(["serve", "--listen", "127.0.0.1:0", "--database"]).arg(self.database());
        command.args(self.settings.iter().map(|setting| format!("--set={setting}")));
        let log = File::options().create(true).append(true).open(self.path().join("log")).unwrap();
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(log).spawn().unwrap()
    }

    /// Starts a process and waits until it serves.
    pub(crate) fn start(&self) -> Process {
        serving(self.spawn()).unwrap_or_else(|_| panic!("it does not serve: {}", self.log()))
    }
}

/// The process once it serves; the child when it says nothing of it.
fn serving(mut child: Child) -> Result<Process, Child> {
    let mut first = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    match first.trim().strip_prefix("listening on ") {
        Some(url) => Ok(Process { url: url.to_owned(), child, client: reqwest::Client::new() }),
        None => Err(child),
    }
}

/// A process that serves.
pub(crate) struct Process {
    pub(crate) url: String,
    child: Child,
    client: reqwest::Client,
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// What was answered.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reply {
    pub(crate) status: u16,
    pub(crate) text: String,
}

impl Reply {
    /// The JSON of this reply, when its status is `status`.
    #[track_caller]
    pub(crate) fn expect(&self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", self.text);
        serde_json::from_str(&self.text).unwrap()
    }
}

impl Process {
    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// SIGKILL; back when the process is gone.
    pub(crate) fn kill(&mut self) {
        // It may have gone already.
        let _ = self.child.kill();
        self.child.wait().unwrap();
    }

    /// Panics unless it died at a fail point, or does so now.
    pub(crate) fn expect_death(&mut self, home: &Home) {
        assert_eq!(self.child.wait().unwrap().signal(), Some(SIGABRT), "{}", home.log());
    }

    pub(crate) fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.client.request(method, format!("{}{path}", self.url))
    }

    pub(crate) async fn send(&self, request: RequestBuilder) -> Reply {
        self.try_send(request).await.unwrap()
    }

    /// The reply, unless the process dies before it is whole.
    pub(crate) async fn try_send(&self, request: RequestBuilder) -> reqwest::Result<Reply> {
        let response = request.send().await?;
        Ok(Reply { status: response.status().as_u16(), text: response.text().await? })
    }

    pub(crate) async fn get(&self, path: &str) -> Value {
        self.send(self.request(Method::GET, path)).await.expect(200)
    }

    pub(crate) async fn post(&self, path: &str, body: &Value) -> Reply {
        self.send(self.request(Method::POST, path).json(body)).await
    }

    pub(crate) async fn post_with_key(&self, path: &str, key: &str, body: &Value) -> Reply {
        self.send(self.request(Method::POST, path).header("idempotency-key", key).json(body)).await
    }

    /// Every entry of the list of `plural` at `path`, page by page.
    pub(crate) async fn list(&self, path: &str, plural: &str) -> Vec<Value> {
        let (mut entries, mut token) = (Vec::new(), String::new());
        loop {
            let mut page = self.get(&format!("{path}?page_size=1000{token}")).await;
            entries.append(page[plural].as_array_mut().unwrap());
            match page["next_page_token"].as_str() {
                Some(next) => token = format!("&page_token={next}"),
                None => return entries,
            }
        }
    }

    /// The task at a final state.
    pub(crate) async fn end_of(&self, task_id: &str) -> Value {
        loop {
            let task = self.get(&format!("/v1/models/default/tasks/{task_id}?wait_s=60")).await;
            if !matches!(task["state"].as_str().unwrap(), "queued" | "running") {
                return task;
            }
        }
    }
}
