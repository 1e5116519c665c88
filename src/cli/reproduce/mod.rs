//! `headway reproduce`: from event files to the paper's tables and figures.

/// What it can be told.
mod arguments;
/// How strongly each method consolidates.
mod choice;
/// The events of the files.
mod events;
/// How a stage drives.
mod measured;
/// What a stage tells on its way.
mod observer;
/// What is learned from what.
mod plan;
/// How far it is.
mod progress;
/// Drivers out of the literature.
mod references;
/// `report.json`.
mod report;
/// What was learned, as tables.
mod results;
/// Tasks and sides from a file.
mod splits_file;
/// Stages on disk.
mod state;
/// Learning what is not there yet.
mod work;

use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::Context;

pub(super) use arguments::ReproduceArguments;

use arguments::Options;
use plan::Plan;
use report::Report;
use results::{Learnt, Results, Runs};
use work::Work;

/// Reads, learns, measures, and writes the report.
pub(super) fn run(arguments: &ReproduceArguments) -> anyhow::Result<()> {
    let options = Options::read(arguments)?;
    let plan = Plan::make(arguments, &options)?;
    let mut work = Work::new(arguments, &options, &plan)?;
    introduce(&work);
    let results = learn(arguments, &options, &plan, &mut work)?;
    let report = Report::new(arguments, &options, &plan.told, &results);
    let text = serde_json::to_string_pretty(&report)? + "\n";
    write(&arguments.out, "report.json", &text)?;
    work.progress.say(&format!("the report is in {}", arguments.out.display()));
    if arguments.json {
        let mut stdout = std::io::stdout().lock();
        serde_json::to_writer(&mut stdout, &report)?;
        writeln!(stdout)?;
        stdout.flush()?;
    }
    Ok(())
}

/// What there is to learn from.
fn introduce(work: &Work<'_>) {
    let told = &work.plan.told;
    work.progress.say(&format!("{} events; tasks: {}; sides: {}", told.events, told.tasks_by, told.split_by));
    for left in &told.left_out {
        let examples = left.examples.join(", ");
        let line = format!("left out {} of {}: {} ({examples}{})", left.events, left.file, left.reason, {
            if left.events > left.examples.len() { ", …" } else { "" }
        });
        work.progress.say(&line);
    }
    for task in &told.tasks {
        work.progress.say(&format!(
            "task {}: {} for training, {} for validation, {} for test; mean speed {:.2} m/s",
            task.name, task.train, task.validation, task.test, task.mean_speed_mps
        ));
    }
}

fn learn(
    arguments: &ReproduceArguments,
    options: &Options,
    plan: &Plan,
    work: &mut Work<'_>,
) -> anyhow::Result<Results> {
    let choices: Vec<_> = options.methods.iter().map(|&method| (method, choice::choose(work, method))).collect();
    let lines = |seed| choices.iter().map(move |(method, choice)| (*method, seed, choice.strength));
    let all: Vec<_> = options.seeds.iter().flat_map(|&seed| lines(seed)).collect();
    let stages: Vec<_> = all.iter().flat_map(|&(method, seed, strength)| work.stages(method, seed, strength)).collect();
    work.survey(&stages);
    let runs = Runs::of(plan);
    let mut learnt: Vec<_> = choices.iter().map(|_| Vec::new()).collect();
    for &seed in &options.seeds {
        for (place, &(method, ref choice)) in choices.iter().enumerate() {
            learnt[place].push(work.line(&work.stages(method, seed, choice.strength))?);
        }
    }
    work.progress.end();
    let methods = choices.into_iter().zip(learnt).map(|((method, choice), seeds)| {
        let of_one = work.stages(method, options.seeds[0], choice.strength);
        let trained = of_one.iter().map(|stage| work.trained(stage)).sum();
        Learnt::new(method, choice, seeds, trained, &runs)
    });
    let references = if arguments.no_references { Vec::new() } else { references::references(work, &runs)? };
    Ok(Results::new(methods.collect(), references, plan, &runs, arguments.resamples))
}

/// Whole or not at all.
fn write(out: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    let (path, beside) = (out.join(name), out.join(format!(".{name}.new")));
    let written = fs::write(&beside, text).and_then(|()| fs::rename(&beside, &path));
    written.with_context(|| format!("cannot write {}", path.display()))
}
