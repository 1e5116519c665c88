//! The decoders from outside: bodies in, events and rejections out.

mod bytes;
pub(crate) mod encode;
mod json;
mod npy;
mod rows;
mod scenes;
mod tabular;

use std::fs::File;
use std::io::Write;
use std::ops::ControlFlow;

use super::*;
use crate::lineage::Rejection;

pub(crate) fn file(body: &[u8]) -> File {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(body).unwrap();
    file
}

pub(crate) fn kind(format: Format, preset: Preset) -> BodyKind {
    BodyKind { format, encoding: Encoding::Identity, preset }
}

pub(crate) type DecodedBody = (Vec<RawEvent>, Vec<Rejection>);

pub(crate) fn decode_file(file: File, kind: BodyKind, limits: &FormatLimits) -> Result<DecodedBody, FormatError> {
    let (mut events, mut rejections) = (Vec::new(), Vec::new());
    decode(file, kind, limits, &ExtractionSettings::default(), &mut |decoded| {
        match decoded {
            Ok(event) => events.push(event),
            Err(rejection) => rejections.push(rejection),
        }
        ControlFlow::Continue(())
    })?;
    Ok((events, rejections))
}

fn decoded(body: impl AsRef<[u8]>, format: Format) -> Result<DecodedBody, FormatError> {
    decode_file(file(body.as_ref()), kind(format, Preset::Headway), &FormatLimits::default())
}

/// Place, code and detail of each rejection.
fn reasons(rejections: &[Rejection]) -> Vec<(String, &str)> {
    rejections.iter().map(|r| (r.place.to_string(), r.code.as_str())).collect()
}
