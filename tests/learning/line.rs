//! A line of versions as a server would keep it, and who watches it learn.

use headway::car_following::{Event, TrafficRegime, TrafficSettings, generate};
use headway::consolidation::{Estimator, ImportanceOptions, MasOutput, Method, Output, PenaltyStep, RegimeMemory};
use headway::driver::{DriverShape, Scaling};
use headway::training::{
    Interim, LearnSettings, Learned, Observer, Progress, RateSchedule, ReplayedRegime, StageInput, learn_stage,
};
use rayon::ThreadPool;

pub(super) fn settings() -> LearnSettings {
    LearnSettings {
        shape: DriverShape { hidden: 8, horizon: 5, accel_limit_mps2: 4.0, ..DriverShape::PAPER },
        epochs: 2,
        minibatch: 8,
        learning_rate: 0.003,
        learning_rate_schedule: RateSchedule::Constant,
        random_start: 0.0,
        clip_norm: 1.0,
        collision_penalty: 1000.0,
        backward_penalty: 1000.0,
        collision_margin_m: 4.0,
        strength: None,
        lambda: None,
        importance: ImportanceOptions {
            estimator: Estimator::Exact,
            output: Output::OpenLoop,
            mas_output: MasOutput::Jacobian,
            draws: 4,
        },
        accumulation: None,
        online_decay: 0.95,
        penalty_step: PenaltyStep::Proximal,
        replay_share: 0.5,
        si_damping: 0.001,
        seed: 42,
    }
}

/// Events of each regime that are kept to be replayed.
const REPLAYED: usize = 10;

pub(super) fn traffic(regime: TrafficRegime, events: usize) -> Vec<Event> {
    let lengths = TrafficSettings { min_steps: 40, max_steps: 60, ..TrafficSettings::default() };
    generate(regime, 7, events, &lengths).into_iter().map(|generated| generated.event).collect()
}

pub(super) fn workers(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// Stops after some updates, keeping the checkpoint.
pub(super) struct StopAfter {
    updates: u64,
    pub(super) state: Option<Vec<u8>>,
    pub(super) penalties: Vec<f64>,
    pub(super) interims: Vec<Interim>,
}

impl Observer for StopAfter {
    fn updated(&mut self, progress: &Progress) -> bool {
        self.penalties.push(progress.penalty);
        progress.update < self.updates
    }
    fn evaluated(&mut self, interim: &Interim) {
        self.interims.push(*interim);
    }
    fn wants_stop(&mut self) -> bool {
        false
    }
    fn wants_checkpoint(&mut self) -> bool {
        false
    }
    fn checkpoint(&mut self, _: &Progress, state: Vec<u8>) {
        self.state = Some(state);
    }
}

pub(super) fn never() -> StopAfter {
    after(u64::MAX)
}

pub(super) fn after(updates: u64) -> StopAfter {
    StopAfter { updates, state: None, penalties: Vec::new(), interims: Vec::new() }
}

/// A line of versions as a server would keep it.
#[derive(Default)]
pub(super) struct Line {
    pub(super) stage: u32,
    pub(super) weights: Option<Vec<f32>>,
    pub(super) scaling: Option<Scaling>,
    pub(super) memory: Vec<RegimeMemory>,
    pub(super) replay: Vec<ReplayedRegime>,
    pub(super) penalties: Vec<f64>,
}

impl Line {
    pub(super) fn learn(&mut self, method: Method, settings: &LearnSettings, regime: &str, train: &[Event]) -> Learned {
        let mut observer = never();
        let learned = {
            let input = self.input(method, settings, regime, train);
            learn_stage(&input, None, &workers(2), &mut observer).unwrap()
        };
        self.stage += 1;
        self.weights = Some(learned.weights.clone());
        self.scaling = Some(learned.scaling);
        self.penalties = observer.penalties;
        if let Some(memory) = learned.memory.clone() {
            self.memory.retain(|kept| kept.regime != memory.regime);
            self.memory.push(memory);
        }
        let some = train.iter().take(REPLAYED).cloned().collect();
        self.replay.retain(|of| of.regime != regime);
        self.replay.push(ReplayedRegime { regime: regime.to_owned(), events: some });
        learned
    }

    pub(super) fn input<'a>(
        &'a self,
        method: Method,
        settings: &LearnSettings,
        regime: &'a str,
        train: &'a [Event],
    ) -> StageInput<'a> {
        StageInput {
            method,
            settings: settings.clone(),
            stage: self.stage + 1,
            regime,
            parent_weights: self.weights.as_deref(),
            scaling: self.scaling,
            memory: &self.memory,
            replay: &self.replay,
            train,
            validation: &[],
        }
    }
}

pub(super) fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}
