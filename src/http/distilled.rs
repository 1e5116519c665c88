//! A version as vehicle types of SUMO: for each regime the IDM driver that comes closest to how it drives.

use std::sync::Arc;

use super::AppState;
use super::evaluate::{Evaluator, refusal};
use super::problem::{Code, Problem};
use crate::artifact::{VehicleType, sumo};
use crate::lineage::{Model, TestMeasures, Version};
use crate::predictor::Distilled;
use crate::reference::ReferenceDriver;

/// The file. Fitting takes as long as an evaluation, and counts as one.
pub(super) async fn file(app: &Arc<AppState>, model: &Model, version: &Version) -> Result<Vec<u8>, Problem> {
    let full = "as many evaluations as the server computes at once are under way";
    let slot = Arc::clone(&app.evaluation_slots).try_acquire_owned().map_err(|_| Problem::busy(Code::Busy, full))?;
    let evaluator = Arc::clone(&app.evaluator);
    let loading = app.predictor.distillation(model, version.version, &evaluator.settings);
    let distillation = loading.await.map_err(|error| refusal(model, error))?;
    let fitting = tokio::task::spawn_blocking(move || {
        let _slot = slot;
        let Evaluator { workers, settings } = &*evaluator;
        distillation.distil(settings, workers)
    });
    let distilled = fitting.await.map_err(Problem::internal)?;
    let types: Vec<_> = distilled.iter().filter_map(vehicle_type).collect();
    if types.is_empty() {
        let detail = format!("no event that version {} of {} learned from is still there", version.version, model.name);
        return Err(Code::NothingToDistil.because(detail));
    }
    Ok(sumo(model.name.as_str(), version.version, &version.weights_sha256, &types).into_bytes())
}

fn vehicle_type(distilled: &Distilled) -> Option<VehicleType> {
    let ReferenceDriver::Idm(idm) = distilled.driver else { return None };
    let mut told = vec![
        ("fitted_events", distilled.fitted_events.to_string()),
        ("held_events", distilled.from_version.map_or(0, |measures| measures.events).to_string()),
    ];
    let mut tell = |names: [&'static str; 2], measures: Option<TestMeasures>| {
        if let Some(TestMeasures { spacing_mse, speed_mse, .. }) = measures {
            told.push((names[0], format!("{:.4}", spacing_mse.sqrt())));
            told.push((names[1], format!("{:.4}", speed_mse.sqrt())));
        }
    };
    tell(["spacing_rmse_from_version_m", "speed_rmse_from_version_mps"], distilled.from_version);
    tell(["spacing_rmse_from_recorded_m", "speed_rmse_from_recorded_mps"], distilled.from_recorded);
    tell(["version_spacing_rmse_m", "version_speed_rmse_mps"], distilled.version_from_recorded);
    Some(VehicleType { regime: distilled.regime.to_string(), idm, told })
}
