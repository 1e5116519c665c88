//! Stages in turn: bits, checkpoints, and what learning comes to.

use headway::car_following::{Event, TrafficRegime};
use headway::consolidation::Method;
use headway::evaluation::evaluate;
use headway::training::{Interim, LearnError, LearnSettings, Learned, Observer, Progress, StageInput, learn_stage};

use super::line::{Line, StopAfter, after, never, settings, traffic, workers};

const ALL: [Method; 8] = [
    Method::Naive,
    Method::Joint,
    Method::Ewc,
    Method::Mas,
    Method::Si,
    Method::Replay,
    Method::ReplayEwc,
    Method::ReplayMas,
];

#[test]
fn stage_one_is_bit_equal_whatever_the_method() {
    let train = traffic(TrafficRegime::Fast, 20);
    let weights = ALL.map(|method| Line::default().learn(method, &settings(), "fast", &train).weights);
    for other in &weights[1..] {
        assert_eq!(weights[0], *other);
    }
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
    for method in [Method::Ewc, Method::Si, Method::ReplayEwc] {
        let mut line = Line::default();
        line.learn(method, &settings(), "fast", &fast);
        let settings = settings();
        let input = line.input(method, &settings, "slow", &slow);
        let undisturbed = learn_stage(&input, None, &workers(2), &mut never()).unwrap();
        for updates in 1..6 {
            let mut observer = after(updates);
            assert_eq!(learn_stage(&input, None, &workers(2), &mut observer), Err(LearnError::Stopped));
            let state = observer.state.expect("a stopped stage leaves a checkpoint");
            let resumed = learn_stage(&input, Some(&state), &workers(1), &mut never()).unwrap();
            assert_eq!(resumed.weights, undisturbed.weights, "{method:?}, stopped after update {updates}");
            assert_eq!(resumed.memory, undisturbed.memory, "{method:?}, stopped after update {updates}");
        }
    }
}

#[test]
fn replayed_events_share_the_updates_of_later_stages_and_an_epoch_is_once_through_the_new_ones() {
    let (fast, slow) = (traffic(TrafficRegime::Fast, 20), traffic(TrafficRegime::Slow, 20));
    let mut line = Line::default();
    line.learn(Method::Replay, &settings(), "fast", &fast);
    assert_eq!(line.penalties.len(), 2 * 3, "twenty new events in updates of eight, twice");
    line.learn(Method::Replay, &settings(), "slow", &slow);
    assert_eq!(line.penalties.len(), 2 * 5, "twenty new events in updates of four new and four replayed, twice");
    let settings = LearnSettings { replay_share: 0.0, ..settings() };
    let without = |method| learn_stage(&line.input(method, &settings, "slow", &slow), None, &workers(1), &mut never());
    assert_eq!(without(Method::Replay).unwrap().weights, without(Method::Naive).unwrap().weights);
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
fn traffic_in_which_nobody_changes_speed_is_not_a_stage_that_diverged() {
    let steady = |spacing: f32| Event::new(0.1, vec![spacing; 60], vec![8.0; 60], vec![8.0; 60]);
    let train = [20.0, 25.0, 30.0].map(steady);
    let line = Line::default();
    let learned =
        learn_stage(&line.input(Method::Naive, &settings(), "steady", &train), None, &workers(1), &mut never());
    assert!(learned.is_ok(), "{learned:?}");
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

/// Wants to stop the n-th time it is asked between updates.
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

#[test]
fn a_stage_stops_within_an_interim_evaluation_and_loses_nothing() {
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

#[test]
fn a_stage_stops_while_importance_is_computed_and_goes_on_there() {
    let train = traffic(TrafficRegime::Fast, 100);
    let line = Line::default();
    let settings = settings();
    let input = line.input(Method::Mas, &settings, "fast", &train);
    let undisturbed = learn_stage(&input, None, &workers(1), &mut never()).unwrap();
    let mut observer = StopWithin(never(), 2);
    assert_eq!(learn_stage(&input, None, &workers(1), &mut observer), Err(LearnError::Stopped));
    let mut resumed = never();
    let learned = learn_stage(&input, observer.0.state.as_deref(), &workers(1), &mut resumed).unwrap();
    assert_eq!((learned.weights, learned.memory), (undisturbed.weights, undisturbed.memory));
    assert!(resumed.penalties.is_empty(), "no update is made twice");
}
