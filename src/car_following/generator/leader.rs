//! Leaders: a plan of phases, driven with bounded acceleration and jerk.

use super::TrafficRegime;
use super::noise::{Noise, OrnsteinUhlenbeck};

/// Seconds in which a leader would close the difference to the speed it aims at.
const APPROACH_S: f64 = 1.5;

/// One phase of a leader's plan.
#[derive(Debug, Clone, Copy)]
struct Phase {
    /// The speed aimed at, m/s; ≤ 0 is a stop.
    aim_mps: f64,
    /// Greatest acceleration, m/s².
    accel_mps2: f64,
    /// Greatest braking, m/s².
    braking_mps2: f64,
    /// Time from the start of the phase to its end, s.
    lasts_s: f64,
}

/// Speeds of a leader in m/s, one a step.
pub(super) fn leader_speeds(regime: TrafficRegime, steps: usize, dt_s: f64, noise: &mut Noise) -> Vec<f64> {
    let mut plan = Plan::new(regime, noise);
    let (deviation, jerk) = match regime {
        TrafficRegime::Fast => (0.3, 1.0),
        TrafficRegime::Middle => (0.4, 2.0),
        TrafficRegime::Slow => (0.3, 3.0),
    };
    let mut wander = OrnsteinUhlenbeck::new(deviation, 4.0, dt_s, noise);
    let (mut speed, mut accel) = (plan.cruise_mps, 0.0);
    let mut phase = plan.next(noise);
    let mut left_s = phase.lasts_s * noise.unit();
    let mut speeds = Vec::with_capacity(steps);
    for _ in 0..steps {
        speeds.push(speed);
        if left_s <= 0.0 {
            phase = plan.next(noise);
            left_s = phase.lasts_s;
        }
        left_s -= dt_s;
        let wandering = wander.next(noise);
        // Who stands, stands: no creeping by noise.
        let aim = if phase.aim_mps > 0.0 { (phase.aim_mps + wandering).max(0.0) } else { phase.aim_mps };
        let wished = ((aim - speed) / APPROACH_S).clamp(-phase.braking_mps2, phase.accel_mps2);
        accel += (wished - accel).clamp(-jerk * dt_s, jerk * dt_s);
        speed += accel * dt_s;
        if speed <= 0.0 {
            (speed, accel) = (0.0, 0.0);
        }
    }
    speeds
}

/// What a leader does next.
struct Plan {
    regime: TrafficRegime,
    /// The speed the leader comes back to, m/s.
    cruise_mps: f64,
    /// Whether the last phase was a slow one.
    was_slow: bool,
}

impl Plan {
    fn new(regime: TrafficRegime, noise: &mut Noise) -> Self {
        let cruise_mps = match regime {
            // Most traffic flows at 15–19 m/s, some at 24.
            TrafficRegime::Fast => 15.0 + 9.0 * noise.unit() * noise.unit(),
            TrafficRegime::Middle => noise.between(12.0, 18.0),
            TrafficRegime::Slow => noise.between(6.0, 13.0),
        };
        Self { regime, cruise_mps, was_slow: noise.chance(0.5) }
    }

    fn next(&mut self, noise: &mut Noise) -> Phase {
        match self.regime {
            TrafficRegime::Fast => self.motorway(noise),
            TrafficRegime::Middle => self.arterial(noise),
            TrafficRegime::Slow => self.congestion(noise),
        }
    }

    /// Cruising with mild changes, now and then a slowdown.
    fn motorway(&mut self, noise: &mut Noise) -> Phase {
        self.was_slow = !self.was_slow && noise.chance(0.3);
        let drop_mps = if self.was_slow { noise.between(3.0, 8.0) } else { 0.8 * noise.normal() };
        Phase {
            aim_mps: self.cruise_mps - drop_mps,
            accel_mps2: noise.between(0.4, 0.9),
            braking_mps2: noise.between(0.6, 1.6),
            lasts_s: noise.between(4.0, 9.0),
        }
    }

    /// Braking for what is ahead and accelerating again, without stopping.
    fn arterial(&mut self, noise: &mut Noise) -> Phase {
        self.was_slow = !self.was_slow;
        let aim_mps = if self.was_slow { noise.between(4.0, 9.0) } else { self.cruise_mps + 0.8 * noise.normal() };
        Phase {
            aim_mps,
            accel_mps2: noise.between(0.9, 1.7),
            braking_mps2: noise.between(1.2, 2.4),
            lasts_s: noise.between(4.0, 8.0),
        }
    }

    /// Stop-and-go waves: mostly to a standstill, sometimes to a crawl.
    fn congestion(&mut self, noise: &mut Noise) -> Phase {
        self.was_slow = !self.was_slow;
        let aim_mps = match (self.was_slow, noise.chance(0.6)) {
            (true, true) => -0.5,
            (true, false) => noise.between(1.0, 3.5),
            (false, _) => self.cruise_mps + 0.6 * noise.normal(),
        };
        let dwell_s = if aim_mps < 0.0 { noise.between(1.0, 3.0) } else { 0.0 };
        Phase {
            aim_mps,
            accel_mps2: noise.between(1.2, 2.2),
            braking_mps2: noise.between(1.5, 3.2),
            lasts_s: noise.between(4.0, 8.0) + dwell_s,
        }
    }
}
