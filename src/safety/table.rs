//! Reports of several drivers side by side, as Markdown.

use std::fmt::Write;

use super::SafetyReport;
use super::assess::StressOutcome;

/// Two tables: the stress set by class, and the platoon. Drivers in the order given, by the name given.
#[must_use]
pub fn markdown(drivers: &[(&str, &SafetyReport)]) -> String {
    let mut text = String::from(
        "| scenarios | driver | collisions, avoidable (all) | backwards | envelope acted, % of steps | min TTC, s: median (worst) | DRAC, m/s² | braking, m/s² | jerk rms, m/s³ | jerk max, m/s³ |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let classes = drivers.first().map_or(0, |(_, report)| report.stress.len());
    for class in 0..classes {
        for (name, report) in drivers {
            stress_row(&mut text, name, &report.stress[class]);
        }
    }
    text.push_str("\n| platoon | dip, last / leader | ");
    let periods = drivers.first().map_or(&[][..], |(_, report)| &report.platoon.waves);
    for wave in periods {
        write!(text, "gain at {} s: greatest (total) | ", wave.period_s).expect("a string takes it");
    }
    text.push_str("least spacing, m | collisions |\n| --- | --- |");
    text.push_str(&" --- |".repeat(periods.len() + 2));
    for (name, SafetyReport { platoon, .. }) in drivers {
        write!(text, "\n| {name} | {:.2} |", platoon.dip_gain).expect("a string takes it");
        for wave in &platoon.waves {
            write!(text, " {:.2} ({:.2}) |", wave.max_gain, wave.total_gain).expect("a string takes it");
        }
        write!(text, " {:.1} | {} |", platoon.min_spacing_m, platoon.collisions).expect("a string takes it");
    }
    text.push('\n');
    text
}

fn stress_row(text: &mut String, name: &str, outcome: &StressOutcome) {
    let number = |value: Option<f64>| value.map_or_else(|| "∞".to_owned(), |value| format!("{value:.1}"));
    let StressOutcome { class, scenarios, avoidable, collisions, avoidable_collisions, backwards, .. } = outcome;
    write!(
        text,
        "| {}, {scenarios} ({avoidable} avoidable) | {name} | {avoidable_collisions} ({collisions}) | {backwards} | {:.1} |",
        class.as_str(),
        outcome.acted_percent
    )
    .expect("a string takes it");
    for spread in [
        outcome.min_ttc_s,
        outcome.max_drac_mps2,
        outcome.max_braking_mps2,
        outcome.jerk_rms_mps3,
        outcome.jerk_max_mps3,
    ] {
        write!(text, " {} ({}) |", number(spread.median), number(spread.worst)).expect("a string takes it");
    }
    text.push('\n');
}
