//! A file that a server wrote.

use std::collections::HashSet;

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::defect::{ArtifactError, Defect};
use super::file::{File, network_names};
use super::keys::Keys;
use super::{Brought, BroughtRegime, Origin};
use crate::artifact::layers::layers;
use crate::artifact::record::{FORMAT, RememberedRegime};
use crate::artifact::safetensors::memory_name;
use crate::consolidation::{Method, RegimeMemory};
use crate::driver::Scaling;
use crate::lineage::{ModelSettings, RegimeName};
use crate::lstm::Layout;

/// Longest name of an arithmetic.
const MAX_KERNEL_BYTES: usize = 64;
/// Most of what is stored as a signed integer.
const MOST: u64 = i64::MAX as u64;

pub(super) fn read(
    file: &File<'_>,
    keys: &Keys<'_>,
    method: Method,
    settings: &ModelSettings,
) -> Result<Brought, ArtifactError> {
    check_format(keys)?;
    check_method(keys, method)?;
    let own = own_settings(keys, method)?;
    refuse_other_shape(&own, settings)?;
    let layout = own.shape().layout();
    let (stage, regime, remembered) = line(keys, settings)?;
    if !method.consolidates() && remembered.iter().any(|one| one.samples.is_some()) {
        let detail = format!("{} keeps nothing of a regime, and here is something kept", method.as_str());
        return Err(Defect::key("regimes", "invalid_value", detail).into());
    }
    file.refuse_others(&names(layout, &remembered))?;
    let weights = file.weights(layout)?;
    if digest(&[&weights]) != keys.digest("weights_sha256")? {
        return Err(Defect::key("weights_sha256", "digest", "the weights are not those of this digest").into());
    }
    let scaling: Scaling = keys.json("scaling")?;
    scaling.check(own.shape()).map_err(|detail| Defect::key("scaling", "invalid_value", detail))?;
    let regimes = remembered.iter().enumerate().map(|(place, one)| regime_at(file, place, one, layout));
    Ok(Brought {
        origin: Some(Origin {
            model: keys.word("model")?,
            version: keys.parsed("version", "a whole number")?,
            tainted: keys.parsed("tainted", "true or false")?,
        }),
        stage,
        regime,
        regimes: regimes.collect::<Result<_, _>>()?,
        strength: amount(keys, "strength")?,
        lambda: amount(keys, "lambda")?,
        kernel: kernel(keys)?,
        train_events: counted(keys, "train_events")?,
        events_sha256: keys.digest("events_sha256")?,
        settings: own,
        scaling,
        weights,
    })
}

fn check_format(keys: &Keys<'_>) -> Result<(), Defect> {
    match keys.text("headway_format")? {
        FORMAT => Ok(()),
        _ => Err(Defect::key("headway_format", "unknown_format", format!("this release reads format {FORMAT}"))),
    }
}

fn check_method(keys: &Keys<'_>, method: Method) -> Result<(), Defect> {
    let own: Method = keys.word("method")?;
    if own == method {
        return Ok(());
    }
    let detail = format!("the file's is {}, the model's {}; a model has one", own.as_str(), method.as_str());
    Err(Defect::key("method", "other_method", detail))
}

fn own_settings(keys: &Keys<'_>, method: Method) -> Result<ModelSettings, Defect> {
    let given: Value = keys.json("settings")?;
    let settings = ModelSettings::default().overridden(&given);
    let wrong = |e: &dyn std::fmt::Display| Defect::key("settings", "invalid_setting", e.to_string());
    let settings = settings.map_err(|e| wrong(&e))?;
    settings.check_for(method).map_err(|e| wrong(&e))?;
    Ok(settings)
}

/// The settings that a line cannot change on its way, each with what is told of it.
fn refuse_other_shape(own: &ModelSettings, model: &ModelSettings) -> Result<(), ArtifactError> {
    let json = |settings: &ModelSettings| serde_json::to_value(settings).expect("settings are plain data");
    let (own, model) = (json(own), json(model));
    let defects: Vec<_> = ["hidden", "horizon", "memory", "features", "dt_s", "accel_limit_mps2"]
        .into_iter()
        .filter(|name| own[name] != model[name])
        .map(|name| {
            let detail = format!("{name} is {} in the file, and {} of the model", own[name], model[name]);
            Defect { pointer: format!("/__metadata__/settings/{name}"), code: "other_shape", detail }
        })
        .collect();
    if defects.is_empty() { Ok(()) } else { Err(ArtifactError::Unusable(defects)) }
}

/// Stage, the regime it learned, and all of them.
fn line(keys: &Keys<'_>, settings: &ModelSettings) -> Result<(u32, RegimeName, Vec<RememberedRegime>), Defect> {
    let stage: u32 = keys.parsed("stage", "a whole number from 1")?;
    let regime: RegimeName = keys.word("regime")?;
    let regimes: Vec<RememberedRegime> = keys.json("regimes")?;
    let wrong = |detail: &str| Err(Defect::key("regimes", "invalid_value", detail));
    if regimes.is_empty() || regimes.len() > settings.max_regimes as usize {
        return wrong(&format!("1 to {} are needed, the model's max_regimes", settings.max_regimes));
    }
    let names: HashSet<_> = regimes.iter().map(|one| &one.regime).collect();
    let stages: HashSet<_> = regimes.iter().map(|one| one.stage).collect();
    if names.len() < regimes.len() || stages.len() < regimes.len() {
        return wrong("no two have the same name or the same stage");
    }
    if regimes.iter().any(|one| !(1..=stage).contains(&one.stage)) {
        return wrong("each was learned at a stage from 1 to that of the version");
    }
    if !regimes.iter().any(|one| one.regime == regime && one.stage == stage) {
        return wrong("the version's own regime, learned at its own stage, is not among them");
    }
    if regimes.iter().any(|one| one.samples.is_some() != one.anchor_sha256.is_some()) {
        return wrong("samples and anchor_sha256 are both there or both null");
    }
    if regimes.iter().any(|one| one.samples.is_some_and(|samples| samples > MOST)) {
        return wrong("samples are too many");
    }
    Ok((stage, regime, regimes))
}

/// The names of all tensors that such a file has.
fn names(layout: Layout, regimes: &[RememberedRegime]) -> HashSet<String> {
    let mut names = network_names(layout);
    for (place, _) in regimes.iter().enumerate().filter(|(_, one)| one.samples.is_some()) {
        for kind in ["importance", "anchor"] {
            names.extend(layers(layout).map(|layer| memory_name(place, kind, layer.name)));
        }
    }
    names
}

fn regime_at(file: &File<'_>, place: usize, one: &RememberedRegime, layout: Layout) -> Result<BroughtRegime, Defect> {
    let (regime, stage) = (one.regime.clone(), one.stage);
    let (Some(samples), Some(known)) = (one.samples, &one.anchor_sha256) else {
        return Ok(BroughtRegime { regime, stage, memory: None });
    };
    let [importance, anchor] = ["importance", "anchor"].map(|kind| file.flat(&memory_name(place, kind, ""), layout));
    let (importance, anchor) = (importance?, anchor?);
    if importance.iter().any(|&x| x < 0.0) {
        let name = format!("regimes.{place}.importance");
        return Err(Defect::tensor(&name, "negative", format!("{name}: no importance is less than 0")));
    }
    if hex::encode(digest(&[&importance, &anchor])) != known.to_lowercase() {
        let detail = format!("importance and anchor of {regime} are not those of their digest");
        return Err(Defect::key(&format!("regimes/{place}/anchor_sha256"), "digest", detail));
    }
    let memory = RegimeMemory { regime: regime.to_string(), importance, anchor, samples, stage };
    Ok(BroughtRegime { regime, stage, memory: Some(memory) })
}

/// SHA-256 over the little-endian numbers.
fn digest(parts: &[&[f32]]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    for part in parts {
        for x in *part {
            hasher.update(x.to_le_bytes());
        }
    }
    hasher.finalize().into()
}

fn amount(keys: &Keys<'_>, key: &str) -> Result<Option<f64>, Defect> {
    let amount: Option<f64> = keys.optional_parsed(key, "a number")?;
    match amount.filter(|x| !x.is_finite() || *x < 0.0) {
        None => Ok(amount),
        Some(_) => Err(Defect::key(key, "invalid_value", "a finite number from 0 is needed")),
    }
}

fn counted(keys: &Keys<'_>, key: &str) -> Result<u64, Defect> {
    let count: u64 = keys.parsed(key, "a whole number")?;
    if count > MOST { Err(Defect::key(key, "invalid_value", "too many")) } else { Ok(count) }
}

fn kernel(keys: &Keys<'_>) -> Result<String, Defect> {
    let kernel = keys.text("kernel")?;
    if (1..=MAX_KERNEL_BYTES).contains(&kernel.len()) && kernel.bytes().all(|b| b.is_ascii_graphic() || b == b' ') {
        return Ok(kernel.to_owned());
    }
    Err(Defect::key("kernel", "invalid_value", format!("1 to {MAX_KERNEL_BYTES} visible ASCII characters")))
}
