//! A network that was trained elsewhere: an `nn.LSTM` called `lstm`, an `nn.Linear` called `head`, and what it reads and says.

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::defect::{ArtifactError, Defect};
use super::file::{File, network_names};
use super::keys::Keys;
use super::{Brought, BroughtRegime};
use crate::driver::{MotionScaling, Scaling};
use crate::lineage::{ModelSettings, RegimeName};

/// What an input is taken to have been seen within where the file does not say, in spreads around its mean.
const SEEN_SPREADS: f32 = 4.0;

/// What tells how to write it.
const EXAMPLE: &str = "the metadata needs scaling, what each input (follower speed, leader speed, relative speed in m/s, \
                       spacing in m) is standardised with: {\"mean\": [8.1, 8.2, 0.1, 14.0], \"spread\": [3.9, 4.0, 1.2, 6.5]}";

/// Standardisation; what was seen in training need not be known.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TheirScaling {
    mean: [f32; 4],
    spread: [f32; 4],
    low: Option<[f32; 4]>,
    high: Option<[f32; 4]>,
    motion: Option<MotionScaling>,
}

impl TheirScaling {
    fn known(self) -> Scaling {
        let Self { mean, spread, low, high, motion } = self;
        let off = |sign: f32| std::array::from_fn(|k| mean[k] + sign * SEEN_SPREADS * spread[k]);
        let (low, high) = (low.unwrap_or_else(|| off(-1.0)), high.unwrap_or_else(|| off(1.0)));
        Scaling { mean, spread, low, high, motion }
    }
}

pub(super) fn read(file: &File<'_>, keys: &Keys<'_>, settings: &ModelSettings) -> Result<Brought, ArtifactError> {
    let shape = settings.shape();
    let layout = shape.layout();
    file.refuse_others(&network_names(layout))?;
    let weights = file.weights(layout)?;
    if !keys.has("scaling") {
        return Err(Defect::key("scaling", "missing", EXAMPLE).into());
    }
    let scaling = keys.json::<TheirScaling>("scaling")?.known();
    scaling.check(shape).map_err(|detail| Defect::key("scaling", "invalid_value", detail))?;
    check_outputs(keys, settings)?;
    let regime = if keys.has("regime") { keys.word("regime")? } else { RegimeName::parse("default").expect("a name") };
    Ok(Brought {
        origin: None,
        stage: 1,
        regimes: vec![BroughtRegime { regime: regime.clone(), stage: 1, memory: None }],
        regime,
        settings: settings.clone(),
        strength: None,
        lambda: None,
        kernel: "imported".to_owned(),
        train_events: 0,
        events_sha256: Sha256::digest([]).into(),
        scaling,
        weights,
    })
}

/// The limit must be said, because the output's unit is in it; horizon and step are compared where they are.
fn check_outputs(keys: &Keys<'_>, settings: &ModelSettings) -> Result<(), ArtifactError> {
    if !keys.has("accel_limit_mps2") {
        let detail = "the metadata needs the limit in m/s²: the output is accel_limit_mps2 · tanh(head(lstm(window)))";
        return Err(Defect::key("accel_limit_mps2", "missing", detail).into());
    }
    let of_the_model = [
        ("accel_limit_mps2", settings.accel_limit_mps2),
        ("horizon", settings.horizon.into()),
        ("dt_s", settings.dt_s),
    ];
    let mut defects = Vec::new();
    for (key, expected) in of_the_model {
        let said: Option<f64> = keys.optional_parsed(key, "a number")?;
        if let Some(other) = said.filter(|said| *said != expected) {
            let detail = format!("{other} in the file, and {expected} of the model");
            defects.push(Defect::key(key, "other_shape", detail));
        }
    }
    if defects.is_empty() { Ok(()) } else { Err(ArtifactError::Unusable(defects)) }
}
