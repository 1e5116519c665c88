//! The same choice where a line has one more stage to learn: every strength starts from the parent, and earlier stages are
//! as they are.

use super::search::Weighed;

/// What the errors after the stage are measured against, m²: on each regime learned earlier the parent's, and on the new one,
/// the last, that of the stage learned without a penalty. Where that one diverged, the least of the candidates' stands in;
/// none where they did too.
#[must_use]
pub fn stage_diagonal(earlier: &[f64], unpenalised: Option<f64>, candidates: &[f64]) -> Option<Vec<f64>> {
    let least = || candidates.iter().copied().min_by(f64::total_cmp);
    let new = unpenalised.or_else(least)?;
    Some(earlier.iter().copied().chain([new]).collect())
}

/// What one strength came to, from the spacing MSE after the stage, m², on every regime in the order of `naive_diagonal`.
///
/// With d of [`stage_diagonal`] and T regimes: cost `(1/T) Σ_j R[T,j] / d_j`, forgetting ratio its mean over the earlier
/// regimes (1 where there are none, and nothing to forget), plasticity loss `R[T,T] / d_T`. With two regimes they are those of
/// [`Candidate`](super::Candidate); with more, this stage alone answers for them.
#[must_use]
pub fn weigh_stage(strength: f64, after: &[f64], naive_diagonal: &[f64], collisions: u32) -> Weighed {
    let ratios: Vec<f64> =
        after.iter().zip(naive_diagonal).map(|(error, before)| error / before.max(f64::MIN_POSITIVE)).collect();
    let mean = |ratios: &[f64]| ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
    let (plasticity_loss, earlier) = ratios.split_last().map_or((1.0, &[][..]), |(new, earlier)| (*new, earlier));
    Weighed {
        strength,
        cost: mean(&ratios),
        forgetting_ratio: if earlier.is_empty() { 1.0 } else { mean(earlier) },
        plasticity_loss,
        collisions,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Candidate, best, best_of};
    use super::*;

    #[test]
    fn with_two_regimes_a_stage_is_weighed_as_a_whole_line_is() {
        let (before, naive) = ([20.0, 30.0], 8.0);
        let diagonal = stage_diagonal(&before[..1], Some(naive), &[]).unwrap();
        let after = [(0.1, [40.0, 8.0]), (1.0, [22.0, 8.8]), (10.0, [20.0, 16.0])];
        let weighed = after.map(|(strength, after)| weigh_stage(strength, &after, &diagonal, 0));
        let lines = after.map(|(strength, after)| Candidate {
            strength,
            spacing_mse: vec![before.to_vec(), after.to_vec()],
            collisions: 0,
        });
        for (stage, line) in weighed.iter().zip(&lines) {
            assert_eq!(stage.cost, line.cost(&diagonal));
            assert_eq!(stage.forgetting_ratio, line.forgetting_ratio());
            assert_eq!(stage.plasticity_loss, line.plasticity_loss(&diagonal));
        }
        assert_eq!((best_of(&weighed), best(&lines, &diagonal)), (Some(1), Some(1)));
    }

    #[test]
    fn with_more_regimes_only_this_stage_counts() {
        let diagonal = stage_diagonal(&[20.0, 10.0], Some(5.0), &[]).unwrap();
        let weighed = weigh_stage(1.0, &[22.0, 13.0, 6.0], &diagonal, 3);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(close(weighed.forgetting_ratio, 1.2) && close(weighed.plasticity_loss, 1.2), "{weighed:?}");
        assert!(close(weighed.cost, 1.2));
        assert_eq!(weighed.collisions, 3);
    }

    #[test]
    fn a_line_of_one_regime_that_repeats_has_nothing_to_forget() {
        let weighed = weigh_stage(1.0, &[6.0], &stage_diagonal(&[], Some(5.0), &[]).unwrap(), 0);
        assert_eq!((weighed.forgetting_ratio, weighed.plasticity_loss, weighed.cost), (1.0, 1.2, 1.2));
    }

    #[test]
    fn without_a_reference_the_best_of_the_candidates_is_one() {
        assert_eq!(stage_diagonal(&[20.0], None, &[9.0, 7.0, 8.0]), Some(vec![20.0, 7.0]));
        assert_eq!(stage_diagonal(&[20.0], None, &[]), None);
    }
}
