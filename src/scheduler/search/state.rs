//! Where a search stands, as bytes of the task's checkpoint.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::consolidation::searched_strengths;
use crate::evaluation::Errors;
use crate::scheduler::stage::Validated;
use crate::training::{LearnError, StageInput, stage_fingerprint};

const MAGIC: &[u8; 8] = b"HWSRCH01";

/// What one network came to on the validation events of every regime.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Row {
    /// One a regime; without steps where it has no events.
    Measured(Vec<Errors>),
    /// There was no network to drive.
    Diverged { update: u64, detail: String },
}

impl Row {
    pub(super) fn measured(&self) -> Option<&[Errors]> {
        match self {
            Self::Measured(errors) => Some(errors),
            Self::Diverged { .. } => None,
        }
    }

    pub(super) fn divergence(&self) -> Option<LearnError> {
        match self {
            Self::Measured(_) => None,
            Self::Diverged { update, detail } => Some(LearnError::Diverged { update: *update, detail: detail.clone() }),
        }
    }
}

/// What is done, and where the stage under way goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchState {
    /// Of everything the search depends on.
    fingerprint: [u8; 32],
    /// The parent, the stage without a penalty, and the candidates, as far as they are done.
    pub(super) rows: Vec<Row>,
    /// The checkpoint of the next stage, where it has begun.
    pub(super) stage: Option<Vec<u8>>,
}

impl SearchState {
    /// Before anything was measured.
    #[must_use]
    pub fn begin(fingerprint: [u8; 32]) -> Self {
        Self { fingerprint, rows: Vec::new(), stage: None }
    }

    /// The checkpoint of the next stage, where it has begun.
    #[must_use]
    pub fn stage(&self) -> Option<&[u8]> {
        self.stage.as_deref()
    }

    /// With `stage` for the checkpoint of the next stage; empty before its first.
    #[must_use]
    pub fn to_bytes(&self, stage: &[u8]) -> Vec<u8> {
        let rows = serde_json::to_vec(&self.rows).expect("errors are plain data");
        let mut bytes = MAGIC.to_vec();
        bytes.extend(self.fingerprint);
        bytes.extend((rows.len() as u64).to_le_bytes());
        bytes.extend(rows);
        bytes.extend(stage);
        bytes
    }

    /// The state in `bytes`, which must belong to the search of this fingerprint.
    ///
    /// # Errors
    /// Why they are none, for a person.
    pub fn from_bytes(bytes: &[u8], fingerprint: [u8; 32]) -> Result<Self, String> {
        let short = || "it is too short".to_owned();
        let (magic, rest) = bytes.split_first_chunk::<8>().ok_or_else(short)?;
        if magic != MAGIC {
            return Err("it is of another format".to_owned());
        }
        let (found, rest) = rest.split_first_chunk::<32>().ok_or_else(short)?;
        if *found != fingerprint {
            return Err("it belongs to other events, settings or parent".to_owned());
        }
        let (length, rest) = rest.split_first_chunk::<8>().ok_or_else(short)?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| short())?;
        let (rows, stage) = rest.split_at_checked(length).ok_or_else(short)?;
        let rows = serde_json::from_slice(rows).map_err(|error| error.to_string())?;
        Ok(Self { fingerprint, rows, stage: (!stage.is_empty()).then(|| stage.to_vec()) })
    }
}

/// Digest of everything the search depends on: the stage, the strengths and the events they are driven on.
pub(super) fn fingerprint(input: &StageInput<'_>, validated: &[Validated]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    hasher.update(stage_fingerprint(input));
    for strength in searched_strengths(input.method) {
        hasher.update(strength.to_le_bytes());
    }
    for of in validated {
        hasher.update((of.regime.as_str().len() as u64).to_le_bytes());
        hasher.update(of.regime.as_str());
        hasher.update((of.events.len() as u64).to_le_bytes());
        for event in &of.events {
            hasher.update(event.content_sha256());
        }
    }
    hasher.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_survives_its_bytes_and_refuses_strangers() {
        let errors = Errors { spacing_sq: 0.1 + 0.2, speed_sq: 1e-9, collisions: 2, events: 3, steps: 40 };
        let diverged = Row::Diverged { update: 7, detail: "as told".to_owned() };
        let rows = vec![Row::Measured(vec![errors, Errors::default()]), diverged];
        let mut state = SearchState { rows, ..SearchState::begin([7; 32]) };
        assert_eq!(SearchState::from_bytes(&state.to_bytes(&[]), [7; 32]).as_ref(), Ok(&state));
        let bytes = state.to_bytes(&[1, 2, 3]);
        state.stage = Some(vec![1, 2, 3]);
        assert_eq!(SearchState::from_bytes(&bytes, [7; 32]), Ok(state));
        assert!(SearchState::from_bytes(&bytes, [8; 32]).is_err());
        assert!(SearchState::from_bytes(&bytes[..60], [7; 32]).is_err());
        assert!(SearchState::from_bytes(b"HWCKPT03", [7; 32]).is_err());
        assert!(SearchState::from_bytes(b"", [7; 32]).is_err());
    }
}
