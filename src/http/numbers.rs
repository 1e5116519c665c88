//! Arrays of numbers in bodies of predictions.

use std::fmt;

use serde::de::{Deserialize, Deserializer, SeqAccess, Visitor};

/// Greatest number taken, m or m/s: absurd on a road, and what the network makes of it is finite.
pub(super) const GREATEST: f64 = 1e6;

/// Numbers, read at double precision as those of uploads are, and kept as the network takes them. Those beyond
/// [`GREATEST`] are also kept as they were sent, to be refused by name.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    narrowed: Vec<f32>,
    absurd: Vec<(usize, f64)>,
}

impl Numbers {
    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.narrowed.len()
    }

    /// Those beyond [`GREATEST`], each behind its place.
    pub(super) fn absurd(&self) -> &[(usize, f64)] {
        &self.absurd
    }

    /// At single precision.
    pub(super) fn into_narrowed(self) -> Vec<f32> {
        self.narrowed
    }
}

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(Array)
    }
}

struct Array;

impl<'de> Visitor<'de> for Array {
    type Value = Numbers;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a sequence")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut array: A) -> Result<Numbers, A::Error> {
        /// JSON does not say how many come. A window of the default horizon, and most others, fits without growing.
        const EXPECTED: usize = 16;
        let mut numbers = Numbers { narrowed: Vec::with_capacity(EXPECTED), absurd: Vec::new() };
        while let Some(value) = array.next_element::<f64>()? {
            if value.abs() > GREATEST {
                numbers.absurd.push((numbers.narrowed.len(), value));
            }
            numbers.narrowed.push(value as f32);
        }
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_narrowed_and_the_absurd_are_known_by_place_and_value() {
        let read = |text| serde_json::from_str::<Numbers>(text);
        let numbers = read("[1, 0.1, -1000000.0001, 1e6, 2e300]").unwrap();
        assert_eq!(numbers.absurd(), [(2, -1_000_000.000_1), (4, 2e300)]);
        assert_eq!((numbers.len(), &numbers.into_narrowed()[..2]), (5, &[1.0, 0.1][..]));
        assert_eq!(read("[]").unwrap().len(), 0);
        for wrong in ["[1, null]", "1", "[[1]]", "{}"] {
            assert!(read(wrong).unwrap_err().is_data(), "{wrong}");
        }
    }
}
