//! What consolidation keeps, one anchor at a time, as it is stored: for a file, which need not be in memory as a whole.

use sqlx::{Row, query};

use super::column::{count, digest, sha256};
use super::version::ROLL_BACK;
use super::{Part, Store, StoreError};

/// What is kept of one regime; both arrays little-endian f32, one value a weight.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeptAnchor {
    /// Supervised steps behind the importance.
    pub samples: u64,
    /// Diagonal importance.
    pub importance: Vec<u8>,
    /// The weights it is anchored at.
    pub anchor: Vec<u8>,
    /// Over importance, then anchor.
    pub sha256: [u8; 32],
}

impl Store {
    /// What is kept under this id; never what its digest does not match.
    ///
    /// # Errors
    /// When the database cannot be read, or what it holds is not what was written.
    pub async fn kept_anchor(&self, anchor_id: i64) -> Result<KeptAnchor, StoreError> {
        let row = query("select samples, importance, weights, anchor_sha256 from anchor where anchor_id = ?")
            .bind(anchor_id)
            .fetch_optional(&self.readers)
            .await?;
        let row = row.ok_or_else(|| StoreError::malformed("anchor", format!("anchor {anchor_id} is missing")))?;
        let (importance, anchor): (Vec<u8>, Vec<u8>) = (row.try_get("importance")?, row.try_get("weights")?);
        let known = digest(&row, "anchor_sha256")?;
        if sha256(&[&importance, &anchor]) != known {
            let detail = format!("what is kept of a regime is corrupt: its digest does not match; {ROLL_BACK}");
            return Err(StoreError::corrupt(Part::Anchor, detail));
        }
        Ok(KeptAnchor { samples: count(&row, "samples")?, importance, anchor, sha256: known })
    }
}
