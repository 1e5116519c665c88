//! What is learned from what: tasks, sides, and how that came about.

use std::collections::BTreeMap;

use anyhow::{Context, bail, ensure};
use serde::Serialize;

use super::arguments::{Options, ReproduceArguments, SplitRule, TaskRule};
use super::events::{CutEvent, FileCount, LeftOut, Recorded};
use super::splits_file;
use crate::car_following::Event;
use crate::lineage::Split;
use crate::protocol::{Tasks, at_random, by_run, missing_side};

/// The experiment's data.
pub(super) struct Plan {
    /// In the order learned.
    pub(super) tasks: Vec<Task>,
    pub(super) told: Told,
}

/// One task's events.
pub(super) struct Task {
    pub(super) name: String,
    pub(super) train: Vec<Event>,
    pub(super) validation: Vec<Event>,
    pub(super) test: Vec<Event>,
    /// Of each test event.
    pub(super) test_runs: Vec<String>,
    /// Of each test event.
    pub(super) test_ids: Vec<String>,
}

/// What a reader needs to know about the data.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Told {
    pub(super) events: usize,
    pub(super) files: Vec<FileCount>,
    pub(super) left_out: Vec<LeftOut>,
    /// Where tasks by mean speed part, m/s; the thirds where a file names the tasks; null for sources.
    pub(super) split_mps: Option<Vec<f64>>,
    /// How tasks were made, in a sentence.
    pub(super) tasks_by: String,
    /// How events were split, in a sentence.
    pub(super) split_by: String,
    pub(super) tasks: Vec<TaskTold>,
    /// Events in the files whose numbers are those of another event.
    pub(super) copies: usize,
    /// Runs with events on more than one side, over all tasks: what a random split leaks.
    pub(super) runs_on_several_sides: usize,
    pub(super) runs: usize,
}

/// One task in numbers.
#[derive(Debug, Clone, Serialize)]
pub(super) struct TaskTold {
    pub(super) name: String,
    pub(super) train: usize,
    pub(super) validation: usize,
    pub(super) test: usize,
    pub(super) mean_speed_mps: f64,
    /// Events of each source.
    pub(super) sources: BTreeMap<String, usize>,
    pub(super) test_runs: usize,
}

impl Plan {
    pub(super) fn make(arguments: &ReproduceArguments, options: &Options) -> anyhow::Result<Self> {
        let recorded = Recorded::read(&arguments.events, arguments.steps as usize, options.settings.dt_s)?;
        let mut kept = Kept::choose(arguments, options, &recorded)?;
        if let Some(order) = &arguments.order {
            let order: Vec<_> = order.iter().map(|name| name.trim().to_owned()).collect();
            kept.tasks = kept.tasks.ordered(&order).context("--order")?;
        }
        if let Some((task, side)) = missing_side(kept.tasks.names.len(), &kept.tasks.of, &kept.sides) {
            bail!(kept.without(task, side, &recorded));
        }
        let tasks = kept.collect(&recorded.events);
        for Task { name, train, .. } in &tasks {
            let events = counted(train.len(), "training event");
            ensure!(
                train.iter().any(changes_speed),
                "task {name} has {events} in which no speed changes: nothing to learn"
            );
        }
        Ok(Self { tasks, told: kept.tell(&recorded) })
    }

    /// The training events of every task.
    pub(super) fn train_all(&self) -> Vec<Event> {
        self.tasks.iter().flat_map(|task| task.train.iter().cloned()).collect()
    }
}

/// Which of the recorded events take part, and as what.
struct Kept {
    /// Indices into the recorded events.
    events: Vec<usize>,
    tasks: Tasks,
    sides: Vec<Split>,
    split_mps: Option<Vec<f64>>,
    tasks_by: String,
    split_by: String,
}

impl Kept {
    fn choose(arguments: &ReproduceArguments, options: &Options, recorded: &Recorded) -> anyhow::Result<Self> {
        let of = &recorded.events;
        if let Some(path) = &arguments.splits {
            let context = || format!("--splits {}", path.display());
            let rows = splits_file::read(path).with_context(context)?;
            let names: Vec<_> = of.iter().map(|event| event.event_id.as_str()).collect();
            let left_out = match recorded.left_out.as_slice() {
                [] => String::new(),
                _ => format!(" (left out of --events: {})", recorded.reasons()),
            };
            let events = splits_file::places(&rows, &names, &left_out).with_context(context)?;
            let speeds: Vec<_> = events.iter().map(|&at| of[at].mean_speed_mps).collect();
            let named: Vec<_> = rows.iter().map(|row| row.task.as_str()).collect();
            return Ok(Self {
                tasks: Tasks::by_name(&named).named_by_speed(&speeds),
                sides: rows.iter().map(|row| row.split).collect(),
                split_mps: Some(Tasks::edges(&speeds, 3)),
                tasks_by: format!("as {} says", path.display()),
                split_by: format!("as {} says", path.display()),
                events,
            });
        }
        let speeds: Vec<_> = of.iter().map(|event| event.mean_speed_mps).collect();
        let sources: Vec<_> = of.iter().map(|event| event.source.as_str()).collect();
        let (tasks, tasks_by) = match options.tasks {
            TaskRule::Speed(count) => (
                Tasks::by_speed(&speeds, count).with_context(|| left_out(recorded))?,
                format!("{count} of equally many events by mean follower speed over the cut steps"),
            ),
            TaskRule::Source => (Tasks::by_source(&sources)?, "one for each source".to_owned()),
        };
        let (rule, split_by) = sides(arguments.split, options.settings.split_seed, &tasks, of);
        let own = of.iter().filter(|event| event.split.is_some()).count();
        let sides = of.iter().zip(rule).map(|(event, side)| event.split.unwrap_or(side)).collect();
        let split_by = if own > 0 { format!("{split_by}; {own} events name their side themselves") } else { split_by };
        let split_mps = tasks.edges_mps.clone();
        Ok(Self { events: (0..of.len()).collect(), tasks, sides, split_mps, tasks_by, split_by })
    }

    fn in_task(&self, task: usize, side: Option<Split>) -> impl Iterator<Item = usize> {
        let wanted = move |at: &usize| self.tasks.of[*at] == task && side.is_none_or(|side| self.sides[*at] == side);
        (0..self.events.len()).filter(wanted).map(|at| self.events[at])
    }

    /// What to tell about a task that lacks a side.
    fn without(&self, task: usize, side: Split, recorded: &Recorded) -> String {
        let events: Vec<_> = self.in_task(task, None).collect();
        let mut runs: Vec<_> = events.iter().map(|&at| &recorded.events[at].run).collect();
        runs.sort();
        runs.dedup();
        format!(
            "task {} has {} of {} runs, and none of them is for {}: a task needs events to learn from and events to be \
             tested on ({})",
            self.tasks.names[task],
            counted(events.len(), "event"),
            runs.len(),
            if side == Split::Train { "training" } else { "test" },
            self.split_by,
        )
    }

    fn collect(&self, of: &[CutEvent]) -> Vec<Task> {
        let task = |(task, name): (usize, &String)| {
            let events = |side| self.in_task(task, Some(side)).map(|at| of[at].event.clone()).collect();
            let test: Vec<_> = self.in_task(task, Some(Split::Test)).collect();
            Task {
                name: name.clone(),
                train: events(Split::Train),
                validation: events(Split::Validation),
                test: events(Split::Test),
                test_runs: test.iter().map(|&at| of[at].run.clone()).collect(),
                test_ids: test.iter().map(|&at| of[at].event_id.clone()).collect(),
            }
        };
        self.tasks.names.iter().enumerate().map(task).collect()
    }

    fn tell(self, recorded: &Recorded) -> Told {
        let of = &recorded.events;
        let told = |(task, name): (usize, &String)| {
            let speeds: Vec<_> = self.in_task(task, None).map(|at| of[at].mean_speed_mps).collect();
            let mut sources = BTreeMap::new();
            for at in self.in_task(task, None) {
                *sources.entry(of[at].source.clone()).or_default() += 1;
            }
            let count = |side| self.in_task(task, Some(side)).count();
            let mut runs: Vec<_> = self.in_task(task, Some(Split::Test)).map(|at| &of[at].run).collect();
            runs.sort();
            runs.dedup();
            TaskTold {
                name: name.clone(),
                train: count(Split::Train),
                validation: count(Split::Validation),
                test: count(Split::Test),
                mean_speed_mps: speeds.iter().sum::<f64>() / speeds.len() as f64,
                sources,
                test_runs: runs.len(),
            }
        };
        let mut sides: BTreeMap<&str, Vec<Split>> = BTreeMap::new();
        for (&at, &side) in self.events.iter().zip(&self.sides) {
            let sides = sides.entry(&of[at].run).or_default();
            if !sides.contains(&side) {
                sides.push(side);
            }
        }
        Told {
            events: self.events.len(),
            files: recorded.files.clone(),
            left_out: recorded.left_out.clone(),
            tasks: self.tasks.names.iter().enumerate().map(told).collect(),
            runs_on_several_sides: sides.values().filter(|sides| sides.len() > 1).count(),
            runs: sides.len(),
            copies: recorded.copies,
            split_mps: self.split_mps,
            tasks_by: self.tasks_by,
            split_by: self.split_by,
        }
    }
}

/// The side of each event, and the rule in words.
fn sides(rule: SplitRule, seed: u64, tasks: &Tasks, of: &[CutEvent]) -> (Vec<Split>, String) {
    match rule {
        SplitRule::Random => {
            let content: Vec<_> = of.iter().map(|event| event.content).collect();
            let words = format!("70/15/15 at random inside each task, split_seed {seed}");
            (at_random(&tasks.of, &content, seed), words)
        }
        SplitRule::Run => {
            let runs: Vec<_> = of.iter().map(|event| event.run.as_str()).collect();
            let words = "by whole runs, each on one side in all tasks, so that every task is as near to 70/15/15 as that \
                         allows; where runs are too few, a task keeps training and test events before validation events";
            (by_run(&tasks.of, &runs), words.to_owned())
        }
    }
}

/// Whether leader or follower drive at more than one speed.
fn changes_speed(event: &Event) -> bool {
    let changes = |speeds: &[f32]| speeds.iter().any(|speed| *speed != speeds[0]);
    changes(event.follower_speed_mps()) || changes(event.leader_speed_mps())
}

fn left_out(recorded: &Recorded) -> String {
    let all: usize = recorded.files.iter().map(|file| file.events).sum();
    match all - recorded.events.len() {
        0 => format!("{} in {}", counted(all, "event"), counted(recorded.files.len(), "file")),
        _ => format!("{} of {} can be used ({})", recorded.events.len(), counted(all, "event"), recorded.reasons()),
    }
}

fn counted(number: usize, of: &str) -> String {
    if number == 1 { format!("1 {of}") } else { format!("{number} {of}s") }
}
