//! What an array is of.

use std::fmt;
use std::io::Read;

use super::Column;
use crate::formats::FormatError;

/// The type of an array's elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    /// 64-bit floats.
    F64 { is_big: bool },
    /// 32-bit floats.
    F32 { is_big: bool },
    /// 64-bit integers.
    I64 { is_big: bool },
    /// 32-bit integers.
    I32 { is_big: bool },
    /// References to objects.
    Object,
}

impl Element {
    /// From `NumPy`'s code: `<f8`, `>i4`, `|O`; without an order of bytes, as in pickles, little-endian.
    pub(super) fn parse(code: &str) -> Option<Self> {
        let (is_big, kind) = match code.as_bytes() {
            [b'>', ..] => (true, &code[1..]),
            [b'<' | b'=' | b'|', ..] => (false, &code[1..]),
            _ => (false, code),
        };
        Some(match kind {
            "f8" => Self::F64 { is_big },
            "f4" => Self::F32 { is_big },
            "i8" => Self::I64 { is_big },
            "i4" => Self::I32 { is_big },
            "O" | "O8" | "O4" => Self::Object,
            _ => return None,
        })
    }

    /// The same with this order of bytes.
    pub(super) fn ordered(self, is_big: bool) -> Self {
        match self {
            Self::F64 { .. } => Self::F64 { is_big },
            Self::F32 { .. } => Self::F32 { is_big },
            Self::I64 { .. } => Self::I64 { is_big },
            Self::I32 { .. } => Self::I32 { is_big },
            Self::Object => Self::Object,
        }
    }

    /// Bytes of an element; objects have none of their own.
    fn bytes(self) -> usize {
        match self {
            Self::F64 { .. } | Self::I64 { .. } => 8,
            Self::F32 { .. } | Self::I32 { .. } => 4,
            Self::Object => 0,
        }
    }

    /// The number in so many bytes as an element has.
    fn number(self, bytes: &[u8]) -> f64 {
        /// The same value whatever the order.
        macro_rules! number {
            ($type:ty, $is_big:expr) => {{
                let bytes = bytes.try_into().expect("as many as an element has");
                if $is_big { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) }
            }};
        }
        match self {
            Self::F64 { is_big } => number!(f64, is_big),
            Self::F32 { is_big } => number!(f32, is_big).into(),
            Self::I64 { is_big } => number!(i64, is_big) as f64,
            Self::I32 { is_big } => number!(i32, is_big).into(),
            Self::Object => f64::NAN,
        }
    }

    /// The numbers in these bytes, if they are as many as is said.
    pub(super) fn numbers(self, bytes: &[u8], length: f64) -> Option<impl Iterator<Item = f64>> {
        let size = self.bytes();
        let is_whole = size > 0 && bytes.len().is_multiple_of(size) && length == (bytes.len() / size) as f64;
        is_whole.then(|| bytes.chunks_exact(size).map(move |chunk| self.number(chunk)))
    }

    /// Reads `length` elements, of which at most `most` are kept.
    pub(super) fn column(self, reader: &mut dyn Read, length: u64, most: u32) -> Result<Column, FormatError> {
        let (mut column, mut buffer) = (Column::default(), [0; 8]);
        for _ in 0..length {
            let bytes = &mut buffer[..self.bytes()];
            reader.read_exact(bytes)?;
            column.push(self.number(bytes), most);
        }
        Ok(column)
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F64 { .. } | Self::F32 { .. } => "floats",
            Self::I64 { .. } | Self::I32 { .. } => "integers",
            Self::Object => "objects",
        })
    }
}
