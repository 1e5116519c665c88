//! The errors of a model on every test event, added up so that resampling runs and seeds is cheap.

use std::collections::BTreeMap;

use super::{Draw, pooled};
use crate::evaluation::Errors;

/// A number of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Mean squared error of spacing over simulated steps, m².
    Spacing,
    /// Mean squared error of speed over simulated steps, m²/s².
    Speed,
    /// Events with a collision, %.
    Collisions,
}

impl Measure {
    /// All of them, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Spacing, Self::Speed, Self::Collisions];

    /// What is summed and what it is divided by.
    fn parts(self, errors: &Errors) -> (f64, f64) {
        match self {
            Self::Spacing => (errors.spacing_sq, errors.steps as f64),
            Self::Speed => (errors.speed_sq, errors.steps as f64),
            Self::Collisions => (100.0 * f64::from(errors.collisions), errors.events.into()),
        }
    }
}

/// Errors of one model: seeds × stages × tasks × runs with test events in the task.
#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    seeds: Vec<Vec<Vec<RunErrors>>>,
}

/// Of one task at one stage: each run and its events' errors.
type RunErrors = Vec<(usize, Errors)>;

impl Tally {
    /// From errors of seeds × stages × tasks × test events; `runs` holds the run of each test event of each task.
    #[must_use]
    pub fn new(seeds: &[Vec<&[Vec<Errors>]>], runs: &[Vec<usize>]) -> Self {
        let task = |events: &Vec<Errors>, runs: &Vec<usize>| {
            let mut sums: BTreeMap<usize, Errors> = BTreeMap::new();
            for (errors, &run) in events.iter().zip(runs) {
                *sums.entry(run).or_default() += *errors;
            }
            sums.into_iter().collect()
        };
        let stage = |tasks: &&[Vec<Errors>]| tasks.iter().zip(runs).map(|(events, runs)| task(events, runs)).collect();
        Self { seeds: seeds.iter().map(|stages| stages.iter().map(stage).collect()).collect() }
    }

    /// Stages learned.
    #[must_use]
    pub fn stages(&self) -> usize {
        self.seeds.first().map_or(0, Vec::len)
    }

    /// Of one seed: pooled over the events of the runs drawn; none when none of them is in the task.
    #[must_use]
    pub fn of_seed(&self, seed: usize, measure: Measure, stage: usize, task: usize, draw: &Draw) -> Option<f64> {
        let parts = self.seeds[seed][stage][task].iter().map(|(run, errors)| {
            let (sum, count) = measure.parts(errors);
            (draw.runs[*run], sum, count)
        });
        pooled(parts)
    }

    /// The mean over the seeds drawn. A model of one seed (a reference has none) is that seed whatever was drawn.
    #[must_use]
    pub fn cell(&self, measure: Measure, stage: usize, task: usize, draw: &Draw) -> Option<f64> {
        if self.seeds.len() == 1 {
            return self.of_seed(0, measure, stage, task, draw);
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for (seed, &weight) in draw.seeds.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            sum += weight * self.of_seed(seed, measure, stage, task, draw)?;
            weights += weight;
        }
        (weights > 0.0).then(|| sum / weights)
    }

    /// The mean over the tasks after the last stage.
    #[must_use]
    pub fn last_mean(&self, measure: Measure, draw: &Draw) -> Option<f64> {
        let last = self.stages().checked_sub(1)?;
        let tasks = self.seeds.first()?[last].len();
        let sum = (0..tasks).try_fold(0.0, |sum, task| Some(sum + self.cell(measure, last, task, draw)?));
        sum.map(|sum| sum / tasks as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(spacing_sq: f64, steps: u64, collisions: u32) -> Errors {
        Errors { spacing_sq, speed_sq: spacing_sq / 10.0, collisions, events: 1, steps }
    }

    #[test]
    fn cells_pool_events_within_a_seed_and_average_over_seeds() {
        // One stage, one task, three events of two runs; two seeds.
        let first = [vec![errors(10.0, 10, 0), errors(30.0, 10, 1), errors(50.0, 20, 0)]];
        let second = [vec![errors(20.0, 10, 0), errors(20.0, 10, 0), errors(20.0, 20, 0)]];
        let tally = Tally::new(&[vec![&first[..]], vec![&second[..]]], &[vec![0, 0, 1]]);
        let whole = Draw { runs: vec![1.0, 1.0], seeds: vec![1.0, 1.0] };
        assert_eq!(tally.of_seed(0, Measure::Spacing, 0, 0, &whole), Some(90.0 / 40.0));
        assert_eq!(tally.cell(Measure::Spacing, 0, 0, &whole), Some(f64::midpoint(90.0 / 40.0, 60.0 / 40.0)));
        assert_eq!(tally.cell(Measure::Speed, 0, 0, &whole), Some(0.1 * f64::midpoint(90.0 / 40.0, 60.0 / 40.0)));
        assert_eq!(tally.of_seed(0, Measure::Collisions, 0, 0, &whole), Some(100.0 / 3.0));
        let drawn = Draw { runs: vec![0.0, 2.0], seeds: vec![2.0, 0.0] };
        assert_eq!(tally.cell(Measure::Spacing, 0, 0, &drawn), Some(2.5));
        assert_eq!(tally.last_mean(Measure::Spacing, &drawn), Some(2.5));
        let nothing = Draw { runs: vec![0.0, 0.0], seeds: vec![1.0, 1.0] };
        assert_eq!(tally.cell(Measure::Spacing, 0, 0, &nothing), None);
    }
}
