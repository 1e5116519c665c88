//! What the inference protocol's statistics tell of each version: counts and times since the server started.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::Serialize;

/// How often, and how long in all.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Timed {
    /// Times.
    pub count: u64,
    /// All of them together, ns.
    pub ns: u64,
}

impl Timed {
    fn add(&mut self, took: Duration) {
        self.count += 1;
        self.ns = self.ns.saturating_add(u64::try_from(took.as_nanos()).unwrap_or(u64::MAX));
    }
}

/// How long the parts of an answered request took.
#[derive(Debug, Clone, Copy, Default)]
pub struct InferenceTimes {
    /// From a request that is in memory to its windows.
    pub input: Duration,
    /// From there to accelerations, waiting for others included.
    pub infer: Duration,
    /// From there to the answer.
    pub output: Duration,
}

/// What is known of a version.
#[derive(Debug, Clone, Copy, Default)]
pub struct VersionStatistics {
    /// When a request was last answered, ms since 1970.
    pub last_inference_ms: u64,
    /// Windows and steps answered.
    pub inferences: u64,
    /// Requests answered, from memory to memory.
    pub success: Timed,
    /// Requests refused after their version was found.
    pub fail: Timed,
    /// See [`InferenceTimes::input`].
    pub input: Timed,
    /// See [`InferenceTimes::infer`].
    pub infer: Timed,
    /// See [`InferenceTimes::output`].
    pub output: Timed,
}

type Versions = BTreeMap<i64, VersionStatistics>;

/// The statistics of a server: of each model's newest versions; those before them are forgotten.
#[derive(Debug)]
pub struct Statistics {
    most: usize,
    models: Mutex<BTreeMap<String, Versions>>,
}

impl Statistics {
    /// Of up to `counted_versions` versions of a model.
    #[must_use]
    pub fn new(counted_versions: usize) -> Self {
        Self { most: counted_versions, models: Mutex::default() }
    }

    /// A request was answered with so many accelerations.
    pub fn answered(&self, model: &str, version: i64, inferences: u64, times: InferenceTimes) {
        self.change(model, version, |known| {
            let InferenceTimes { input, infer, output } = times;
            known.inferences += inferences;
            known.last_inference_ms = since_1970_ms();
            known.success.add(input + infer + output);
            known.input.add(input);
            known.infer.add(infer);
            known.output.add(output);
        });
    }

    /// A request was refused after so long.
    pub fn refused(&self, model: &str, version: i64, took: Duration) {
        self.change(model, version, |known| known.fail.add(took));
    }

    /// What is known of a model's versions, in order of their numbers.
    #[must_use]
    pub fn of(&self, model: &str) -> Vec<(i64, VersionStatistics)> {
        let models = self.models.lock().unwrap_or_else(PoisonError::into_inner);
        models.get(model).into_iter().flatten().map(|(&version, &known)| (version, known)).collect()
    }

    /// Models of which something is known.
    #[must_use]
    pub fn models(&self) -> Vec<String> {
        self.models.lock().unwrap_or_else(PoisonError::into_inner).keys().cloned().collect()
    }

    fn change(&self, model: &str, version: i64, change: impl FnOnce(&mut VersionStatistics)) {
        let mut models = self.models.lock().unwrap_or_else(PoisonError::into_inner);
        if !models.contains_key(model) {
            models.insert(model.to_owned(), Versions::new());
        }
        let versions = models.get_mut(model).expect("it was put there");
        change(versions.entry(version).or_default());
        while versions.len() > self.most {
            versions.pop_first();
        }
    }
}

fn since_1970_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_add_up_and_the_oldest_version_is_forgotten() {
        let statistics = Statistics::new(2);
        let ms = Duration::from_millis;
        let times = InferenceTimes { input: ms(1), infer: ms(2), output: ms(3) };
        for version in 1..=3 {
            statistics.answered("m", version, 10, times);
        }
        statistics.answered("m", 3, 1, times);
        statistics.refused("m", 3, ms(5));
        let known = statistics.of("m");
        assert_eq!(known.iter().map(|(version, _)| *version).collect::<Vec<_>>(), [2, 3]);
        let last = known[1].1;
        assert_eq!((last.inferences, last.success), (11, Timed { count: 2, ns: 12_000_000 }));
        assert_eq!((last.infer.ns, last.fail), (4_000_000, Timed { count: 1, ns: 5_000_000 }));
        assert!(last.last_inference_ms > 0);
        assert_eq!((statistics.of("other").len(), statistics.models()), (0, vec!["m".to_owned()]));
    }
}
