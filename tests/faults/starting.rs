use std::time::{Duration, Instant};

use crate::SETTINGS;
use crate::plan::Plan;
use crate::process::Home;

#[tokio::test]
async fn a_process_that_dies_while_it_makes_its_database_leaves_one_that_the_next_can_use() {
    let mut plan = Plan::new(2);
    let began = Instant::now();
    drop(Home::new(&SETTINGS).start());
    let usual = began.elapsed();
    for _ in 0..plan.kills {
        let home = Home::new(&SETTINGS);
        let until = usual.mul_f64(plan.share());
        let (mut child, began) = (home.spawn(), Instant::now());
        while began.elapsed() < until.max(Duration::from_millis(1)) {
            std::hint::spin_loop();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let process = home.start();
        assert_eq!(process.list("/v1/models", "models").await.len(), 1);
    }
}
