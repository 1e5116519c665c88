//! FP32 tensors: in JSON, flat or nested, or as little-endian bytes behind it.

use std::fmt;

use serde::de::{Deserialize, DeserializeSeed, Deserializer, Error, SeqAccess, Visitor};

use super::super::numbers::GREATEST;
use super::super::problem::{Code, InputError, Problem};

/// Bytes of an element.
const ELEMENT_BYTES: usize = 4;

/// Elements in row-major order.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Elements(pub(super) Vec<f32>);

impl Elements {
    /// From bytes.
    ///
    /// # Errors
    /// When they are not a whole number of elements.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (elements, rest) = bytes.as_chunks::<ELEMENT_BYTES>();
        rest.is_empty().then(|| Self(elements.iter().copied().map(f32::from_le_bytes).collect()))
    }

    /// As bytes.
    pub(super) fn to_bytes(elements: &[f32]) -> Vec<u8> {
        elements.iter().copied().flat_map(f32::to_le_bytes).collect()
    }

    /// The elements, when there are as many as the shape says and each is one that the network is asked about.
    ///
    /// # Errors
    /// Names the tensor and what is wrong with it.
    pub(super) fn checked(self, name: &str, shape: &[u64]) -> Result<Vec<f32>, Problem> {
        let expected = shape.iter().try_fold(1_u64, |product, &length| product.checked_mul(length));
        let found = self.0.len() as u64;
        if expected != Some(found) {
            return Err(wrong(name, "wrong_length", format!("shape {shape:?}, and {found} elements")));
        }
        // NaN is beyond no bound, and within none.
        let within = |element: f32| f64::from(element).abs() <= GREATEST;
        match self.0.iter().position(|&element| !within(element)) {
            Some(at) => {
                let detail = format!("element {at} is {:e}, not within ±{GREATEST:e}", self.0[at]);
                Err(wrong(name, "out_of_range", detail))
            }
            None => Ok(self.0),
        }
    }
}

/// A 422 for a tensor.
pub(super) fn wrong(name: &str, code: &'static str, detail: String) -> Problem {
    Code::InvalidBody.because(format!("tensor {name:?}: {detail}")).with_error(InputError::at(
        format!("/{name}"),
        code,
        detail,
    ))
}

impl<'de> Deserialize<'de> for Elements {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut elements = Self::default();
        deserializer.deserialize_seq(Level { into: &mut elements.0, left: MAX_LEVELS })?;
        Ok(elements)
    }
}

/// Of nesting: more than a tensor here has dimensions is a mistake.
const MAX_LEVELS: usize = 4;

/// An array, or an element, of a nested array.
struct Level<'a> {
    into: &'a mut Vec<f32>,
    left: usize,
}

impl<'de> DeserializeSeed<'de> for Level<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Level<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("numbers, flat or nested")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<(), E> {
        self.into.push(number as f32);
        Ok(())
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<(), E> {
        self.visit_f64(number as f64)
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<(), E> {
        self.visit_f64(number as f64)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut array: A) -> Result<(), A::Error> {
        let Some(left) = self.left.checked_sub(1) else {
            return Err(A::Error::custom(format!("more than {MAX_LEVELS} levels of arrays")));
        };
        while array.next_element_seed(Level { into: self.into, left })?.is_some() {}
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_and_nested_numbers_and_bytes_are_the_same_elements() {
        let read = |text| serde_json::from_str::<Elements>(text);
        let expected = Elements(vec![1.0, 0.1, -3.0, 4e5]);
        assert_eq!(read("[1, 0.1, -3, 4e5]").unwrap(), expected);
        assert_eq!(read("[[[1, 0.1]], [[-3, 4e5]]]").unwrap(), expected);
        assert_eq!(Elements::from_bytes(&Elements::to_bytes(&expected.0)), Some(expected.clone()));
        assert_eq!(Elements::from_bytes(&[0; 7]), None);
        assert_eq!(expected.checked("window", &[2, 2]).unwrap().len(), 4);
        for wrong in ["1", "[null]", "[\"1\"]", "[[[[[1]]]]]", "{}", "[true]"] {
            assert!(read(wrong).unwrap_err().is_data(), "{wrong}");
        }
    }

    #[test]
    fn what_does_not_fit_its_shape_or_is_no_number_of_traffic_is_refused() {
        let refused = |elements: &[f32], shape: &[u64]| {
            let problem = Elements(elements.to_vec()).checked("window", shape).unwrap_err();
            problem.code()
        };
        assert_eq!(refused(&[1.0], &[2]), Code::InvalidBody);
        assert_eq!(refused(&[1.0], &[u64::MAX, 2]), Code::InvalidBody);
        for odd in [f32::NAN, f32::INFINITY, -2e6] {
            assert_eq!(refused(&[0.0, odd], &[2]), Code::InvalidBody);
        }
    }
}
