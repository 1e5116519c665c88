//! Lines to paste into a shell, and the window they ask about.

use serde_json::{Value, json};

/// Ten steps of 0.1 s: a driver at 18 m/s closes in on a leader at 16 m/s.
pub(super) fn window() -> Value {
    let (follower_speed_mps, leader_speed_mps) = ([18; 10], [16; 10]);
    let spacing_m = [25.0, 24.8, 24.6, 24.4, 24.2, 24.0, 23.8, 23.6, 23.4, 23.2];
    json!({"follower_speed_mps": follower_speed_mps, "leader_speed_mps": leader_speed_mps, "spacing_m": spacing_m})
}

/// Predict with the live version, see what the naive model forgot, see who served when and why.
pub(super) fn lines(url: &str) -> [String; 3] {
    let ask = json!({"windows": [window()]});
    [
        format!("curl -s {url}/v1/models/ewc/predict -H 'Content-Type: application/json' -d '{ask}'"),
        format!("curl -s {url}/v1/models/naive/versions/3/evaluation"),
        format!("curl -s {url}/v1/models/ewc/history"),
    ]
}
