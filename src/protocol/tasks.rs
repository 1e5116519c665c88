//! Which event belongs to which task.

use std::collections::BTreeMap;

use super::quantile;

/// The tasks, in the order in which they are learned, and the task of each event.
#[derive(Debug, Clone, PartialEq)]
pub struct Tasks {
    /// Their names.
    pub names: Vec<String>,
    /// Index into `names` of each event.
    pub of: Vec<usize>,
    /// Where tasks by mean speed part, m/s, ascending; none when they do not.
    pub edges_mps: Option<Vec<f64>>,
}

/// Why events make no tasks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TasksError {
    /// Fewer events than tasks.
    #[error("{events} events cannot make {tasks} tasks: each needs events to learn from and events to be tested on")]
    TooFew {
        /// Events there are.
        events: usize,
        /// Tasks wanted.
        tasks: usize,
    },
    /// Speeds that do not differ enough.
    #[error(
        "the mean speeds of the events do not part them into {tasks} tasks: task {empty} is empty, since the speeds, \
         from {low:.3} to {high:.3} m/s, part at {edges}"
    )]
    Collapsed {
        /// Tasks wanted.
        tasks: usize,
        /// The first without an event.
        empty: String,
        /// Least mean speed, m/s.
        low: f64,
        /// Greatest, m/s.
        high: f64,
        /// Where they part, for a person.
        edges: String,
    },
    /// Tasks by source need sources.
    #[error("only one source is named ({0}); tasks by source need at least two")]
    OneSource(String),
    /// The order names other tasks.
    #[error("the order names {named}, but the tasks are {known}: each of them once")]
    Order {
        /// As given.
        named: String,
        /// As they are.
        known: String,
    },
}

impl Tasks {
    /// `count` tasks, at least 2, of equally many events by mean speed, the fastest first: parted at the linear percentiles
    /// 100·k/count, a task being (low, high]. Three are `fast`, `middle` and `slow`; otherwise `speed-1` is the fastest.
    ///
    /// # Errors
    /// When there are too few events, or their speeds do not differ.
    pub fn by_speed(mean_speeds_mps: &[f64], count: usize) -> Result<Self, TasksError> {
        if mean_speeds_mps.len() < 2 * count {
            return Err(TasksError::TooFew { events: mean_speeds_mps.len(), tasks: count });
        }
        let edges = Self::edges(mean_speeds_mps, count);
        let of: Vec<_> = mean_speeds_mps.iter().map(|v| edges.iter().filter(|&edge| v <= edge).count()).collect();
        let names = Self::speed_names(count);
        match (0..count).find(|task| !of.contains(task)) {
            None => Ok(Self { names, of, edges_mps: Some(edges) }),
            Some(empty) => Err(TasksError::Collapsed {
                tasks: count,
                empty: names[empty].clone(),
                low: mean_speeds_mps.iter().copied().fold(f64::INFINITY, f64::min),
                high: mean_speeds_mps.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                edges: edges.iter().map(|edge| format!("{edge:.3}")).collect::<Vec<_>>().join(" and ") + " m/s",
            }),
        }
    }

    /// Where `count` tasks of equally many events part, m/s, ascending.
    ///
    /// # Panics
    /// Without speeds.
    #[must_use]
    pub fn edges(mean_speeds_mps: &[f64], count: usize) -> Vec<f64> {
        let mut sorted = mean_speeds_mps.to_vec();
        sorted.sort_by(f64::total_cmp);
        (1..count).map(|k| quantile(&sorted, k as f64 / count as f64)).collect()
    }

    fn speed_names(count: usize) -> Vec<String> {
        match count {
            3 => ["fast", "middle", "slow"].map(str::to_owned).to_vec(),
            _ => (1..=count).map(|k| format!("speed-{k}")).collect(),
        }
    }

    /// A task for each source, in the order in which they first appear.
    ///
    /// # Errors
    /// When all events have the same.
    pub fn by_source(sources: &[&str]) -> Result<Self, TasksError> {
        let mut names: Vec<String> = Vec::new();
        let of = sources.iter().map(|source| {
            names.iter().position(|name| name == source).unwrap_or_else(|| {
                names.push((*source).to_owned());
                names.len() - 1
            })
        });
        let of = of.collect();
        if names.len() < 2 {
            return Err(TasksError::OneSource(names.pop().unwrap_or_default()));
        }
        Ok(Self { names, of, edges_mps: None })
    }

    /// Tasks that each event names itself, in numerical order where all names are numbers, else in that of the alphabet.
    #[must_use]
    pub fn by_name(task_of_event: &[&str]) -> Self {
        let mut names: Vec<_> = task_of_event.to_vec();
        names.sort_by_key(|name| (name.parse::<u64>().unwrap_or(u64::MAX), *name));
        names.dedup();
        let place: BTreeMap<_, _> = names.iter().enumerate().map(|(place, name)| (*name, place)).collect();
        let of = task_of_event.iter().map(|name| place[name]).collect();
        Self { of, names: names.into_iter().map(str::to_owned).collect(), edges_mps: None }
    }

    /// The same under the names of the speed thirds, where three tasks are those thirds (to within 1 % of their events, so
    /// that rounding at an edge is forgiven); else as they are.
    #[must_use]
    pub fn named_by_speed(mut self, mean_speeds_mps: &[f64]) -> Self {
        let Ok(thirds) = Self::by_speed(mean_speeds_mps, 3) else { return self };
        let off = self.of.iter().zip(&thirds.of).filter(|(own, third)| own != third).count();
        if self.names.len() == 3 && off * 100 <= self.of.len() {
            self.names = thirds.names;
        }
        self
    }

    /// The same tasks in another order.
    ///
    /// # Errors
    /// When `order` does not name each of them once.
    pub fn ordered(self, order: &[String]) -> Result<Self, TasksError> {
        let sorted = |names: &[String]| {
            let mut names = names.to_vec();
            names.sort();
            names
        };
        if sorted(order) != sorted(&self.names) {
            let named = if order.iter().all(String::is_empty) { "nothing".to_owned() } else { order.join(", ") };
            return Err(TasksError::Order { named, known: self.names.join(", ") });
        }
        let place: Vec<_> = self
            .names
            .iter()
            .map(|name| order.iter().position(|other| other == name).expect("both have the same names"))
            .collect();
        Ok(Self { names: order.to_vec(), of: self.of.iter().map(|&task| place[task]).collect(), ..self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn owned(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn thirds_hold_their_upper_edge_and_not_their_lower_one() {
        // The percentiles of 1 to 7 are 3 and 5, which are events themselves.
        let tasks = Tasks::by_speed(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], 3).unwrap();
        assert_eq!(tasks.edges_mps, Some(vec![3.0, 5.0]));
        assert_eq!(tasks.names, ["fast", "middle", "slow"]);
        assert_eq!(tasks.of, [2, 2, 2, 1, 1, 0, 0]);
    }

    #[test]
    fn five_tasks_have_a_fifth_of_the_events_each() {
        let speeds: Vec<f64> = (0..500).map(f64::from).collect();
        let tasks = Tasks::by_speed(&speeds, 5).unwrap();
        assert_eq!(tasks.names, ["speed-1", "speed-2", "speed-3", "speed-4", "speed-5"]);
        for task in 0..5 {
            assert_eq!(tasks.of.iter().filter(|&&of| of == task).count(), 100);
        }
        assert_eq!((tasks.of[0], tasks.of[499]), (4, 0));
    }

    #[test]
    fn speeds_that_do_not_differ_are_refused_with_what_is_missing() {
        let refused = |speeds: &[f64]| Tasks::by_speed(speeds, 3).unwrap_err().to_string();
        assert!(refused(&[10.0; 30]).contains("task fast is empty, since the speeds, from 10.000 to 10.000 m/s"));
        assert!(refused(&[1.0, 2.0, 3.0]).contains("3 events cannot make 3 tasks"));
    }

    #[test]
    fn sources_become_tasks_in_the_order_they_come() {
        let tasks = Tasks::by_source(&["b", "a", "b", "c"]).unwrap();
        assert_eq!((tasks.names, tasks.of), (owned(&["b", "a", "c"]), vec![0, 1, 0, 2]));
        assert_eq!(Tasks::by_source(&["b", "b"]), Err(TasksError::OneSource("b".to_owned())));
    }

    #[test]
    fn numbered_tasks_count_as_numbers_and_thirds_get_their_names() {
        let tasks = Tasks::by_name(&["10", "2", "1"]);
        assert_eq!((&tasks.names, &tasks.of), (&owned(&["1", "2", "10"]), &vec![2, 1, 0]));
        let speeds = [9.0, 5.0, 1.0, 1.5, 8.5, 5.5];
        assert_eq!(Tasks::by_name(&["1", "2", "3", "3", "1", "2"]).named_by_speed(&speeds).names[0], "fast");
        assert_eq!(Tasks::by_name(&["2", "1", "3", "3", "2", "1"]).named_by_speed(&speeds).names[0], "1");
    }

    #[test]
    fn another_order_moves_names_and_events_together() {
        let tasks = Tasks::by_source(&["b", "a", "b", "c"]).unwrap();
        let turned = tasks.clone().ordered(&owned(&["c", "a", "b"])).unwrap();
        assert_eq!((turned.names, turned.of), (owned(&["c", "a", "b"]), vec![2, 1, 2, 0]));
        for wrong in [&["c", "a"][..], &["c", "a", "d"], &["c", "a", "a"]] {
            let message = tasks.clone().ordered(&owned(wrong)).unwrap_err().to_string();
            assert!(message.contains("the tasks are b, a, c"), "{message}");
        }
    }
}
