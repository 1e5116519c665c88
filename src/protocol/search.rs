//! Which strength of consolidation is best, from validation events.

/// What one strength came to on validation events, stage by stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The strength.
    pub strength: f64,
    /// Spacing MSE, stages × tasks, m².
    pub spacing_mse: Vec<Vec<f64>>,
    /// Collided events of tasks seen, the stage where they are most.
    pub collisions: u32,
}

impl Candidate {
    /// `(1/T) Σ_j R[T,j] / N[j,j]`: the error after the last stage over that of `naive` when it had just learned the task,
    /// the mean over the tasks. Forgetting raises it by the early tasks, rigidity by the late ones, and no task counts more
    /// for being harder.
    #[must_use]
    pub fn cost(&self, naive_diagonal: &[f64]) -> f64 {
        let last = self.spacing_mse.last().map_or(&[][..], Vec::as_slice);
        let ratios = last.iter().zip(naive_diagonal).map(|(error, naive)| error / naive.max(f64::MIN_POSITIVE));
        ratios.sum::<f64>() / naive_diagonal.len().max(1) as f64
    }

    /// Mean over the tasks but the last of `R[T,j] / R[j,j]`.
    #[must_use]
    pub fn forgetting_ratio(&self) -> f64 {
        let last = self.spacing_mse.len() - 1;
        let ratio = |task: usize| self.spacing_mse[last][task] / self.spacing_mse[task][task];
        (0..last).map(ratio).sum::<f64>() / last.max(1) as f64
    }

    /// Mean over the tasks but the first of `R[j,j] / N[j,j]`.
    #[must_use]
    pub fn plasticity_loss(&self, naive_diagonal: &[f64]) -> f64 {
        let ratio = |task: usize| self.spacing_mse[task][task] / naive_diagonal[task];
        (1..naive_diagonal.len()).map(ratio).sum::<f64>() / (naive_diagonal.len() - 1).max(1) as f64
    }

    fn weighed(&self, naive_diagonal: &[f64]) -> Weighed {
        Weighed {
            strength: self.strength,
            cost: self.cost(naive_diagonal),
            forgetting_ratio: self.forgetting_ratio(),
            plasticity_loss: self.plasticity_loss(naive_diagonal),
            collisions: self.collisions,
        }
    }
}

/// What decides between strengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighed {
    /// The strength.
    pub strength: f64,
    /// Mean over the tasks of the error over what it was at best.
    pub cost: f64,
    /// How much worse tasks learned before are driven.
    pub forgetting_ratio: f64,
    /// How much worse new tasks are learned than without consolidation.
    pub plasticity_loss: f64,
    /// Collided events of tasks seen.
    pub collisions: u32,
}

impl Weighed {
    /// The greater of the forgetting ratio and the plasticity loss; 1 where both are below, since then nothing is lost.
    #[must_use]
    pub fn worse_end(&self) -> f64 {
        self.forgetting_ratio.max(self.plasticity_loss).max(1.0)
    }
}

/// [`best_of`] in words.
pub const SEARCH_RULE: &str = "fewest collisions on tasks seen; of these within 5 % of the least cost, the mean over tasks of R[T,j] / naive's R[j,j]; of these within 5 % of the least greater of forgetting ratio, plasticity loss and 1; of these the strongest";

/// Costs, and balances, that differ by less than this share are the same: so much lies between two seeds of one setting.
const INDIFFERENCE: f64 = 0.05;

/// The place of the best candidate, see [`best_of`].
#[must_use]
pub fn best(candidates: &[Candidate], naive_diagonal: &[f64]) -> Option<usize> {
    best_of(&candidates.iter().map(|candidate| candidate.weighed(naive_diagonal)).collect::<Vec<_>>())
}

/// The place of the best: of those with the fewest collisions whose cost is as good as the least, those whose
/// worse end of the front is as good as the best of these; and among them the strongest. Where the front is flat it is the one
/// that holds on hardest, since what comes later is not known (as the one-standard-error rule of Breiman et al. 1984 takes
/// the simplest), but not at the price of what is new.
#[must_use]
pub fn best_of(weighed: &[Weighed]) -> Option<usize> {
    let fewest = weighed.iter().map(|one| one.collisions).min()?;
    let mut left: Vec<usize> = (0..weighed.len()).filter(|&place| weighed[place].collisions == fewest).collect();
    keep_as_good(&mut left, |place| weighed[place].cost);
    keep_as_good(&mut left, |place| weighed[place].worse_end());
    left.into_iter().max_by(|&a, &b| weighed[a].strength.total_cmp(&weighed[b].strength))
}

/// Leaves those whose `measure` is as good as the least.
fn keep_as_good(places: &mut Vec<usize>, measure: impl Fn(usize) -> f64) {
    let least = places.iter().map(|&place| measure(place)).fold(f64::INFINITY, f64::min);
    places.retain(|&place| measure(place) <= (1.0 + INDIFFERENCE) * least);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(strength: f64, spacing_mse: [[f64; 2]; 2], collisions: u32) -> Candidate {
        Candidate { strength, spacing_mse: spacing_mse.map(|row| row.to_vec()).to_vec(), collisions }
    }

    #[test]
    fn the_front_is_judged_by_both_ends() {
        let naive = [20.0, 8.0];
        let free = candidate(0.1, [[20.0, 30.0], [40.0, 8.0]], 0);
        let held = candidate(1.0, [[20.0, 30.0], [22.0, 8.8]], 0);
        let stiff = candidate(10.0, [[20.0, 30.0], [20.0, 16.0]], 0);
        assert!((free.cost(&naive) - 1.5).abs() < 1e-12 && (held.cost(&naive) - 1.1).abs() < 1e-12);
        assert!((stiff.cost(&naive) - 1.5).abs() < 1e-12);
        assert!((held.forgetting_ratio() - 1.1).abs() < 1e-12 && (held.plasticity_loss(&naive) - 1.1).abs() < 1e-12);
        assert_eq!(best(&[free, held, stiff], &naive), Some(1));
    }

    #[test]
    fn where_the_front_is_flat_the_strongest_is_taken() {
        let each = [(0.1, 8.0), (1.0, 8.2), (3.0, 8.3), (10.0, 12.0)];
        let candidates = each.map(|(strength, last)| candidate(strength, [[20.0, 30.0], [20.0, last]], 0));
        assert_eq!(best(&candidates, &[20.0, 8.0]), Some(2), "costs 1, 1.01, 1.02 and 1.25");
    }

    #[test]
    fn of_equal_costs_the_one_that_learns_what_is_new_is_taken() {
        let naive = [20.0, 8.0];
        let balanced = candidate(3.0, [[20.0, 30.0], [22.0, 8.8]], 0);
        let stiff = candidate(10.0, [[20.0, 30.0], [19.0, 10.4]], 0);
        assert!((balanced.cost(&naive) - 1.1).abs() < 1e-12 && (stiff.cost(&naive) - 1.125).abs() < 1e-12);
        assert!(
            (balanced.weighed(&naive).worse_end() - 1.1).abs() < 1e-12
                && (stiff.weighed(&naive).worse_end() - 1.3).abs() < 1e-12
        );
        assert_eq!(best(&[balanced, stiff], &naive), Some(0), "costs within 5 %, but learned 1.1 and 1.3 times worse");
    }

    #[test]
    fn a_collision_outweighs_every_error_and_nothing_is_best_of_nothing() {
        let crashing = candidate(0.1, [[20.0, 8.0], [20.0, 8.0]], 1);
        let safe = candidate(1.0, [[20.0, 8.0], [30.0, 9.0]], 0);
        assert_eq!(best(&[crashing, safe], &[20.0, 8.0]), Some(1));
        assert_eq!(best(&[], &[20.0, 8.0]), None);
    }
}
