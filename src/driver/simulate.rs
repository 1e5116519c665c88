//! A served driver on its way: closed loop behind a given leader.

use super::{Driver, Memory, Seen, Sequence, Window};
use crate::lstm::EncoderState;
use crate::safety::Envelope;

/// A simulated follower: one value per given leader step.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Spacing at each leader step, m.
    pub spacing_m: Vec<f32>,
    /// Follower speed at each leader step, m/s.
    pub follower_speed_mps: Vec<f32>,
    /// Acceleration that led to each of them, m/s².
    pub accel_mps2: Vec<f32>,
    /// Steps on which that is not what the network asked for.
    pub differing_steps: usize,
}

/// What the network remembers on the way.
enum Remembered {
    Windows(Sequence),
    Carried(EncoderState),
}

impl Driver {
    /// Drives on from `initial` behind a leader whose speed is given from the step after the window on: n speeds give n
    /// steps. The first acceleration is what [`Self::accelerations`] answers for the window, within the envelope; later ones
    /// what it answers for the last `horizon` steps, or, with [`Memory::Carried`], what the state carried on from the window
    /// answers. Goes on after a collision.
    ///
    /// # Panics
    /// When the window does not hold `horizon` steps.
    #[must_use]
    pub fn simulate(&self, initial: &Window, leader_speed_mps: &[f32], envelope: Option<Envelope>) -> Simulation {
        self.check(initial);
        let horizon = self.shape.horizon;
        let mut driven = initial.clone();
        let mut accel = Vec::with_capacity(leader_speed_mps.len());
        let mut differing_steps = 0;
        let mut remembered = match self.shape.memory {
            Memory::Window => Remembered::Windows(self.sequence()),
            Memory::Carried => Remembered::Carried(self.encoder.state()),
        };
        for t in 0..horizon - 1 {
            self.remember(&mut remembered, &driven, t);
        }
        for &next_leader in leader_speed_mps {
            let now = driven.leader_speed_mps.len() - 1;
            let raw = self.remember(&mut remembered, &driven, now).expect("the window is full");
            let Seen { spacing_m: s, follower_speed_mps: v, leader_speed_mps: l } = driven.seen(now);
            let a = envelope.map_or(raw, |e| e.served_mps2(raw, s, v, l));
            differing_steps += usize::from(a != raw);
            let next_v = v + self.shape.dt_s * a;
            let closing = 0.5 * (l + next_leader) - 0.5 * (v + next_v);
            driven.spacing_m.push(s + self.shape.dt_s * closing);
            driven.follower_speed_mps.push(next_v);
            driven.leader_speed_mps.push(next_leader);
            accel.push(a);
        }
        Simulation {
            spacing_m: driven.spacing_m.split_off(horizon),
            follower_speed_mps: driven.follower_speed_mps.split_off(horizon),
            accel_mps2: accel,
            differing_steps,
        }
    }

    /// Reads step `t` of `driven`; the acceleration for it, m/s², unless a window is to be filled first.
    fn remember(&self, remembered: &mut Remembered, driven: &Window, t: usize) -> Option<f32> {
        match remembered {
            Remembered::Windows(sequence) => self.read(sequence, driven.seen(t)),
            Remembered::Carried(state) => {
                let back = t.min(self.shape.reach());
                let mut inputs = Vec::with_capacity(self.shape.features.inputs());
                self.standardise(driven.seen(t), driven.seen(t - back), back, &mut inputs);
                let mut head = [self.encoder.advance(state, &inputs)];
                self.squash(&mut head);
                Some(head[0])
            }
        }
    }
}
