//! Recorded events into three tasks: thirds by mean follower speed.

use crate::car_following::TrafficRegime;
use crate::protocol::quantile;

/// Where the thirds part, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Thirds {
    low: f64,
    high: f64,
}

impl Thirds {
    /// At the linear percentiles 100/3 and 200/3 of these speeds, which are finite.
    ///
    /// # Panics
    /// Without speeds.
    pub(super) fn of(speeds_mps: &[f64]) -> Self {
        let mut sorted = speeds_mps.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self { low: quantile(&sorted, 1.0 / 3.0), high: quantile(&sorted, 2.0 / 3.0) }
    }

    /// The middle third is (low, high].
    pub(super) fn regime(self, mean_speed_mps: f64) -> TrafficRegime {
        if mean_speed_mps <= self.low {
            TrafficRegime::Slow
        } else if mean_speed_mps <= self.high {
            TrafficRegime::Middle
        } else {
            TrafficRegime::Fast
        }
    }

    /// The two speeds, m/s.
    pub(super) fn split_mps(self) -> [f64; 2] {
        [self.low, self.high]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_linear_between_neighbours() {
        // numpy.percentile([4, 1, 3, 2], [100 / 3, 200 / 3]) is [2, 3], of [5, 1, 2] it is [1.66…, 3].
        let near = |thirds: Thirds, low: f64, high: f64| {
            assert!((thirds.low - low).abs() < 1e-12 && (thirds.high - high).abs() < 1e-12, "{thirds:?}");
        };
        near(Thirds::of(&[4.0, 1.0, 3.0, 2.0]), 2.0, 3.0);
        near(Thirds::of(&[5.0, 1.0, 2.0]), 5.0 / 3.0, 3.0);
        near(Thirds::of(&[7.0]), 7.0, 7.0);
    }

    #[test]
    fn the_middle_third_holds_its_upper_edge_and_not_its_lower_one() {
        let thirds = Thirds { low: 8.0, high: 13.0 };
        assert_eq!(thirds.regime(8.0), TrafficRegime::Slow);
        assert_eq!(thirds.regime(8.1), TrafficRegime::Middle);
        assert_eq!(thirds.regime(13.0), TrafficRegime::Middle);
        assert_eq!(thirds.regime(13.1), TrafficRegime::Fast);
    }

    #[test]
    fn a_third_of_the_events_is_in_each() {
        let speeds: Vec<f64> = (0..300).map(f64::from).collect();
        let thirds = Thirds::of(&speeds);
        for regime in TrafficRegime::ALL {
            assert_eq!(speeds.iter().filter(|&&speed| thirds.regime(speed) == regime).count(), 100);
        }
    }
}
