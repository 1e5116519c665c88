//! Into a model of a running server.

use std::fmt::Write;
use std::io::{self, Read};

use futures_util::stream;
use hyper::body::{Bytes, Frame};
use serde_json::{Map, Value};

use super::report::Outcome;
use crate::cli::looking::Bar;
use crate::cli::remote::{FileBody, Remote};
use crate::formats::Encoding;
use crate::ingest::UploadOptions;
use crate::lineage::ModelName;

/// Bytes sent at once.
const CHUNK_BYTES: usize = 64 << 10;

/// A server, and its model that takes events.
pub(super) struct Server {
    remote: Remote,
    path: String,
}

impl Server {
    pub(super) fn new(remote: Remote, model: &ModelName) -> Self {
        Self { remote, path: format!("/v1/models/{model}/batches") }
    }

    /// Uploads the file.
    pub(super) async fn take(&self, upload: super::Upload<'_>, bar: &Bar) -> anyhow::Result<Outcome> {
        let super::Upload { path, file, bytes, format, encoding, options } = upload;
        let (name, bar) = (path.display().to_string(), bar.clone());
        let chunks = std::iter::from_fn({
            let (mut file, mut sent) = (file, 0_u64);
            move || {
                let mut chunk = vec![0; CHUNK_BYTES];
                let read = match file.read(&mut chunk) {
                    Ok(0) => return None,
                    Ok(read) => read,
                    Err(error) => return Some(Err(error)),
                };
                chunk.truncate(read);
                sent += read as u64;
                bar.share(&name, sent as f64 / bytes.max(sent) as f64);
                Some(io::Result::Ok(Frame::data(Bytes::from(chunk))))
            }
        });
        let body = FileBody {
            content_type: format.media_type(),
            content_encoding: match encoding {
                Encoding::Identity => None,
                Encoding::Gzip => Some("gzip"),
                Encoding::Zstd => Some("zstd"),
            },
            chunks: stream::iter(chunks),
        };
        let (taken, answer) = self.remote.upload(&format!("{}{}", self.path, query(&options)), body).await?;
        Ok(match answer {
            Value::Object(mut members) if members.contains_key("batch_id") => {
                // Those of a problem say what the receipt says.
                for member in ["type", "title", "status", "detail", "instance", "code", "request_id"] {
                    members.remove(member);
                }
                Outcome::of_receipt(members, !taken)
            }
            answer => Outcome::Refused(told(answer)),
        })
    }
}

/// What is told of a problem.
fn told(problem: Value) -> Value {
    let Value::Object(mut problem) = problem else { return problem };
    let kept = ["code", "detail", "errors", "request_id"].map(|member| (member, problem.remove(member)));
    Value::Object(
        kept.into_iter().filter_map(|(member, value)| Some((member.to_owned(), value?))).collect::<Map<_, _>>(),
    )
}

/// The options that say something, as a query.
fn query(options: &UploadOptions) -> String {
    let Ok(Value::Object(members)) = serde_json::to_value(options) else { unreachable!("options are an object") };
    let mut query = String::new();
    for (name, value) in members {
        let text = match value {
            Value::Null => continue,
            Value::String(text) => text,
            other => other.to_string(),
        };
        query.push(if query.is_empty() { '?' } else { '&' });
        write!(query, "{name}={}", encoded(&text)).expect("memory");
    }
    query
}

/// Percent-encoded: everything but letters, digits and what RFC 3986 leaves unreserved.
fn encoded(text: &str) -> String {
    let mut encoded = String::new();
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => encoded.push(byte.into()),
            _ => write!(encoded, "%{byte:02X}").expect("memory"),
        }
    }
    encoded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_a_query_that_a_server_reads() {
        let options =
            UploadOptions {
                source: Some("a b&c=ü".to_owned()), min_duration_s: Some(5.5), ..UploadOptions::default()
            };
        assert_eq!(query(&options), "?min_duration_s=5.5&preset=headway&source=a%20b%26c%3D%C3%BC&spacing=net");
    }
}
