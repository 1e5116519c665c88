//! Everything a task's stage starts from, loaded from the store.

use std::collections::HashMap;

use sha2::{Digest, Sha256};

use super::error::JobError;
use crate::car_following::Event;
use crate::consolidation::{Method, RegimeMemory};
use crate::driver::Scaling;
use crate::lineage::{Model, ModelSettings, RegimeName, Split, Task, TaskError, Version};
use crate::store::{LedgerEvent, LineRegime, Part, Store, StoreError};
use crate::training::{ReplayedRegime, StageInput};

/// What a stage starts from.
#[derive(Debug)]
pub(super) struct Stage {
    pub(super) task: Task,
    pub(super) model: Model,
    /// The model's with the task's overrides.
    pub(super) settings: ModelSettings,
    pub(super) number: u32,
    pub(super) parent: Option<Known>,
    /// At the model's step, in order of their digests.
    pub(super) train: Vec<Event>,
    /// What interim evaluations drive, at the model's step.
    validation: Vec<Event>,
    /// Over the digests of the training events.
    pub(super) events_sha256: [u8; 32],
    memories: Vec<RegimeMemory>,
    /// Training events of the line's earlier stages, at the model's step.
    replay: Vec<ReplayedRegime>,
    /// What a search for the strength drives: regimes learned earlier, then the new one. None where nothing is searched.
    pub(super) search: Option<Vec<Validated>>,
}

/// Validation events of one regime, at the model's step; each longer than the horizon.
#[derive(Debug)]
pub(super) struct Validated {
    pub(super) regime: RegimeName,
    pub(super) events: Vec<Event>,
}

/// A version with its weights, ready to be measured.
#[derive(Debug)]
pub(super) struct Known {
    pub(super) version: Version,
    pub(super) scaling: Scaling,
    pub(super) weights: Vec<f32>,
    /// What its line has learned.
    pub(super) regimes: Vec<LineRegime>,
}

impl Known {
    pub(super) async fn load(store: &Store, model_id: i64, version: i64) -> Result<Self, StoreError> {
        let found = store.version(model_id, version).await?;
        let version = found.ok_or_else(|| StoreError::malformed("version", format!("{version} is missing")))?;
        if let Some(detail) = &version.corrupt {
            store.note_corrupt(model_id, version.version, detail);
            return Err(StoreError::corrupt(Part::Version, detail));
        }
        let scaling = serde_json::from_value(version.scaling.clone());
        Ok(Self {
            scaling: scaling.map_err(|e| StoreError::malformed("scaling", e))?,
            weights: store.weights(model_id, version.version).await?,
            regimes: store.line_regimes(model_id, version.version).await?,
            version,
        })
    }
}

impl Stage {
    pub(super) async fn load(store: &Store, task: Task) -> Result<Self, JobError> {
        let model = store.intact_model(task.model_id).await?;
        let settings = model.settings.for_task(&task.settings).map_err(|e| StoreError::malformed("settings", e))?;
        Self::load_with(store, task, model, settings).await
    }

    /// The same with settings that are given.
    pub(super) async fn load_with(
        store: &Store,
        task: Task,
        model: Model,
        settings: ModelSettings,
    ) -> Result<Self, JobError> {
        let number = task.stage.ok_or_else(|| StoreError::malformed("task", "a running task has no stage"))?;
        let parent = match task.parent {
            Some(version) => Some(Known::load(store, model.model_id, version).await?),
            None => None,
        };
        if let Some(parent) = &parent {
            let known = parent.regimes.iter().any(|regime| regime.evaluation.regime == task.regime);
            if !known && parent.regimes.len() >= settings.max_regimes as usize {
                let detail = format!("the line has learned {} regimes, its max_regimes", parent.regimes.len());
                return Err(JobError::Failed(TaskError { code: "too_many_regimes".to_owned(), detail }));
            }
        }
        let memories = match &parent {
            Some(parent) if model.method.consolidates() => {
                store.memories(model.model_id, parent.version.version).await?
            }
            _ => Vec::new(),
        };
        let events = match &parent {
            Some(parent) if model.method == Method::Joint => {
                store.line_training_events(model.model_id, task.task_id, parent.version.version).await?
            }
            _ => store.training_events(task.task_id).await?,
        };
        let replay = match &parent {
            Some(parent) if model.method.replays() => {
                let limit = settings.replay_events;
                store
                    .line_events_by_regime(Split::Train, model.model_id, task.task_id, parent.version.version, limit)
                    .await?
            }
            _ => Vec::new(),
        };
        let replay = replay
            .into_iter()
            .map(|(regime, events)| ReplayedRegime { regime, events: at_step(events, settings.dt_s) })
            .collect();
        let events_sha256 = digest(&events);
        let train = at_step(events, settings.dt_s);
        let validation = store.validation_events(task.task_id, settings.test_reservoir).await?;
        let validation = at_step(validation, settings.dt_s);
        let search = match &parent {
            Some(parent) if settings.searches_strength(model.method) => {
                Some(validated(store, &task, &settings, parent, &validation).await?)
            }
            _ => None,
        };
        Ok(Self { task, model, settings, number, parent, train, validation, events_sha256, memories, replay, search })
    }

    /// What the arithmetic is told.
    pub(super) fn input(&self) -> StageInput<'_> {
        let afresh = self.model.method == Method::Joint;
        StageInput {
            method: self.model.method,
            settings: self.settings.learning(),
            stage: self.number,
            regime: self.task.regime.as_str(),
            parent_weights: self.parent.as_ref().filter(|_| !afresh).map(|parent| parent.weights.as_slice()),
            scaling: self.parent.as_ref().map(|parent| parent.scaling),
            memory: &self.memories,
            replay: &self.replay,
            train: &self.train,
            validation: &self.validation,
        }
    }
}

/// The validation events of every regime the parent's line has learned and of the task's own, which counts as new even when
/// it was learned before.
async fn validated(
    store: &Store,
    task: &Task,
    settings: &ModelSettings,
    parent: &Known,
    own: &[Event],
) -> Result<Vec<Validated>, StoreError> {
    let limit = settings.test_reservoir;
    let stored = store
        .line_events_by_regime(Split::Validation, task.model_id, task.task_id, parent.version.version, limit)
        .await?;
    let mut stored: HashMap<_, _> = stored.into_iter().collect();
    let long_enough = |events: Vec<Event>| -> Vec<Event> {
        events.into_iter().filter(|event| event.steps() > settings.horizon as usize).collect()
    };
    let names = parent.regimes.iter().map(|regime| &regime.evaluation.regime).filter(|name| **name != task.regime);
    let earlier = names.map(|name| {
        let events = stored.remove(name.as_str()).unwrap_or_default();
        Validated { regime: name.clone(), events: long_enough(at_step(events, settings.dt_s)) }
    });
    let new = Validated { regime: task.regime.clone(), events: long_enough(own.to_vec()) };
    Ok(earlier.chain([new]).collect())
}

/// Stored events at the model's step.
pub(super) fn at_step(events: Vec<LedgerEvent>, dt_s: f64) -> Vec<Event> {
    events.into_iter().map(|stored| stored.event.resample(dt_s)).collect()
}

/// SHA-256 over the digests, which are sorted.
fn digest(events: &[LedgerEvent]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    for event in events {
        hasher.update(event.sha256);
    }
    hasher.finalize().into()
}
