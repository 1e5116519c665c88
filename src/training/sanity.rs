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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coasting_behind_a_coasting_leader_costs_nothing() {
        let event = Event::new(0.1, vec![20.0; 30], vec![8.0; 30], vec![8.0; 30]);
        let shape = DriverShape { hidden: 1, horizon: 10, accel_limit_mps2: 3.0, ..DriverShape::PAPER };
        let penalties = Penalties { collision: 1000.0, backward: 1000.0, collision_margin_m: 4.0 };
        assert!(coasting_loss(&[&event], shape, penalties) < 1e-6);
    }
}
