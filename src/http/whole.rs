//! A whole number, however JSON writes it.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};

/// An integer. JSON has one kind of number: `3.0` is 3, and languages with one kind of number write it so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Whole(pub(super) i64);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Among alternatives, serde shows a float only to who takes anything.
        deserializer.deserialize_any(Number)
    }
}

struct Number;

impl Visitor<'_> for Number {
    type Value = Whole;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an integer")
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Whole, E> {
        Ok(Whole(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Whole, E> {
        i64::try_from(value).map(Whole).map_err(|_| E::invalid_value(Unexpected::Unsigned(value), &self))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Whole, E> {
        /// Beyond it, not every integer is a float.
        const GREATEST: f64 = 9_007_199_254_740_991.0;
        if value.fract() != 0.0 || value.abs() > GREATEST {
            return Err(E::invalid_value(Unexpected::Float(value), &self));
        }
        Ok(Whole(value as i64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_whole_by_its_value_and_not_by_how_it_is_written() {
        let read = |text: &str| serde_json::from_str::<Option<Whole>>(text).ok().map(|read| read.map(|Whole(n)| n));
        for (text, value) in
            [("3", 3), ("3.0", 3), ("3e0", 3), ("-0.0", 0), ("9007199254740991.0", 9_007_199_254_740_991)]
        {
            assert_eq!(read(text), Some(Some(value)), "{text}");
        }
        assert_eq!(read("null"), Some(None));
        for text in ["3.5", "1e300", "18446744073709551615", "\"3\"", "true", "[3]"] {
            assert_eq!(read(text), None, "{text}");
        }
    }

    #[test]
    fn it_is_one_among_alternatives_too() {
        #[derive(Debug, PartialEq, serde::Deserialize)]
        #[serde(untagged)]
        enum Given {
            Whole(Whole),
            Text(String),
        }
        let read = |text: &str| serde_json::from_str::<Given>(text).ok();
        assert_eq!(read("474.0"), Some(Given::Whole(Whole(474))));
        assert_eq!(read("\"474.0\""), Some(Given::Text("474.0".to_owned())));
        assert_eq!(read("0.5"), None);
    }
}
