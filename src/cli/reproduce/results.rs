//! What was learned, as tables: means over seeds, intervals, comparisons.

use std::collections::BTreeMap;
use std::ops::Range;

use super::choice::Choice;
use super::measured::Measured;
use super::plan::Plan;
use super::state::StoredStage;
use crate::consolidation::Method;
use crate::evaluation::Errors;
use crate::protocol::{Bootstrap, Draw, Measure, Measures, Tally};
use crate::reference::ReferenceDriver;
use crate::safety::Spread;

/// Level of the confidence intervals.
pub(super) const LEVEL: f64 = 0.95;
/// Of the resamples, which are the same for every number.
const BOOTSTRAP_KEY: u64 = 20_240_714;

/// Stages × tasks.
pub(super) type Matrix = Vec<Vec<f64>>;

/// One method, learned with every seed.
pub(super) struct Learnt {
    pub(super) method: Method,
    pub(super) choice: Choice,
    /// Seeds × stages.
    pub(super) seeds: Vec<Vec<StoredStage>>,
    /// Training events times epochs of all stages of one seed.
    pub(super) trained: f64,
    /// Of the network alone.
    pub(super) tally: Tally,
    /// Within the envelope.
    pub(super) served: Tally,
}

/// A driver that was calibrated and not learned.
pub(super) struct Reference {
    pub(super) name: String,
    /// As calibrated for each task.
    pub(super) drivers: Vec<ReferenceDriver>,
    /// Of each task, on the training events that it was calibrated on.
    pub(super) fitted_to: Vec<Errors>,
    /// Of each task, on its test events with the published parameters.
    pub(super) published: Vec<Errors>,
    pub(super) tally: Tally,
}

/// Everything that the report tells.
pub(super) struct Results {
    pub(super) methods: Vec<Learnt>,
    pub(super) references: Vec<Reference>,
    pub(super) bootstrap: Bootstrap,
    pub(super) tasks: usize,
}

/// A number and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Estimate {
    pub(super) value: f64,
    pub(super) interval: Option<[f64; 2]>,
}

/// Places of the runs of every task's test events among all runs.
pub(super) struct Runs {
    pub(super) of: Vec<Vec<usize>>,
    pub(super) count: usize,
}

impl Runs {
    pub(super) fn of(plan: &Plan) -> Self {
        let mut place = BTreeMap::new();
        let of = plan.tasks.iter().map(|task| {
            let runs = task.test_runs.iter().map(|run| {
                let next = place.len();
                *place.entry(run.as_str()).or_insert(next)
            });
            runs.collect()
        });
        Self { of: of.collect(), count: place.len() }
    }
}

impl Learnt {
    pub(super) fn new(method: Method, choice: Choice, seeds: Vec<Vec<StoredStage>>, trained: f64, runs: &Runs) -> Self {
        let tally = |errors: fn(&Measured) -> &[Vec<Errors>]| {
            let seeds = seeds.iter().map(|stages| stages.iter().map(|stage| errors(&stage.measured)).collect());
            Tally::new(&seeds.collect::<Vec<_>>(), &runs.of)
        };
        let (alone, served) = (tally(|measured| &measured.alone), tally(|measured| &measured.served));
        Self { method, choice, trained, tally: alone, served, seeds }
    }

    /// Share of the simulated steps on which the envelope acted for the leader's sake, %, stages × tasks, the mean over these
    /// seeds.
    pub(super) fn acted_percent(&self, seeds: Range<usize>) -> Matrix {
        self.share_of_steps(seeds, |measured| &measured.acted_steps)
    }

    /// The same of the steps on which it only kept the follower from driving backwards.
    pub(super) fn held_percent(&self, seeds: Range<usize>) -> Matrix {
        self.share_of_steps(seeds, |measured| &measured.held_steps)
    }

    fn share_of_steps(&self, seeds: Range<usize>, counted: impl Fn(&Measured) -> &[u64]) -> Matrix {
        let share = |measured: &Measured, task: usize| {
            let steps: u64 = measured.served[task].iter().map(|errors| errors.steps).sum();
            100.0 * counted(measured)[task] as f64 / steps.max(1) as f64
        };
        let mean = |stage: usize, task: usize| {
            let each = self.seeds[seeds.clone()].iter().map(|stages| share(&stages[stage].measured, task));
            each.sum::<f64>() / seeds.len() as f64
        };
        let tasks = self.seeds[0][0].measured.served.len();
        (0..self.tally.stages()).map(|stage| (0..tasks).map(|task| mean(stage, task)).collect()).collect()
    }

    /// Least time to collision of a drive of the network alone, s, stages × tasks, over the drives with all seeds.
    pub(super) fn alone_min_ttc_s(&self) -> Vec<Vec<Spread>> {
        self.min_ttc_s(|measured| &measured.alone_min_ttc_s)
    }

    /// The same within the envelope.
    pub(super) fn served_min_ttc_s(&self) -> Vec<Vec<Spread>> {
        self.min_ttc_s(|measured| &measured.served_min_ttc_s)
    }

    fn min_ttc_s(&self, of: fn(&Measured) -> &[Vec<Option<f64>>]) -> Vec<Vec<Spread>> {
        let spread = |stage: usize, task: usize| {
            Spread::of_least(self.seeds.iter().flat_map(|stages| of(&stages[stage].measured)[task].iter().copied()))
        };
        let tasks = self.seeds[0][0].measured.alone.len();
        (0..self.tally.stages()).map(|stage| (0..tasks).map(|task| spread(stage, task)).collect()).collect()
    }

    /// λ of each stage with this seed.
    pub(super) fn lambda(&self, seed: usize) -> Vec<Option<f64>> {
        self.seeds[seed].iter().map(|stage| stage.learned.lambda).collect()
    }

    /// Training events × epochs / time inside updates, of one seed.
    pub(super) fn train_events_per_s(&self, seed: usize) -> f64 {
        self.trained / self.seeds[seed].iter().map(|stage| stage.learned.update_s).sum::<f64>()
    }
}

impl Results {
    pub(super) fn new(
        methods: Vec<Learnt>,
        references: Vec<Reference>,
        plan: &Plan,
        runs: &Runs,
        resamples: u32,
    ) -> Self {
        let seeds = methods.first().map_or(0, |learnt| learnt.seeds.len());
        let bootstrap = Bootstrap::new(runs.count, seeds, resamples as usize, LEVEL, BOOTSTRAP_KEY);
        Self { methods, references, bootstrap, tasks: plan.tasks.len() }
    }

    pub(super) fn method(&self, method: Method) -> Option<&Learnt> {
        self.methods.iter().find(|learnt| learnt.method == method)
    }

    pub(super) fn reference(&self, name: &str) -> Option<&Reference> {
        self.references.iter().find(|reference| reference.name == name)
    }

    /// R: the mean over seeds, of the network alone.
    pub(super) fn matrix(&self, tally: &Tally, measure: Measure) -> Matrix {
        self.each(tally, |stage, task| self.bootstrap.value(|draw| tally.cell(measure, stage, task, draw)))
    }

    /// R of one seed.
    pub(super) fn matrix_of_seed(&self, tally: &Tally, measure: Measure, seed: usize) -> Matrix {
        self.each(tally, |stage, task| self.bootstrap.value(|draw| tally.of_seed(seed, measure, stage, task, draw)))
    }

    /// The interval of each cell of R; stages × tasks.
    pub(super) fn intervals(&self, tally: &Tally, measure: Measure) -> Vec<Vec<Option<[f64; 2]>>> {
        let interval = |stage, task| self.bootstrap.interval(|draw| tally.cell(measure, stage, task, draw));
        (0..tally.stages()).map(|stage| (0..self.tasks).map(|task| interval(stage, task)).collect()).collect()
    }

    fn each(&self, tally: &Tally, cell: impl Fn(usize, usize) -> Option<f64>) -> Matrix {
        let cell = |stage, task| cell(stage, task).expect("every task has test events that were driven");
        (0..tally.stages()).map(|stage| (0..self.tasks).map(|task| cell(stage, task)).collect()).collect()
    }

    /// The measures of learning in turn, of spacing.
    pub(super) fn measures(&self, learnt: &Learnt) -> Measures {
        let naive = self.method(Method::Naive).map(|naive| self.matrix(&naive.tally, Measure::Spacing));
        let idm = self.reference("idm").map(|idm| self.matrix(&idm.tally, Measure::Spacing).remove(0));
        Measures::of(&self.matrix(&learnt.tally, Measure::Spacing), naive.as_deref(), idm.as_deref())
    }

    /// R[T, j] / R[j, j] of spacing for each task but the last.
    pub(super) fn forgetting_ratios(&self, learnt: &Learnt) -> Option<Vec<Estimate>> {
        let (tally, last) = (&learnt.tally, self.tasks - 1);
        let of = |stage, task| move |draw: &Draw| tally.cell(Measure::Spacing, stage, task, draw);
        (tally.stages() == self.tasks)
            .then(|| (0..last).map(|task| self.ratio(of(last, task), of(task, task))).collect::<Option<_>>())?
    }

    /// R[j, j] / naive's R[j, j] of spacing for each task.
    pub(super) fn plasticity_losses(&self, learnt: &Learnt) -> Option<Vec<Estimate>> {
        let (tally, naive) = (&learnt.tally, &self.method(Method::Naive)?.tally);
        let of = |tally: &'_ Tally, task| {
            let tally = tally.clone();
            move |draw: &Draw| tally.cell(Measure::Spacing, task, task, draw)
        };
        (tally.stages() == self.tasks)
            .then(|| (0..self.tasks).map(|task| self.ratio(of(tally, task), of(naive, task))).collect::<Option<_>>())?
    }

    /// The mean over tasks after the last stage.
    pub(super) fn last_mean(&self, tally: &Tally, measure: Measure) -> Estimate {
        let value = self.bootstrap.value(|draw| tally.last_mean(measure, draw));
        Estimate {
            value: value.expect("every task has test events that were driven"),
            interval: self.bootstrap.interval(|draw| tally.last_mean(measure, draw)),
        }
    }

    /// The mean spacing error over tasks after the last stage, one model's over another's, on the same events.
    pub(super) fn compared(&self, one: &Tally, other: &Tally) -> Option<Estimate> {
        self.ratio(|draw| one.last_mean(Measure::Spacing, draw), |draw| other.last_mean(Measure::Spacing, draw))
    }

    /// Of two numbers of the same draw: the ratio is paired.
    fn ratio(&self, one: impl Fn(&Draw) -> Option<f64>, other: impl Fn(&Draw) -> Option<f64>) -> Option<Estimate> {
        let ratio = |draw: &Draw| Some(one(draw)? / other(draw)?).filter(|ratio| ratio.is_finite());
        Some(Estimate { value: self.bootstrap.value(ratio)?, interval: self.bootstrap.interval(ratio) })
    }
}
