//! What the numbers mean, in sentences that hold whatever the numbers are.

/// Errors that differ by less than this share count as equal.
const EQUAL: f64 = 0.05;

/// Up to this ratio of last error to error when just learned, a regime counts as kept.
const KEPT: f64 = 1.1;

/// What both models forgot: the regimes and each model's ratios of last error to error when just learned.
pub(super) fn forgetting(regimes: &[&str], ewc: &[Option<f64>], naive: &[Option<f64>]) -> String {
    let (Some((ewc_regime, ewc)), Some((naive_regime, naive))) = (worst(regimes, ewc), worst(regimes, naive)) else {
        return "Nothing can be said about forgetting: an earlier kind of traffic needs test events for that."
            .to_owned();
    };
    let meaning = if naive <= KEPT {
        "Here naive forgot next to nothing, so there was little to protect"
    } else if ewc <= KEPT {
        "Here consolidation kept what was learned"
    } else if ewc < naive * (1.0 - EQUAL) {
        "Here consolidation forgot too, but less"
    } else if ewc <= naive * (1.0 + EQUAL) {
        "Here consolidation made no difference"
    } else {
        "Here consolidation forgot more than going without it"
    };
    format!(
        "In the end, naive's spacing error on {naive_regime} traffic is {naive:.2} times what it was right after learning \
         it;\newc's worst is {ewc:.2} times, on {ewc_regime} traffic. {meaning}."
    )
}

/// What holding on costs: errors on the regime learned last.
pub(super) fn price(regime: &str, ewc: Option<f64>, naive: Option<f64>) -> String {
    let (Some(ewc), Some(naive)) = (ewc, naive) else {
        return format!("What holding on costs cannot be said: {regime} traffic has no test events.");
    };
    let meaning =
        if ewc > naive * (1.0 + EQUAL) { "that is the price of holding on" } else { "holding on cost nothing" };
    format!("On {regime} traffic, learned last, ewc's error is {ewc:.2} m² and naive's {naive:.2} m²: {meaning}.")
}

fn worst<'r>(regimes: &[&'r str], ratios: &[Option<f64>]) -> Option<(&'r str, f64)> {
    let known = regimes.iter().zip(ratios).filter_map(|(&regime, ratio)| Some((regime, (*ratio)?)));
    known.max_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sentence_follows_the_numbers() {
        let said =
            |ewc: f64, naive: f64| forgetting(&["fast", "middle"], &[Some(ewc), Some(0.9)], &[Some(naive), None]);
        for (ewc, naive, meaning) in [
            (0.99, 1.02, "little to protect"),
            (1.04, 1.9, "kept what was learned"),
            (1.2, 1.9, "but less"),
            (1.9, 1.9, "made no difference"),
            (2.5, 1.9, "forgot more"),
        ] {
            let said = said(ewc, naive);
            assert!(said.contains(meaning) && said.contains(&format!("{naive:.2}")), "{said}");
        }
        assert!(forgetting(&["fast"], &[None], &[Some(1.0)]).starts_with("Nothing can be said"));
    }

    #[test]
    fn the_worst_regime_is_named() {
        assert_eq!(worst(&["a", "b", "c"], &[Some(1.0), None, Some(2.0)]), Some(("c", 2.0)));
    }

    #[test]
    fn the_price_is_told_only_when_there_is_one() {
        assert!(price("slow", Some(1.2), Some(1.0)).ends_with("the price of holding on."));
        assert!(price("slow", Some(0.8), Some(1.0)).ends_with("cost nothing."));
        assert!(price("slow", None, Some(1.0)).contains("cannot be said"));
    }
}
