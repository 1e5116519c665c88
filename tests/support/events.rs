//! Made-up events: a leader on a wave, a follower that lags behind it.

use serde_json::{Value, json};

/// `count` events around `speed` m/s, told apart by `kind` and number; all for training but every fourth, for tests.
pub(crate) fn events(kind: &str, count: usize, speed: f64) -> Vec<Value> {
    (0..count).map(|i| event(&format!("{kind}-{i}"), speed, if i % 4 == 3 { "test" } else { "train" })).collect()
}

/// One event of 40 steps at 10 Hz. Of another name, it has other content.
pub(crate) fn event(name: &str, speed: f64, split: &str) -> Value {
    const STEPS: usize = 40;
    const DT_S: f64 = 0.1;
    let phase = phase(name);
    let wave = |step: usize, phase: f64| speed + (0.15 * step as f64 + phase).sin();
    let leader: Vec<f64> = (0..STEPS).map(|t| wave(t, phase)).collect();
    let follower: Vec<f64> = (0..STEPS).map(|t| wave(t, phase - 0.6)).collect();
    let mut spacing = vec![12.0 + speed + phase % 3.0];
    for t in 1..STEPS {
        let closing = f64::midpoint(leader[t - 1], leader[t]) - f64::midpoint(follower[t - 1], follower[t]);
        spacing.push(spacing[t - 1] + DT_S * closing);
    }
    json!({
        "event_id": name,
        "dt_s": DT_S,
        "split": split,
        "spacing_m": spacing,
        "follower_speed_mps": follower,
        "leader_speed_mps": leader,
    })
}

/// Some angle, another one for another name.
fn phase(name: &str) -> f64 {
    // FNV-1a: the same on every machine and in every release.
    let hash = name.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    f64::from(hash) / f64::from(u32::MAX) * std::f64::consts::TAU
}

/// A window of `steps` steps.
pub(crate) fn window(steps: usize, speed: f64) -> Value {
    json!({
        "follower_speed_mps": vec![speed; steps],
        "leader_speed_mps": vec![speed; steps],
        "spacing_m": vec![20.0; steps],
    })
}
