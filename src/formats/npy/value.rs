//! What a pickle makes, and how much of it there is.

use std::cell::Cell;
use std::ops::Deref;
use std::rc::Rc;

use super::element::Element;
use super::flaw::{broken, forbidden};
use crate::formats::FormatError;
use crate::formats::excerpt::shortened;

/// Longest tuple; the state of a type has nine.
const MAX_TUPLE: usize = 16;
/// What a value takes beside its content, bytes.
const OVERHEAD: u64 = 64;

/// What may be called by name, in the sense of a pickle: each builds a value from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Name {
    /// An empty array, to be filled.
    Reconstruct,
    /// A full one, as protocol 5 has it.
    FromBuffer,
    /// The type of arrays, an argument of the first.
    Ndarray,
    /// A type of elements.
    Dtype,
    /// A number of `NumPy`'s.
    Scalar,
    /// Text into bytes, as protocol 2 has to say them.
    Encode,
}

impl Name {
    /// The one that is called so.
    ///
    /// # Errors
    /// For any other.
    pub(super) fn parse(module: &str, name: &str) -> Result<Self, FormatError> {
        Ok(match (module, name) {
            ("numpy.core.multiarray" | "numpy._core.multiarray", "_reconstruct") => Self::Reconstruct,
            ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar") => Self::Scalar,
            ("numpy.core.numeric" | "numpy._core.numeric", "_frombuffer") => Self::FromBuffer,
            ("numpy", "ndarray") => Self::Ndarray,
            ("numpy", "dtype") => Self::Dtype,
            ("_codecs", "encode") => Self::Encode,
            _ => {
                let name = format!("{}.{}", shortened(module), shortened(name));
                return Err(forbidden(&format!("names {name:?}")));
            }
        })
    }
}

/// Something on the stack.
#[derive(Clone)]
pub(super) enum Value {
    None,
    Truth(bool),
    Number(f64),
    Text(Rc<Kept<String>>),
    Bytes(Rc<Kept<Vec<u8>>>),
    Tuple(Rc<Kept<Vec<Value>>>),
    Name(Name),
    /// What arrays are of; its order of bytes is set after it was made and may be known by number already.
    Element(Rc<Cell<Element>>),
    /// A list or an array of numbers, by its number.
    Column(u64),
    /// An array that was made, and is filled by what comes next.
    Array(u64),
    /// The array of objects.
    Whole,
}

impl Value {
    /// A tuple of these: a short one, and none of a tuple of tuples of tuples, so that whatever is let go of is soon gone.
    pub(super) fn tuple(values: Vec<Value>, room: &Room) -> Result<Self, FormatError> {
        let is_nested = |value: &Value| match value {
            Self::Tuple(inner) => inner.iter().any(|value| matches!(value, Self::Tuple(_))),
            _ => false,
        };
        if values.len() > MAX_TUPLE || values.iter().any(is_nested) {
            return Err(forbidden("has tuples that no array is made of"));
        }
        let bytes = size_of_val(values.as_slice());
        Ok(Self::Tuple(Kept::new(values, bytes, room)?))
    }

    pub(super) fn text(bytes: Vec<u8>, room: &Room) -> Result<Self, FormatError> {
        let text = String::from_utf8(bytes).map_err(|_| broken("a text is not UTF-8"))?;
        let bytes = text.len();
        Ok(Self::Text(Kept::new(text, bytes, room)?))
    }

    pub(super) fn bytes(bytes: Vec<u8>, room: &Room) -> Result<Self, FormatError> {
        let length = bytes.len();
        Ok(Self::Bytes(Kept::new(bytes, length, room)?))
    }

    /// Whether a pickle that remembers it will need it only while it makes one column. Python has one object for every bytes
    /// of length 1.
    pub(super) fn is_passing(&self) -> bool {
        match self {
            Self::Number(_) | Self::Tuple(_) => true,
            Self::Text(text) => text.len() > OVERHEAD as usize,
            Self::Bytes(bytes) => bytes.len() > 1,
            _ => false,
        }
    }
}

/// Memory that values may take at once.
pub(super) struct Room {
    taken: Rc<Cell<u64>>,
    most: u64,
}

impl Room {
    /// So many bytes.
    pub(super) fn new(most: u64) -> Self {
        Self { taken: Rc::default(), most }
    }

    pub(super) fn take(&self, bytes: u64) -> Result<(), FormatError> {
        let taken = self.taken.get() + bytes;
        if taken > self.most {
            let detail = format!("what the pickle has read at once takes more than {} bytes", self.most);
            return Err(FormatError::TooLarge { code: "event_too_large", detail });
        }
        self.taken.set(taken);
        Ok(())
    }

    pub(super) fn give_back(&self, bytes: u64) {
        self.taken.set(self.taken.get().saturating_sub(bytes));
    }
}

/// Something that takes room as long as it is there.
pub(super) struct Kept<T> {
    content: T,
    bytes: u64,
    taken: Rc<Cell<u64>>,
}

impl<T> Kept<T> {
    fn new(content: T, bytes: usize, room: &Room) -> Result<Rc<Self>, FormatError> {
        let bytes = bytes as u64 + OVERHEAD;
        room.take(bytes)?;
        Ok(Rc::new(Self { content, bytes, taken: Rc::clone(&room.taken) }))
    }
}

impl<T> Deref for Kept<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.content
    }
}

impl<T> Drop for Kept<T> {
    fn drop(&mut self) {
        self.taken.set(self.taken.get().saturating_sub(self.bytes));
    }
}
