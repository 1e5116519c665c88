//! Sources whose events keep failing the checks.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::store::{StoreError, WriteTransaction, source};

/// When a source is held.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SourceSettings {
    /// So many of its last events are looked at.
    pub window: u32,
    /// It is held when more than this share of them failed.
    pub failed_share: f64,
    /// And no less than so many were looked at.
    pub min_events: u32,
    /// Sources that one upload may name and that are looked at; what comes from further ones is not.
    pub max_sources: u32,
}

impl Default for SourceSettings {
    fn default() -> Self {
        Self { window: 500, failed_share: 0.5, min_events: 50, max_sources: 1000 }
    }
}

impl SourceSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 4] {
        [
            ("window", self.window.into(), 1.0..=100_000.0),
            ("failed_share", self.failed_share, 0.0..=1.0),
            ("min_events", self.min_events.into(), 1.0..=100_000.0),
            ("max_sources", self.max_sources.into(), 1.0..=1e6),
        ]
    }

    /// Why a source whose last events fared so is to be held; none when it is not.
    fn objection(&self, outcomes: &str) -> Option<String> {
        let failed = outcomes.bytes().filter(|&outcome| outcome == b'0').count();
        let seen = outcomes.len();
        let too_many = failed as f64 > self.failed_share * seen as f64;
        (seen >= self.min_events as usize && too_many)
            .then(|| format!("{failed} of its last {seen} events failed the checks"))
    }
}

/// The sources of one upload.
pub(super) struct Sources {
    model_id: i64,
    settings: SourceSettings,
    seen: BTreeMap<String, Seen>,
}

struct Seen {
    outcomes: String,
    held: bool,
}

impl Sources {
    pub(super) fn new(model_id: i64, settings: SourceSettings) -> Self {
        Self { model_id, settings, seen: BTreeMap::new() }
    }

    /// Whether the source is held, and one more outcome of its checks.
    pub(super) async fn note(
        &mut self,
        transaction: &mut WriteTransaction,
        name: &str,
        passed: bool,
    ) -> Result<bool, StoreError> {
        if !self.seen.contains_key(name) {
            if self.seen.len() >= self.settings.max_sources as usize {
                return Ok(false);
            }
            let known = source::get(transaction, self.model_id, name).await?;
            let seen = known.map_or(Seen { outcomes: String::new(), held: false }, |known| Seen {
                outcomes: known.outcomes,
                held: known.held_at.is_some(),
            });
            self.seen.insert(name.to_owned(), seen);
        }
        let window = self.settings.window as usize;
        let Some(seen) = self.seen.get_mut(name) else { return Ok(false) };
        seen.outcomes.push(if passed { '1' } else { '0' });
        // Cut now and then: a string loses its beginning in the time of its length.
        if seen.outcomes.len() >= 2 * window {
            seen.outcomes.drain(..seen.outcomes.len() - window);
        }
        Ok(seen.held)
    }

    /// Keeps how the sources fared and holds those that failed too often. Gives the names of all that are held.
    pub(super) async fn end(
        self,
        transaction: &mut WriteTransaction,
        now: Timestamp,
    ) -> Result<Vec<String>, StoreError> {
        let mut held = Vec::new();
        for (name, seen) in self.seen {
            let from = seen.outcomes.len().saturating_sub(self.settings.window as usize);
            let outcomes = &seen.outcomes[from..];
            source::note(transaction, self.model_id, &name, outcomes).await?;
            if !seen.held
                && let Some(reason) = self.settings.objection(outcomes)
            {
                source::hold(transaction, self.model_id, &name, &reason, now).await?;
                tracing::warn!(model_id = self.model_id, source = name, reason, "a source is held");
                held.push(name);
            } else if seen.held {
                held.push(name);
            }
        }
        Ok(held)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_held_when_enough_was_seen_and_too_much_of_it_failed() {
        let settings = SourceSettings { min_events: 4, failed_share: 0.5, ..SourceSettings::default() };
        for (outcomes, held) in [("", false), ("000", false), ("0011", false), ("0001", true), ("00011", true)] {
            assert_eq!(settings.objection(outcomes).is_some(), held, "{outcomes}");
        }
        let all = SourceSettings { failed_share: 1.0, min_events: 1, ..settings };
        assert_eq!(all.objection("0000"), None, "a share of 1 holds nothing");
    }
}
