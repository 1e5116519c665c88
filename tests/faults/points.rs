use std::collections::BTreeMap;
use std::sync::Mutex;

use headway::store::Purpose;

use crate::SETTINGS;
use crate::life::{Life, let_in};
use crate::plan::Plan;
use crate::process::Home;
use crate::unsynced::Disk;

/// How often a process died where.
struct Points {
    hits: BTreeMap<String, u32>,
    /// Where the process that lives now is to die.
    chosen: Option<String>,
    left: u32,
    plan: Plan,
}

impl Points {
    fn new(plan: Plan) -> Self {
        let hits = Purpose::ALL
            .iter()
            .flat_map(|purpose| ["before", "after"].map(|side| format!("{}.{side}", purpose.as_str())));
        Self { hits: hits.map(|point| (point, 0)).collect(), chosen: None, left: 2 * plan.kills, plan }
    }

    /// The fail points of a process that follows one that died where it was to.
    fn next(&mut self) -> String {
        if let Some(point) = self.chosen.take() {
            *self.hits.get_mut(&point).unwrap() += 1;
            self.left -= 1;
        }
        if self.left == 0 {
            return String::new();
        }
        let fewest = *self.hits.values().min().unwrap();
        let points: Vec<_> = self.hits.iter().filter(|(_, hits)| **hits == fewest).map(|(point, _)| point).collect();
        let point = points[self.plan.below(points.len())].clone();
        // Not always the first time that it comes by.
        let passed = if self.plan.below(4) == 0 { 1 + self.plan.below(2) } else { 0 };
        self.chosen = Some(point.clone());
        if passed == 0 { format!("{point}=return") } else { format!("{point}={passed}*off->return") }
    }
}

/// Lives until every process that was to die has died, at all points about as often.
pub(crate) async fn all_points(test: u64, disk: Option<&Disk>) {
    // It asks again and again how far the server is.
    let eager = ["training.checkpoint_s=0.02", "upkeep.interval_s=0.1", "access.rate_requests=0"];
    let settings = [&SETTINGS[..], &eager].concat();
    let undisturbed = {
        let mut home = Home::new(&settings);
        let_in(&mut home);
        Life::begin(&home, None, String::new).await.live().await
    };
    let points = Mutex::new(Points::new(Plan::new(test)));
    while points.lock().unwrap().left > 0 {
        let mut home = disk.map_or_else(|| Home::new(&settings), |disk| disk.home(&settings));
        let_in(&mut home);
        let life = Life::begin(&home, disk, || points.lock().unwrap().next()).await;
        assert_eq!(life.live().await, undisturbed);
        // This one lived to its end.
        points.lock().unwrap().chosen = None;
    }
    let points = points.into_inner().unwrap();
    println!("{:#?}", points.hits);
    if 2 * points.plan.kills as usize >= points.hits.len() {
        assert!(points.hits.values().all(|&hits| hits > 0), "a point was never reached");
    }
}

#[tokio::test]
async fn a_life_comes_out_the_same_wherever_the_process_dies() {
    all_points(6, None).await;
}
