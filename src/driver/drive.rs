//! Several events driven at once, forward and backward through the whole loop.

use super::features::Sight;
use super::{DriverShape, Memory, Scaling};
use crate::car_following::Event;
use crate::lstm::{Gradients, Network, Passes, Real};
use crate::safety::{Cause, Envelope};

/// Whether the network reads its own simulation or the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loop {
    /// From step `horizon` on the follower is simulated.
    Closed,
    /// Every window is recorded.
    Open,
}

/// The trajectories of some events and everything needed to go back through them.
///
/// Values are step-major: step `t` of event `n` lies at `t · events + n`. Events come longest first.
#[derive(Debug)]
pub struct Drive<T> {
    shape: DriverShape,
    /// What bounds the network's acceleration; only forward drives may be bounded.
    envelope: Option<Envelope>,
    passes: Passes<T>,
    events: usize,
    /// Steps of each event.
    steps: Vec<usize>,
    leader: Vec<T>,
    spacing: Vec<T>,
    speed: Vec<T>,
    /// tanh of the head at the step that led here.
    squashed: Vec<T>,
    /// Steps of each event on which the envelope acted for the leader's sake.
    acted: Vec<u32>,
    /// Steps of each event on which it kept the follower from driving backwards.
    held: Vec<u32>,
    inputs: Vec<T>,
    outputs: Vec<T>,
    by_inputs: Vec<T>,
    by_earlier: Vec<T>,
    own: Vec<T>,
}

/// Derivatives of a scalar by every simulated spacing and speed, laid out as [`Drive`]'s trajectories.
#[derive(Debug, Clone)]
pub struct TrajectoryGradient<T> {
    /// By spacing.
    pub spacing: Vec<T>,
    /// By follower speed.
    pub speed: Vec<T>,
}

/// What a scalar of a drive is a function of, by its derivatives.
#[derive(Debug, Clone, Copy)]
pub enum By<'a, T> {
    /// The simulated trajectory; after [`Loop::Closed`] only, and not within an envelope.
    Trajectory(&'a TrajectoryGradient<T>),
    /// The accelerations that led to each step, m/s², laid out as [`Drive`]'s trajectories; after [`Loop::Open`].
    Accelerations(&'a [T]),
}

impl<T: Real> Drive<T> {
    /// Empty buffers.
    #[must_use]
    pub fn new(shape: DriverShape) -> Self {
        Self {
            shape,
            envelope: None,
            passes: match shape.memory {
                Memory::Window => Passes::windows(shape.layout()),
                Memory::Carried => Passes::carried(shape.layout()),
            },
            events: 0,
            steps: Vec::new(),
            leader: Vec::new(),
            spacing: Vec::new(),
            speed: Vec::new(),
            squashed: Vec::new(),
            acted: Vec::new(),
            held: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            by_inputs: Vec::new(),
            by_earlier: Vec::new(),
            own: Vec::new(),
        }
    }

    /// Drives from now on within this envelope, as a served driver does; none is the network alone.
    pub fn bound(&mut self, envelope: Option<Envelope>) {
        self.envelope = envelope;
    }

    /// Steps of event `n` on which the envelope acted for the leader's sake.
    #[must_use]
    pub fn acted_steps(&self, n: usize) -> u32 {
        self.acted[n]
    }

    /// Steps of event `n` on which the envelope kept the follower from driving backwards.
    #[must_use]
    pub fn held_steps(&self, n: usize) -> u32 {
        self.held[n]
    }

    /// Steps of event `n`.
    #[must_use]
    pub fn steps(&self, n: usize) -> usize {
        self.steps[n]
    }

    /// Events driven.
    #[must_use]
    pub fn events(&self) -> usize {
        self.events
    }

    /// Spacing of event `n` at step `t`, m: recorded before step `horizon`, simulated from there on.
    #[must_use]
    pub fn spacing_m(&self, t: usize, n: usize) -> T {
        self.spacing[t * self.events + n]
    }

    /// Follower speed likewise, m/s.
    #[must_use]
    pub fn speed_mps(&self, t: usize, n: usize) -> T {
        self.speed[t * self.events + n]
    }

    /// The network's acceleration that led to step `t` of event `n`, m/s²; `t` ≥ `horizon`.
    #[must_use]
    pub fn accel_mps2(&self, t: usize, n: usize) -> T {
        T::of(f64::from(self.shape.accel_limit_mps2)) * self.squashed[t * self.events + n]
    }

    /// Drives `events` (longest first, each longer than the horizon) with this network.
    ///
    /// `v[t+1] = v[t] + dt·a[t]`, `s[t+1] = s[t] + dt·((l[t] + l[t+1])/2 − (v[t] + v[t+1])/2)`; in the open loop too, from the
    /// recorded state of each step.
    ///
    /// # Panics
    /// When an event is not longer than the horizon or they are not sorted.
    pub fn forward(&mut self, network: &Network<T>, scaling: &Scaling, events: &[&Event], which: Loop) {
        self.load(events);
        let horizon = self.shape.horizon;
        let input_steps: Vec<usize> = self.steps.iter().map(|steps| steps - 1).collect();
        self.passes.begin(horizon, &input_steps);
        let (mean, spread) = scaling.all::<T>();
        for t in 0..self.passes.steps() {
            self.inputs.clear();
            for n in 0..self.passes.events(t) {
                let x = self.shape.features.of(&self.sight(t, n, events, which));
                self.inputs.extend((0..self.shape.features.inputs()).map(|k| (x[k] - mean[k]) / spread[k]));
            }
            let outputs = self.passes.forward(network, t, &self.inputs);
            self.outputs.clear();
            self.outputs.extend(outputs.iter().map(|y| y.fast_tanh()));
            self.integrate(t, events, which);
        }
    }

    /// What the network sees of step `t` of event `n`, whose earlier steps are driven.
    fn sight(&self, t: usize, n: usize, events: &[&Event], which: Loop) -> Sight<T> {
        let state = |t: usize| {
            let at = t * self.events + n;
            if which == Loop::Open { recorded(events[n], t) } else { (self.speed[at], self.spacing[at]) }
        };
        let back = t.min(self.shape.reach());
        let (speed, spacing) = state(t);
        let leader = |t: usize| self.leader[t * self.events + n];
        Sight {
            speed,
            leader: leader(t),
            spacing,
            earlier: (state(t - back).0, leader(t - back)),
            elapsed_s: T::of(back as f64 * f64::from(self.shape.dt_s)),
        }
    }

    fn load(&mut self, events: &[&Event]) {
        self.events = events.len();
        self.steps.clear();
        self.steps.extend(events.iter().map(|e| e.steps()));
        for counts in [&mut self.acted, &mut self.held] {
            counts.clear();
            counts.resize(self.events, 0);
        }
        assert!(self.steps.iter().all(|&steps| steps > self.shape.horizon), "every event outlasts its first window");
        let len = self.steps.first().copied().unwrap_or(0) * self.events;
        for buffer in [&mut self.leader, &mut self.spacing, &mut self.speed, &mut self.squashed] {
            buffer.clear();
            buffer.resize(len, T::zero());
        }
        for (n, event) in events.iter().enumerate() {
            for (t, &leader) in event.leader_speed_mps().iter().enumerate() {
                self.leader[t * self.events + n] = T::of(leader.into());
            }
            for t in 0..self.shape.horizon {
                let (v, s) = recorded(event, t);
                self.speed[t * self.events + n] = v;
                self.spacing[t * self.events + n] = s;
            }
        }
    }

    fn integrate(&mut self, t: usize, events: &[&Event], which: Loop) {
        let dt = T::of(f64::from(self.shape.dt_s));
        let limit = T::of(f64::from(self.shape.accel_limit_mps2));
        let half = T::of(0.5);
        for (n, &u) in self.outputs.iter().enumerate() {
            let (now, next) = (t * self.events + n, (t + 1) * self.events + n);
            let (v, s) = match which {
                Loop::Closed => (self.speed[now], self.spacing[now]),
                Loop::Open => recorded(events[n], t),
            };
            let mut next_v = v + dt * limit * u;
            if let Some(envelope) = self.envelope {
                let [raw, s, v_now, leader] = [limit * u, s, v, self.leader[now]].map(|x| x.wide() as f32);
                let bounded = envelope.bounded(raw, s, v_now, leader);
                if let Some(cause) = bounded.cause {
                    let counts = if cause == Cause::Leader { &mut self.acted } else { &mut self.held };
                    counts[n] += 1;
                    next_v = v + dt * T::of(bounded.accel_mps2.into());
                }
            }
            self.squashed[next] = u;
            self.speed[next] = next_v;
            self.spacing[next] = s + dt * (half * (self.leader[now] + self.leader[next]) - half * (v + next_v));
        }
    }

    /// Adds to `gradient` the derivative by every weight of a scalar: through every step that the network read a simulated
    /// state at, if it was one of the trajectory.
    pub fn backward(&mut self, network: &Network<T>, scaling: &Scaling, by: By<'_, T>, gradient: &mut [T]) {
        self.back(network, scaling, by, Gradients::Summed);
        self.passes.finish(gradient);
    }

    /// Gives `each` the number of every event and what it alone contributes to what [`Self::backward`] adds. May be done
    /// several times after one way forward.
    pub fn backward_each(
        &mut self,
        network: &Network<T>,
        scaling: &Scaling,
        by: By<'_, T>,
        mut each: impl FnMut(usize, &[T]),
    ) {
        self.back(network, scaling, by, Gradients::Own);
        let mut gradient = std::mem::take(&mut self.own);
        gradient.resize(network.weights().len(), T::zero());
        for n in 0..self.events {
            gradient.fill(T::zero());
            self.passes.add_own(n, &mut gradient);
            each(n, &gradient);
        }
        self.own = gradient;
    }

    fn back(&mut self, network: &Network<T>, scaling: &Scaling, by: By<'_, T>, wanted: Gradients) {
        self.passes.turn(wanted);
        match by {
            By::Trajectory(by) => self.back_through_the_loop(network, scaling, by),
            By::Accelerations(by) => self.back_from_accelerations(network, by),
        }
    }

    /// Through the integrator too.
    fn back_through_the_loop(&mut self, network: &Network<T>, scaling: &Scaling, by: &TrajectoryGradient<T>) {
        let dt = T::of(f64::from(self.shape.dt_s));
        let limit = T::of(f64::from(self.shape.accel_limit_mps2));
        let half_dt = T::of(0.5) * dt;
        let (horizon, features) = (self.shape.horizon, self.shape.features);
        let (_, spread) = scaling.all::<T>();
        // Derivatives by the state at step t + 1, then at step t.
        let (mut d_spacing, mut d_speed) = (vec![T::zero(); self.events], vec![T::zero(); self.events]);
        // By the speeds that accelerations were measured from; those of step t lie at t · events.
        self.by_earlier.clear();
        self.by_earlier.resize(self.speed.len(), T::zero());
        for t in (0..self.passes.steps()).rev() {
            self.outputs.clear();
            for n in 0..self.passes.answering(t) {
                let next = (t + 1) * self.events + n;
                d_spacing[n] += by.spacing[next];
                // s[t+1] depends on v[t+1], which depends on a[t].
                let through = d_speed[n] + by.speed[next] - half_dt * d_spacing[n];
                d_speed[n] = through - half_dt * d_spacing[n];
                let u = self.squashed[next];
                self.outputs.push(dt * through * limit * (T::one() - u * u));
            }
            self.passes.backward(network, t, &self.outputs);
            if t < horizon {
                continue;
            }
            self.by_inputs.clear();
            self.by_inputs.extend_from_slice(self.passes.by_inputs(network, t));
            let back = t.min(self.shape.reach());
            for n in 0..self.passes.events(t) {
                let dx = &mut self.by_inputs[n * features.inputs()..(n + 1) * features.inputs()];
                for (dx, spread) in dx.iter_mut().zip(spread) {
                    *dx /= spread;
                }
                let dx = &self.by_inputs[n * features.inputs()..(n + 1) * features.inputs()];
                let by_sight = features.back(&self.sight(t, n, &[], Loop::Closed), dx);
                d_speed[n] += by_sight.speed + self.by_earlier[t * self.events + n];
                d_spacing[n] += by_sight.spacing;
                self.by_earlier[(t - back) * self.events + n] += by_sight.earlier_speed;
            }
        }
    }

    fn back_from_accelerations(&mut self, network: &Network<T>, by: &[T]) {
        let limit = T::of(f64::from(self.shape.accel_limit_mps2));
        for t in (0..self.passes.steps()).rev() {
            let next = (t + 1) * self.events;
            let answering = next..next + self.passes.answering(t);
            self.outputs.clear();
            let each = by[answering.clone()].iter().zip(&self.squashed[answering]);
            self.outputs.extend(each.map(|(by, &u)| *by * limit * (T::one() - u * u)));
            self.passes.backward(network, t, &self.outputs);
        }
    }
}

/// What the network sees of step `t` of an event as recorded; for networks that see no more of it than that.
pub(super) fn recorded_sight<T: Real>(event: &Event, t: usize) -> Sight<T> {
    let (speed, spacing) = recorded(event, t);
    let leader = T::of(event.leader_speed_mps()[t].into());
    Sight { speed, leader, spacing, earlier: (speed, leader), elapsed_s: T::zero() }
}

/// Follower speed and spacing as recorded.
fn recorded<T: Real>(event: &Event, t: usize) -> (T, T) {
    (T::of(event.follower_speed_mps()[t].into()), T::of(event.spacing_m()[t].into()))
}
