//! A key as its owner has it: `hw_`, sixteen hexadecimal digits that name it, `_`, and 256 random bits as 43 characters of
//! base64url. The prefix lets scanners for leaked secrets find one.

use std::fmt;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest, Sha256};

use super::KeyId;

const PREFIX: &[u8] = b"hw_";
const ID_BYTES: usize = 16;
const SECRET_BYTES: usize = 43;

/// What somebody sent as a key, well formed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Token<'a> {
    /// The key it claims to be.
    pub key_id: KeyId,
    secret: &'a [u8],
}

impl<'a> Token<'a> {
    /// Reads a key; `None` when it does not look like one.
    #[must_use]
    pub fn parse(text: &'a [u8]) -> Option<Self> {
        let (id, rest) = text.strip_prefix(PREFIX)?.split_at_checked(ID_BYTES)?;
        let secret = rest.strip_prefix(b"_")?;
        let well_formed = secret.len() == SECRET_BYTES
            && secret.iter().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_'));
        let key_id = KeyId::parse(std::str::from_utf8(id).ok()?)?;
        well_formed.then_some(Self { key_id, secret })
    }

    /// SHA-256 of the secret part: all that is kept of it.
    ///
    /// A slow hash would protect nothing: it helps secrets that people think of and that can be guessed, and nobody guesses
    /// 256 random bits. This one costs every request next to nothing.
    #[must_use]
    pub fn secret_sha256(&self) -> [u8; 32] {
        Sha256::digest(self.secret).into()
    }
}

impl fmt::Debug for Token<'_> {
    /// Without the secret: what can be printed ends up in a log.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Token").field("key_id", &self.key_id).finish_non_exhaustive()
    }
}

/// A new key, before it is shown to its owner for the only time.
#[derive(Clone, PartialEq, Eq)]
pub struct Issued {
    /// Its public part.
    pub key_id: KeyId,
    /// What recognises its secret part.
    pub secret_sha256: [u8; 32],
    text: String,
}

impl Issued {
    /// Draws a key from the system's randomness.
    ///
    /// # Errors
    /// When the system has none to give.
    pub fn draw() -> Result<Self, getrandom::Error> {
        let (mut id, mut secret) = ([0; 8], [0; 32]);
        getrandom::fill(&mut id)?;
        getrandom::fill(&mut secret)?;
        let text = format!("hw_{}_{}", hex::encode(id), URL_SAFE_NO_PAD.encode(secret));
        Ok(Self::read(&text).expect("it was written just so"))
    }

    /// A key that somebody else drew; `None` when it does not look like one.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let token = Token::parse(text.as_bytes())?;
        Some(Self { key_id: token.key_id, secret_sha256: token.secret_sha256(), text: text.to_owned() })
    }

    /// The whole key, secret part included, for its owner alone.
    #[must_use]
    pub fn reveal(&self) -> &str {
        &self.text
    }
}

impl fmt::Debug for Issued {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Issued").field("key_id", &self.key_id).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawn_key_is_read_back_and_no_two_are_alike() {
        let (one, other) = (Issued::draw().unwrap(), Issued::draw().unwrap());
        let token = Token::parse(one.reveal().as_bytes()).unwrap();
        assert_eq!((token.key_id, token.secret_sha256()), (one.key_id, one.secret_sha256));
        assert_ne!((one.key_id, one.secret_sha256), (other.key_id, other.secret_sha256));
        assert_eq!(Issued::read(one.reveal()), Some(one));
    }

    #[test]
    fn nothing_else_reads_as_a_key() {
        let good = format!("hw_0123456789abcdef_{}", "A".repeat(43));
        assert!(Token::parse(good.as_bytes()).is_some());
        for bad in [
            String::new(),
            "hw_".to_owned(),
            good.replace("hw_", "HW_"),
            good.replace("abcdef", "ABCDEF"),
            good.replace("f_A", "fAA"),
            good.replace("AA", "A"),
            format!("{good}A"),
            format!(" {good}"),
            format!("{}=", &good[..good.len() - 1]),
            format!("{}é", &good[..good.len() - 2]),
        ] {
            assert_eq!(Token::parse(bad.as_bytes()), None, "{bad}");
        }
    }

    #[test]
    fn neither_a_token_nor_a_new_key_prints_its_secret() {
        let key = Issued::draw().unwrap();
        let secret = &key.reveal()[20..];
        let printed = format!("{key:?} {:?}", Token::parse(key.reveal().as_bytes()));
        assert!(printed.contains(&key.key_id.to_string()) && !printed.contains(secret), "{printed}");
    }
}
