use headway::car_following::{TrafficRegime, TrafficSettings, generate};
use serde_json::json;

/// Lines of NDJSON, one event each; other seeds give other events.
pub(crate) fn lines(regime: TrafficRegime, seed: u64, events: usize) -> Vec<String> {
    let settings = TrafficSettings { dt_s: 0.1, min_steps: 40, max_steps: 40 };
    let line = |generated: headway::car_following::GeneratedEvent| {
        let event = &generated.event;
        let line = json!({
            "event_id": generated.event_id,
            "dt_s": event.dt_s(),
            "spacing_m": event.spacing_m(),
            "follower_speed_mps": event.follower_speed_mps(),
            "leader_speed_mps": event.leader_speed_mps(),
        });
        format!("{line}\n")
    };
    generate(regime, seed, events, &settings).into_iter().map(line).collect()
}
