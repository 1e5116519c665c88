//! `report.md`: the paper's tables with our numbers, how sure they are, and how they came about.

use std::fmt::Write as _;
use std::time::Duration;

use indicatif::HumanDuration;

use super::arguments::{Options, ReproduceArguments};
use super::figures::Figure;
use super::paper;
use super::plan::Told;
use super::report::{mean_lambda, preset, strength};
use super::results::{Estimate, Learnt, Results};
use super::safety::{self, Assessed};
use crate::protocol::{Measure, SEARCH_RULE, Tally};
use crate::safety::Spread;

/// Everything the page tells.
pub(super) struct Page<'a> {
    pub(super) arguments: &'a ReproduceArguments,
    pub(super) options: &'a Options,
    pub(super) told: &'a Told,
    pub(super) results: &'a Results,
    pub(super) safety: &'a [Assessed],
    pub(super) figures: &'a [Figure],
    pub(super) threads: usize,
    pub(super) took: Duration,
}

impl Page<'_> {
    /// The whole page.
    pub(super) fn text(&self) -> String {
        let mut text = String::from("# Learning car-following task by task\n\n");
        self.summary(&mut text);
        self.tables(&mut text);
        self.searches(&mut text);
        self.comparisons(&mut text);
        self.references(&mut text);
        self.served(&mut text);
        self.safety(&mut text);
        self.figures(&mut text);
        self.data(&mut text);
        self.conditions(&mut text);
        text
    }

    fn names(&self) -> Vec<&str> {
        self.told.tasks.iter().map(|task| task.name.as_str()).collect()
    }

    fn summary(&self, text: &mut String) {
        let seeds: Vec<_> = self.options.seeds.iter().map(u64::to_string).collect();
        line(
            text,
            &format!(
                "{} events, tasks learned in the order {}, seeds {}, preset {}, {} hidden units, {} epochs a task.",
                self.told.events,
                self.names().join(", "),
                seeds.join(", "),
                preset(self.arguments),
                self.options.settings.hidden,
                self.options.settings.epochs
            ),
        );
        line(
            text,
            "Errors are of the network alone, closed loop, on test events, after the last stage unless said otherwise; in parentheses 95 % confidence intervals.",
        );
        text.push('\n');
        table(
            text,
            &[
                "method",
                "mean spacing error, m²",
                "over joint's",
                "over IDM's",
                "forgetting R[T,j]/R[j,j]",
                "plasticity R[j,j]/naive's",
                "collisions on tasks seen, worst stage, %",
                "training events/s",
                "strength",
                "λ by stage",
            ],
        );
        for learnt in &self.results.methods {
            self.summary_row(text, learnt);
        }
        text.push('\n');
        line(
            text,
            "R[i,j] is the error on task j after stage i of T: forgetting above 1 is error that learning later tasks has added, plasticity above 1 is what holding on to earlier tasks costs in learning the new one.",
        );
        line(text, "Training events/s counts new training events times epochs over the time inside updates.");
    }

    fn summary_row(&self, text: &mut String, learnt: &Learnt) {
        let results = self.results;
        let over = |other: Option<&Tally>| {
            let ratio = other.and_then(|other| results.compared(&learnt.tally, other));
            ratio.map_or_else(nothing, |ratio| shown(ratio, 2))
        };
        let each = |estimates: Option<Vec<Estimate>>| {
            estimates
                .map_or_else(nothing, |each| each.into_iter().map(|one| shown(one, 2)).collect::<Vec<_>>().join(", "))
        };
        let speeds = (0..learnt.seeds.len()).map(|seed| learnt.train_events_per_s(seed)).sum::<f64>()
            / learnt.seeds.len() as f64;
        let lambda = mean_lambda(learnt).into_iter().map(|x| x.map_or_else(nothing, |x| format!("{x:.3e}")));
        let consolidates = learnt.method.consolidates();
        row(
            text,
            &[
                learnt.method.as_str().to_owned(),
                shown(results.last_mean(&learnt.tally, Measure::Spacing), 2),
                over(
                    results
                        .method(crate::consolidation::Method::Joint)
                        .filter(|joint| joint.method != learnt.method)
                        .map(|joint| &joint.tally),
                ),
                over(results.reference("idm").map(|idm| &idm.tally)),
                each(results.forgetting_ratios(learnt)),
                each(results.plasticity_losses(learnt)),
                format!("{:.2}", self.worst_collisions(learnt)),
                format!("{speeds:.0}"),
                strength(learnt).map_or_else(nothing, |strength| format!("{strength}")),
                if consolidates { lambda.collect::<Vec<_>>().join(" / ") } else { nothing() },
            ],
        );
    }

    /// On tasks seen, over seeds, the worst.
    fn worst_collisions(&self, learnt: &Learnt) -> f64 {
        let seeds = 0..learnt.seeds.len();
        let of_seed = |seed| {
            let matrix = self.results.matrix_of_seed(&learnt.tally, Measure::Collisions, seed);
            let first = self.results.tasks - matrix.len();
            let seen =
                matrix.into_iter().enumerate().flat_map(move |(stage, row)| row.into_iter().take(first + stage + 1));
            seen.fold(0.0, f64::max)
        };
        seeds.map(of_seed).fold(0.0, f64::max)
    }

    fn tables(&self, text: &mut String) {
        let thirds = self.names() == ["fast", "middle", "slow"];
        for (measure, title, digits) in [
            (Measure::Spacing, "Spacing error: mean squared error over simulated steps, m²", 2),
            (Measure::Speed, "Speed error: mean squared error over simulated steps, m²/s²", 3),
            (Measure::Collisions, "Collisions: test events with a spacing of 0 or less, %", 2),
        ] {
            write!(text, "\n## {title}\n\n").expect("a string takes it");
            let stages: Vec<_> = (1..=self.results.tasks).map(|stage| format!("stage {stage}")).collect();
            let mut heads: Vec<_> = ["method", "task"].into_iter().chain(stages.iter().map(String::as_str)).collect();
            if thirds {
                heads.push("paper, stage 1 / 2 / 3");
            }
            table(text, &heads);
            for learnt in &self.results.methods {
                self.rows(text, learnt, measure, digits, thirds);
            }
        }
        text.push('\n');
        line(
            text,
            "Means over seeds; in parentheses 95 % intervals, none where no resample differs; cells in italics are tasks that the stage had not seen yet.",
        );
        if thirds {
            line(
                text,
                "The paper's figures are of its own 20,724 events and its own settings, which it does not state in full: a target for accuracy, not cells to be met one by one.",
            );
        }
    }

    /// What each search for a strength saw.
    fn searches(&self, text: &mut String) {
        let searched = |learnt: &&Learnt| learnt.choice.search["candidates"].is_array();
        let searched: Vec<_> = self.results.methods.iter().filter(searched).collect();
        if searched.is_empty() {
            return;
        }
        text.push_str("\n## How strongly to hold on\n\n");
        line(
            text,
            "Strengths were tried with the first seeds and judged on validation events of every task, also of those learned earlier; test events were not looked at.",
        );
        line(text, &format!("The rule: {SEARCH_RULE}."));
        text.push('\n');
        table(text, &["method", "strength", "cost", "forgetting", "plasticity", "collided events", ""]);
        for learnt in searched {
            let search = &learnt.choice.search;
            for candidate in search["candidates"].as_array().into_iter().flatten() {
                let number = |name: &str| format!("{:.3}", candidate[name].as_f64().unwrap_or(f64::NAN));
                let taken = if candidate["strength"] == search["chosen"] { "taken" } else { "" };
                let strength = candidate["strength"].to_string();
                let name = learnt.method.as_str().to_owned();
                let cells = [name, strength, number("cost"), number("forgetting_ratio"), number("plasticity_loss")];
                let rest = [candidate["collisions"].to_string(), taken.to_owned()];
                row(text, &cells.into_iter().chain(rest).collect::<Vec<_>>());
            }
        }
    }

    fn rows(&self, text: &mut String, learnt: &Learnt, measure: Measure, digits: usize, thirds: bool) {
        let matrix = self.results.matrix(&learnt.tally, measure);
        let intervals = self.results.intervals(&learnt.tally, measure);
        let skipped = self.results.tasks - matrix.len();
        for (task, name) in self.names().into_iter().enumerate() {
            let mut cells = vec![learnt.method.as_str().to_owned(), name.to_owned()];
            cells.extend(std::iter::repeat_n(nothing(), skipped));
            for (stage, row) in matrix.iter().enumerate() {
                let cell = shown(Estimate { value: row[task], interval: intervals[stage][task] }, digits);
                cells.push(if task > stage + skipped { format!("*{cell}*") } else { cell });
            }
            if thirds {
                let paper = paper::rows(learnt.method, measure).map(|rows| rows[task]);
                let cell = |x: Option<f64>| x.map_or_else(nothing, |x| format!("{x:.2}"));
                cells.push(paper.map_or_else(nothing, |row| row.map(cell).join(" / ")));
            }
            row(text, &cells);
        }
    }

    fn comparisons(&self, text: &mut String) {
        let methods: Vec<_> =
            self.results.methods.iter().map(|learnt| (learnt.method.as_str(), &learnt.tally)).collect();
        if methods.len() < 2 {
            return;
        }
        text.push_str("\n## Methods against each other\n\n");
        line(
            text,
            "Mean over tasks of the last spacing error, the row's over the column's, on the same events, runs and seeds drawn alike for both; an interval without 1 is a difference that another draw of recordings and seeds would be likely to show too.",
        );
        text.push('\n');
        table(text, &["over"].into_iter().chain(methods.iter().map(|(name, _)| *name)).collect::<Vec<_>>());
        for (name, tally) in &methods {
            let ratio = |other: &(&str, &Tally)| match other {
                (other, _) if other == name => "1".to_owned(),
                (_, other) => self.results.compared(tally, other).map_or_else(nothing, |ratio| shown(ratio, 3)),
            };
            row(text, &[(*name).to_owned()].into_iter().chain(methods.iter().map(ratio)).collect::<Vec<_>>());
        }
    }

    fn references(&self, text: &mut String) {
        if self.results.references.is_empty() {
            return;
        }
        text.push_str("\n## Reference drivers\n\n");
        line(
            text,
            "Calibrated for each task on its training events, which no network here is, and driven closed loop on the same test events; spacing error, m² / speed error, m²/s² / collisions, %.",
        );
        text.push('\n');
        table(text, &["driver"].into_iter().chain(self.names()).chain(["mean spacing error, m²"]).collect::<Vec<_>>());
        for reference in &self.results.references {
            let of = |measure| self.results.matrix(&reference.tally, measure).remove(0);
            let [spacing, speed, collisions] = Measure::ALL.map(of);
            let cells = (0..self.results.tasks)
                .map(|task| format!("{:.2} / {:.3} / {:.2}", spacing[task], speed[task], collisions[task]));
            let mean = shown(self.results.last_mean(&reference.tally, Measure::Spacing), 2);
            row(text, &[reference.name.clone()].into_iter().chain(cells).chain([mean]).collect::<Vec<_>>());
        }
        text.push('\n');
        line(
            text,
            "Spacing error on the training events that it was calibrated on / on the test events with published parameters, m²:",
        );
        text.push('\n');
        table(text, &["driver"].into_iter().chain(self.names()).collect::<Vec<_>>());
        for reference in &self.results.references {
            let cells = reference
                .fitted_to
                .iter()
                .zip(&reference.published)
                .map(|(on, published)| format!("{:.2} / {:.2}", on.spacing_mse(), published.spacing_mse()));
            row(text, &[reference.name.clone()].into_iter().chain(cells).collect::<Vec<_>>());
        }
    }

    fn served(&self, text: &mut String) {
        text.push_str("\n## Served, within the envelope\n\n");
        line(
            text,
            "What the envelope changes on the same test events after the last stage: it acts for the leader's sake, and it holds a car that would else drive backwards.",
        );
        text.push('\n');
        table(
            text,
            &[
                "method",
                "task",
                "spacing error, m²",
                "over the network's",
                "collisions, %",
                "envelope acted, % of steps",
                "held, % of steps",
                "least TTC alone, s: median (worst)",
                "least TTC served, s: median (worst)",
            ],
        );
        for learnt in &self.results.methods {
            let matrix = |tally, measure| self.results.matrix(tally, measure).pop().expect("a method has a stage");
            let (served, alone) = (matrix(&learnt.served, Measure::Spacing), matrix(&learnt.tally, Measure::Spacing));
            let collisions = matrix(&learnt.served, Measure::Collisions);
            let [acted, held] = [Learnt::acted_percent, Learnt::held_percent]
                .map(|percent| percent(learnt, 0..learnt.seeds.len()).pop().expect("a method has a stage"));
            let [ttc_alone, ttc_served] = [Learnt::alone_min_ttc_s, Learnt::served_min_ttc_s]
                .map(|closest| closest(learnt).pop().expect("a method has a stage"));
            for (task, name) in self.names().into_iter().enumerate() {
                row(
                    text,
                    &[
                        learnt.method.as_str().to_owned(),
                        name.to_owned(),
                        format!("{:.2}", served[task]),
                        format!("{:.4}", served[task] / alone[task]),
                        format!("{:.2}", collisions[task]),
                        format!("{:.3}", acted[task]),
                        format!("{:.3}", held[task]),
                        seconds(ttc_alone[task]),
                        seconds(ttc_served[task]),
                    ],
                );
            }
        }
    }

    fn safety(&self, text: &mut String) {
        if self.safety.is_empty() {
            return;
        }
        text.push_str("\n## Hard scenarios and string stability\n\n");
        line(
            text,
            "The last stage with the first seed, alone and as served, on leaders that brake at up to 8 m/s², stop and go, and on cut-ins; avoidable are those in which a follower that brakes at 8 m/s² one step after the leader does not collide.",
        );
        line(text, "Below, ten cars of one driver behind a leader that dips or waves: above 1 a disturbance grows.");
        text.push('\n');
        text.push_str(&safety::tables(self.safety));
    }

    fn figures(&self, text: &mut String) {
        if self.figures.is_empty() {
            return;
        }
        text.push_str("\n## Figures\n");
        for figure in self.figures {
            write!(text, "\n{}\n\n![{}]({})\n", figure.caption, figure.caption.trim_end_matches('.'), figure.file)
                .expect("a string takes it");
        }
    }

    fn data(&self, text: &mut String) {
        let told = self.told;
        text.push_str("\n## Events\n\n");
        line(text, &format!("Tasks: {}.", told.tasks_by));
        if let Some(edges) = &told.split_mps {
            let edges: Vec<_> = edges.iter().map(|edge| format!("{edge:.2}")).collect();
            line(text, &format!("Mean speeds part at {} m/s.", edges.join(" and ")));
        }
        line(text, &format!("Sides: {}.", told.split_by));
        line(
            text,
            &format!(
                "{} of {} runs have events on more than one side: where that is so, test events resemble training events more than traffic of another day would.",
                told.runs_on_several_sides, told.runs
            ),
        );
        line(text, &format!("Events are cut to {} steps of {} s.", self.arguments.steps, self.options.settings.dt_s));
        if told.copies > 0 {
            line(
                text,
                &format!("{} events in the files are copies of others, and take part as the others do.", told.copies),
            );
        }
        text.push('\n');
        table(text, &["task", "training", "validation", "test", "runs in test", "mean speed, m/s", "sources"]);
        for task in &told.tasks {
            let sources: Vec<_> = task.sources.iter().map(|(source, events)| format!("{source} {events}")).collect();
            row(
                text,
                &[
                    task.name.clone(),
                    task.train.to_string(),
                    task.validation.to_string(),
                    task.test.to_string(),
                    task.test_runs.to_string(),
                    format!("{:.2}", task.mean_speed_mps),
                    sources.join(", "),
                ],
            );
        }
        text.push('\n');
        table(text, &["file", "events", "used or usable", "left out"]);
        for file in &told.files {
            let reasons = told.left_out.iter().filter(|left| left.file == file.file);
            let reasons: Vec<_> = reasons.map(|left| format!("{}: {}", left.events, left.reason)).collect();
            row(text, &[file.file.clone(), file.events.to_string(), file.kept.to_string(), reasons.join("; ")]);
        }
    }

    fn conditions(&self, text: &mut String) {
        text.push_str("\n## How it was measured\n\n");
        line(
            text,
            &format!(
                "headway {}, kernel {}, {}.",
                env!("CARGO_PKG_VERSION"),
                crate::lstm::kernel_name(),
                if self.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", self.threads) }
            ),
        );
        line(
            text,
            &format!(
                "Intervals are percentiles of {} resamples that draw whole runs of test events, and seeds, with replacement; the same draws for every number, so that ratios are paired.",
                self.arguments.resamples
            ),
        );
        let trained: f64 = self
            .results
            .methods
            .iter()
            .flat_map(|learnt| learnt.seeds.iter().flatten())
            .map(|stage| stage.learned.update_s)
            .sum();
        line(
            text,
            &format!(
                "This call took {}; all updates together {}, those of a shared first stage counted for each method.",
                HumanDuration(self.took),
                HumanDuration(Duration::from_secs_f64(trained.max(0.0)))
            ),
        );
        let settings = serde_json::to_string_pretty(&self.options.settings).expect("settings are plain data");
        write!(text, "\n```json\n{settings}\n```\n").expect("a string takes it");
    }
}

/// A number and its interval.
fn shown(Estimate { value, interval }: Estimate, digits: usize) -> String {
    match interval {
        Some([low, high]) => format!("{value:.digits$} ({low:.digits$}–{high:.digits$})"),
        None => format!("{value:.digits$}"),
    }
}

/// Median and worst.
fn seconds(spread: Spread) -> String {
    let shown = |value: Option<f64>| value.map_or_else(|| "∞".to_owned(), |value| format!("{value:.1}"));
    format!("{} ({})", shown(spread.median), shown(spread.worst))
}

/// A cell with nothing to say.
fn nothing() -> String {
    "–".to_owned()
}

fn line(text: &mut String, sentence: &str) {
    text.push_str(sentence);
    text.push('\n');
}

fn table(text: &mut String, heads: &[&str]) {
    row(text, &heads.iter().map(|head| (*head).to_owned()).collect::<Vec<_>>());
    row(text, &vec!["---".to_owned(); heads.len()]);
}

fn row(text: &mut String, cells: &[String]) {
    let cells: Vec<_> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    writeln!(text, "| {} |", cells.join(" | ")).expect("a string takes it");
}
