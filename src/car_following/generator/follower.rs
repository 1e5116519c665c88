//! Followers: people and cruise controls that differ, react late and are not quite steady.

use super::TrafficRegime;
use super::noise::{Noise, OrnsteinUhlenbeck};
use crate::car_following::{FollowerState, Idm};

/// How long a driver's headway stays above or below the usual, s.
const DRIFT_S: f64 = 12.0;

/// However inattentive, a driver keeps this share of the usual headway.
const LEAST_HEADWAY_SHARE: f64 = 0.4;

/// A driver.
#[derive(Debug, Clone, Copy)]
pub(super) struct Follower {
    idm: Idm,
    /// How old the perceived spacing and leader speed are, s; one's own speed is felt at once.
    reaction_s: f64,
    /// Deviation of the acceleration around the intended one, m/s².
    unsteadiness_mps2: f64,
    /// Deviation of the headway kept around the driver's own, as a share of it: attention comes and goes.
    headway_drift: f64,
}

/// Trajectory of a follower: spacing in m and speed in m/s, one a step.
pub(super) struct Trajectory {
    pub(super) spacing_m: Vec<f64>,
    pub(super) speed_mps: Vec<f64>,
}

impl Follower {
    /// A driver as found in this traffic: in motorway traffic calm ones that keep long headways, as adaptive cruise
    /// controls do; on arterials people of medium haste; in congestion impatient ones, close up and harsh.
    pub(super) fn drawn(regime: TrafficRegime, noise: &mut Noise) -> Self {
        match regime {
            TrafficRegime::Fast => Self {
                idm: Idm {
                    desired_speed_mps: noise.person(33.0, 1.5),
                    time_headway_s: noise.person(1.5, 0.3),
                    jam_spacing_m: noise.person(2.8, 0.5),
                    max_accel_mps2: noise.person(1.3, 0.2),
                    comfortable_braking_mps2: noise.person(1.5, 0.2),
                },
                reaction_s: noise.between(0.2, 0.4),
                unsteadiness_mps2: 0.22,
                headway_drift: 0.27,
            },
            TrafficRegime::Middle => Self {
                idm: Idm {
                    desired_speed_mps: noise.person(25.0, 1.5),
                    time_headway_s: noise.person(1.4, 0.25),
                    jam_spacing_m: noise.person(2.6, 0.4),
                    max_accel_mps2: noise.person(1.4, 0.2),
                    comfortable_braking_mps2: noise.person(1.8, 0.3),
                },
                reaction_s: noise.between(0.2, 0.5),
                unsteadiness_mps2: 0.2,
                headway_drift: 0.25,
            },
            TrafficRegime::Slow => Self {
                idm: Idm {
                    desired_speed_mps: noise.person(20.0, 1.5),
                    time_headway_s: noise.person(1.3, 0.22),
                    jam_spacing_m: noise.person(2.4, 0.3),
                    max_accel_mps2: noise.person(1.6, 0.25),
                    comfortable_braking_mps2: noise.person(2.2, 0.3),
                },
                reaction_s: noise.between(0.2, 0.5),
                unsteadiness_mps2: 0.2,
                headway_drift: 0.25,
            },
        }
    }

    /// Follows a leader from equilibrium on.
    pub(super) fn behind(&self, leader_mps: &[f64], dt_s: f64, noise: &mut Noise) -> Trajectory {
        let start_mps = leader_mps[0].min(0.95 * self.idm.desired_speed_mps);
        let mut state = FollowerState { spacing_m: self.idm.equilibrium_spacing_m(start_mps), speed_mps: start_mps };
        let mut unsteady = OrnsteinUhlenbeck::new(self.unsteadiness_mps2, 1.5, dt_s, noise);
        let mut drift = OrnsteinUhlenbeck::new(self.headway_drift, DRIFT_S, dt_s, noise);
        let late = self.late_steps(dt_s);
        let mut past = Trajectory { spacing_m: vec![state.spacing_m], speed_mps: vec![state.speed_mps] };
        for (now, leader) in leader_mps.windows(2).enumerate() {
            let seen = now.saturating_sub(late);
            let headway_s = self.idm.time_headway_s * (1.0 + drift.next(noise)).max(LEAST_HEADWAY_SHARE);
            let mood = Idm { time_headway_s: headway_s, ..self.idm };
            let wished = mood.accel_mps2(past.spacing_m[seen], state.speed_mps, leader_mps[seen]);
            let deviation = unsteady.next(noise);
            // A standing driver holds the brake: unsteadiness moves no car.
            let accel = if state.speed_mps == 0.0 && wished <= 0.0 { wished } else { wished + deviation };
            state = state.advanced(accel, [leader[0], leader[1]], dt_s);
            past.spacing_m.push(state.spacing_m);
            past.speed_mps.push(state.speed_mps);
        }
        past
    }

    fn late_steps(&self, dt_s: f64) -> usize {
        (self.reaction_s / dt_s).round() as usize
    }
}
