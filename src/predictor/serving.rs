//! What serves now: the live version of every model behind a swap, and the versions that somebody named.

use std::collections::BTreeMap;
use std::sync::Arc;

use tokio::sync::Semaphore;

use super::company::Company;
use super::recent::Recent;
use super::sync::{ArcSwap, AtomicBool, Mutex, Ordering, PoisonError};
use super::{Loaded, PredictError, PredictorSettings};
use crate::store::Store;

/// What serves for a model.
#[derive(Debug, Clone)]
struct Live {
    /// What the store says is live.
    version: i64,
    /// What answers: that version; its newest good ancestor when it cannot be loaded; nothing when no ancestor can.
    loaded: Option<Arc<Loaded>>,
}

/// A model of which another version answers than the one that is live.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Degraded {
    /// The model's name.
    pub model: String,
    /// What is live and cannot be loaded.
    pub live: i64,
    /// What answers in its place; none when nothing does.
    pub serving: Option<i64>,
}

/// The models that serve. Swapped as a whole, so that a request reads it without a lock and never sees half a change.
#[derive(Debug, Clone, Default)]
struct Directory {
    /// By name.
    ids: BTreeMap<String, i64>,
    /// By id.
    live: BTreeMap<i64, Live>,
}

/// Serves every model's live version, and named ones.
#[derive(Debug)]
pub struct Predictor {
    pub(super) store: Arc<Store>,
    pub(super) settings: PredictorSettings,
    directory: ArcSwap<Directory>,
    recent: Mutex<Recent>,
    pub(super) company: Arc<Company>,
    /// Turns on the threads that compute large requests.
    pub(super) threads: Arc<Semaphore>,
    /// Whether all live versions were looked for at start-up.
    started: AtomicBool,
    /// One change of the directory at a time, so that a slow one cannot bring back an older version.
    refreshing: tokio::sync::Mutex<()>,
}

impl Predictor {
    /// A predictor that has loaded nothing yet; see [`Self::load_all`].
    #[must_use]
    pub fn new(store: Arc<Store>, settings: PredictorSettings) -> Self {
        let recent = Mutex::new(Recent::new(settings.named_versions));
        let company = Arc::new(Company::new(settings.waiting_windows));
        let threads = Arc::new(Semaphore::new(settings.threads()));
        Self {
            store,
            settings,
            directory: ArcSwap::default(),
            recent,
            company,
            threads,
            started: AtomicBool::new(false),
            refreshing: tokio::sync::Mutex::new(()),
        }
    }

    /// Loads the live version of every model, or its newest good ancestor where it cannot be loaded.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn load_all(&self) -> Result<(), crate::store::StoreError> {
        for (model_id, _) in self.store.live_versions().await? {
            self.refresh(model_id).await;
        }
        self.started.store(true, Ordering::Release);
        Ok(())
    }

    /// Whether something answers for every model that has a live version.
    #[must_use]
    pub fn ready(&self) -> bool {
        let loaded = |live: &Live| live.loaded.is_some();
        self.started.load(Ordering::Acquire) && self.directory.load().live.values().all(loaded)
    }

    /// Models whose live version does not answer, in order of their names.
    #[must_use]
    pub fn degraded(&self) -> Vec<Degraded> {
        let directory = self.directory.load();
        let of = |(name, id): (&String, &i64)| {
            let live = directory.live.get(id)?;
            let serving = live.loaded.as_ref().map(|loaded| loaded.version());
            let degraded = || Degraded { model: name.clone(), live: live.version, serving };
            (serving != Some(live.version)).then(degraded)
        };
        directory.ids.iter().filter_map(of).collect()
    }

    /// Brings the model's live version in line with the store: to be called after every commit that moved it.
    pub async fn refresh(&self, model_id: i64) {
        let _one_at_a_time = self.refreshing.lock().await;
        let model = match self.store.model_by_id(model_id).await {
            Ok(model) => model,
            Err(error) => {
                tracing::error!(model_id, %error, "the live version cannot be read; the one before goes on serving");
                return;
            }
        };
        let served = match model.live {
            None => None,
            Some(version) => Some(Live { version, loaded: self.load_live(model_id, version).await }),
        };
        let mut directory = Directory::clone(&self.directory.load());
        directory.ids.retain(|_, id| *id != model_id);
        directory.live.remove(&model_id);
        if let Some(served) = served {
            directory.ids.insert(model.name.into(), model_id);
            directory.live.insert(model_id, served);
        }
        self.directory.store(Arc::new(directory));
    }

    /// The model of this name, if something of it is live. Asks no database: another model need not be unknown.
    #[must_use]
    pub fn serving(&self, name: &str) -> Option<i64> {
        self.directory.load().ids.get(name).copied()
    }

    /// The version, or its newest ancestor that can be loaded. The live pointer stays where people or the policy put it:
    /// once a backup is restored, that version serves again.
    async fn load_live(&self, model_id: i64, version: i64) -> Option<Arc<Loaded>> {
        let before = self.directory.load().live.get(&model_id).and_then(|live| live.loaded.clone());
        let mut candidate = Some(version);
        while let Some(at) = candidate {
            let loaded = match &before {
                Some(loaded) if loaded.version() == at => Ok(Arc::clone(loaded)),
                _ => Loaded::load(&self.store, model_id, at).await.map(Arc::new),
            };
            match loaded {
                Ok(loaded) if at == version => return Some(loaded),
                Ok(loaded) => {
                    tracing::error!(model_id, live = version, serving = at, "an ancestor of the live version serves");
                    return Some(loaded);
                }
                Err(error) => tracing::error!(model_id, version = at, %error, "a version cannot be loaded"),
            }
            candidate = match self.store.parent(model_id, at).await {
                // A corrupt row may name any version; an ancestor is older.
                Ok(parent) => parent.filter(|&parent| parent < at),
                Err(error) => {
                    tracing::error!(model_id, version = at, %error, "a version's parent cannot be read");
                    None
                }
            };
        }
        tracing::error!(model_id, live = version, "neither the live version nor an ancestor can be served");
        None
    }

    /// The version that answers for the model when a request names none; none when nothing does.
    #[must_use]
    pub fn answering(&self, model_id: i64) -> Option<i64> {
        Some(self.directory.load().live.get(&model_id)?.loaded.as_ref()?.version())
    }

    /// The version that answers a request: the named one, else the live one.
    ///
    /// # Errors
    /// When there is no such version, or it cannot be loaded.
    pub async fn version(&self, model_id: i64, version: Option<i64>) -> Result<Arc<Loaded>, PredictError> {
        let live = self.directory.load().live.get(&model_id).cloned();
        match (version, live) {
            (None, None) => Err(PredictError::NoLiveVersion),
            (None, Some(Live { version, loaded })) => loaded.ok_or(PredictError::Unusable(version)),
            (Some(named), Some(Live { loaded: Some(loaded), .. })) if loaded.version() == named => Ok(loaded),
            (Some(named), _) => self.named(model_id, named).await,
        }
    }

    async fn named(&self, model_id: i64, version: i64) -> Result<Arc<Loaded>, PredictError> {
        let recent = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(loaded) = recent().get(model_id, version) {
            return Ok(loaded);
        }
        let forgotten = recent().forgotten();
        let loaded = Arc::new(Loaded::load(&self.store, model_id, version).await?);
        recent().put(model_id, Arc::clone(&loaded), forgotten);
        Ok(loaded)
    }

    /// Lets go of a version whose weights were dropped.
    pub fn forget(&self, model_id: i64, version: i64) {
        self.recent.lock().unwrap_or_else(PoisonError::into_inner).forget(model_id, version);
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &PredictorSettings {
        &self.settings
    }
}
