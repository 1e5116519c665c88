//! Colours that the colour-blind tell apart (Okabe & Ito 2008), and dashes for prints without any.

use super::svg::Stroke;

const TASKS: [&str; 6] = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"];
const DASHES: [&str; 4] = ["", "7 3", "2 3", "9 3 2 3"];

/// Of the task at this place.
pub(super) fn task(place: usize) -> Stroke {
    Stroke { color: TASKS[place % TASKS.len()], width: 2.0, dash: DASHES[place / TASKS.len() % DASHES.len()] }
}

/// Of a method or reference by its name; what is recorded is black.
pub(super) fn model(name: &str) -> Stroke {
    let (color, dash) = match name {
        "joint" => ("#666666", ""),
        "naive" => ("#D55E00", "7 3"),
        "ewc" => ("#0072B2", ""),
        "mas" => ("#009E73", "9 3 2 3"),
        "si" => ("#CC79A7", ""),
        "replay" => ("#E69F00", ""),
        "replay_ewc" => ("#56B4E9", "7 3"),
        "replay_mas" => ("#8A7A00", "2 3"),
        "idm" => ("#999999", "2 3"),
        _ => ("#000000", ""),
    };
    Stroke { color, width: 2.0, dash }
}

/// White to deep blue, and the ink that can be read on it; `share` from 0 to 1.
pub(super) fn heat(share: f64) -> (String, &'static str) {
    let mix = |from: f64, to: f64| (from + (to - from) * share.clamp(0.0, 1.0)) as u8;
    let color = format!("#{:02x}{:02x}{:02x}", mix(247.0, 8.0), mix(251.0, 69.0), mix(255.0, 148.0));
    (color, if share > 0.55 { "#fff" } else { "#111" })
}
