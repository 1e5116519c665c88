//! An upload's way from a body to stored events: spooled, decoded, checked and stored in one transaction; or only looked at.

mod decode;
mod error;
mod examine;
mod options;
mod receipt;
mod receive;
mod settings;
mod sources;
mod spool;
#[cfg(test)]
mod tests;
mod upload;

pub use error::IngestError;
pub use examine::{Examined, examine};
pub use options::{OptionError, SpacingKind, UploadOptions};
pub use receipt::{Receipt, SpeedRange, Summary};
pub use receive::{Received, receive};
pub use settings::{IngestSettings, IngestSettingsError};
pub use sources::SourceSettings;
pub use spool::{Interrupted, Spool, SpoolError, Spooled, spool};
pub use upload::Upload;
