//! When a new version goes live by itself.

use serde::{Deserialize, Serialize};

use super::{RegimeName, TestMeasures};

/// A model's policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PromotionPolicy {
    /// Always.
    Auto,
    /// When no regime collides more, nor errs beyond a factor, than with the live version.
    Gated,
    /// Never.
    Manual,
}

/// What the policy said of a version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PromotionDecision {
    /// It went live when it was made.
    Promoted,
    /// It was kept, not served.
    Kept,
}

/// The decision and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Promotion {
    /// The policy in force.
    pub policy: PromotionPolicy,
    /// What it decided.
    pub decision: PromotionDecision,
    /// For a person.
    pub reason: String,
}

/// The new and the live version on the same test events of one regime.
#[derive(Debug, Clone, PartialEq)]
pub struct RegimeComparison {
    /// The regime.
    pub regime: RegimeName,
    /// The new version's measures.
    pub new: TestMeasures,
    /// The live version's.
    pub live: TestMeasures,
}

impl PromotionPolicy {
    /// Decides about a new version. `comparisons` is `None` when nothing is live.
    #[must_use]
    pub fn decide(self, comparisons: Option<&[RegimeComparison]>, error_ratio: f64) -> Promotion {
        let (decision, reason) = match (self, comparisons) {
            (Self::Manual, _) => (PromotionDecision::Kept, "the policy is manual".to_owned()),
            (Self::Auto, _) => (PromotionDecision::Promoted, "the policy is auto".to_owned()),
            (Self::Gated, None) => (PromotionDecision::Promoted, "nothing was live".to_owned()),
            (Self::Gated, Some(comparisons)) => match objections(comparisons, error_ratio) {
                objections if objections.is_empty() => (
                    PromotionDecision::Promoted,
                    format!("on {} regimes no worse than the live version", comparisons.len()),
                ),
                objections => (PromotionDecision::Kept, objections.join("; ")),
            },
        };
        Promotion { policy: self, decision, reason }
    }

    /// Decides about a version that comes from elsewhere, `from` there: with it come no test events to judge it on. `tainted`:
    /// there it has learned what was retracted.
    #[must_use]
    pub fn of_import(self, from: &str, live: Option<i64>, tainted: bool) -> Promotion {
        let (decision, reason) = match (self, live) {
            _ if tainted => (PromotionDecision::Kept, "it has learned what was retracted there".to_owned()),
            (Self::Manual, _) => (PromotionDecision::Kept, "the policy is manual".to_owned()),
            (Self::Auto, _) => (PromotionDecision::Promoted, "the policy is auto".to_owned()),
            (Self::Gated, None) => (PromotionDecision::Promoted, "nothing was live".to_owned()),
            (Self::Gated, Some(live)) => (
                PromotionDecision::Kept,
                format!("not judged against version {live}, because no test events came with it"),
            ),
        };
        Promotion { policy: self, decision, reason: format!("{from}; {reason}") }
    }
}

fn objections(comparisons: &[RegimeComparison], error_ratio: f64) -> Vec<String> {
    let mut objections = Vec::new();
    for RegimeComparison { regime, new, live } in comparisons {
        if new.collisions > live.collisions {
            objections.push(format!(
                "{regime}: {} of {} test events collide, {} with the live version",
                new.collisions, new.events, live.collisions
            ));
        }
        for (what, new, live) in
            [("spacing", new.spacing_mse, live.spacing_mse), ("speed", new.speed_mse, live.speed_mse)]
        {
            if new > error_ratio * live {
                objections.push(format!(
                    "{regime}: {what} MSE {new:.3} exceeds {error_ratio} × the live version's {live:.3}"
                ));
            }
        }
    }
    objections
}

#[cfg(test)]
mod tests {
    use super::*;

    fn comparison(new_mse: f64, new_collisions: u32) -> RegimeComparison {
        let live = TestMeasures { spacing_mse: 10.0, speed_mse: 1.0, collisions: 1, events: 100, steps: 14_000 };
        RegimeComparison {
            regime: RegimeName::parse("fast").unwrap(),
            new: TestMeasures { spacing_mse: new_mse, collisions: new_collisions, ..live },
            live,
        }
    }

    #[test]
    fn gated_keeps_what_collides_more_or_errs_beyond_the_ratio() {
        let decide = |c: RegimeComparison| PromotionPolicy::Gated.decide(Some(&[c]), 1.1).decision;
        assert_eq!(decide(comparison(11.0, 1)), PromotionDecision::Promoted);
        assert_eq!(decide(comparison(11.1, 1)), PromotionDecision::Kept);
        assert_eq!(decide(comparison(5.0, 2)), PromotionDecision::Kept);
    }

    #[test]
    fn what_comes_from_elsewhere_is_not_judged() {
        let decide = |policy: PromotionPolicy, live, tainted| policy.of_import("a file", live, tainted).decision;
        assert_eq!(decide(PromotionPolicy::Gated, None, false), PromotionDecision::Promoted);
        assert_eq!(decide(PromotionPolicy::Gated, Some(2), false), PromotionDecision::Kept);
        assert_eq!(decide(PromotionPolicy::Auto, Some(2), false), PromotionDecision::Promoted);
        assert_eq!(decide(PromotionPolicy::Manual, None, false), PromotionDecision::Kept);
        assert_eq!(decide(PromotionPolicy::Auto, None, true), PromotionDecision::Kept);
    }

    #[test]
    fn the_first_version_goes_live_unless_the_policy_is_manual() {
        assert_eq!(PromotionPolicy::Gated.decide(None, 1.1).decision, PromotionDecision::Promoted);
        assert_eq!(PromotionPolicy::Manual.decide(None, 1.1).decision, PromotionDecision::Kept);
    }
}
