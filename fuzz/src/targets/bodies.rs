use std::collections::BTreeSet;
use std::fmt;

use headway::http::Code;
use headway::http::reading::{Call, body};
use headway::lineage::ModelSettings;
use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::Value;

/// A body that is taken is JSON that says everything once, and says the same however it is written.
pub(super) fn run(data: &[u8]) {
    let Some((choice, text)) = super::chosen(data, Call::ALL.len()) else { return };
    let (call, defaults) = (Call::ALL[choice], ModelSettings::default());
    let most = 64 * text.len() as u64 + (256 << 10);
    match super::within(most, || body(call, text, &defaults)) {
        Ok(said) => {
            let value: Value = serde_json::from_slice(text).expect("what is taken is JSON");
            serde_json::from_slice::<SaidOnce>(text).expect("what is taken says nothing twice");
            assert_eq!(body(call, value.to_string().as_bytes(), &defaults), Ok(said));
        }
        Err(code) => {
            let known = matches!(code, Code::MalformedJson | Code::InvalidBody | Code::InvalidSettings);
            assert!(known, "{code:?}");
            if serde_json::from_slice::<Value>(text).is_ok() {
                assert_ne!(code, Code::MalformedJson);
            }
        }
    }
}

/// JSON of any shape in which no member comes twice.
struct SaidOnce;

impl<'de> Deserialize<'de> for SaidOnce {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Once)
    }
}

struct Once;

impl<'de> Visitor<'de> for Once {
    type Value = SaidOnce;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_unit<E>(self) -> Result<SaidOnce, E> {
        Ok(SaidOnce)
    }

    fn visit_bool<E>(self, _: bool) -> Result<SaidOnce, E> {
        Ok(SaidOnce)
    }

    fn visit_i64<E>(self, _: i64) -> Result<SaidOnce, E> {
        Ok(SaidOnce)
    }

    fn visit_u64<E>(self, _: u64) -> Result<SaidOnce, E> {
        Ok(SaidOnce)
    }

    fn visit_f64<E>(self, _: f64) -> Result<SaidOnce, E> {
        Ok(SaidOnce)
    }

    fn visit_str<E>(self, _: &str) -> Result<SaidOnce, E> {
        Ok(SaidOnce)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<SaidOnce, A::Error> {
        while seq.next_element::<SaidOnce>()?.is_some() {}
        Ok(SaidOnce)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<SaidOnce, A::Error> {
        let mut names = BTreeSet::new();
        while let Some(name) = map.next_key::<String>()? {
            if !names.insert(name) {
                map.next_value::<IgnoredAny>()?;
                return Err(serde::de::Error::custom("a member comes twice"));
            }
            map.next_value::<SaidOnce>()?;
        }
        Ok(SaidOnce)
    }
}
