//! `__metadata__`: text by key.

use std::str::FromStr;

use serde::de::DeserializeOwned;

use super::defect::Defect;
use super::file::File;
use crate::formats::excerpt;

/// What a file says beside its tensors.
pub(super) struct Keys<'a>(&'a File<'a>);

impl<'a> Keys<'a> {
    pub(super) fn of(file: &'a File<'a>) -> Self {
        Self(file)
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.optional(key).is_some()
    }

    pub(super) fn optional(&self, key: &str) -> Option<&'a str> {
        self.0.metadata.get(key).map(String::as_str)
    }

    pub(super) fn text(&self, key: &str) -> Result<&'a str, Defect> {
        self.optional(key).ok_or_else(|| Defect::key(key, "missing", "the file's metadata has no such key"))
    }

    /// A number, a boolean.
    pub(super) fn parsed<T: FromStr>(&self, key: &str, what: &str) -> Result<T, Defect> {
        parse(key, self.text(key)?, what)
    }

    /// The same where it is there.
    pub(super) fn optional_parsed<T: FromStr>(&self, key: &str, what: &str) -> Result<Option<T>, Defect> {
        self.optional(key).map(|text| parse(key, text, what)).transpose()
    }

    /// A name, a word.
    pub(super) fn word<T: DeserializeOwned>(&self, key: &str) -> Result<T, Defect> {
        serde_json::from_value(self.text(key)?.into()).map_err(|e| Defect::key(key, "invalid_value", excerpt(&e)))
    }

    /// A value written as JSON.
    pub(super) fn json<T: DeserializeOwned>(&self, key: &str) -> Result<T, Defect> {
        serde_json::from_str(self.text(key)?).map_err(|e| Defect::key(key, "invalid_value", excerpt(&e)))
    }

    /// A digest in hex.
    pub(super) fn digest(&self, key: &str) -> Result<[u8; 32], Defect> {
        let mut digest = [0; 32];
        let read = hex::decode_to_slice(self.text(key)?, &mut digest);
        read.map(|()| digest).map_err(|_| Defect::key(key, "invalid_value", "64 hexadecimal digits are needed"))
    }
}

fn parse<T: FromStr>(key: &str, text: &str, what: &str) -> Result<T, Defect> {
    text.parse().map_err(|_| Defect::key(key, "invalid_value", format!("{what} is needed, not {:?}", excerpt(&text))))
}
