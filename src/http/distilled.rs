//! A version as vehicle types of SUMO: for each regime the IDM driver that comes closest to how it drives.

use super::AppState;
use super::evaluate::{self, Evaluator};
use super::problem::{Code, Problem};
use crate::artifact::{VehicleType, sumo};
use crate::lineage::{Model, TestMeasures, Version};
use crate::predictor::Distilled;

/// The file. Fitting takes as long as an evaluation, and counts as one.
pub(super) async fn file(app: &AppState, model: &Model, version: &Version) -> Result<Vec<u8>, Problem> {
    let turn = evaluate::turn(app)?;
    let loading = app.predictor.distillation(model, version.version, &app.evaluator.settings);
    let distillation = loading.await.map_err(|error| evaluate::refusal(model, error))?;
    let fit = |Evaluator { workers, settings }: &Evaluator| distillation.distil(settings, workers);
    let distilled = evaluate::compute(app, turn, fit).await?;
    if distilled.is_empty() {
        let detail = format!("no event that version {} of {} learned from is still there", version.version, model.name);
        return Err(Code::NothingToDistil.because(detail));
    }
    let types: Vec<_> = distilled.iter().map(vehicle_type).collect();
    Ok(sumo(model.name.as_str(), version.version, &version.weights_sha256, &types))
}

fn vehicle_type(distilled: &Distilled) -> VehicleType {
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
    VehicleType { regime: distilled.regime.to_string(), idm: distilled.idm, told }
}
