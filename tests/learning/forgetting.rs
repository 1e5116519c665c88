//! What consolidation does, with every option of it.

use headway::car_following::{Event, TrafficRegime};
use headway::consolidation::{Accumulation, Estimator, ImportanceOptions, MasOutput, Method, Output, PenaltyStep};
use headway::evaluation::evaluate;
use headway::training::{LearnSettings, Learned};

use super::line::{Line, distance, settings, traffic, workers};

/// The methods that keep importance, each kind of it once.
const CONSOLIDATING: [Method; 3] = [Method::Ewc, Method::Mas, Method::Si];

/// The first steps of some events, for what takes long.
fn short(regime: TrafficRegime, events: usize) -> Vec<Event> {
    let cut = |values: &[f32]| values[..20].to_vec();
    let short = |event: &Event| {
        let [spacing, follower, leader] =
            [event.spacing_m(), event.follower_speed_mps(), event.leader_speed_mps()].map(cut);
        Event::new(event.dt_s(), spacing, follower, leader)
    };
    traffic(regime, events).iter().map(short).collect()
}

/// Every way to compute importance that the method has; where it has none, its own.
fn importances(method: Method) -> Vec<ImportanceOptions> {
    if method.keeps().is_none() {
        return vec![settings().importance];
    }
    let mut all = Vec::new();
    for estimator in [Estimator::Exact, Estimator::Empirical, Estimator::Sampled] {
        for output in [Output::OpenLoop, Output::ClosedLoop] {
            for mas_output in [MasOutput::Jacobian, MasOutput::SquaredNorm] {
                let options = ImportanceOptions { estimator, output, mas_output, draws: 3 };
                if options.conflict(Some(method)).is_none() {
                    all.push(options);
                }
            }
        }
    }
    all
}

/// How far the second stage moved the weights, weighed by what the first found important.
fn important_move(importance: &[f32], before: &[f32], after: &[f32]) -> f64 {
    let each = before.iter().zip(after).zip(importance);
    each.map(|((a, b), i)| f64::from(*i) * f64::from(a - b).powi(2)).sum()
}

#[test]
fn every_combination_of_options_penalises_after_stage_one_and_holds_what_matters() {
    let (fast, slow) = (short(TrafficRegime::Fast, 8), short(TrafficRegime::Slow, 8));
    for method in CONSOLIDATING {
        for importance in importances(method) {
            for accumulation in [Accumulation::Separate, Accumulation::Online, Accumulation::SumLatest] {
                for penalty_step in [PenaltyStep::Proximal, PenaltyStep::Coupled, PenaltyStep::Modulated] {
                    let accumulation = Some(accumulation);
                    let of_method =
                        LearnSettings { importance, accumulation, penalty_step, strength: Some(100.0), ..settings() };
                    let case = format!("{method:?} {importance:?} {accumulation:?} {penalty_step:?}");
                    let (mut held, mut free) = (Line::default(), Line::default());
                    let first = held.learn(method, &of_method, "fast", &fast);
                    assert!(held.penalties.iter().all(|&penalty| penalty == 0.0), "{case}: stage 1 keeps nothing");
                    free.learn(Method::Naive, &of_method, "fast", &fast);
                    let held_to = held.learn(method, &of_method, "slow", &slow).weights;
                    let free_to = free.learn(Method::Naive, &of_method, "slow", &slow).weights;
                    assert!(held.penalties.last().copied().unwrap() > 0.0, "{case}: no penalty");
                    let important = first.memory.unwrap().importance;
                    let (held, free) = (
                        important_move(&important, &first.weights, &held_to),
                        important_move(&important, &first.weights, &free_to),
                    );
                    assert!(held > 0.0 && held < 0.7 * free, "{case}: moved {held} of {free}");
                }
            }
        }
    }
}

#[test]
fn every_method_forgets_less_than_naive_and_learns_the_new_traffic() {
    let (mut fast, mut slow) = (traffic(TrafficRegime::Fast, 120), traffic(TrafficRegime::Slow, 120));
    let (test_fast, test_slow) = (fast.split_off(80), slow.split_off(80));
    let settings = LearnSettings { epochs: 6, ..settings() };
    let learn = |method| {
        let mut line = Line::default();
        let first = line.learn(method, &settings, "fast", &fast);
        let second = line.learn(method, &settings, "slow", &slow);
        let forgetting = spacing_mse(&second, &test_fast) / spacing_mse(&first, &test_fast);
        (forgetting, spacing_mse(&first, &test_slow), spacing_mse(&second, &test_slow))
    };
    let (naive, ..) = learn(Method::Naive);
    let methods = [Method::Ewc, Method::Mas, Method::Si, Method::Replay, Method::ReplayEwc, Method::ReplayMas];
    for method in methods {
        let (forgetting, before, after) = learn(method);
        assert!(1.0 < naive && forgetting < 0.6 * naive, "{method:?} forgets {forgetting} times, naive {naive}");
        assert!(after < 0.85 * before, "{method:?} learns: spacing MSE {after} after {before}");
    }
}

#[test]
fn a_real_stage_is_stable_for_every_lambda() {
    let (fast, slow) = (traffic(TrafficRegime::Fast, 20), traffic(TrafficRegime::Slow, 20));
    for method in CONSOLIDATING {
        for penalty_step in [PenaltyStep::Proximal, PenaltyStep::Modulated] {
            let moved = |lambda: Option<f64>| {
                let settings = LearnSettings { penalty_step, lambda, ..settings() };
                let mut line = Line::default();
                let first = line.learn(method, &settings, "fast", &fast);
                let after = if lambda.is_some() { method } else { Method::Naive };
                let second = line.learn(after, &settings, "slow", &slow);
                assert!(second.weights.iter().all(|w| w.is_finite()), "{method:?} {penalty_step:?} {lambda:?}");
                important_move(&first.memory.unwrap().importance, &first.weights, &second.weights)
            };
            let free = moved(None);
            let moves: Vec<_> = (-6..=12).step_by(3).map(|power| moved(Some(10.0_f64.powi(power)))).collect();
            let case = format!("{method:?} {penalty_step:?}: {moves:?}, free {free}");
            assert!((moves[0] / free - 1.0).abs() < 0.01, "next to nothing changes next to nothing: {case}");
            assert!(moves.is_sorted_by(|weaker, stronger| *stronger < weaker * 1.05), "more holds more: {case}");
            assert!(moves[moves.len() - 1] < 1e-3 * free, "so much holds everything: {case}");
        }
    }
}

/// Every method with every way to add regimes up.
fn accumulations() -> impl Iterator<Item = (Method, Accumulation)> {
    let all = [Accumulation::Separate, Accumulation::Online, Accumulation::SumLatest];
    CONSOLIDATING.into_iter().flat_map(move |method| all.map(|accumulation| (method, accumulation)))
}

fn spacing_mse(learned: &Learned, test: &[Event]) -> f64 {
    let errors = evaluate(settings().shape, &learned.scaling, &learned.weights, test, &workers(2));
    errors.spacing_sq / errors.steps as f64
}

fn stiffness(line: &Line) -> f64 {
    line.memory.iter().flat_map(|kept| &kept.importance).map(|&x| f64::from(x)).sum()
}

#[test]
fn a_regime_learned_twice_in_a_row_is_neither_forgotten_nor_twice_as_important() {
    let mut fast = traffic(TrafficRegime::Fast, 120);
    let test = fast.split_off(80);
    for (method, accumulation) in accumulations() {
        let settings = LearnSettings { accumulation: Some(accumulation), epochs: 6, ..settings() };
        let mut line = Line::default();
        let once = line.learn(method, &settings, "fast", &fast);
        let stiff = stiffness(&line);
        let twice = line.learn(method, &settings, "fast", &fast);
        let case = format!("{method:?} {accumulation:?}");
        assert!(line.penalties.last().copied().unwrap() > 0.0, "{case}: its own penalty applies");
        assert_eq!(line.memory.len(), 1, "{case}");
        assert!(stiffness(&line) < 1.5 * stiff, "{case}: importance {} after {stiff}", stiffness(&line));
        let (first, second) = (spacing_mse(&once, &test), spacing_mse(&twice, &test));
        assert!(second < 1.02 * first, "{case}: spacing MSE {second} after {first}");
    }
}

#[test]
fn the_same_regime_a_hundred_times_does_not_freeze_the_model() {
    let (fast, slow) = (traffic(TrafficRegime::Fast, 10), traffic(TrafficRegime::Slow, 10));
    for (method, accumulation) in accumulations() {
        let settings = LearnSettings { accumulation: Some(accumulation), epochs: 1, ..settings() };
        let learn_slow_after = |repeats: u32| {
            let mut line = Line::default();
            for _ in 0..repeats {
                line.learn(method, &settings, "fast", &fast);
            }
            assert_eq!(line.memory.len(), 1);
            let (before, stiff) = (line.weights.clone().unwrap(), stiffness(&line));
            let after = line.learn(method, &settings, "slow", &slow).weights;
            (stiff, distance(&before, &after))
        };
        let (once_stiff, once_moved) = learn_slow_after(1);
        let (often_stiff, often_moved) = learn_slow_after(100);
        let case = format!("{method:?} {accumulation:?}");
        assert!(often_stiff < 10.0 * once_stiff, "{case}: importance {often_stiff} after {once_stiff}");
        assert!(often_moved > 0.3 * once_moved, "{case}: moves {often_moved} after {once_moved}");
    }
}
