//! Whole recordings on one side, and every task as near to 70/15/15 as they allow.

use std::collections::BTreeMap;

use crate::lineage::Split;

const SIDES: [Split; 3] = [Split::Train, Split::Validation, Split::Test];
const SHARES: [f64; 3] = [0.7, 0.15, 0.15];

/// What a task without events on a side costs, beside its distance from 70/15/15: it must be learned and tested; that it is
/// validated is good to have.
const EMPTY: [f64; 3] = [1e6, 1e2, 1e6];

/// The side of each event such that all events of a run are on one, in whichever tasks they are.
///
/// A run with events in several tasks, or few runs in a task, leave no exact 70/15/15. The rule: make
/// `Σ_tasks Σ_sides (events − share · n)² / (share · n)` least, an empty training or test side costing more than any
/// distance and an empty validation side less. Runs are placed largest first, each where the sum is least, then moved one
/// by one and exchanged in pairs until nothing improves. Nothing is random, and the order of the events does not matter.
#[must_use]
pub fn by_run(task_of: &[usize], run_of: &[&str]) -> Vec<Split> {
    let tasks = task_of.iter().max().map_or(0, |last| last + 1);
    let mut counts: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (&task, &run) in task_of.iter().zip(run_of) {
        counts.entry(run).or_insert_with(|| vec![0.0; tasks])[task] += 1.0;
    }
    let mut runs: Vec<_> = counts.into_iter().collect();
    runs.sort_by(|a, b| b.1.iter().sum::<f64>().total_cmp(&a.1.iter().sum()).then(a.0.cmp(b.0)));
    let mut balance = Balance::new(tasks, &runs);
    for run in 0..runs.len() {
        balance.place_best(run);
    }
    while balance.move_one() || balance.exchange_two() {}
    let side: BTreeMap<_, _> = runs.iter().zip(&balance.side).map(|((run, _), &side)| (*run, SIDES[side])).collect();
    run_of.iter().map(|run| side[run]).collect()
}

/// Runs on sides, and what is on each side of each task.
struct Balance<'a> {
    runs: &'a [(&'a str, Vec<f64>)],
    /// Of each run placed.
    side: Vec<usize>,
    /// Events of each task.
    total: Vec<f64>,
    /// Tasks × sides.
    placed: Vec<[f64; 3]>,
}

impl<'a> Balance<'a> {
    fn new(tasks: usize, runs: &'a [(&'a str, Vec<f64>)]) -> Self {
        let total = (0..tasks).map(|task| runs.iter().map(|(_, events)| events[task]).sum()).collect();
        Self { runs, side: Vec::new(), total, placed: vec![[0.0; 3]; tasks] }
    }

    /// Cost of one task with these counts.
    fn cost(&self, task: usize, placed: [f64; 3]) -> f64 {
        let part = |side: usize| {
            let target = SHARES[side] * self.total[task];
            let empty = if placed[side] == 0.0 { EMPTY[side] } else { 0.0 };
            (placed[side] - target).powi(2) / target + empty
        };
        (0..3).map(part).sum()
    }

    /// By how much the cost grows when `events` of each task are added to a side and taken from another.
    fn change(&self, moves: &[(usize, Option<usize>, usize)]) -> f64 {
        let mut sum = 0.0;
        for task in 0..self.total.len() {
            if moves.iter().all(|&(run, ..)| self.runs[run].1[task] == 0.0) {
                continue;
            }
            let mut after = self.placed[task];
            for &(run, from, to) in moves {
                let events = self.runs[run].1[task];
                after[to] += events;
                if let Some(from) = from {
                    after[from] -= events;
                }
            }
            sum += self.cost(task, after) - self.cost(task, self.placed[task]);
        }
        sum
    }

    fn put(&mut self, run: usize, from: Option<usize>, to: usize) {
        for (task, events) in self.runs[run].1.iter().enumerate() {
            self.placed[task][to] += events;
            if let Some(from) = from {
                self.placed[task][from] -= events;
            }
        }
    }

    fn place_best(&mut self, run: usize) {
        let best = (0..3).min_by(|&a, &b| self.change(&[(run, None, a)]).total_cmp(&self.change(&[(run, None, b)])));
        let best = best.expect("there are three sides");
        self.put(run, None, best);
        self.side.push(best);
    }

    /// Moves single runs while that improves; whether any did.
    fn move_one(&mut self) -> bool {
        let mut moved = false;
        for run in 0..self.runs.len() {
            for to in 0..3 {
                let from = self.side[run];
                if to != from && self.change(&[(run, Some(from), to)]) < -1e-9 {
                    self.put(run, Some(from), to);
                    self.side[run] = to;
                    moved = true;
                }
            }
        }
        moved
    }

    /// Exchanges the first two runs for which that improves; whether there were any.
    fn exchange_two(&mut self) -> bool {
        for a in 0..self.runs.len() {
            for b in a + 1..self.runs.len() {
                let (of_a, of_b) = (self.side[a], self.side[b]);
                if of_a != of_b && self.change(&[(a, Some(of_a), of_b), (b, Some(of_b), of_a)]) < -1e-9 {
                    self.put(a, Some(of_a), of_b);
                    self.put(b, Some(of_b), of_a);
                    self.side.swap(a, b);
                    return true;
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::missing_side;

    fn counts(task: usize, task_of: &[usize], sides: &[Split]) -> [usize; 3] {
        SIDES.map(|side| (0..sides.len()).filter(|&i| task_of[i] == task && sides[i] == side).count())
    }

    #[test]
    fn runs_stay_whole_and_tasks_come_out_nearly_seventy_fifteen_fifteen() {
        // Sixty runs of 1 to 12 events, each in two of three tasks.
        let (mut task_of, mut run_of) = (Vec::new(), Vec::new());
        for run in 0..60 {
            for event in 0..=run % 12 {
                task_of.push((run + event % 2) % 3);
                run_of.push(format!("run-{run}"));
            }
        }
        let run_of: Vec<_> = run_of.iter().map(String::as_str).collect();
        let sides = by_run(&task_of, &run_of);
        for (side, run) in sides.iter().zip(&run_of) {
            let first = run_of.iter().position(|other| other == run).unwrap();
            assert_eq!(*side, sides[first], "{run}");
        }
        for task in 0..3 {
            let found = counts(task, &task_of, &sides);
            let all = found.iter().sum::<usize>() as f64;
            for (found, share) in found.into_iter().zip(SHARES) {
                assert!((found as f64 - share * all).abs() <= 1.0, "task {task}: {found} of {all}");
            }
        }
        let turned = by_run(
            &task_of.iter().rev().copied().collect::<Vec<_>>(),
            &run_of.iter().rev().copied().collect::<Vec<_>>(),
        );
        assert_eq!(turned.into_iter().rev().collect::<Vec<_>>(), sides);
    }

    #[test]
    fn three_runs_give_each_side_one_and_two_runs_leave_out_validation() {
        let sides = by_run(&[0; 9], &["a", "a", "a", "a", "a", "b", "b", "c", "c"]);
        assert_eq!(counts(0, &[0; 9], &sides), [5, 2, 2]);
        let sides = by_run(&[0; 7], &["a", "a", "a", "a", "a", "b", "b"]);
        assert_eq!(counts(0, &[0; 7], &sides), [5, 0, 2]);
    }

    #[test]
    fn one_run_cannot_be_learned_and_tested() {
        let sides = by_run(&[0; 7], &["a"; 7]);
        assert_eq!(missing_side(1, &[0; 7], &sides), Some((0, Split::Test)));
    }
}
