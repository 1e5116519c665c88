//! Stages in turn: bits, checkpoints, and what consolidation does.

use headway::car_following::{Event, TrafficRegime, TrafficSettings, generate};
use headway::consolidation::{MasOutput, Method, PenaltyStep, RegimeMemory};
use headway::driver::{DriverShape, Scaling};
use headway::evaluation::evaluate;
use headway::training::{Interim, LearnError, LearnSettings, Learned, Observer, Progress, StageInput, learn_stage};
use rayon::ThreadPool;

fn settings() -> LearnSettings {
    LearnSettings {
        shape: DriverShape { hidden: 8, horizon: 5, dt_s: 0.1, accel_limit_mps2: 4.0 },
        epochs: 2,
        minibatch: 8,
        learning_rate: 0.003,
        clip_norm: 1.0,
        collision_penalty: 1000.0,
        backward_penalty: 1000.0,
        collision_margin_m: 4.0,
        strength: None,
        lambda: None,
        mas_output: MasOutput::Jacobian,
        accumulation: None,
        penalty_step: PenaltyStep::Proximal,
        seed: 42,
    }
}

fn traffic(regime: TrafficRegime, events: usize) -> Vec<Event> {
    let lengths = TrafficSettings { min_steps: 40, max_steps: 60, ..TrafficSettings::default() };
    generate(regime, 7, events, &lengths).into_iter().map(|generated| generated.event).collect()
}

fn workers(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// Stops after some updates, keeping the checkpoint.
struct StopAfter {
    updates: u64,
    state: Option<Vec<u8>>,
    penalties: Vec<f64>,
    interims: Vec<Interim>,
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

fn never() -> StopAfter {
    after(u64::MAX)
}

fn after(updates: u64) -> StopAfter {
    StopAfter { updates, state: None, penalties: Vec::new(), interims: Vec::new() }
}

/// A line of versions as a server would keep it.
#[derive(Default)]
struct Line {
    stage: u32,
    weights: Option<Vec<f32>>,
    scaling: Option<Scaling>,
    memory: Vec<RegimeMemory>,
    penalties: Vec<f64>,
}

impl Line {
    fn learn(&mut self, method: Method, settings: &LearnSettings, regime: &str, train: &[Event]) -> Learned {
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
        learned
    }

    fn input<'a>(
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
            train,
            validation: &[],
        }
    }
}

fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn stage_one_of_naive_ewc_and_mas_is_bit_equal() {
    let train = traffic(TrafficRegime::Fast, 20);
    let weights = [Method::Naive, Method::Ewc, Method::Mas]
        .map(|method| Line::default().learn(method, &settings(), "fast", &train).weights);
    assert_eq!(weights[0], weights[1]);
    assert_eq!(weights[0], weights[2]);
}

#[test]
fn neither_threads_nor_the_order_of_arrival_change_a_bit() {
    let mut train = traffic(TrafficRegime::Fast, 37);
    let line = Line::default();
    let settings = settings();
    let learn = |train: &[Event], threads| {
        learn_stage(&line.input(Method::Ewc, &settings, "fast", train), None, &workers(threads), &mut never()).unwrap()
    };
    let one = learn(&train, 1);
    train.reverse();
    let three = learn(&train, 3);
    assert_eq!(one.weights, three.weights);
    assert_eq!(one.memory, three.memory, "importance included");
}

#[test]
fn a_stage_resumed_anywhere_ends_with_the_same_bits() {
    let (fast, slow) = (traffic(TrafficRegime::Fast, 20), traffic(TrafficRegime::Slow, 20));
    let mut line = Line::default();
    line.learn(Method::Ewc, &settings(), "fast", &fast);
    let settings = settings();
    let input = line.input(Method::Ewc, &settings, "slow", &slow);
    let undisturbed = learn_stage(&input, None, &workers(2), &mut never()).unwrap();
    for updates in 1..6 {
        let mut observer = after(updates);
        assert_eq!(learn_stage(&input, None, &workers(2), &mut observer), Err(LearnError::Stopped));
        let state = observer.state.expect("a stopped stage leaves a checkpoint");
        let resumed = learn_stage(&input, Some(&state), &workers(1), &mut never()).unwrap();
        assert_eq!(resumed.weights, undisturbed.weights, "stopped after update {updates}");
        assert_eq!(resumed.memory, undisturbed.memory);
    }
}

#[test]
fn a_checkpoint_of_other_events_is_refused() {
    let (fast, slow) = (traffic(TrafficRegime::Fast, 10), traffic(TrafficRegime::Slow, 10));
    let line = Line::default();
    let settings = settings();
    let mut observer = after(1);
    let input = line.input(Method::Ewc, &settings, "fast", &fast);
    assert_eq!(learn_stage(&input, None, &workers(1), &mut observer), Err(LearnError::Stopped));
    let other = line.input(Method::Ewc, &settings, "slow", &slow);
    let refused = learn_stage(&other, observer.state.as_deref(), &workers(1), &mut never());
    assert!(matches!(refused, Err(LearnError::Checkpoint(_))), "{refused:?}");
}

#[test]
fn the_penalty_is_not_zero_after_stage_one_and_holds_what_matters() {
    let (fast, slow) = (traffic(TrafficRegime::Fast, 30), traffic(TrafficRegime::Slow, 30));
    for (penalty_step, strength) in [(PenaltyStep::Proximal, 1e6), (PenaltyStep::Coupled, 1e3)] {
        for method in [Method::Ewc, Method::Mas] {
            let settings = LearnSettings { penalty_step, strength: Some(strength), ..settings() };
            let (mut held, mut free) = (Line::default(), Line::default());
            let first = held.learn(method, &settings, "fast", &fast);
            assert!(held.penalties.iter().all(|&penalty| penalty == 0.0), "stage 1 has nothing to keep");
            free.learn(Method::Naive, &settings, "fast", &fast);
            let importance = first.memory.expect("the method keeps importance").importance;
            let moved = |line: &mut Line, method| {
                let second = line.learn(method, &settings, "slow", &slow).weights;
                let each = second.iter().zip(&first.weights).zip(&importance);
                each.map(|((a, b), i)| f64::from(*i) * f64::from(a - b).powi(2)).sum::<f64>()
            };
            let (held_moved, free_moved) = (moved(&mut held, method), moved(&mut free, Method::Naive));
            assert!(held.penalties.last().copied().unwrap() > 0.0, "{method:?}, {penalty_step:?}");
            assert!(held_moved > 0.0, "{method:?}, {penalty_step:?} still learns");
            assert!(held_moved < 0.5 * free_moved, "{method:?}, {penalty_step:?}: {held_moved} of {free_moved}");
        }
    }
}

#[test]
fn the_same_regime_a_hundred_times_does_not_freeze_the_model() {
    let fast = traffic(TrafficRegime::Fast, 10);
    let slow = traffic(TrafficRegime::Slow, 10);
    let settings = LearnSettings { epochs: 1, ..settings() };
    let learn_slow_after = |repeats: u32| {
        let mut line = Line::default();
        for _ in 0..repeats {
            line.learn(Method::Ewc, &settings, "fast", &fast);
        }
        assert_eq!(line.memory.len(), 1);
        let before = line.weights.clone().unwrap();
        let stiffness: f64 = line.memory[0].importance.iter().map(|&f| f64::from(f)).sum();
        let after = line.learn(Method::Ewc, &settings, "slow", &slow).weights;
        (stiffness, distance(&before, &after))
    };
    let (once_stiff, once_moved) = learn_slow_after(1);
    let (often_stiff, often_moved) = learn_slow_after(100);
    assert!(often_stiff < 10.0 * once_stiff, "importance {often_stiff} after a hundred times, {once_stiff} after one");
    assert!(often_moved > 0.3 * once_moved, "moves {often_moved} after a hundred times, {once_moved} after one");
}

#[test]
fn a_stage_without_events_or_with_a_wild_rate_fails_clearly() {
    let line = Line::default();
    let empty = learn_stage(&line.input(Method::Naive, &settings(), "x", &[]), None, &workers(1), &mut never());
    assert_eq!(empty, Err(LearnError::NoTrainingEvents));
    let train = traffic(TrafficRegime::Fast, 20);
    let wild = LearnSettings { learning_rate: 1e30, ..settings() };
    let diverged = learn_stage(&line.input(Method::Naive, &wild, "fast", &train), None, &workers(1), &mut never());
    assert!(matches!(diverged, Err(LearnError::Diverged { .. })), "{diverged:?}");
}

#[test]
fn learning_lowers_the_error_on_events_not_seen() {
    let mut events = traffic(TrafficRegime::Slow, 80);
    let test = events.split_off(60);
    let settings = LearnSettings { epochs: 10, ..settings() };
    let mut line = Line::default();
    let learned = line.learn(Method::Naive, &settings, "slow", &events);
    let untrained = LearnSettings { epochs: 1, learning_rate: 1e-8, ..settings.clone() };
    let untouched = Line::default().learn(Method::Naive, &untrained, "slow", &events);
    let error = |learned: &Learned| {
        let errors = evaluate(settings.shape, &learned.scaling, &learned.weights, &test, &workers(2));
        assert_eq!(errors.events, 20);
        errors.spacing_sq / errors.steps as f64
    };
    assert!(error(&learned) < 0.5 * error(&untouched), "{} against {}", error(&learned), error(&untouched));
}

#[test]
fn interim_evaluations_tell_how_the_network_drives_and_change_no_bit() {
    let mut train = traffic(TrafficRegime::Fast, 100);
    let validation = train.split_off(20);
    let line = Line::default();
    let settings = LearnSettings { epochs: 3, ..settings() };
    let without = line.input(Method::Ewc, &settings, "fast", &train);
    let with = StageInput { validation: &validation, ..line.input(Method::Ewc, &settings, "fast", &train) };
    let plain = learn_stage(&without, None, &workers(2), &mut never()).unwrap();
    let mut observer = never();
    let watched = learn_stage(&with, None, &workers(2), &mut observer).unwrap();
    assert_eq!((&watched.weights, &watched.memory), (&plain.weights, &plain.memory));
    assert_eq!(observer.interims.iter().map(|interim| interim.epoch).collect::<Vec<_>>(), [1, 2, 3]);
    let last = observer.interims[2].errors;
    let again = evaluate(settings.shape, &watched.scaling, &watched.weights, &validation, &workers(1));
    assert_eq!((last.events, last.steps, last.collisions), (80, again.steps, again.collisions));
    assert!((last.spacing_sq / again.spacing_sq - 1.0).abs() < 1e-12);

    // Three minibatches an epoch: stopped at its end, after it, and within the next one.
    for updates in 3..6 {
        let mut stopped = after(updates);
        assert_eq!(learn_stage(&with, None, &workers(1), &mut stopped), Err(LearnError::Stopped));
        let mut resumed = never();
        let learned = learn_stage(&with, stopped.state.as_deref(), &workers(3), &mut resumed).unwrap();
        assert_eq!(learned.weights, plain.weights);
        assert_eq!(resumed.interims, observer.interims, "stopped after update {updates}");
    }
}

#[test]
fn a_stage_stops_within_an_interim_evaluation_and_loses_nothing() {
    /// Wants to stop once this many validation events may have been driven.
    struct StopWithin(StopAfter, u32);

    impl Observer for StopWithin {
        fn updated(&mut self, progress: &Progress) -> bool {
            self.0.updated(progress)
        }
        fn evaluated(&mut self, interim: &Interim) {
            self.0.evaluated(interim);
        }
        fn wants_stop(&mut self) -> bool {
            self.1 = self.1.saturating_sub(1);
            self.1 == 0
        }
        fn wants_checkpoint(&mut self) -> bool {
            false
        }
        fn checkpoint(&mut self, progress: &Progress, state: Vec<u8>) {
            self.0.checkpoint(progress, state);
        }
    }

    let mut train = traffic(TrafficRegime::Fast, 100);
    let validation = train.split_off(20);
    let line = Line::default();
    let settings = settings();
    let input = StageInput { validation: &validation, ..line.input(Method::Ewc, &settings, "fast", &train) };
    let undisturbed = learn_stage(&input, None, &workers(1), &mut never()).unwrap();
    let mut observer = StopWithin(never(), 2);
    assert_eq!(learn_stage(&input, None, &workers(1), &mut observer), Err(LearnError::Stopped));
    assert!(observer.0.interims.is_empty() && observer.0.penalties.len() == 3);
    let mut resumed = never();
    let learned = learn_stage(&input, observer.0.state.as_deref(), &workers(1), &mut resumed).unwrap();
    assert_eq!((learned.weights, resumed.interims.len()), (undisturbed.weights, 2));
}
