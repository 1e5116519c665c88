//! The id of a sequence, however JSON writes it.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};

/// What names a vehicle: the protocol has both.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum GivenId {
    Number(u64),
    Text(String),
}

impl<'de> Deserialize<'de> for GivenId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NumberOrText)
    }
}

struct NumberOrText;

impl Visitor<'_> for NumberOrText {
    type Value = GivenId;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("text or an integer from 0")
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<GivenId, E> {
        Ok(GivenId::Number(value))
    }

    /// JSON has one kind of number: `3.0` is 3.
    fn visit_f64<E: Error>(self, value: f64) -> Result<GivenId, E> {
        /// Beyond it, not every integer is a float.
        const GREATEST: f64 = 9_007_199_254_740_991.0;
        if value.fract() != 0.0 || !(0.0..=GREATEST).contains(&value) {
            return Err(E::invalid_value(Unexpected::Float(value), &self));
        }
        Ok(GivenId::Number(value as u64))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<GivenId, E> {
        Ok(GivenId::Text(value.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_text_or_a_number_by_its_value() {
        let read = |text: &str| serde_json::from_str::<GivenId>(text).map_err(|error| error.to_string());
        for (text, number) in [("0", 0), ("474.0", 474), ("18446744073709551615", u64::MAX)] {
            assert_eq!(read(text), Ok(GivenId::Number(number)), "{text}");
        }
        assert_eq!(read("\"bus-12\""), Ok(GivenId::Text("bus-12".to_owned())));
        for text in ["-1", "-1.0", "0.5", "1e300", "true", "[1]"] {
            assert!(read(text).unwrap_err().contains("text or an integer from 0"), "{text}");
        }
    }
}
