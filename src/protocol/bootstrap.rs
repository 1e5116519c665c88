//! How sure a number is: the bootstrap over whole runs and over seeds.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::quantile;

/// One resample: how often each run and each seed was drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// Of each run.
    pub runs: Vec<f64>,
    /// Of each seed.
    pub seeds: Vec<f64>,
}

/// Resamples with replacement, the same for every number, so that comparisons are paired.
///
/// Events cut from one recording are alike, so runs are drawn and not events (the cluster bootstrap); and seeds, since
/// training has its own luck. Intervals are percentiles of the resampled values (Efron & Tibshirani 1993).
#[derive(Debug, Clone)]
pub struct Bootstrap {
    whole: Draw,
    draws: Vec<Draw>,
    level: f64,
}

impl Bootstrap {
    /// `resamples` draws of `runs` runs and `seeds` seeds, for intervals of this `level` (0.95 leaves 2.5 % on each side).
    #[must_use]
    pub fn new(runs: usize, seeds: usize, resamples: usize, level: f64, key: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(key);
        let mut drawn = |count: usize| {
            let mut times = vec![0.0; count];
            for _ in 0..count {
                // The high half of a 64 × 64 bit product is uniform to within 2⁻⁶⁴ · count.
                let pick = (u128::from(random.next_u64()) * count as u128) >> 64;
                times[pick as usize] += 1.0;
            }
            times
        };
        let draws = (0..resamples).map(|_| Draw { runs: drawn(runs), seeds: drawn(seeds) }).collect();
        Self { whole: Draw { runs: vec![1.0; runs], seeds: vec![1.0; seeds] }, draws, level }
    }

    /// The number itself: every run and every seed once.
    pub fn value<X>(&self, statistic: impl Fn(&Draw) -> X) -> X {
        statistic(&self.whole)
    }

    /// The interval of a number; none when fewer than half of the resamples have it, or none of them differs: without a
    /// collision, or with one run, they tell nothing about how sure the number is.
    pub fn interval(&self, statistic: impl Fn(&Draw) -> Option<f64>) -> Option<[f64; 2]> {
        let mut values: Vec<f64> = self.draws.iter().filter_map(statistic).filter(|x| x.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let (least, greatest) = (values.first()?, values.last()?);
        let differ = greatest - least > 1e-9 * greatest.abs();
        if !differ || values.len() * 2 < self.draws.len() {
            return None;
        }
        let tail = (1.0 - self.level) / 2.0;
        Some([quantile(&values, tail), quantile(&values, 1.0 - tail)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(values: &[f64]) -> impl Fn(&Draw) -> Option<f64> {
        move |draw| {
            let sum: f64 = draw.runs.iter().zip(values).map(|(times, x)| times * x).sum();
            Some(sum / draw.runs.iter().sum::<f64>())
        }
    }

    #[test]
    fn the_interval_of_a_mean_is_that_of_the_central_limit() {
        let values: Vec<f64> = (0..200).map(|i| f64::from(i * 37 % 200)).collect();
        let bootstrap = Bootstrap::new(200, 3, 4000, 0.95, 1);
        let [low, high] = bootstrap.interval(mean(&values)).unwrap();
        // Standard deviation √((200² − 1)/12) = 57.7, of the mean 4.08; 1.96 of them are 8.0.
        assert!((low - (99.5 - 8.0)).abs() < 0.7 && (high - (99.5 + 8.0)).abs() < 0.7, "{low} {high}");
        assert_eq!(bootstrap.value(mean(&values)), Some(99.5));
        assert_eq!(bootstrap.interval(mean(&values)), Bootstrap::new(200, 3, 4000, 0.95, 1).interval(mean(&values)));
    }

    #[test]
    fn draws_keep_their_number_and_seeds_vary_too() {
        let bootstrap = Bootstrap::new(5, 3, 100, 0.95, 7);
        let seeds = [1.0, 2.0, 3.0];
        for draw in &bootstrap.draws {
            assert_eq!((draw.runs.iter().sum::<f64>(), draw.seeds.iter().sum::<f64>()), (5.0, 3.0));
        }
        let over_seeds = |draw: &Draw| Some(draw.seeds.iter().zip(seeds).map(|(w, x)| w * x).sum::<f64>() / 3.0);
        let [low, high] = bootstrap.interval(over_seeds).unwrap();
        assert!(low < 1.7 && high > 2.3, "{low} {high}");
    }

    #[test]
    fn one_run_tells_nothing_and_numbers_that_are_seldom_there_have_no_interval() {
        let of_one = |draw: &Draw| Some(draw.runs[0] / draw.runs.iter().sum::<f64>());
        assert_eq!(Bootstrap::new(1, 3, 100, 0.95, 7).interval(of_one), None);
        assert_eq!(Bootstrap::new(9, 3, 100, 0.95, 7).interval(|_| Some(0.0)), None);
        let seldom = |draw: &Draw| (draw.runs[0] > 2.0).then_some(1.0);
        assert_eq!(Bootstrap::new(9, 1, 500, 0.95, 7).interval(seldom), None);
    }
}
