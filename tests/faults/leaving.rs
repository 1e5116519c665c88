use std::time::{Duration, Instant};

use serde_json::json;

use crate::SETTINGS;
use crate::moves::{MODEL, predictions, with_versions};
use crate::process::Home;
use crate::wire::Wire;

#[tokio::test]
async fn a_promotion_whose_client_goes_away_is_served() {
    let home = Home::new(&[&SETTINGS[..], &["model.schedule=manual", "model.epochs=1"]].concat());
    drop(with_versions(&home).await);
    // Between the commit and what follows it there is time to see the commit, and to go away.
    let process = home.start_failing("promoted.after=sleep(1000)").unwrap();
    let wire =
        Wire::post(&process, &format!("{MODEL}/promote"), "leaving", &json!({"version": 1, "reason": "leaving"}));
    let began = Instant::now();
    while process.get(MODEL).await["live"] != 1 {
        assert!(began.elapsed() < Duration::from_mins(1), "version 1 is not live");
    }
    drop(wire);
    while predictions(&process).await.1["version"] != 1 {
        assert!(began.elapsed() < Duration::from_mins(1), "version 1 is live and does not serve");
    }
}
