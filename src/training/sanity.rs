//! The yardstick for divergence: a driver who does nothing.

use super::loss::Penalties;
use crate::car_following::Event;
use crate::driver::DriverShape;

/// Loss of a follower who keeps the speed it had when the simulation begins, on the same events and terms as training.
pub(super) fn coasting_loss(events: &[&Event], shape: DriverShape, penalties: Penalties) -> f64 {
    let dt = f64::from(shape.dt_s);
    let (mut sum, mut steps) = (0.0, 0_usize);
    for event in events {
        let from = shape.horizon - 1;
        let speed = f64::from(event.follower_speed_mps()[from]);
        let mut spacing = f64::from(event.spacing_m()[from]);
        for t in shape.horizon..event.steps() {
            let leader = 0.5 * (f64::from(event.leader_speed_mps()[t - 1]) + f64::from(event.leader_speed_mps()[t]));
            spacing += dt * (leader - speed);
            let recorded = f64::from(event.spacing_m()[t]);
            sum += (spacing - recorded).powi(2);
            sum += (speed - f64::from(event.follower_speed_mps()[t])).powi(2);
            sum += penalties.collision * penalties.intrusion_m(spacing, recorded);
            steps += 1;
        }
    }
    sum / steps.max(1) as f64
}

/// Acceleration that a driver who learns may be off by all along before it counts as one who does not, m/s².
pub(super) const DRIFT_MPS2: f64 = 0.25;

/// Loss of a follower who is off by [`DRIFT_MPS2`] on every simulated step: after t seconds by t²/2 and t times that. What a
/// driver is measured by in traffic so steady that doing nothing costs nothing.
pub(super) fn drift_loss(events: &[&Event], shape: DriverShape) -> f64 {
    let (mut sum, mut steps) = (0.0, 0_usize);
    for event in events {
        for step in 1..=event.steps() - shape.horizon {
            let t = step as f64 * f64::from(shape.dt_s);
            sum += (0.5 * DRIFT_MPS2 * t * t).powi(2) + (DRIFT_MPS2 * t).powi(2);
            steps += 1;
        }
    }
    sum / steps.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drift_costs_what_its_path_and_its_speed_cost() {
        let event = Event::new(1.0, vec![20.0; 4], vec![8.0; 4], vec![8.0; 4]);
        let shape = DriverShape { horizon: 2, dt_s: 1.0, ..DriverShape::PAPER };
        // After 1 s off by 0.125 m and 0.25 m/s, after 2 s by 0.5 m and 0.5 m/s.
        let by_hand = (0.125_f64.powi(2) + 0.25_f64.powi(2) + 0.5_f64.powi(2) + 0.5_f64.powi(2)) / 2.0;
        assert!((drift_loss(&[&event], shape) - by_hand).abs() < 1e-12);
    }

    #[test]
    fn coasting_behind_a_coasting_leader_costs_nothing() {
        let event = Event::new(0.1, vec![20.0; 30], vec![8.0; 30], vec![8.0; 30]);
        let shape = DriverShape { hidden: 1, horizon: 10, accel_limit_mps2: 3.0, ..DriverShape::PAPER };
        let penalties = Penalties { collision: 1000.0, backward: 1000.0, collision_margin_m: 4.0 };
        assert!(coasting_loss(&[&event], shape, penalties) < 1e-6);
    }
}
