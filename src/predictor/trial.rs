//! A trial: versions and reference drivers driven over events that are not kept.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::ThreadPool;

use super::{Loaded, PredictError, Predictor, TrialSettings};
use crate::car_following::Event;
use crate::evaluation::{Calibration, calibrate, evaluate_reference};
use crate::lineage::{Model, RegimeEvaluation, RegimeName, ServedMeasures, TestMeasures, Version};
use crate::reference::ReferenceKind;

/// Everything a trial computes from, loaded.
#[derive(Debug)]
pub struct Trial {
    /// Events by regime, as they came; at the model's step while driven.
    events: BTreeMap<RegimeName, Vec<Event>>,
    /// The versions asked for, with what their lines have learned.
    versions: Vec<(Version, Vec<RegimeEvaluation>)>,
    /// Those, and the ones they are compared with.
    loaded: BTreeMap<i64, Arc<Loaded>>,
    references: Vec<ReferenceKind>,
    /// The version on whose line reference drivers are calibrated.
    calibrated_on: i64,
    lessons: Vec<Lesson>,
    /// Which lesson a regime's reference drivers take.
    lesson_of: BTreeMap<RegimeName, usize>,
    horizon: usize,
    /// The model's step, s.
    dt_s: f64,
}

/// Where the events came from that a reference driver was calibrated on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// The regime's, learned on the line.
    Regime,
    /// Of all regimes of the line, which has not learned this one.
    Line,
    /// From nowhere: the parameters are the published ones, or there are none.
    Published,
}

#[derive(Debug)]
struct Lesson {
    scope: Scope,
    /// Training events as stored; at the model's step while driven.
    events: Vec<Event>,
}

/// How a version drove.
#[derive(Debug)]
pub struct TriedVersion {
    /// The version.
    pub version: i64,
    /// Its stage.
    pub stage: u32,
    /// One entry for each regime among the events: those its line has learned, in the order first learned, then the others.
    pub regimes: Vec<TriedRegime>,
}

/// How a version drove in one regime.
#[derive(Debug)]
pub struct TriedRegime {
    /// Whether the version's line has learned the regime; where not, its stage and version mean nothing.
    pub learned: bool,
    /// All of it measured on the events of the trial, the best of the stages in between excepted, which is left out.
    pub evaluation: RegimeEvaluation,
}

/// How a reference driver drove in one regime.
#[derive(Debug)]
pub struct TriedReference {
    /// Which.
    pub kind: ReferenceKind,
    /// The regime.
    pub regime: RegimeName,
    /// None when every event is too short.
    pub measures: Option<TestMeasures>,
    /// Its parameters, and how they were found.
    pub calibration: Calibration,
    /// Where the events for that came from.
    pub scope: Scope,
    /// On whose line.
    pub calibrated_on: i64,
}

impl Predictor {
    /// Loads what it takes to drive `versions` (at least one) and `references` over events, grouped by regime.
    /// Reference drivers will be calibrated on training events of the line of the first version.
    ///
    /// # Errors
    /// When there is no such version, or it cannot be loaded.
    pub async fn trial(
        &self,
        model: &Model,
        versions: &[i64],
        references: Vec<ReferenceKind>,
        events: BTreeMap<RegimeName, Vec<Event>>,
        settings: &TrialSettings,
    ) -> Result<Trial, PredictError> {
        let mut trial = Trial {
            events,
            versions: Vec::new(),
            loaded: BTreeMap::new(),
            references,
            calibrated_on: versions[0],
            lessons: Vec::new(),
            lesson_of: BTreeMap::new(),
            horizon: model.settings.horizon as usize,
            dt_s: model.settings.dt_s,
        };
        for &number in versions {
            let version = self.store.version(model.model_id, number).await?;
            let version = version.ok_or(PredictError::UnknownVersion(number))?;
            let mut line = self.store.evaluation(model.model_id, number).await?;
            line.retain(|regime| trial.events.contains_key(&regime.regime));
            let compared = line.iter().map(|regime| regime.learned_version).chain(version.parent).chain([number]);
            for number in compared {
                if let std::collections::btree_map::Entry::Vacant(place) = trial.loaded.entry(number) {
                    place.insert(Arc::new(Loaded::load(&self.store, model.model_id, number).await?));
                }
            }
            trial.versions.push((version, line));
        }
        if trial.references.iter().any(|kind| !kind.parameters().is_empty()) {
            self.prepare_lessons(model, &mut trial, settings).await?;
        }
        Ok(trial)
    }

    /// For each regime its own training events on the line, else those of all regimes, which are loaded once.
    async fn prepare_lessons(
        &self,
        model: &Model,
        trial: &mut Trial,
        settings: &TrialSettings,
    ) -> Result<(), PredictError> {
        let limit = u32::try_from(settings.calibration.max_events).unwrap_or(u32::MAX);
        let mut of_line = None;
        for regime in trial.events.keys() {
            let load = async |regime| {
                let stored = self.store.line_sample(model.model_id, trial.calibrated_on, regime, limit).await?;
                let events = stored.into_iter().map(|stored| stored.event);
                Ok::<Vec<Event>, PredictError>(events.collect())
            };
            let own = load(Some(regime)).await?;
            let lesson = match (own.is_empty(), of_line) {
                (false, _) => trial.lessons.len(),
                (true, Some(of_line)) => of_line,
                (true, None) => *of_line.insert(trial.lessons.len()),
            };
            if lesson == trial.lessons.len() {
                let (scope, events) =
                    if own.is_empty() { (Scope::Line, load(None).await?) } else { (Scope::Regime, own) };
                trial.lessons.push(Lesson { scope, events });
            }
            trial.lesson_of.insert(regime.clone(), lesson);
        }
        Ok(())
    }
}

impl Trial {
    /// Drives the versions, and calibrates and drives the reference drivers: one entry for each of them and each regime.
    /// The same bits for any number of threads.
    #[must_use]
    pub fn drive(mut self, settings: &TrialSettings, workers: &ThreadPool) -> (Vec<TriedVersion>, Vec<TriedReference>) {
        let lessons = self.lessons.iter_mut().map(|lesson| &mut lesson.events);
        for event in self.events.values_mut().chain(lessons).flatten() {
            *event = event.resample(self.dt_s);
        }
        (self.drive_versions(workers), self.drive_references(settings, workers))
    }

    fn drive_versions(&self, workers: &ThreadPool) -> Vec<TriedVersion> {
        let mut driven = Driven { trial: self, workers, known: BTreeMap::new() };
        self.versions.iter().map(|(version, line)| driven.version(version, line)).collect()
    }

    fn drive_references(&self, settings: &TrialSettings, workers: &ThreadPool) -> Vec<TriedReference> {
        let mut tried = Vec::new();
        for &kind in &self.references {
            let mut calibrations = BTreeMap::new();
            for (regime, events) in &self.events {
                let lesson = self.lesson_of.get(regime).copied();
                let calibration = *calibrations.entry(lesson).or_insert_with(|| {
                    let events = lesson.map_or(&[][..], |lesson| &self.lessons[lesson].events);
                    let events: Vec<&Event> = events.iter().collect();
                    calibrate(kind, self.horizon, &events, &settings.calibration, workers)
                });
                let scope = match lesson {
                    Some(lesson) if calibration.evaluations > 0 => self.lessons[lesson].scope,
                    _ => Scope::Published,
                };
                let errors = evaluate_reference(&calibration.driver, self.horizon, events, workers);
                tried.push(TriedReference {
                    kind,
                    regime: regime.clone(),
                    measures: TestMeasures::of(&errors),
                    calibration,
                    scope,
                    calibrated_on: self.calibrated_on,
                });
            }
        }
        tried
    }
}

/// Versions driven over regimes, each pair once.
struct Driven<'a> {
    trial: &'a Trial,
    workers: &'a ThreadPool,
    known: BTreeMap<(i64, &'a RegimeName), Option<TestMeasures>>,
}

impl<'a> Driven<'a> {
    fn version(&mut self, version: &Version, line: &'a [RegimeEvaluation]) -> TriedVersion {
        let mut regimes = Vec::new();
        for known in line {
            let number = version.version;
            let just_learned = known.learned_version == number;
            let before =
                version.parent.filter(|_| just_learned).and_then(|parent| self.measures(parent, &known.regime));
            let evaluation = RegimeEvaluation {
                measures: self.measures(number, &known.regime),
                served: self.served(number, &known.regime),
                before,
                diagonal_spacing_mse: self.measures(known.learned_version, &known.regime).map(|m| m.spacing_mse),
                best_spacing_mse: None,
                ..known.clone()
            };
            regimes.push(TriedRegime { learned: true, evaluation });
        }
        for regime in self.trial.events.keys().filter(|regime| line.iter().all(|known| known.regime != **regime)) {
            let evaluation = RegimeEvaluation {
                regime: regime.clone(),
                learned_stage: version.stage,
                learned_version: version.version,
                measures: self.measures(version.version, regime),
                served: self.served(version.version, regime),
                before: None,
                diagonal_spacing_mse: None,
                best_spacing_mse: None,
            };
            regimes.push(TriedRegime { learned: false, evaluation });
        }
        TriedVersion { version: version.version, stage: version.stage, regimes }
    }

    fn served(&self, version: i64, regime: &RegimeName) -> Option<ServedMeasures> {
        let Trial { loaded, events, .. } = self.trial;
        ServedMeasures::of(&loaded[&version].evaluate_served(&events[regime], self.workers)?)
    }

    fn measures(&mut self, version: i64, regime: &'a RegimeName) -> Option<TestMeasures> {
        let Self { trial, workers, known } = self;
        *known
            .entry((version, regime))
            .or_insert_with(|| TestMeasures::of(&trial.loaded[&version].evaluate(&trial.events[regime], workers)))
    }
}
