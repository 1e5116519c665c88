//! `headway reproduce`: from event files to the paper's tables and figures.

/// What it can be told.
mod arguments;
/// How strongly a method consolidates.
mod choice;
/// The events of the files.
mod events;
/// The figures.
mod figures;
/// How a stage drives.
mod measured;
/// What a stage tells on its way.
mod observer;
/// `report.md`.
mod page;
/// The paper's figures.
mod paper;
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
/// Where it is hard.
mod safety;
/// The strength, found.
mod search;
/// Tasks and sides from a file.
mod splits_file;
/// Stages on disk.
mod state;
/// Error over λ.
mod sweep;
/// Learning what is not there yet.
mod work;

use std::fs;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use anyhow::Context;

pub(super) use arguments::ReproduceArguments;

use arguments::Options;
use page::Page;
use plan::Plan;
use report::Report;
use results::{Learnt, Results, Runs};
use sweep::Sweep;
use work::Work;

/// Reads, learns, measures, and writes the report.
pub(super) fn run(arguments: &ReproduceArguments) -> anyhow::Result<()> {
    let began = Instant::now();
    let options = Options::read(arguments)?;
    let plan = Plan::make(arguments, &options)?;
    let mut work = Work::new(arguments, &options, &plan)?;
    introduce(&work);
    let (results, sweeps) = learn(arguments, &options, &plan, &mut work)?;
    let safety =
        if arguments.no_safety { Vec::new() } else { safety::assessed(&work, &results, !arguments.no_references)? };
    let figures = if arguments.no_figures { Vec::new() } else { figures::figures(&work, &results, &sweeps) };
    for figure in &figures {
        write(&arguments.out, figure.file, &figure.svg)?;
    }
    let mut report = Report::new(arguments, &work, &results, &sweeps, safety);
    report.seconds = began.elapsed().as_secs_f64();
    let page = Page {
        arguments,
        options: &options,
        told: &plan.told,
        results: &results,
        safety: &report.safety,
        figures: &figures,
        threads: work.workers.current_num_threads(),
        took: began.elapsed(),
    };
    write(&arguments.out, "report.md", &page.text())?;
    write(&arguments.out, "report.json", &(serde_json::to_string_pretty(&report)? + "\n"))?;
    work.progress.say(&format!("done: the report is in {}", arguments.out.join("report.md").display()));
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
) -> anyhow::Result<(Results, Vec<Sweep>)> {
    let searched: Vec<_> = options.methods.iter().flat_map(|&method| search::stages(work, method)).collect();
    if !searched.is_empty() {
        work.progress.say("searching strengths on validation events");
        work.survey(&searched);
    }
    let choice = |&method| Ok((method, search::choose(work, method)?));
    let choices = options.methods.iter().map(choice).collect::<anyhow::Result<Vec<_>>>()?;
    let lines = |seed| choices.iter().map(move |(method, choice)| (*method, seed, choice.strength));
    let all: Vec<_> = options.seeds.iter().flat_map(|&seed| lines(seed)).collect();
    let stages: Vec<_> = all.iter().flat_map(|&(method, seed, strength)| work.stages(method, seed, strength)).collect();
    let swept = !arguments.no_figures && !arguments.no_sweep;
    let sweep = choices.iter().filter(|_| swept).flat_map(|(method, choice)| sweep::stages(work, *method, choice));
    let stages: Vec<_> = searched.into_iter().chain(stages).chain(sweep).collect();
    work.survey(&stages);
    let runs = Runs::of(plan);
    let mut learnt: Vec<_> = choices.iter().map(|_| Vec::new()).collect();
    for &seed in &options.seeds {
        for (place, &(method, ref choice)) in choices.iter().enumerate() {
            learnt[place].push(work.line(&work.stages(method, seed, choice.strength))?);
        }
    }
    let methods = choices.into_iter().zip(learnt).map(|((method, choice), seeds)| {
        let of_one = work.stages(method, options.seeds[0], choice.strength);
        let trained = of_one.iter().map(|stage| work.trained(stage)).sum();
        Learnt::new(method, choice, seeds, trained, &runs)
    });
    let methods: Vec<_> = methods.collect();
    let sweeps = methods.iter().filter(|learnt| swept && learnt.method.consolidates());
    let sweeps = sweeps.map(|learnt| sweep::sweep(work, learnt)).collect::<anyhow::Result<_>>()?;
    work.progress.end();
    let references = if arguments.no_references { Vec::new() } else { references::references(work, &runs)? };
    Ok((Results::new(methods, references, plan, &runs, arguments.resamples), sweeps))
}

/// Whole or not at all.
fn write(out: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    let (path, beside) = (out.join(name), out.join(format!(".{name}.new")));
    let written = fs::write(&beside, text).and_then(|()| fs::rename(&beside, &path));
    written.with_context(|| format!("cannot write {}", path.display()))
}
