//! `from` of `POST /v1/models`: a model that begins where another one's version is.

use std::sync::Arc;

use jiff::Timestamp;
use serde::Deserialize;
use tokio::runtime::Handle;

use super::AppState;
use super::path::find_model;
use super::problem::{Code, InputError, Problem};
use super::versions;
use super::whole::Whole;
use crate::consolidation::Method;
use crate::lineage::{Model, ModelName};
use crate::scheduler::step_back;
use crate::store::copy::ForkRefused;
use crate::store::{StoreError, WriteTransaction};

/// The version a fork starts from.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Origin {
    pub(super) model: ModelName,
    pub(super) version: Whole,
}

impl Origin {
    /// The model it names, which must have learned by `method`, and whose version and events must be what was written. Events
    /// are looked at before the fork has the database's one writer, on a thread that steps back.
    pub(super) async fn find(&self, app: &Arc<AppState>, method: Method) -> Result<Model, Problem> {
        let model = find_model(app, self.model.as_str()).await?;
        if model.method != method {
            let detail = format!("a fork goes on by the method of its model, {}", model.method.as_str());
            let error = InputError::at("/method", "invalid_value", detail.clone());
            return Err(Code::InvalidBody.because(detail).with_error(error));
        }
        let version = versions::find(app, &model, self.version.0).await?;
        if version.pruned {
            return Err(refusal(&model, self.version.0, ForkRefused::Pruned));
        }
        let (niceness, looker, model_id) = (app.scheduler.niceness(), Arc::clone(app), model.model_id);
        let looking = tokio::task::spawn_blocking(move || {
            step_back(niceness);
            Handle::current().block_on(looker.store.look_at_line(model_id, version.version))
        });
        looking.await.map_err(Problem::internal)??;
        Ok(model)
    }
}

/// Makes the fork in this transaction.
pub(super) async fn make(tx: &mut WriteTransaction, fork: &crate::store::copy::Fork<'_>) -> Result<Model, Problem> {
    let made: Result<_, StoreError> = fork.make(tx, Timestamp::now()).await;
    made?.map_err(|refused| match refused {
        ForkRefused::NameTaken => taken(fork.name),
        other => refusal(fork.of, fork.version, other),
    })
}

/// Why a fork or an archive has to wait.
pub(super) const BUSY: &str = "as many models as the server copies at once are being copied";

/// 409: the name is another model's.
pub(super) fn taken(name: &ModelName) -> Problem {
    Code::ModelExists.because(format!("a model is already called {name}"))
}

fn refusal(model: &Model, version: i64, refused: ForkRefused) -> Problem {
    match refused {
        ForkRefused::NameTaken => taken(&model.name),
        ForkRefused::UnknownVersion => versions::missing(model.name.as_str(), version),
        ForkRefused::Pruned => Code::VersionPruned.because(format!("the weights of version {version} were not kept")),
    }
}
