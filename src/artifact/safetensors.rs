//! Writing safetensors: eight bytes of length, a header in JSON, and the tensors one after another.
//!
//! The header is written here, and not by the library, so that a large file needs not be in memory as a whole, and so that the
//! same version gives the same bytes.

use serde_json::{Map, Value, json};

use super::layers::{SECOND_BIAS, layers};
use super::record::Record;
use crate::lstm::Layout;

/// What comes before the tensors, and how long the file is with them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// The first bytes of the file.
    pub bytes: Vec<u8>,
    /// Bytes of the whole file.
    pub file_bytes: u64,
}

/// The header of a version's file. After it come [`weights_data`], and for every regime of which something is kept its
/// importance and then its anchor, flat and little-endian, as they are stored.
///
/// # Panics
/// When the layout is that of no network.
#[must_use]
pub fn header(record: &Record, layout: Layout) -> Header {
    let mut tensors = Tensors::default();
    for layer in layers(layout) {
        tensors.add(layer.name.to_owned(), &layer.shape);
        if layer.range == layout.bias() {
            tensors.add(SECOND_BIAS.to_owned(), &layer.shape);
        }
    }
    for (place, _) in record.regimes.iter().enumerate().filter(|(_, regime)| regime.samples.is_some()) {
        for kind in ["importance", "anchor"] {
            for layer in layers(layout) {
                tensors.add(memory_name(place, kind, layer.name), &layer.shape);
            }
        }
    }
    let Tensors { mut entries, bytes } = tensors;
    entries.insert("__metadata__".to_owned(), json!(record.metadata()));
    let mut text = Value::Object(entries).to_string().into_bytes();
    // Tensors begin at a multiple of eight bytes.
    text.resize(text.len().next_multiple_of(8), b' ');
    let file_bytes = 8 + text.len() as u64 + bytes;
    Header { bytes: [&(text.len() as u64).to_le_bytes()[..], &text].concat(), file_bytes }
}

/// What is kept of the regime at `place` of the line, one tensor a layer; `kind` is `importance` or `anchor`.
pub(super) fn memory_name(place: usize, kind: &str, layer: &str) -> String {
    format!("regimes.{place}.{kind}.{layer}")
}

/// Flat weights as the file has them: little-endian, with torch's second bias, all zeros, behind the first.
///
/// # Panics
/// When there are not as many as the layout has.
#[must_use]
pub fn weights_data(layout: Layout, weights: &[f32]) -> Vec<u8> {
    assert_eq!(weights.len(), layout.len(), "the weights of this network");
    let (before, after) = weights.split_at(layout.bias().end);
    let second = std::iter::repeat_n(0.0_f32, layout.gates());
    let all = before.iter().copied().chain(second).chain(after.iter().copied());
    all.flat_map(f32::to_le_bytes).collect()
}

/// Entries of a header, and the bytes that they take behind it.
#[derive(Default)]
struct Tensors {
    entries: Map<String, Value>,
    bytes: u64,
}

impl Tensors {
    fn add(&mut self, name: String, shape: &[usize]) {
        let end = self.bytes + 4 * shape.iter().product::<usize>() as u64;
        let entry = json!({"dtype": "F32", "shape": shape, "data_offsets": [self.bytes, end]});
        self.entries.insert(name, entry);
        self.bytes = end;
    }
}
