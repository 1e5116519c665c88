//! Event files as bodies: the format by the file's name, how it is to be read in the query.

use std::fmt::Write;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bytes::Bytes;
use clap::Args;
use futures_util::{Stream, stream};
use hyper::body::Frame;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::looking::Bar;
use super::member::text;
use super::service::FileBody;
use crate::formats::{Encoding, Format, Preset};
use crate::ingest::{SpacingKind, UploadOptions};
use crate::lineage::RegimeName;

/// Bytes sent at once.
const CHUNK_BYTES: usize = 64 << 10;

/// As in the query of an upload.
#[derive(Debug, Args)]
pub(super) struct EventOptions {
    /// How columns are named: headway, follownet, ngsim, fcd
    #[arg(long, value_name = "NAME", default_value = "headway", value_parser = word::<Preset>)]
    preset: Preset,
    /// Step of events that do not state one, s
    #[arg(long, value_name = "S")]
    dt_s: Option<f64>,
    /// What spacing is measured between: net, front, centre
    #[arg(long, value_name = "KIND", default_value = "net", value_parser = word::<SpacingKind>)]
    spacing: SpacingKind,
    /// Leader's length, m, where spacing is not net
    #[arg(long, value_name = "M")]
    leader_length_m: Option<f64>,
    /// Follower's length, m, where spacing is from centre to centre
    #[arg(long, value_name = "M")]
    follower_length_m: Option<f64>,
    /// Source of events that name none
    #[arg(long, value_name = "TEXT")]
    source: Option<String>,
    /// Label of the traffic
    #[arg(long, value_name = "NAME", value_parser = RegimeName::parse)]
    regime: Option<RegimeName>,
    /// Of a whole road: shortest event, s
    #[arg(long, value_name = "S")]
    min_duration_s: Option<f64>,
    /// Of a whole road: longest event, s
    #[arg(long, value_name = "S")]
    max_duration_s: Option<f64>,
    /// Of a whole road: least net spacing, m
    #[arg(long, value_name = "M")]
    min_spacing_m: Option<f64>,
    /// Of a whole road: largest net spacing, m
    #[arg(long, value_name = "M")]
    max_spacing_m: Option<f64>,
}

/// A word that a query knows too.
fn word<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(Value::from(text)).map_err(|error| error.to_string())
}

impl EventOptions {
    /// As a query, with its question mark.
    pub(super) fn query(&self) -> String {
        self.query_with(&[])
    }

    /// As a query with further members, but for those that are empty.
    pub(super) fn query_with(&self, others: &[(&str, String)]) -> String {
        let options = UploadOptions {
            preset: self.preset,
            dt_s: self.dt_s,
            spacing: self.spacing,
            leader_length_m: self.leader_length_m,
            follower_length_m: self.follower_length_m,
            source: self.source.clone(),
            regime: self.regime.clone(),
            min_duration_s: self.min_duration_s,
            max_duration_s: self.max_duration_s,
            min_spacing_m: self.min_spacing_m,
            max_spacing_m: self.max_spacing_m,
        };
        query(&options, others)
    }
}

/// A file of events, and what its name says that it is.
pub(super) struct EventFile {
    path: PathBuf,
    file: File,
    bytes: u64,
    format: Format,
    encoding: Encoding,
}

impl EventFile {
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let (format, encoding) = Format::of_file(path).context(
            "its name ends in none of .json, .ndjson, .jsonl, .csv, .parquet, .npy and .xml, with .gz or .zst or without",
        )?;
        let file = File::open(path)?;
        let about = file.metadata()?;
        if !about.is_file() {
            bail!("it is no file");
        }
        Ok(Self { path: path.to_owned(), file, bytes: about.len(), format, encoding })
    }

    /// What is sent of it; the bar is shown how much of it was.
    pub(super) fn into_body(self, bar: &Bar) -> FileBody<impl Stream<Item = io::Result<Frame<Bytes>>> + Send + use<>> {
        let Self { path, mut file, bytes, format, encoding } = self;
        let (name, bar, mut sent) = (path.display().to_string(), bar.clone(), 0_u64);
        let chunks = std::iter::from_fn(move || {
            let mut chunk = vec![0; CHUNK_BYTES];
            let read = match file.read(&mut chunk) {
                Ok(0) => return None,
                Ok(read) => read,
                Err(error) => return Some(Err(error)),
            };
            chunk.truncate(read);
            sent += read as u64;
            bar.share(&name, sent as f64 / bytes.max(sent) as f64);
            Some(Ok(Frame::data(Bytes::from(chunk))))
        });
        FileBody {
            content_type: format.media_type(),
            content_encoding: match encoding {
                Encoding::Identity => None,
                Encoding::Gzip => Some("gzip"),
                Encoding::Zstd => Some("zstd"),
            },
            chunks: stream::iter(chunks),
        }
    }
}

/// The members that say something, as a query.
fn query(options: &UploadOptions, others: &[(&str, String)]) -> String {
    let Ok(Value::Object(members)) = serde_json::to_value(options) else { unreachable!("options are an object") };
    let members = members.iter().map(|(name, value)| (name.as_str(), text(value)));
    let others = others.iter().map(|(name, value)| (*name, value.clone()));
    let mut query = String::new();
    for (name, text) in members.chain(others).filter(|(_, text)| !text.is_empty()) {
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
        let others = [("versions", "1,2".to_owned()), ("references", String::new())];
        assert_eq!(
            query(&options, &others),
            "?min_duration_s=5.5&preset=headway&source=a%20b%26c%3D%C3%BC&spacing=net&versions=1%2C2"
        );
    }
}
