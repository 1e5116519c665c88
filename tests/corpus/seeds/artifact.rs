//! Seeds that are safetensors: versions as a server writes them, networks of others, and what is neither.

use headway::artifact::{Record, RememberedRegime, header, weights_data};
use headway::consolidation::Method;
use headway::driver::{Features, Memory};
use headway::lineage::{ModelName, ModelSettings, RegimeName};
use headway::lstm::initial_weights;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// A few weights are enough.
fn settings() -> ModelSettings {
    ModelSettings { hidden: 2, horizon: 3, ..ModelSettings::default() }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn sha256(bytes: &[u8]) -> String {
    hex::encode(Sha256::digest(bytes))
}

/// A version of so many regimes.
fn version(method: Method, regimes: u32) -> Vec<u8> {
    let settings = settings();
    assert_eq!((settings.memory, settings.features), (Memory::Carried, Features::Motion));
    let layout = settings.shape().layout();
    let weights = initial_weights(layout, 1);
    let kept =
        [floats(&initial_weights(layout, 2).iter().map(|x| x.abs()).collect::<Vec<_>>()), floats(&weights)].concat();
    let keeps = method.consolidates();
    let remembered = |stage: u32| RememberedRegime {
        regime: RegimeName::parse(&format!("r{stage}")).unwrap(),
        stage,
        samples: keeps.then_some(9),
        anchor_sha256: keeps.then(|| sha256(&kept)),
    };
    let record = Record {
        model: ModelName::parse("m").unwrap(),
        version: 3,
        method,
        stage: regimes,
        regime: RegimeName::parse(&format!("r{regimes}")).unwrap(),
        regimes: (1..=regimes).map(remembered).collect(),
        settings,
        strength: keeps.then_some(1.0),
        lambda: keeps.then_some(25.0),
        kernel: "k".to_owned(),
        train_events: 2,
        events_sha256: sha256(b""),
        scaling: scaling(),
        weights_sha256: sha256(&floats(&weights)),
        tainted: false,
    };
    let kept = if keeps { kept.repeat(regimes as usize) } else { Vec::new() };
    [header(&record, layout).bytes, weights_data(layout, &weights), kept].concat()
}

fn scaling() -> Value {
    json!({"mean": [8.0, 8.5, 0.5, 14.0], "spread": [3.0, 3.5, 1.5, 5.0], "low": [0, 0, -5, 0], "high": [30, 30, 5, 90],
        "motion": {"mean": [0, 0, 0], "spread": [1, 1, 1]}})
}

/// A file with another header.
fn with_header(file: &[u8], change: impl FnOnce(&mut Map<String, Value>)) -> Vec<u8> {
    let (length, rest) = file.split_first_chunk::<8>().unwrap();
    let (text, data) = rest.split_at(usize::try_from(u64::from_le_bytes(*length)).unwrap());
    let mut members: Map<String, Value> = serde_json::from_slice(text).unwrap();
    change(&mut members);
    let header = Value::Object(members).to_string();
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

/// The method, as the target counts them; a name; a file.
pub(super) fn files() -> Vec<(u8, &'static str, Vec<u8>)> {
    let (ewc, naive) = (version(Method::Ewc, 2), version(Method::Naive, 1));
    let network = with_header(&naive, |members| {
        members["__metadata__"] = json!({"scaling": scaling().to_string(), "accel_limit_mps2": "4", "regime": "city"});
    });
    let bare = with_header(&naive, |members| members["__metadata__"] = json!({}));
    let half = with_header(&naive, |members| members["head.weight"]["dtype"] = json!("I32"));
    let lying = with_header(&naive, |members| members["head.weight"]["shape"] = json!([1 << 20, 1 << 20]));
    let stranger = with_header(&naive, |members| {
        let bias = members.remove("head.bias").unwrap();
        members.insert("fc.bias".to_owned(), bias);
    });
    let mut not_finite = naive.clone();
    let end = not_finite.len();
    not_finite[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    vec![
        (0, "ewc", ewc.clone()),
        (1, "si", version(Method::Si, 1)),
        (2, "naive", naive.clone()),
        (0, "network", network),
        (2, "bare", bare),
        (1, "other-method", naive.clone()),
        (2, "integers", half),
        (2, "lying-shape", lying),
        (2, "stranger", stranger),
        (2, "not-finite", not_finite),
        (0, "cut", ewc[..ewc.len() - 1].to_vec()),
        (2, "longer", [&naive[..], &[0]].concat()),
        (2, "huge-header", [&u64::MAX.to_le_bytes(), &naive[8..]].concat()),
        (2, "twice", [&37_u64.to_le_bytes()[..], br#"{"__metadata__":{"a":"1","a":"2"}}   "#].concat()),
        (2, "deep", [&64_u64.to_le_bytes()[..], &[b'['; 64]].concat()),
    ]
}
