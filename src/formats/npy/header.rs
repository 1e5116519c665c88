//! What stands before the array: its type, its order and its shape, as the literal of a Python dictionary.

use std::io::Read;

use super::element::Element;
use super::{bytes, whole};
use crate::formats::FormatError;
use crate::formats::excerpt::shortened;

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Longest header that is read, bytes; one without a structured type has about a hundred.
const MAX_HEADER_BYTES: u32 = 4096;
/// Most axes that are looked at.
const MAX_AXES: usize = 32;

/// What the header says of the array.
#[derive(Debug, PartialEq)]
pub(super) struct Header {
    pub(super) element: Element,
    pub(super) shape: Vec<u64>,
}

impl Header {
    /// Reads as far as the array.
    pub(super) fn read(reader: &mut dyn Read) -> Result<Self, FormatError> {
        let magic: [u8; 8] = bytes(reader)?;
        if &magic[..6] != MAGIC {
            return Err(malformed("it does not begin as a .npy file does"));
        }
        let length = match magic[6] {
            1 => u32::from(u16::from_le_bytes(bytes(reader)?)),
            2 | 3 => u32::from_le_bytes(bytes(reader)?),
            version => return Err(malformed(&format!("version {version} of .npy is unknown; 1 to 3 are read"))),
        };
        if length > MAX_HEADER_BYTES {
            return Err(malformed(&format!("its header has {length} bytes, at most {MAX_HEADER_BYTES} are read")));
        }
        let mut text = vec![0; length as usize];
        reader.read_exact(&mut text)?;
        let text = String::from_utf8(text).map_err(|_| malformed("its header is not UTF-8"))?;
        Self::parse(&text)
    }

    /// Reads the literal that `NumPy` writes.
    fn parse(text: &str) -> Result<Self, FormatError> {
        let unusable = || {
            let shown = shortened(text.trim_end());
            malformed(&format!("its header is {shown:?}, not {{'descr': …, 'fortran_order': …, 'shape': (…)}}"))
        };
        let inside = text.trim().strip_prefix('{').and_then(|text| text.strip_suffix('}')).ok_or_else(unusable)?;
        let (mut element, mut is_in_c_order, mut shape) = (None, false, None);
        let mut rest = inside.trim_start();
        while !rest.is_empty() {
            let (name, after) = quoted(rest).ok_or_else(unusable)?;
            let value = after.trim_start().strip_prefix(':').ok_or_else(unusable)?.trim_start();
            let after = match name {
                "descr" if element.is_none() => {
                    if value.starts_with(['[', '{', '(']) {
                        return Err(wrong_type("its elements are structures"));
                    }
                    let (code, after) = quoted(value).ok_or_else(unusable)?;
                    let known = Element::parse(code)
                        .ok_or_else(|| wrong_type(&format!("its type is {:?}", shortened(code))))?;
                    element = Some(known);
                    after
                }
                "fortran_order" if !is_in_c_order => {
                    if value.starts_with("True") {
                        let detail =
                            "the array is in Fortran's order; numpy.ascontiguousarray brings it into C's".to_owned();
                        return Err(FormatError::invalid(whole(), "wrong_order", detail));
                    }
                    is_in_c_order = true;
                    value.strip_prefix("False").ok_or_else(unusable)?
                }
                "shape" if shape.is_none() => {
                    let (lengths, after) =
                        value.strip_prefix('(').and_then(|value| value.split_once(')')).ok_or_else(unusable)?;
                    let lengths = lengths.split(',').map(str::trim).filter(|length| !length.is_empty()).take(MAX_AXES);
                    shape = Some(lengths.map(axis).collect::<Option<Vec<u64>>>().ok_or_else(unusable)?);
                    after
                }
                _ => return Err(unusable()),
            };
            let after = after.trim_start();
            rest = match after.strip_prefix(',') {
                Some(more) => more.trim_start(),
                None if after.is_empty() => after,
                None => return Err(unusable()),
            };
        }
        match (element, shape) {
            (Some(element), Some(shape)) if is_in_c_order => Ok(Self { element, shape }),
            _ => Err(unusable()),
        }
    }
}

/// The text in quotes at the beginning, and what comes after it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    text.strip_prefix('\'')?.split_once('\'')
}

/// The length of an axis: digits only.
fn axis(text: &str) -> Option<u64> {
    text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok()).flatten()
}

fn malformed(detail: &str) -> FormatError {
    FormatError::malformed(None, &detail)
}

fn wrong_type(what: &str) -> FormatError {
    let detail = format!("{what}; arrays of objects (|O), of f4, f8, i4 and i8 are read");
    FormatError::invalid(whole(), "wrong_type", detail)
}
