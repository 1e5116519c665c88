//! Tasks as they are answered, and the stream of their progress.

use anyhow::Context;
use http_body_util::BodyExt;
use jiff::Timestamp;
use serde::Deserialize;

use super::Service;

/// Of a task.
#[derive(Debug, Deserialize)]
pub(in crate::cli) struct Task {
    #[serde(rename = "task_id")]
    pub(in crate::cli) id: String,
    pub(in crate::cli) state: String,
    pub(in crate::cli) regime: Option<String>,
    pub(in crate::cli) stage: Option<u32>,
    pub(in crate::cli) version: Option<i64>,
    pub(in crate::cli) error: Option<TaskError>,
    pub(in crate::cli) started_at: Option<Timestamp>,
    pub(in crate::cli) ended_at: Option<Timestamp>,
}

/// Why a task failed.
#[derive(Debug, Deserialize)]
pub(in crate::cli) struct TaskError {
    pub(in crate::cli) code: String,
    pub(in crate::cli) detail: String,
}

impl Task {
    /// From its start to its end, s.
    pub(in crate::cli) fn seconds(&self) -> Option<f64> {
        Some(self.ended_at?.duration_since(self.started_at?).as_secs_f64())
    }
}

/// One event of a task's progress.
#[derive(Debug, Deserialize)]
pub(in crate::cli) struct Advance {
    pub(in crate::cli) progress: f64,
    pub(in crate::cli) epoch: u64,
    pub(in crate::cli) loss: Option<f64>,
    pub(in crate::cli) events_per_s: Option<f64>,
}

pub(super) async fn follow(service: &Service, path: &str, mut shown: impl FnMut(&Advance)) -> anyhow::Result<Task> {
    let stream = format!("{path}/progress");
    let (mut body, mut lines) = (service.stream(&stream).await?, Lines::default());
    while let Some(frame) = body.frame().await {
        if let Some(chunk) = frame.context("the stream of a task's progress broke off")?.data_ref() {
            lines.add(chunk);
        }
        while let Some(data) = lines.next_data("progress") {
            shown(&serde_json::from_str(&data).with_context(|| format!("{stream} said {data}"))?);
        }
    }
    loop {
        let task: Task = service.get(&format!("{path}?wait_s=60")).await?;
        if !matches!(task.state.as_str(), "queued" | "running") {
            return Ok(task);
        }
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
}
