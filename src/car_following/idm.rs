//! The Intelligent Driver Model.

/// Nobody brakes harder than this, m/s²: below the 8 m/s² that the physics checks accept.
pub const HARDEST_BRAKING_MPS2: f64 = 7.5;

/// Below this spacing the interaction term is evaluated at it, so that a collided follower brakes instead of dividing by 0.
const LEAST_SPACING_M: f64 = 0.1;

/// The Intelligent Driver Model of Treiber, Hennecke and Helbing (Physical Review E 62, 1805, 2000).
///
/// `a · (1 − (v/v₀)⁴ − (s*/s)²)` with the desired spacing `s* = s₀ + max(0, v·T − v·Δv / (2·√(a·b)))`,
/// where s is the spacing, v the follower's speed and Δv the relative speed, leader − follower
/// (the paper's Δv has the other sign).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Idm {
    /// v₀, the speed on a free road, m/s, > 0.
    pub desired_speed_mps: f64,
    /// T, the time headway kept while following, s, ≥ 0.
    pub time_headway_s: f64,
    /// s₀, the spacing kept at standstill, m, > 0.
    pub jam_spacing_m: f64,
    /// a, the acceleration from standstill on a free road, m/s², > 0.
    pub max_accel_mps2: f64,
    /// b, the braking that is felt as comfortable, m/s², > 0.
    pub comfortable_braking_mps2: f64,
}

impl Idm {
    /// The acceleration wished for, m/s², at least −7.5.
    #[must_use]
    pub fn accel_mps2(&self, spacing_m: f64, follower_speed_mps: f64, leader_speed_mps: f64) -> f64 {
        let v = follower_speed_mps;
        let closing_mps = v - leader_speed_mps;
        let braking_term = closing_mps / (2.0 * (self.max_accel_mps2 * self.comfortable_braking_mps2).sqrt());
        let desired_spacing_m = self.jam_spacing_m + (v * (self.time_headway_s + braking_term)).max(0.0);
        let interaction = square(desired_spacing_m / spacing_m.max(LEAST_SPACING_M));
        let free_road = square(square(v / self.desired_speed_mps));
        (self.max_accel_mps2 * (1.0 - free_road - interaction)).max(-HARDEST_BRAKING_MPS2)
    }

    /// The spacing at which a follower behind an equally fast leader neither accelerates nor brakes, m:
    /// `(s₀ + v·T) / √(1 − (v/v₀)⁴)`. Infinite from the desired speed on.
    #[must_use]
    pub fn equilibrium_spacing_m(&self, speed_mps: f64) -> f64 {
        let room = 1.0 - square(square(speed_mps / self.desired_speed_mps));
        if room <= 0.0 {
            return f64::INFINITY;
        }
        (self.jam_spacing_m + speed_mps * self.time_headway_s) / room.sqrt()
    }
}

/// A follower's place and speed relative to its leader.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowerState {
    /// Bumper-to-bumper spacing, m.
    pub spacing_m: f64,
    /// Follower speed, m/s, ≥ 0.
    pub speed_mps: f64,
}

impl FollowerState {
    /// One step of the project's integrator, with an acceleration that is cut so that the follower stops and never backs:
    /// `v' = v + dt·a`, `s' = s + dt·((l + l')/2 − (v + v')/2)`, l and l' being the leader's speeds before and after.
    #[must_use]
    pub fn advanced(self, accel_mps2: f64, leader_mps: [f64; 2], dt_s: f64) -> Self {
        let speed_mps = (self.speed_mps + dt_s * accel_mps2).max(0.0);
        let leader_mean = f64::midpoint(leader_mps[0], leader_mps[1]);
        let follower_mean = f64::midpoint(self.speed_mps, speed_mps);
        Self { spacing_m: self.spacing_m + dt_s * (leader_mean - follower_mean), speed_mps }
    }
}

fn square(x: f64) -> f64 {
    x * x
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The motorway parameters of the paper's table I, with a desired speed of 120 km/h.
    const PAPER: Idm = Idm {
        desired_speed_mps: 120.0 / 3.6,
        time_headway_s: 1.6,
        jam_spacing_m: 2.0,
        max_accel_mps2: 0.73,
        comfortable_braking_mps2: 1.67,
    };

    #[test]
    fn a_follower_at_equilibrium_keeps_its_speed() {
        for speed in [0.0, 5.0, 20.0, 33.0] {
            let spacing = PAPER.equilibrium_spacing_m(speed);
            assert!(PAPER.accel_mps2(spacing, speed, speed).abs() < 1e-12, "at {speed} m/s");
        }
        assert!(PAPER.equilibrium_spacing_m(40.0).is_infinite());
    }

    #[test]
    fn a_free_road_gives_the_greatest_acceleration_and_the_desired_speed_none() {
        assert!((PAPER.accel_mps2(1e9, 0.0, 0.0) - 0.73).abs() < 1e-9);
        assert!(PAPER.accel_mps2(1e9, PAPER.desired_speed_mps, PAPER.desired_speed_mps).abs() < 1e-9);
    }

    #[test]
    fn the_hand_computed_case_agrees() {
        // v = 10, leader 8, s = 20: s* = 2 + 10·1.6 + 10·2/(2·√(0.73·1.67)) = 27.0569;
        // a = 0.73·(1 − (10/33.3333)⁴ − (27.0569/20)²) = −0.61196.
        let accel = PAPER.accel_mps2(20.0, 10.0, 8.0);
        assert!((accel - -0.611_96).abs() < 1e-4, "{accel}");
    }

    proptest! {
        #[test]
        fn braking_is_bounded_and_no_follower_moves_backwards(
            spacing in -5.0..200.0f64, speed in 0.0..40.0f64, leader in 0.0..40.0f64,
        ) {
            let accel = PAPER.accel_mps2(spacing, speed, leader);
            prop_assert!((-HARDEST_BRAKING_MPS2..=PAPER.max_accel_mps2).contains(&accel));
            let next = FollowerState { spacing_m: spacing, speed_mps: speed }.advanced(accel, [leader, leader], 0.1);
            prop_assert!(next.speed_mps >= 0.0);
        }

        #[test]
        fn more_room_never_means_less_acceleration(
            spacing in 0.5..150.0f64, more in 0.0..50.0f64, speed in 0.0..30.0f64, leader in 0.0..30.0f64,
        ) {
            let (near, far) = (PAPER.accel_mps2(spacing, speed, leader), PAPER.accel_mps2(spacing + more, speed, leader));
            prop_assert!(far >= near);
        }
    }
}
