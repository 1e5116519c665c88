//! Importance in short: what a version shows of half a megabyte.

use serde::Serialize;
use serde_json::Value;

use crate::consolidation::RegimeMemory;
use crate::driver::DriverShape;

/// Importance of the regime learned, over one part of the network.
#[derive(Debug, Serialize)]
struct LayerImportance {
    layer: &'static str,
    weights: usize,
    mean: f64,
    max: f32,
    /// Of the sum over all layers.
    share: f64,
}

/// Per layer: mean, greatest, and share of the whole. Null where nothing is kept.
#[must_use]
pub fn summary(shape: DriverShape, memory: Option<&RegimeMemory>) -> Value {
    let Some(memory) = memory else { return Value::Null };
    let total: f64 = memory.importance.iter().map(|&x| f64::from(x)).sum();
    let layers: Vec<_> = shape
        .layout()
        .parts()
        .into_iter()
        .filter_map(|(layer, range)| {
            let part = memory.importance.get(range)?;
            let sum: f64 = part.iter().map(|&x| f64::from(x)).sum();
            Some(LayerImportance {
                layer,
                weights: part.len(),
                mean: sum / part.len().max(1) as f64,
                max: part.iter().copied().fold(0.0, f32::max),
                share: if total > 0.0 { sum / total } else { 0.0 },
            })
        })
        .collect();
    serde_json::json!({ "regime": memory.regime, "samples": memory.samples, "layers": layers })
}
