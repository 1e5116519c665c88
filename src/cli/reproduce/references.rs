//! Reference drivers, calibrated for each task on its training events and driven on its test events.

use serde::{Deserialize, Serialize};

use super::results::{Reference, Runs};
use super::work::Work;
use crate::car_following::Event;
use crate::evaluation::{Calibration, CalibrationSettings, Errors, calibrate, evaluate_reference};
use crate::protocol::Tally;
use crate::reference::ReferenceKind;

/// A reference driver, as it is kept.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Calibrated {
    /// Of each task, in the order of the driver's parameters.
    values: Vec<Vec<f64>>,
    /// Tasks × test events.
    errors: Vec<Vec<Errors>>,
    /// Of each task, on the training events that it was calibrated on.
    fitted_to: Vec<Errors>,
    /// Of each task, on its test events with the published parameters.
    published: Vec<Errors>,
}

/// Every reference driver.
pub(super) fn references(work: &Work<'_>, runs: &Runs) -> anyhow::Result<Vec<Reference>> {
    ReferenceKind::ALL.into_iter().map(|kind| reference(work, runs, kind)).collect()
}

fn reference(work: &Work<'_>, runs: &Runs, kind: ReferenceKind) -> anyhow::Result<Reference> {
    let settings = CalibrationSettings::default();
    let horizon = work.options.settings.horizon as usize;
    let told = format!("reference {} {horizon} {settings:?}", kind.as_str());
    let calibrated = work.kept(&told, "reference", || {
        work.progress.say(&format!("calibrating {} for each task", kind.as_str()));
        let mut calibrated = Calibrated::default();
        for task in &work.plan.tasks {
            let train: Vec<&Event> = task.train.iter().collect();
            let Calibration { driver, on, .. } = calibrate(kind, horizon, &train, &settings, &work.workers);
            let one = |event: &Event| Errors::of(event, horizon, &driver.drive(event, horizon).into());
            calibrated.errors.push(task.test.iter().map(one).collect());
            calibrated.values.push(driver.values());
            calibrated.fitted_to.push(on);
            calibrated.published.push(evaluate_reference(&kind.published(), horizon, &task.test, &work.workers));
        }
        Ok(calibrated)
    })?;
    Ok(Reference {
        name: kind.as_str().to_owned(),
        tally: Tally::new(&[vec![&calibrated.errors[..]]], &runs.of),
        drivers: calibrated.values.iter().map(|values| kind.with(values)).collect(),
        fitted_to: calibrated.fitted_to,
        published: calibrated.published,
    })
}
