//! How safely every model drives where it is hard: the stress set and a platoon.

use serde::Serialize;

use super::results::{Learnt, Results};
use super::work::Work;
use crate::car_following::Event;
use crate::evaluation::{CalibrationSettings, calibrate, drive_events};
use crate::reference::ReferenceKind;
use crate::safety::{Envelope, Platoon, SafetyReport, StressSettings, assess, markdown, stress_set};

/// One driver's report.
#[derive(Debug, Serialize)]
pub(super) struct Assessed {
    pub(super) driver: String,
    #[serde(flatten)]
    pub(super) report: SafetyReport,
}

/// The last stage of every method (first seed), alone and as served, and the IDM.
pub(super) fn assessed(work: &Work<'_>, results: &Results, with_idm: bool) -> anyhow::Result<Vec<Assessed>> {
    let settings = &work.options.settings;
    let horizon = settings.horizon as usize;
    let set = stress_set(&StressSettings::published(settings.dt_s, horizon));
    let platoon = Platoon::published(settings.dt_s, horizon);
    let mut assessed = Vec::new();
    for learnt in &results.methods {
        let name = learnt.method.as_str();
        work.progress.say(&format!("driving {name} on the stress set"));
        for (driver, envelope) in [(name.to_owned(), false), (format!("{name}, served"), true)] {
            let mut drive = |events: &[Event]| drive(work, learnt, envelope, events);
            assessed.push(Assessed { driver, report: assess(&set, horizon, &platoon, &mut drive) });
        }
    }
    if with_idm {
        // One driver for all traffic, as the networks are.
        let told = format!("reference idm of all tasks {horizon}");
        let values = work.kept(&told, "reference", || {
            let train: Vec<&Event> = work.plan.tasks.iter().flat_map(|task| &task.train).collect();
            let settings = CalibrationSettings::default();
            Ok(calibrate(ReferenceKind::Idm, horizon, &train, &settings, &work.workers).driver.values())
        })?;
        let idm = ReferenceKind::Idm.with(&values);
        let mut drive = |events: &[Event]| events.iter().map(|event| idm.drive(event, horizon).into()).collect();
        assessed.push(Assessed { driver: "idm".to_owned(), report: assess(&set, horizon, &platoon, &mut drive) });
    }
    Ok(assessed)
}

fn drive(work: &Work<'_>, learnt: &Learnt, envelope: bool, events: &[Event]) -> Vec<crate::safety::Trajectory> {
    let last = &learnt.seeds[0].last().expect("a method has a stage").learned;
    let shape = work.options.settings.shape();
    let envelope = envelope.then(|| Envelope::new(shape.dt_s));
    drive_events(shape, &last.scaling, &last.weights, envelope, events, &work.workers)
}

/// As tables.
pub(super) fn tables(assessed: &[Assessed]) -> String {
    markdown(&assessed.iter().map(|one| (one.driver.as_str(), &one.report)).collect::<Vec<_>>())
}
