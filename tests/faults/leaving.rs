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
    // Long enough for the client to be gone when the commit is done, and what follows it is due.
    let process = home.start_failing("promoted.after=sleep(300)").unwrap();
    let wish = json!({"version": 1, "reason": "leaving"});
    drop(Wire::post(&process, &format!("{MODEL}/promote"), "leaving", &wish));
    let began = Instant::now();
    while process.get(MODEL).await["live"] != 1 || predictions(&process).await.1["version"] != 1 {
        assert!(began.elapsed() < Duration::from_mins(1), "version 1 is live and does not serve");
    }
}
