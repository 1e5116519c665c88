//! Who may do what: keys, what each may be used for, and whether a request brings one. No I/O but the system's randomness.

/// What a key is and may.
mod key;
/// How much one key may ask.
mod meter;
/// Words for what may be done.
mod scope;
/// Limits.
mod settings;
/// Every key, to be recognised.
mod table;
/// A key as its owner has it.
mod token;

pub use key::{Key, KeyDefect, KeyId, KeyState, KeyWish};
pub use meter::{Class, Meters, Policy, Standing, TooMany};
pub use scope::{Scope, Scopes};
pub use settings::AccessSettings;
pub use table::{Entry, KeyTable, StoredKey, Unrecognised};
pub use token::{Issued, Token};
