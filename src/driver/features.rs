//! What the network reads of a step: the paper's four inputs, and what can be told from them.

use serde::{Deserialize, Serialize};

use crate::lstm::{INPUTS, Real};

/// Most inputs of a step.
pub(super) const MAX_INPUTS: usize = 7;

/// Spacing added in the inverse time to collision, m, so that it stays finite.
const LEAST_SPACING_M: f64 = 1.0;

/// What the network reads of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Features {
    /// Follower speed, leader speed, relative speed (m/s), spacing (m): the paper's.
    Raw,
    /// Those, and three more that an LSTM has trouble making of them:
    ///
    /// - follower and leader acceleration over the last `horizon` steps, `(v[t] − v[t−k]) / (k·dt)` with k = `horizon` − 1,
    ///   or as far back as there are steps, 0 at the first (m/s²);
    /// - inverse time to collision, `(l − v) / (max(s, 0) + 1 m)` (1/s), negative when closing.
    Motion,
}

/// A step as the network sees it, with the earlier step that its accelerations are measured from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight<T> {
    /// Follower speed, m/s.
    pub(super) speed: T,
    /// Leader speed, m/s.
    pub(super) leader: T,
    /// Spacing, m.
    pub(super) spacing: T,
    /// Follower and leader speed at the earlier step, m/s.
    pub(super) earlier: (T, T),
    /// From there to here, s; 0 at the first step.
    pub(super) elapsed_s: T,
}

/// Derivatives by what a simulated step brought about.
#[derive(Debug, Clone, Copy)]
pub(super) struct BySight<T> {
    pub(super) speed: T,
    pub(super) spacing: T,
    pub(super) earlier_speed: T,
}

impl Features {
    /// Inputs of a step.
    #[must_use]
    pub fn inputs(self) -> usize {
        match self {
            Self::Raw => INPUTS,
            Self::Motion => MAX_INPUTS,
        }
    }

    /// Whether windows that overlap read different inputs at a step that they share, because of where each begins.
    pub(super) fn depend_on_the_window(self) -> bool {
        self == Self::Motion
    }

    /// The inputs, in their own units; those that are not read are 0.
    pub(super) fn of<T: Real>(self, sight: &Sight<T>) -> [T; MAX_INPUTS] {
        let Sight { speed, leader, spacing, earlier, elapsed_s } = *sight;
        let mut x = [T::zero(); MAX_INPUTS];
        (x[0], x[1], x[2], x[3]) = (speed, leader, leader - speed, spacing);
        if self == Self::Motion {
            if elapsed_s > T::zero() {
                x[4] = (speed - earlier.0) / elapsed_s;
                x[5] = (leader - earlier.1) / elapsed_s;
            }
            x[6] = (leader - speed) / room(spacing);
        }
        x
    }

    /// From the derivatives by the inputs to those by the follower's state.
    pub(super) fn back<T: Real>(self, sight: &Sight<T>, dx: &[T]) -> BySight<T> {
        let mut by = BySight { speed: dx[0] - dx[2], spacing: dx[3], earlier_speed: T::zero() };
        if self == Self::Motion {
            if sight.elapsed_s > T::zero() {
                let by_accel = dx[4] / sight.elapsed_s;
                by.speed += by_accel;
                by.earlier_speed = -by_accel;
            }
            let room = room(sight.spacing);
            by.speed -= dx[6] / room;
            if sight.spacing > T::zero() {
                by.spacing -= dx[6] * (sight.leader - sight.speed) / (room * room);
            }
        }
        by
    }
}

fn room<T: Real>(spacing: T) -> T {
    let positive = if spacing > T::zero() { spacing } else { T::zero() };
    positive + T::of(LEAST_SPACING_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGHT: Sight<f64> = Sight { speed: 9.0, leader: 8.0, spacing: 4.0, earlier: (8.1, 8.9), elapsed_s: 0.9 };

    #[test]
    fn features_agree_with_hand_computed_ones() {
        let x = Features::Motion.of(&SIGHT);
        for (x, expected) in x.into_iter().zip([9.0, 8.0, -1.0, 4.0, 1.0, -1.0, -0.2]) {
            assert!((x - expected).abs() < 1e-12, "{x} {expected}");
        }
        assert_eq!(Features::Raw.of(&SIGHT)[..4], [9.0, 8.0, -1.0, 4.0]);
        let first = Sight { elapsed_s: 0.0, earlier: (9.0, 8.0), ..SIGHT };
        assert_eq!(Features::Motion.of(&first)[4..6], [0.0, 0.0]);
        let collided = Sight { spacing: -3.0, ..SIGHT };
        assert_eq!(Features::Motion.of(&collided)[6], -1.0, "finite behind the leader's bumper");
    }
}
