//! Measures and predictions as tables.

use std::sync::Arc;

use serde_json::Value;

use crate::formats::{Cells, Sheet};
use crate::predictor::{Flag, Prediction};

/// What a column of an evaluation holds.
enum Kind {
    Text,
    Whole,
    Number,
}

/// Columns of an evaluation, and where they are in what JSON says of a regime.
const OF_A_REGIME: [(&str, &str, Kind); 16] = [
    ("regime", "/regime", Kind::Text),
    ("stage", "/stage", Kind::Whole),
    ("learned_version", "/learned_version", Kind::Whole),
    ("events", "/events", Kind::Whole),
    ("steps", "/steps", Kind::Whole),
    ("spacing_mse", "/spacing_mse", Kind::Number),
    ("speed_mse", "/speed_mse", Kind::Number),
    ("collision_rate_percent", "/collision_rate_percent", Kind::Number),
    ("before", "/before", Kind::Number),
    ("diagonal_spacing_mse", "/diagonal_spacing_mse", Kind::Number),
    ("forgetting_ratio", "/forgetting_ratio", Kind::Number),
    ("served_spacing_mse", "/served/spacing_mse", Kind::Number),
    ("served_speed_mse", "/served/speed_mse", Kind::Number),
    ("served_collision_rate_percent", "/served/collision_rate_percent", Kind::Number),
    ("served_acted_percent", "/served/acted_percent", Kind::Number),
    ("served_held_percent", "/served/held_percent", Kind::Number),
];

/// An evaluation: a row a regime.
pub(super) fn of_regimes(regimes: &[Value]) -> Sheet {
    OF_A_REGIME.iter().fold(Sheet::default(), |sheet, (name, pointer, kind)| {
        let cells = regimes.iter().map(|regime| regime.pointer(pointer).unwrap_or(&Value::Null));
        let cells = match kind {
            Kind::Text => Cells::Text(cells.map(|cell| cell.as_str().map(Arc::from)).collect()),
            Kind::Whole => Cells::Whole(cells.map(Value::as_i64).collect()),
            Kind::Number => Cells::Number(cells.map(Value::as_f64).collect()),
        };
        sheet.with(name, cells)
    })
}

/// Predictions: a row a window, flags with semicolons between them.
pub(super) fn of_predictions(predictions: &[Prediction]) -> Sheet {
    let flags = |flags: &[Flag]| flags.iter().map(|flag| flag.as_str()).collect::<Vec<_>>().join(";");
    let told = |prediction: &Prediction| (!prediction.flags.is_empty()).then(|| flags(&prediction.flags).into());
    Sheet::default()
        .with("window", Cells::Whole((0..).map(Some).take(predictions.len()).collect()))
        .with("accel_mps2", Cells::Single(predictions.iter().map(|prediction| prediction.accel_mps2).collect()))
        .with("raw_accel_mps2", Cells::Single(predictions.iter().map(|prediction| prediction.raw_accel_mps2).collect()))
        .with("flags", Cells::Text(predictions.iter().map(told).collect()))
}
