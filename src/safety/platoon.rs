//! String stability: what becomes of a disturbance from car to car.

use std::f64::consts::TAU;

use serde::Serialize;

use super::Trajectory;
use crate::car_following::Event;

/// Seconds for which the platoon is left to find its equilibrium before the leader does anything.
const WARM_UP_S: f64 = 60.0;

/// Seconds after which a periodic disturbance has reached the last car and its beginning is forgotten.
const SETTLING_S: f64 = 60.0;

/// Least seconds over which a periodic disturbance is measured, in whole periods.
const MEASURED_S: f64 = 60.0;

/// Braking of the leader in the single disturbance, m/s², for [`DIP_MPS`], held for [`HOLD_S`] and made good at half the rate.
const DIP_BRAKING_MPS2: f64 = 2.0;
const DIP_MPS: f64 = 4.0;
const HOLD_S: f64 = 5.0;

/// Below this share of the leader's amplitude a car's oscillation is not worth amplifying.
const LEAST_SHARE: f64 = 0.01;

/// Cars of one kind of driver behind a leader whose speed is disturbed.
#[derive(Debug, Clone, PartialEq)]
pub struct Platoon {
    /// Seconds between steps.
    pub dt_s: f64,
    /// Steps of the window that is given.
    pub horizon: usize,
    /// Followers.
    pub cars: usize,
    /// The leader's undisturbed speed, m/s.
    pub speed_mps: f64,
    /// Amplitude of its periodic disturbances, m/s.
    pub amplitude_mps: f64,
    /// Their periods, s.
    pub periods_s: Vec<f64>,
}

/// What became of one periodic disturbance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WaveGain {
    /// s.
    pub period_s: f64,
    /// Amplitude of the speed at this period, from the leader (first) to the last car, m/s.
    pub amplitude_mps: Vec<f64>,
    /// Greatest gain from one car to the next; above 1 the disturbance grows.
    pub max_gain: f64,
    /// From the leader to the last car.
    pub total_gain: f64,
}

/// What becomes of disturbances in a platoon.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlatoonOutcome {
    /// Followers.
    pub cars: usize,
    /// The leader's undisturbed speed, m/s.
    pub speed_mps: f64,
    /// Greatest deviation from that speed when the leader brakes once by 4 m/s, from the leader to the last car, m/s.
    pub dip_mps: Vec<f64>,
    /// The last car's dip over the leader's.
    pub dip_gain: f64,
    /// One entry a period.
    pub waves: Vec<WaveGain>,
    /// Least spacing of any car behind any leader, m.
    pub min_spacing_m: f64,
    /// Cars, over all disturbances, that collide.
    pub collisions: usize,
}

impl Platoon {
    /// The platoon that is published: ten cars at 12 m/s, waves of 1 m/s and 5 to 40 s.
    #[must_use]
    pub fn published(dt_s: f64, horizon: usize) -> Self {
        Self { dt_s, horizon, cars: 10, speed_mps: 12.0, amplitude_mps: 1.0, periods_s: vec![5.0, 10.0, 20.0, 40.0] }
    }

    /// Lets the cars drive one after the other, each behind the one before it.
    pub fn run(&self, drive: &mut dyn FnMut(&[Event]) -> Vec<Trajectory>) -> PlatoonOutcome {
        let mut leaders: Vec<Vec<f32>> = vec![self.dip()];
        leaders.extend(self.periods_s.iter().map(|&period| self.wave(period)));
        let mut dips = vec![self.deviation(&leaders[0])];
        let mut amplitudes: Vec<Vec<f64>> =
            self.periods_s.iter().zip(&leaders[1..]).map(|(&p, speeds)| vec![self.amplitude(speeds, p)]).collect();
        let (mut least, mut collisions) = (f64::INFINITY, 0);
        for _ in 0..self.cars {
            let events: Vec<Event> = leaders.iter().map(|leader| self.behind(leader)).collect();
            let driven = drive(&events);
            collisions += driven.iter().filter(|driven| driven.collides(self.horizon)).count();
            least = driven.iter().flat_map(|d| &d.spacing_m).fold(least, |least, &s| least.min(s.into()));
            leaders = driven.into_iter().map(|driven| driven.follower_speed_mps).collect();
            dips.push(self.deviation(&leaders[0]));
            for ((&period, speeds), amplitudes) in self.periods_s.iter().zip(&leaders[1..]).zip(&mut amplitudes) {
                amplitudes.push(self.amplitude(speeds, period));
            }
        }
        PlatoonOutcome {
            cars: self.cars,
            speed_mps: self.speed_mps,
            dip_gain: dips[self.cars] / dips[0],
            dip_mps: dips,
            waves: self.periods_s.iter().zip(amplitudes).map(|(&period, a)| gain(period, a)).collect(),
            min_spacing_m: least,
            collisions,
        }
    }

    /// A car at the leader's speed, in a spacing from which it finds its own.
    fn behind(&self, leader: &[f32]) -> Event {
        let steps = leader.len();
        let spacing = (2.0 + 1.5 * self.speed_mps) as f32;
        Event::new(self.dt_s, vec![spacing; steps], vec![self.speed_mps as f32; steps], leader.to_vec())
    }

    fn steps(&self, seconds: f64) -> usize {
        (seconds / self.dt_s).round() as usize
    }

    fn dip(&self) -> Vec<f32> {
        let mut speeds = vec![self.speed_mps; self.steps(WARM_UP_S)];
        let down = self.steps(DIP_MPS / DIP_BRAKING_MPS2);
        let low = self.speed_mps - DIP_MPS;
        speeds.extend((1..=down).map(|i| self.speed_mps - DIP_MPS * i as f64 / down as f64));
        speeds.extend(vec![low; self.steps(HOLD_S)]);
        speeds.extend((1..=2 * down).map(|i| low + DIP_MPS * i as f64 / (2 * down) as f64));
        speeds.extend(vec![self.speed_mps; self.steps(SETTLING_S)]);
        speeds.into_iter().map(|v| v as f32).collect()
    }

    fn wave(&self, period_s: f64) -> Vec<f32> {
        let warm_up = self.steps(WARM_UP_S);
        let steps = warm_up + self.steps(SETTLING_S) + self.measured(period_s);
        let speed = |t: usize| {
            let phase = TAU * self.dt_s * t.saturating_sub(warm_up) as f64 / period_s;
            (self.speed_mps + self.amplitude_mps * phase.sin()) as f32
        };
        (0..steps).map(speed).collect()
    }

    /// Steps of whole periods, at least [`MEASURED_S`].
    fn measured(&self, period_s: f64) -> usize {
        self.steps((MEASURED_S / period_s).ceil() * period_s)
    }

    fn deviation(&self, speeds: &[f32]) -> f64 {
        let after = &speeds[self.steps(WARM_UP_S)..];
        after.iter().fold(0.0, |most: f64, &v| most.max((f64::from(v) - self.speed_mps).abs()))
    }

    /// Amplitude of the speed at this period: its Fourier coefficient over the last whole periods.
    fn amplitude(&self, speeds: &[f32], period_s: f64) -> f64 {
        let measured = self.measured(period_s);
        let (mut sin, mut cos) = (0.0, 0.0);
        for (t, &v) in speeds[speeds.len() - measured..].iter().enumerate() {
            let phase = TAU * self.dt_s * t as f64 / period_s;
            sin += f64::from(v) * phase.sin();
            cos += f64::from(v) * phase.cos();
        }
        2.0 * sin.hypot(cos) / measured as f64
    }
}

fn gain(period_s: f64, amplitude_mps: Vec<f64>) -> WaveGain {
    let felt = LEAST_SHARE * amplitude_mps[0];
    let gains = amplitude_mps.windows(2).filter(|pair| pair[0] > felt).map(|pair| pair[1] / pair[0]);
    WaveGain {
        period_s,
        max_gain: gains.fold(0.0, f64::max),
        total_gain: amplitude_mps.last().unwrap_or(&0.0) / amplitude_mps[0],
        amplitude_mps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HORIZON: usize = 10;

    /// a = (l − v)/τ: the gain of its speed at angular frequency ω is 1/√(1 + (ω·τ)²), whatever the spacing.
    fn relaxing(tau_s: f64) -> PlatoonOutcome {
        let platoon = Platoon { cars: 3, ..Platoon::published(0.1, HORIZON) };
        platoon.run(&mut |events| {
            events.iter().map(|e| Trajectory::by_rule(e, HORIZON, |_, _, v, l| (l - v) / tau_s)).collect()
        })
    }

    #[test]
    fn the_gain_of_a_linear_driver_is_the_one_of_theory() {
        let outcome = relaxing(2.0);
        for wave in &outcome.waves {
            let theory = 1.0 / (1.0 + (TAU / wave.period_s * 2.0).powi(2)).sqrt();
            assert!((wave.max_gain - theory).abs() < 0.05 * theory, "{} s: {} {theory}", wave.period_s, wave.max_gain);
            assert!((wave.total_gain - theory.powi(3)).abs() < 0.15 * theory.powi(3));
            assert!((wave.amplitude_mps[0] - 1.0).abs() < 1e-3);
        }
        assert_eq!((outcome.dip_mps.len(), outcome.collisions), (4, 0));
        assert!(outcome.dip_gain < 1.0 && (outcome.dip_mps[0] - 4.0).abs() < 1e-3);
    }

    #[test]
    fn a_driver_who_overdoes_it_makes_waves_grow() {
        let platoon = Platoon { cars: 4, periods_s: vec![10.0], ..Platoon::published(0.1, HORIZON) };
        // Closed loop on a wished spacing of 20 m with too little damping.
        let outcome = platoon.run(&mut |events| {
            let accel = |_, s, v: f64, l| 0.4 * (s - 20.0) + 0.25 * (l - v);
            events.iter().map(|e| Trajectory::by_rule(e, HORIZON, accel)).collect()
        });
        assert!(outcome.waves[0].max_gain > 1.2 && outcome.waves[0].total_gain > 2.0, "{:?}", outcome.waves);
    }
}
