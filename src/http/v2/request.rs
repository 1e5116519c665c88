//! A request for an inference: JSON, and behind it the tensors that are sent as bytes.

use std::io::Read;

use axum::http::HeaderMap;
use axum::http::header::{CONTENT_ENCODING, HeaderName};
use flate2::read::{MultiGzDecoder, ZlibDecoder};
use serde::Deserialize;

use super::super::AppState;
use super::super::body::{Held, parse, too_large};
use super::super::problem::{Code, InputError, Problem};
use super::super::whole::Whole;
use super::metadata::OUTPUTS;
use super::tensor::{Elements, wrong};
use crate::driver::Seen;
use crate::predictor::SequenceId;

/// How long the JSON before the bytes is.
pub(super) const HEADER_LENGTH: HeaderName = HeaderName::from_static("inference-header-content-length");

/// Longest name of a sequence, bytes.
const MAX_ID_BYTES: usize = 128;

/// Columns of a step: follower speed, leader speed, relative speed, spacing.
pub(super) const COLUMNS: usize = 4;

/// What is asked.
#[derive(Debug)]
pub(in crate::http) struct Request {
    /// Comes back with the answer.
    pub(super) id: Option<String>,
    pub(in crate::http) input: Input,
    /// None asks for all of them.
    pub(super) outputs: Option<Vec<Wanted>>,
    /// Whether outputs that do not say are answered as bytes.
    pub(super) binary: bool,
}

/// The input.
#[derive(Debug, PartialEq)]
pub(in crate::http) enum Input {
    /// `[n, horizon, 4]`.
    Windows { count: usize, horizon: usize, elements: Vec<f32> },
    /// The newest step of a vehicle.
    Step { sequence: Sequence, step: [f32; COLUMNS] },
}

/// Which vehicle, and what becomes of it.
#[derive(Debug, PartialEq)]
pub(in crate::http) struct Sequence {
    pub(super) id: SequenceId,
    pub(super) starts: bool,
    pub(super) ends: bool,
    /// Whether what serves now goes on with it.
    pub(super) follows_live: bool,
}

/// An output that is asked for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::http) struct Wanted {
    pub(super) name: String,
    #[serde(default)]
    pub(super) parameters: WantedParameters,
}

/// How an output is answered.
#[derive(Debug, Default, Deserialize)]
pub(in crate::http) struct WantedParameters {
    pub(super) binary_data: Option<bool>,
    classification: Option<u64>,
    shared_memory_region: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Body {
    id: Option<String>,
    #[serde(default)]
    parameters: Parameters,
    inputs: Vec<Tensor>,
    outputs: Option<Vec<Wanted>>,
}

/// Others are for other servers.
#[derive(Debug, Default, Deserialize)]
#[expect(clippy::struct_excessive_bools, reason = "the protocol has them")]
struct Parameters {
    sequence_id: Option<GivenId>,
    #[serde(default)]
    sequence_start: bool,
    #[serde(default)]
    sequence_end: bool,
    #[serde(default)]
    sequence_follow_live: bool,
    #[serde(default)]
    binary_data_output: bool,
}

/// What names a vehicle: the protocol has both.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "text or an integer from 0 is needed")]
enum GivenId {
    Number(u64),
    Whole(Whole),
    Text(String),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tensor {
    name: String,
    shape: Vec<Whole>,
    datatype: String,
    #[serde(default)]
    parameters: TensorParameters,
    data: Option<Elements>,
}

#[derive(Debug, Default, Deserialize)]
struct TensorParameters {
    binary_data_size: Option<Whole>,
    shared_memory_region: Option<String>,
}

/// The body with its compression undone; it takes no more than a body may.
///
/// # Errors
/// When the encoding is another one, or the body is not of it or too large.
pub(super) fn decompressed(headers: &HeaderMap, held: Held, app: &AppState) -> Result<Held, Problem> {
    let encoding = headers.get(CONTENT_ENCODING).map(|value| value.to_str().unwrap_or("?").trim().to_ascii_lowercase());
    let limit = app.settings.json_body_bytes;
    let bytes = match encoding.as_deref() {
        None | Some("" | "identity") => return Ok(held),
        Some("gzip") => undo(MultiGzDecoder::new(&held.bytes[..]), limit)?,
        Some("deflate") => undo(ZlibDecoder::new(&held.bytes[..]), limit)?,
        Some(other) => {
            return Err(
                Code::UnsupportedMediaType.because(format!("{other:?} is not undone here; gzip and deflate are"))
            );
        }
    };
    Held::of(bytes, app)
}

fn undo(reader: impl Read, limit: u64) -> Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    reader.take(limit + 1).read_to_end(&mut bytes).map_err(|e| Code::MalformedBody.because(e.to_string()))?;
    if bytes.len() as u64 > limit { Err(too_large(limit)) } else { Ok(bytes) }
}

/// Understands a body.
///
/// # Errors
/// When it is not what the protocol, or this server, takes.
pub(in crate::http) fn understood(headers: &HeaderMap, bytes: &[u8]) -> Result<Request, Problem> {
    let (json, mut behind) = bytes.split_at(header_length(headers, bytes.len())?);
    let Body { id, parameters, inputs, outputs } = parse(json)?;
    let mut tensors = inputs.into_iter().map(|tensor| tensor.read(&mut behind)).collect::<Result<Vec<_>, _>>()?;
    if !behind.is_empty() {
        return Err(Code::InvalidBody.because(format!("{} bytes follow the last tensor", behind.len())));
    }
    let (Some((name, shape, elements)), true) = (tensors.pop(), tensors.is_empty()) else {
        return Err(Code::InvalidBody.because("one input is taken: window, or step of a sequence"));
    };
    for wanted in outputs.iter().flatten() {
        wanted.check()?;
    }
    let sequence = parameters.sequence()?;
    let input = match (name.as_str(), &shape[..], sequence) {
        ("window", &[count, horizon, 4], None) => {
            Input::Windows { count: length(&name, count)?, horizon: length(&name, horizon)?, elements }
        }
        ("step", &[1, 4], Some(sequence)) => {
            Input::Step { sequence, step: elements.try_into().expect("as many as the shape says") }
        }
        ("window", _, None) => {
            return Err(wrong(&name, "wrong_shape", format!("shape {shape:?}; [n, horizon, 4] is taken")));
        }
        ("step", _, Some(_)) => return Err(wrong(&name, "wrong_shape", format!("shape {shape:?}; [1, 4] is taken"))),
        ("window", _, Some(_)) => {
            return Err(wrong(&name, "wrong_input", "a sequence takes its newest step, as input \"step\"".to_owned()));
        }
        ("step", _, None) => {
            let detail = "a step belongs to a sequence: the parameter sequence_id says which".to_owned();
            return Err(wrong(&name, "wrong_input", detail));
        }
        _ => return Err(wrong(&name, "unknown_input", "window is taken, and step of a sequence".to_owned())),
    };
    Ok(Request { id, input, outputs, binary: parameters.binary_data_output })
}

fn length(name: &str, length: u64) -> Result<usize, Problem> {
    usize::try_from(length).map_err(|_| wrong(name, "wrong_shape", format!("a length of {length}")))
}

fn header_length(headers: &HeaderMap, whole: usize) -> Result<usize, Problem> {
    let Some(value) = headers.get(&HEADER_LENGTH) else { return Ok(whole) };
    let length = value.to_str().ok().and_then(|text| text.parse().ok()).filter(|&length: &usize| length <= whole);
    length.ok_or_else(|| {
        let detail = format!("{HEADER_LENGTH} is a number of bytes within the body, which has {whole}");
        Code::MalformedHeader.because(detail)
    })
}

impl Tensor {
    /// Name, shape and elements; those that are sent as bytes are taken off `behind`.
    fn read(self, behind: &mut &[u8]) -> Result<(String, Vec<u64>, Vec<f32>), Problem> {
        let Self { name, shape, datatype, parameters, data } = self;
        let shape = shape.iter().map(|&Whole(length)| u64::try_from(length)).collect::<Result<Vec<_>, _>>();
        let shape = shape.map_err(|_| wrong(&name, "wrong_shape", "a length below 0".to_owned()))?;
        if datatype != "FP32" {
            return Err(wrong(&name, "wrong_datatype", format!("{datatype:?}; FP32 is taken")));
        }
        if parameters.shared_memory_region.is_some() {
            return Err(wrong(&name, "not_available", "memory is not shared with clients".to_owned()));
        }
        let elements = match (data, parameters.binary_data_size) {
            (Some(elements), None) => elements,
            (None, Some(Whole(size))) => {
                let taken = usize::try_from(size).ok().and_then(|size| behind.split_at_checked(size));
                let (own, rest) = taken.ok_or_else(|| {
                    let detail = format!("binary_data_size {size}, and {} bytes are left", behind.len());
                    wrong(&name, "wrong_length", detail)
                })?;
                *behind = rest;
                let detail = || wrong(&name, "wrong_length", format!("binary_data_size {size} is no multiple of 4"));
                Elements::from_bytes(own).ok_or_else(detail)?
            }
            _ => return Err(wrong(&name, "missing_data", "either data or binary_data_size is needed".to_owned())),
        };
        let elements = elements.checked(&name, &shape)?;
        Ok((name, shape, elements))
    }
}

impl Wanted {
    fn check(&self) -> Result<(), Problem> {
        let name = &self.name;
        if !OUTPUTS.contains(&name.as_str()) {
            let detail = format!("{} are there", OUTPUTS.join(" and "));
            return Err(wrong(name, "unknown_output", detail));
        }
        if self.parameters.classification.is_some_and(|classes| classes > 0) {
            return Err(wrong(name, "not_available", "an acceleration is no class".to_owned()));
        }
        if self.parameters.shared_memory_region.is_some() {
            return Err(wrong(name, "not_available", "memory is not shared with clients".to_owned()));
        }
        Ok(())
    }
}

impl Parameters {
    /// The sequence; 0 and an empty name are none.
    fn sequence(&self) -> Result<Option<Sequence>, Problem> {
        let id = match &self.sequence_id {
            None | Some(GivenId::Number(0) | GivenId::Whole(Whole(0))) => return Ok(None),
            Some(GivenId::Text(name)) if name.is_empty() => return Ok(None),
            Some(GivenId::Number(number)) => SequenceId::Number(*number),
            Some(GivenId::Whole(Whole(number))) => SequenceId::Number(u64::try_from(*number).map_err(|_| {
                let error = InputError::at("/parameters/sequence_id", "out_of_range", "a number below 0");
                Code::InvalidBody.because("the sequence has no usable id").with_error(error)
            })?),
            Some(GivenId::Text(name)) if name.len() > MAX_ID_BYTES => {
                let detail = format!("at most {MAX_ID_BYTES} bytes are taken");
                let error = InputError::at("/parameters/sequence_id", "too_long", detail);
                return Err(Code::InvalidBody.because("the name of the sequence is too long").with_error(error));
            }
            Some(GivenId::Text(name)) => SequenceId::Text(name.as_str().into()),
        };
        Ok(Some(Sequence {
            id,
            starts: self.sequence_start,
            ends: self.sequence_end,
            follows_live: self.sequence_follow_live,
        }))
    }
}

/// A step in words.
pub(super) fn seen(&[follower_speed_mps, leader_speed_mps, _, spacing_m]: &[f32; COLUMNS]) -> Seen {
    Seen { follower_speed_mps, leader_speed_mps, spacing_m }
}
