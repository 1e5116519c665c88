//! Every key, in memory, so that a request is let in without the database.

use std::collections::HashMap;
use std::sync::Arc;

use jiff::Timestamp;
use subtle::ConstantTimeEq;

use super::{AccessSettings, Key, KeyId, KeyState, Meters, Token};

/// A key, and what recognises its secret part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredKey {
    /// The key.
    pub key: Key,
    /// SHA-256 of its secret part.
    pub secret_sha256: [u8; 32],
}

/// Why nobody is let in by a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unrecognised {
    /// It is none of ours, whichever part of it is wrong.
    Unknown,
    /// It was one of ours until then. Only who has the secret part is told.
    Expired(Timestamp),
    /// It was one of ours until somebody ended it then. Only who has the secret part is told.
    Revoked(Timestamp),
}

/// A key, and how much it asked.
#[derive(Debug)]
pub struct Entry {
    /// The key.
    pub key: Arc<Key>,
    /// Its buckets.
    pub meters: Arc<Meters>,
    secret_sha256: [u8; 32],
}

/// Every key there is, those that have ended included.
#[derive(Debug, Default)]
pub struct KeyTable(HashMap<KeyId, Entry>);

impl KeyTable {
    /// The table of these keys after `self`: what each of them asked so far still counts.
    #[must_use]
    pub fn followed_by(&self, keys: impl IntoIterator<Item = StoredKey>, settings: &AccessSettings) -> Self {
        let entry = |StoredKey { key, secret_sha256 }: StoredKey| {
            let before = self.0.get(&key.key_id).map(|entry| Arc::clone(&entry.meters));
            let meters = before.unwrap_or_else(|| Arc::new(Meters::new(settings)));
            (key.key_id, Entry { key: Arc::new(key), meters, secret_sha256 })
        };
        Self(keys.into_iter().map(entry).collect())
    }

    /// Whether there has never been a key, so that whoever reaches the server may use it.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether there is such a key, and it has not ended.
    #[must_use]
    pub fn is_active(&self, key_id: KeyId) -> bool {
        self.0.get(&key_id).is_some_and(|entry| entry.key.state(Timestamp::now()) == KeyState::Active)
    }

    /// The active key that `text` is.
    ///
    /// # Errors
    /// When it is none. The secret part is compared in constant time.
    pub fn recognise(&self, text: &[u8]) -> Result<&Entry, Unrecognised> {
        let token = Token::parse(text).ok_or(Unrecognised::Unknown)?;
        let entry = self.0.get(&token.key_id).ok_or(Unrecognised::Unknown)?;
        let key = &entry.key;
        if !bool::from(token.secret_sha256().ct_eq(&entry.secret_sha256)) {
            return Err(Unrecognised::Unknown);
        }
        // Only for keys that end does the clock matter.
        let ends = key.expires_at.or(key.revoked_at);
        match ends.map_or(KeyState::Active, |_| key.state(Timestamp::now())) {
            KeyState::Active => Ok(entry),
            KeyState::Expired => Err(Unrecognised::Expired(key.expires_at.unwrap_or_default())),
            KeyState::Revoked => Err(Unrecognised::Revoked(key.revoked_at.unwrap_or_default())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{Class, Issued, Scope, Scopes};

    fn stored(issued: &Issued, expires_at: Option<Timestamp>, revoked_at: Option<Timestamp>) -> StoredKey {
        let key = Key {
            key_id: issued.key_id,
            name: None,
            scopes: Scopes::from_iter([Scope::Predict]),
            models: None,
            created_at: Timestamp::UNIX_EPOCH,
            expires_at,
            revoked_at,
        };
        StoredKey { key, secret_sha256: issued.secret_sha256 }
    }

    fn settings() -> AccessSettings {
        AccessSettings {
            key_file: std::path::PathBuf::new(),
            max_keys: 9,
            rate_window_s: 86_400,
            rate_requests: 1,
            rate_predictions: 0,
            refusal_log_s: 1.0,
        }
    }

    fn table<const N: usize>(keys: [StoredKey; N]) -> KeyTable {
        KeyTable::default().followed_by(keys, &settings())
    }

    #[test]
    fn what_a_key_asked_counts_after_other_keys_changed() {
        let [one, other] = std::array::from_fn(|_| Issued::draw().unwrap());
        let before = table([stored(&one, None, None)]);
        before.recognise(one.reveal().as_bytes()).unwrap().meters.take(Class::Default).unwrap();
        let after = before.followed_by([stored(&one, None, None), stored(&other, None, None)], &settings());
        let take = |key: &Issued| after.recognise(key.reveal().as_bytes()).unwrap().meters.take(Class::Default);
        assert!(take(&one).is_err() && take(&other).is_ok());
    }

    #[test]
    fn only_the_whole_key_is_recognised_and_only_its_owner_is_told_that_it_ended() {
        let [active, expired, revoked, foreign] = std::array::from_fn(|_| Issued::draw().unwrap());
        let past = Timestamp::from_second(1).unwrap();
        let table = table([
            stored(&active, Some(Timestamp::MAX), None),
            stored(&expired, Some(past), None),
            stored(&revoked, None, Some(past)),
        ]);
        let told = |text: &str| table.recognise(text.as_bytes()).map(|entry| entry.key.key_id);
        assert_eq!(told(active.reveal()), Ok(active.key_id));
        assert_eq!(told(expired.reveal()), Err(Unrecognised::Expired(past)));
        assert_eq!(told(revoked.reveal()), Err(Unrecognised::Revoked(past)));
        let still = [&active, &expired, &revoked, &foreign].map(|key| table.is_active(key.key_id));
        assert_eq!(still, [true, false, false, false]);
        for key in [&active, &expired, &revoked] {
            let forged = format!("hw_{}_{}", key.key_id, &foreign.reveal()[20..]);
            assert_eq!(told(&forged), Err(Unrecognised::Unknown));
        }
        for other in [foreign.reveal(), "", "x", &active.reveal()[..62]] {
            assert_eq!(told(other), Err(Unrecognised::Unknown));
        }
    }

    #[test]
    fn ended_keys_keep_the_server_closed() {
        assert!(KeyTable::default().is_open());
        let past = Timestamp::from_second(1).unwrap();
        let ended = stored(&Issued::draw().unwrap(), Some(past), Some(past));
        assert!(!table([ended]).is_open());
    }
}
