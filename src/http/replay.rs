//! What a replay came to, as a task and the history tell it.

use serde_json::{Value, json};

use super::versions::driven_body;
use crate::lineage::{ReplayReport, ReplayedRegimes};

/// The report of a replay.
pub(super) fn report_body(report: &ReplayReport) -> Value {
    json!({
        "before": report.before,
        "after": report.after,
        "stages": report.stages,
        "regimes": report.regimes.iter().map(regime_body).collect::<Vec<_>>(),
        "live": report.live,
    })
}

fn regime_body(regime: &ReplayedRegimes) -> Value {
    let driven = regime.before.or(regime.after);
    json!({
        "regime": regime.regime,
        "events": driven.map_or(0, |measures| measures.events),
        "before": driven_body(regime.before.as_ref()),
        "after": driven_body(regime.after.as_ref()),
    })
}
