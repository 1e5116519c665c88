//! The same ten updates as `torch` (golden file and its script in `tests/golden/`).

use headway::car_following::Event;
use headway::driver::{Crew, DriverShape, Scaling};
use headway::lstm::{Network, Real};
use headway::training::{Adam, Penalties, clip_norm, minibatch_gradient};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    #[serde(flatten)]
    driver: GoldenDriver,
    learning_rate: f32,
    clip_norm: f32,
    updates: Vec<Update>,
}

/// A network and the events it drives behind, as every golden file has them.
#[derive(Deserialize)]
pub(super) struct GoldenDriver {
    hidden: usize,
    horizon: usize,
    dt_s: f32,
    accel_limit_mps2: f32,
    mean: [f32; 4],
    spread: [f32; 4],
    events: Vec<GoldenEvent>,
    pub(super) weights: Tensors,
}

impl GoldenDriver {
    pub(super) fn shape(&self) -> DriverShape {
        DriverShape {
            hidden: self.hidden,
            horizon: self.horizon,
            dt_s: self.dt_s,
            accel_limit_mps2: self.accel_limit_mps2,
            ..DriverShape::PAPER
        }
    }

    pub(super) fn scaling(&self) -> Scaling {
        Scaling { mean: self.mean, spread: self.spread, low: [0.0; 4], high: [0.0; 4], motion: None }
    }

    pub(super) fn events(&self) -> Vec<Event> {
        self.events.iter().map(|event| event.event(self.dt_s)).collect()
    }
}

#[derive(Deserialize)]
struct GoldenEvent {
    spacing_m: Vec<f32>,
    follower_speed_mps: Vec<f32>,
    leader_speed_mps: Vec<f32>,
}

impl GoldenEvent {
    fn event(&self, dt_s: f32) -> Event {
        let [spacing, follower, leader] =
            [&self.spacing_m, &self.follower_speed_mps, &self.leader_speed_mps].map(Clone::clone);
        Event::new(f64::from(dt_s), spacing, follower, leader)
    }
}

#[derive(Deserialize)]
pub(super) struct Tensors {
    input: Vec<f32>,
    recurrent: Vec<f32>,
    bias: Vec<f32>,
    head: Vec<f32>,
    head_bias: Vec<f32>,
}

#[derive(Deserialize)]
struct Update {
    loss: f64,
    norm: f64,
    gradient: Tensors,
    weights: Tensors,
}

impl Tensors {
    pub(super) fn flat(&self) -> Vec<f32> {
        [&self.input, &self.recurrent, &self.bias, &self.head, &self.head_bias].into_iter().flatten().copied().collect()
    }
}

struct Case {
    golden: Golden,
    shape: DriverShape,
    scaling: Scaling,
    events: Vec<Event>,
}

fn case() -> Case {
    let golden: Golden = serde_json::from_str(include_str!("../golden/gradients.json")).unwrap();
    let (shape, scaling, events) = (golden.driver.shape(), golden.driver.scaling(), golden.driver.events());
    Case { golden, shape, scaling, events }
}

/// Largest difference between two vectors, in units of the second's largest value: what f32 sums can promise.
fn off<T: Real>(ours: &[T], theirs: &[f32]) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    let scale = theirs.iter().map(|x| f64::from(x.abs())).fold(0.0, f64::max);
    ours.iter().zip(theirs).map(|(a, b)| (a.wide() - f64::from(*b)).abs() / scale).fold(0.0, f64::max)
}

fn gradient_of<T: Real>(case: &Case, weights: &[T], collision_margin_m: f64) -> (f64, Vec<T>) {
    let workers = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let crew = Crew::<T>::new(case.shape, &workers);
    let events: Vec<_> = case.events.iter().collect();
    let penalties = Penalties { collision: 1000.0, backward: 1000.0, collision_margin_m };
    let mut gradient = vec![T::zero(); weights.len()];
    let network = Network::new(case.shape.layout(), weights);
    let loss =
        minibatch_gradient(&crew, case.shape.horizon, &case.scaling, &network, &events, penalties, &mut gradient);
    (loss, gradient)
}

fn wide_weights(weights: &[f32]) -> Vec<f64> {
    weights.iter().copied().map(f64::from).collect()
}

#[test]
fn every_gradient_agrees_with_torch_at_the_same_weights() {
    let case = case();
    let mut weights = case.golden.driver.weights.flat();
    assert_eq!(weights.len(), case.shape.layout().len());
    for (update, theirs) in case.golden.updates.iter().enumerate() {
        let (loss, gradient) = gradient_of(&case, &weights, 0.0);
        let expected = theirs.gradient.flat();
        assert!((loss / theirs.loss - 1.0).abs() < 1e-5, "update {update}: loss {loss}, torch {}", theirs.loss);
        assert!(off(&gradient, &expected) < 1e-4, "update {update}: off by {}", off(&gradient, &expected));
        let (_, wide) = gradient_of::<f64>(&case, &wide_weights(&weights), 0.0);
        assert!(off(&wide, &expected) < 1e-4, "update {update}: f64 off by {}", off(&wide, &expected));
        weights = theirs.weights.flat();
    }
}

#[test]
fn ten_updates_lead_where_torch_leads() {
    let case = case();
    let mut weights = case.golden.driver.weights.flat();
    let mut adam = Adam::new(weights.len());
    for (update, theirs) in case.golden.updates.iter().enumerate() {
        let (loss, mut gradient) = gradient_of(&case, &weights, 0.0);
        assert!((loss / theirs.loss - 1.0).abs() < 1e-3, "update {update}: loss {loss}, torch {}", theirs.loss);
        let norm = clip_norm(&mut gradient, case.golden.clip_norm);
        assert!((norm / theirs.norm - 1.0).abs() < 1e-2, "update {update}: norm {norm}, torch {}", theirs.norm);
        adam.step(&mut weights, &gradient, case.golden.learning_rate);
        let expected = theirs.weights.flat();
        assert!(off(&weights, &expected) < 1e-4, "update {update}: weights off by {}", off(&weights, &expected));
    }
}

#[test]
fn with_a_margin_too_the_gradient_is_the_derivative_of_the_loss() {
    let case = case();
    let mut weights = wide_weights(&case.golden.driver.weights.flat());
    let (plain, _) = gradient_of::<f64>(&case, &weights, 0.0);
    let (loss, gradient) = gradient_of::<f64>(&case, &weights, 4.0);
    assert!(loss > plain, "the case comes close enough for the margin to matter");
    for i in 0..weights.len() {
        let (kept, h) = (weights[i], 1e-6);
        weights[i] = kept + h;
        let (up, _) = gradient_of(&case, &weights, 4.0);
        weights[i] = kept - h;
        let (down, _) = gradient_of(&case, &weights, 4.0);
        weights[i] = kept;
        let central = (up - down) / (2.0 * h);
        let off = (central - gradient[i]).abs();
        assert!(
            off <= 1e-4 * (1.0 + central.abs()),
            "weight {i}: {} by the pass, {central} by differences",
            gradient[i]
        );
    }
}
