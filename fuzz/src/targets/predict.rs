use std::sync::LazyLock;

use headway::config::Config;
use headway::driver::{Driver, DriverShape, Features, Scaling, Window};
use headway::http::reading::{simulation, windows};
use headway::http::{Code, ServerSettings};
use headway::lstm::initial_weights;
use serde_json::{Value, json};

const HORIZON: usize = 5;
/// Greatest number taken, m or m/s.
const GREATEST: f32 = 1e6;

static SETTINGS: LazyLock<ServerSettings> = LazyLock::new(|| {
    let config = Config::resolve([]).expect("the defaults are usable");
    ServerSettings { predict_windows_max: 20, simulate_steps_max: 50, errors_max: 4, ..config.server }
});

static DRIVER: LazyLock<Driver> = LazyLock::new(|| {
    let shape = DriverShape { hidden: 4, horizon: HORIZON, features: Features::Raw, ..DriverShape::PAPER };
    let (mean, spread) = ([8.0, 8.5, 0.3, 14.0], [3.0, 3.5, 1.2, 5.0]);
    let scaling = Scaling { mean, spread, low: [0.0; 4], high: [40.0; 4], motion: None };
    Driver::new(shape, scaling, initial_weights(shape.layout(), 1)).expect("the weights fit")
});

/// A body that is taken holds whole windows of usable numbers; what the network makes of them is finite.
pub(super) fn run(data: &[u8]) {
    // A number is one of at least two bytes, and is kept in four, with room to grow; what is wrong is told a few times.
    let settings = &*SETTINGS;
    let most = 64 * data.len() as u64 + (64 << 10);
    match super::within(most, || windows(data, HORIZON, settings)) {
        Ok(windows) => {
            assert!((1..=20).contains(&windows.len()));
            windows.iter().for_each(usable);
            assert!(DRIVER.accelerations(&windows).iter().all(|accel_mps2| accel_mps2.is_finite()));
            let body = json!({"windows": windows.iter().map(shown).collect::<Vec<_>>()}).to_string();
            let again = self::windows(body.as_bytes(), HORIZON, settings).expect("what was read can be read");
            assert_eq!(windows.iter().map(shown).collect::<Vec<_>>(), again.iter().map(shown).collect::<Vec<_>>());
        }
        Err(code) => refused(data, code),
    }
    match super::within(most, || simulation(data, HORIZON, settings)) {
        Ok((window, leader_speed_mps)) => {
            assert!((1..=50).contains(&leader_speed_mps.len()));
            usable(&window);
            assert!(leader_speed_mps.iter().all(|v| v.abs() <= GREATEST));
        }
        Err(code) => refused(data, code),
    }
}

fn usable(window: &Window) {
    for values in [&window.follower_speed_mps, &window.leader_speed_mps, &window.spacing_m] {
        assert_eq!(values.len(), HORIZON);
        assert!(values.iter().all(|value| value.abs() <= GREATEST), "{values:?}");
    }
}

fn shown(window: &Window) -> Value {
    json!({
        "follower_speed_mps": window.follower_speed_mps,
        "leader_speed_mps": window.leader_speed_mps,
        "spacing_m": window.spacing_m,
    })
}

/// What is JSON is not called malformed.
fn refused(data: &[u8], code: Code) {
    assert!(matches!(code, Code::MalformedJson | Code::InvalidBody), "{code:?}");
    if serde_json::from_slice::<Value>(data).is_ok() {
        assert_eq!(code, Code::InvalidBody);
    }
}
