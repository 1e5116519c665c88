//! A key: whom it lets do what, and until when.

use std::fmt;

use jiff::Timestamp;
use serde::{Serialize, Serializer};

use super::{Scope, Scopes};
use crate::lineage::ModelName;

/// Longest name of a key, characters.
const MAX_NAME_CHARS: usize = 128;
/// Most models a key may be limited to.
const MAX_MODELS: usize = 64;

/// The public part of a key; sixteen hexadecimal digits on the wire.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct KeyId(u64);

impl KeyId {
    /// Reads an id in its one spelling.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let well_formed = text.len() == 16 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        u64::from_str_radix(text, 16).ok().filter(|_| well_formed).map(Self)
    }
}

impl fmt::Display for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl fmt::Debug for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Serialize for KeyId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// What a key may be used for, and how long.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    /// Its public part.
    pub key_id: KeyId,
    /// For people.
    pub name: Option<String>,
    /// What it may be used for.
    pub scopes: Scopes,
    /// The only models it is for; none: every model.
    pub models: Option<Vec<ModelName>>,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it stops by itself.
    pub expires_at: Option<Timestamp>,
    /// When somebody ended it.
    pub revoked_at: Option<Timestamp>,
}

/// Whether a key opens anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum KeyState {
    /// It does.
    Active,
    /// Not any more: its time is up.
    Expired,
    /// Not any more: somebody ended it.
    Revoked,
}

impl Key {
    /// Whether it opens anything at `now`.
    #[must_use]
    pub fn state(&self, now: Timestamp) -> KeyState {
        match (self.revoked_at, self.expires_at) {
            (Some(_), _) => KeyState::Revoked,
            (None, Some(end)) if end <= now => KeyState::Expired,
            _ => KeyState::Active,
        }
    }

    /// Whether it is for the model of this name, which need not be well formed.
    #[must_use]
    pub fn covers(&self, model: &str) -> bool {
        self.models.as_ref().is_none_or(|models| models.iter().any(|own| own.as_str() == model))
    }
}

/// A key that somebody would like to have.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct KeyWish {
    /// For people.
    pub name: Option<String>,
    /// What it is to be used for.
    pub scopes: Scopes,
    /// The only models it is for; none: every model.
    pub models: Option<Vec<ModelName>>,
    /// When it stops by itself.
    pub expires_at: Option<Timestamp>,
}

/// Why there can be no such key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{member}: {detail}")]
pub struct KeyDefect {
    /// The member of the wish.
    pub member: &'static str,
    /// Stable name.
    pub code: &'static str,
    /// For a person.
    pub detail: String,
}

impl KeyWish {
    /// Checks what is wished for.
    ///
    /// # Errors
    /// Names the first member that cannot be.
    pub fn check(&self, now: Timestamp) -> Result<(), KeyDefect> {
        let refuse = |member, code, detail: &str| Err(KeyDefect { member, code, detail: detail.to_owned() });
        if self.scopes.is_empty() {
            return refuse("scopes", "empty", "at least one of predict, ingest, train, admin is needed");
        }
        let printable =
            |name: &String| (1..=MAX_NAME_CHARS).contains(&name.chars().count()) && !name.contains(char::is_control);
        if !self.name.as_ref().is_none_or(printable) {
            return refuse("name", "out_of_range", "1 to 128 characters without control characters are needed");
        }
        if let Some(models) = &self.models {
            if !(1..=MAX_MODELS).contains(&models.len()) {
                return refuse("models", "out_of_range", "1 to 64 models, or none for all of them");
            }
            if self.scopes.allow(Scope::Admin) {
                return refuse("models", "not_limited", "admin is for the whole server: such a key has no models");
            }
        }
        if self.expires_at.is_some_and(|end| end <= now) {
            return refuse("expires_at", "out_of_range", "it lies in the past");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(name: &str) -> ModelName {
        ModelName::parse(name).unwrap()
    }

    #[test]
    fn an_id_has_one_spelling() {
        let id = KeyId::parse("00ab00cd00ef0012").unwrap();
        assert_eq!(id.to_string(), "00ab00cd00ef0012");
        for bad in ["", "ab", "00AB00cd00ef0012", "+0ab00cd00ef0012", "00ab00cd00ef00123"] {
            assert_eq!(KeyId::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_key_ends_at_its_time_and_when_it_is_revoked() {
        let (before, end) = (Timestamp::from_second(9).unwrap(), Timestamp::from_second(10).unwrap());
        let key = Key {
            key_id: KeyId(1),
            name: None,
            scopes: Scopes::from_iter([Scope::Predict]),
            models: Some(vec![name("a")]),
            created_at: before,
            expires_at: Some(end),
            revoked_at: None,
        };
        assert_eq!((key.state(before), key.state(end)), (KeyState::Active, KeyState::Expired));
        assert!(key.covers("a") && !key.covers("b") && !key.covers(""));
        let revoked = Key { revoked_at: Some(before), models: None, ..key };
        assert_eq!(revoked.state(before), KeyState::Revoked);
        assert!(revoked.covers("b"));
    }

    #[test]
    fn a_wish_that_cannot_be_is_refused_by_member() {
        let now = Timestamp::from_second(10).unwrap();
        let good = KeyWish { scopes: Scopes::from_iter([Scope::Train]), ..KeyWish::default() };
        assert_eq!(good.check(now), Ok(()));
        let admin = Scopes::from_iter([Scope::Admin]);
        for (wish, member) in [
            (KeyWish::default(), "scopes"),
            (KeyWish { name: Some(String::new()), ..good.clone() }, "name"),
            (KeyWish { name: Some("a\nb".to_owned()), ..good.clone() }, "name"),
            (KeyWish { models: Some(Vec::new()), ..good.clone() }, "models"),
            (KeyWish { models: Some(vec![name("a"); 65]), ..good.clone() }, "models"),
            (KeyWish { models: Some(vec![name("a")]), scopes: admin, ..good.clone() }, "models"),
            (KeyWish { expires_at: Some(now), ..good.clone() }, "expires_at"),
        ] {
            assert_eq!(wish.check(now).unwrap_err().member, member);
        }
    }
}
