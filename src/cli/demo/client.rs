//! A thin client: paths and JSON in, typed answers or problems out.

use std::time::Duration;

use anyhow::{Context, anyhow};
use reqwest::header::CONTENT_TYPE;
use reqwest::{RequestBuilder, Response};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::answers::{Advance, Task};

/// Speaks to one server.
pub(super) struct Client {
    http: reqwest::Client,
    url: String,
}

/// What is read of a problem.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Problem {
    title: String,
    detail: String,
    errors: Vec<Reason>,
    rejected: Vec<Reason>,
}

#[derive(Debug, Deserialize)]
struct Reason {
    code: String,
    detail: String,
}

/// Most reasons of a problem that are shown.
const REASONS: usize = 3;

impl Client {
    pub(super) fn new(url: &str) -> anyhow::Result<Self> {
        // A proxy of the environment has no business between this process and itself.
        let http = reqwest::Client::builder().no_proxy().connect_timeout(Duration::from_secs(10)).build()?;
        Ok(Self { http, url: url.to_owned() })
    }

    pub(super) async fn get<T: DeserializeOwned>(&self, path: &str) -> anyhow::Result<T> {
        self.read(path, self.http.get(self.at(path))).await
    }

    pub(super) async fn post<T: DeserializeOwned>(&self, path: &str, body: &Value) -> anyhow::Result<T> {
        self.read(path, self.http.post(self.at(path)).json(body)).await
    }

    /// Uploads events, one a line.
    pub(super) async fn upload<T: DeserializeOwned>(&self, path: &str, ndjson: &str) -> anyhow::Result<T> {
        let request = self.http.post(self.at(path)).header(CONTENT_TYPE, "application/x-ndjson");
        self.read(path, request.body(ndjson.to_owned())).await
    }

    /// The task at `path` once it has ended; `shown` is told of its progress on the way.
    pub(super) async fn follow(&self, path: &str, mut shown: impl FnMut(&Advance)) -> anyhow::Result<Task> {
        let stream = format!("{path}/progress");
        let mut response = self.send(&stream, self.http.get(self.at(&stream))).await?;
        let mut lines = Lines::default();
        while let Some(chunk) = response.chunk().await? {
            lines.add(&chunk);
            while let Some(data) = lines.next_data("progress") {
                shown(&serde_json::from_str(&data).with_context(|| format!("{stream} said {data}"))?);
            }
        }
        loop {
            let task: Task = self.get(&format!("{path}?wait_s=60")).await?;
            if !matches!(task.state.as_str(), "queued" | "running") {
                return Ok(task);
            }
        }
    }

    fn at(&self, path: &str) -> String {
        format!("{}{path}", self.url)
    }

    async fn read<T: DeserializeOwned>(&self, path: &str, request: RequestBuilder) -> anyhow::Result<T> {
        let body = self.send(path, request).await?.text().await?;
        serde_json::from_str(&body).with_context(|| format!("{path} answered {body}"))
    }

    async fn send(&self, path: &str, request: RequestBuilder) -> anyhow::Result<Response> {
        let response = request.send().await?;
        let status = response.status();
        if status.is_success() {
            return Ok(response);
        }
        let problem: Problem = serde_json::from_str(&response.text().await?).unwrap_or_default();
        Err(anyhow!("{path} answered {status}: {}", problem.told()))
    }
}

impl Problem {
    /// In one line.
    fn told(&self) -> String {
        let reasons = self.errors.iter().chain(&self.rejected).take(REASONS);
        let reasons: Vec<_> = reasons.map(|reason| format!("; {}: {}", reason.code, reason.detail)).collect();
        format!("{}: {}{}", self.title, self.detail, reasons.concat())
    }
}

/// Lines of a stream of server-sent events.
#[derive(Default)]
struct Lines {
    bytes: Vec<u8>,
    event: String,
}

impl Lines {
    fn add(&mut self, chunk: &[u8]) {
        self.bytes.extend_from_slice(chunk);
    }

    /// The data of the next event of this name that has arrived.
    fn next_data(&mut self, name: &str) -> Option<String> {
        while let Some(end) = self.bytes.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.bytes.drain(..=end).collect();
            let line = String::from_utf8_lossy(&line);
            if let Some(event) = line.strip_prefix("event:") {
                event.trim().clone_into(&mut self.event);
            } else if let Some(data) = line.strip_prefix("data:").filter(|_| self.event == name) {
                return Some(data.trim().to_owned());
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_read_however_they_are_cut() {
        let sent =
            b"event: task\ndata: {\"a\": 1}\n\n:\n\nevent: progress\ndata: {\"b\": 2}\n\nevent:progress\ndata:3\n\n";
        for size in [1, 7, sent.len()] {
            let (mut lines, mut found) = (Lines::default(), Vec::new());
            for chunk in sent.chunks(size) {
                lines.add(chunk);
                found.extend(std::iter::from_fn(|| lines.next_data("progress")));
            }
            assert_eq!(found, ["{\"b\": 2}", "3"], "chunks of {size}");
        }
    }

    #[test]
    fn a_problem_is_told_with_its_first_reasons() {
        let reason = |code: &str| Reason { code: code.to_owned(), detail: "d".to_owned() };
        let problem = Problem {
            title: "Title".to_owned(),
            detail: "detail".to_owned(),
            errors: vec![reason("a")],
            rejected: vec![reason("b"), reason("c"), reason("e")],
        };
        assert_eq!(problem.told(), "Title: detail; a: d; b: d; c: d");
    }
}
