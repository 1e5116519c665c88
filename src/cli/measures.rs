//! How versions and drivers do, regime by regime, as a table.

use serde_json::Value;

use super::member::{number, text};
use super::table::table;

/// A row for each regime of each, where `who` names them: `tasks` of an evaluation.
pub(super) fn measures(of: &[(String, &Value)]) -> String {
    let rows = of.iter().flat_map(|(who, tasks)| {
        tasks.as_array().into_iter().flatten().map(move |task| {
            vec![
                who.clone(),
                text(&task["regime"]),
                text(&task["events"]),
                number(&task["spacing_mse"], 3),
                number(&task["speed_mse"], 4),
                number(&task["collision_rate_percent"], 1),
                number(&task["forgetting_ratio"], 2),
            ]
        })
    });
    let head = ["DRIVER", "REGIME", "EVENTS", "SPACING_MSE_M2", "SPEED_MSE", "COLLISIONS_%", "FORGETTING"];
    table(&head, rows.collect())
}
