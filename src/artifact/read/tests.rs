use std::collections::BTreeMap;

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use super::file::MAX_HEADER_BYTES;
use super::*;
use crate::artifact::{Record, RememberedRegime, header, weights_data};
use crate::lstm::initial_weights;

fn settings() -> ModelSettings {
    ModelSettings { hidden: 3, horizon: 4, ..ModelSettings::default() }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn scaling() -> Value {
    json!({"mean": [8.0, 8.5, 0.25, 14.0], "spread": [3.0, 3.5, 1.25, 5.0], "low": [0, 0, -5, 0], "high": [30, 30, 5, 90],
        "motion": {"mean": [0, 0, 0], "spread": [1, 1, 1]}})
}

/// A version of two regimes as a server writes it, with its weights and what is kept of both regimes.
fn ours() -> (Vec<u8>, Brought) {
    let layout = settings().shape().layout();
    let weights = initial_weights(layout, 1);
    let memory = |stage: u32, regime: &str| RegimeMemory {
        regime: regime.to_owned(),
        importance: initial_weights(layout, 7).iter().map(|x| x.abs()).collect(),
        anchor: if stage == 2 { weights.clone() } else { initial_weights(layout, 9) },
        samples: 100 * u64::from(stage),
        stage,
    };
    let memories = [memory(1, "fast"), memory(2, "slow")];
    let kept: Vec<_> = memories.iter().map(|m| [floats(&m.importance), floats(&m.anchor)].concat()).collect();
    let name = |name: &str| RegimeName::parse(name).unwrap();
    let regimes = memories.iter().zip(&kept).map(|(m, kept)| RememberedRegime {
        regime: name(&m.regime),
        stage: m.stage,
        samples: Some(m.samples),
        anchor_sha256: Some(hex::encode(Sha256::digest(kept))),
    });
    let record = Record {
        model: ModelName::parse("site").unwrap(),
        version: 7,
        method: Method::Ewc,
        stage: 2,
        regime: name("slow"),
        regimes: regimes.collect(),
        settings: settings(),
        strength: Some(0.1),
        lambda: Some(1e6 / 3.0),
        kernel: "lines-16".to_owned(),
        train_events: 12,
        events_sha256: hex::encode([5; 32]),
        scaling: scaling(),
        weights_sha256: hex::encode(Sha256::digest(floats(&weights))),
        tainted: false,
    };
    let head = header(&record, layout);
    let file = [head.bytes, weights_data(layout, &weights), kept.concat()].concat();
    assert_eq!(head.file_bytes, file.len() as u64);
    let brought = Brought {
        origin: Some(Origin { model: record.model, version: 7, tainted: false }),
        stage: 2,
        regime: record.regime,
        regimes: memories
            .into_iter()
            .map(|m| BroughtRegime { regime: name(&m.regime), stage: m.stage, memory: Some(m) })
            .collect(),
        settings: settings(),
        strength: Some(0.1),
        lambda: Some(1e6 / 3.0),
        kernel: record.kernel,
        train_events: 12,
        events_sha256: [5; 32],
        scaling: serde_json::from_value(scaling()).unwrap(),
        weights,
    };
    (file, brought)
}

/// The header of a file and what is behind it, put together again after a change of the header.
fn with_header(file: &[u8], change: impl FnOnce(&mut Map<String, Value>)) -> Vec<u8> {
    let (length, rest) = file.split_first_chunk::<8>().unwrap();
    let (text, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let mut members: Map<String, Value> = serde_json::from_slice(text).unwrap();
    change(&mut members);
    behind(&Value::Object(members).to_string(), data)
}

/// A file of this header and these bytes behind it.
fn behind(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

fn with_key(file: &[u8], key: &str, value: &str) -> Vec<u8> {
    with_header(file, |members| members["__metadata__"][key] = json!(value))
}

fn taken(file: &[u8]) -> Result<Brought, ArtifactError> {
    read(file, Method::Ewc, &settings())
}

/// The pointer and code of the first thing that is wrong with the contents.
fn defect(file: &[u8]) -> (String, &'static str) {
    match taken(file).unwrap_err() {
        ArtifactError::Unusable(defects) => (defects[0].pointer.clone(), defects[0].code),
        malformed @ ArtifactError::Malformed(_) => panic!("{malformed}"),
    }
}

fn malformed(file: &[u8]) -> String {
    match taken(file).unwrap_err() {
        ArtifactError::Malformed(detail) => detail,
        unusable @ ArtifactError::Unusable(_) => panic!("{unusable}"),
    }
}

#[test]
fn what_a_server_wrote_is_read_back_to_the_bit() {
    let (file, brought) = ours();
    assert_eq!(taken(&file).unwrap(), brought);
}

#[test]
fn a_bias_of_minus_zero_keeps_its_sign() {
    let layout = settings().shape().layout();
    let mut weights = initial_weights(layout, 1);
    weights[layout.bias().start] = -0.0;
    let file = theirs(&weights, &[("scaling", &scaling().to_string()), ("accel_limit_mps2", "4")]);
    let read = taken(&file).unwrap().weights;
    assert_eq!(floats(&read), floats(&weights));
}

/// A network alone, as torch would save it.
fn theirs(weights: &[f32], keys: &[(&str, &str)]) -> Vec<u8> {
    let (file, _) = ours();
    let keys: BTreeMap<_, _> = keys.iter().copied().collect();
    let file = with_header(&file, |members| {
        members.retain(|name, _| !name.starts_with("regimes."));
        members["__metadata__"] = json!(keys);
    });
    let length = 8 + u64::from_le_bytes(*file.first_chunk::<8>().unwrap()) as usize;
    [&file[..length], &weights_data(settings().shape().layout(), weights)].concat()
}

#[test]
fn a_network_of_torch_is_a_first_stage_of_which_nothing_is_kept() {
    let weights = initial_weights(settings().shape().layout(), 4);
    let plain = json!({"mean": [8.0, 8.5, 0.25, 14.0], "spread": [3.0, 3.5, 1.25, 5.0],
        "motion": {"mean": [0, 0, 0], "spread": [1, 1, 1]}});
    let keys = [("scaling", &*plain.to_string()), ("accel_limit_mps2", "4.0"), ("regime", "city")];
    let brought = taken(&theirs(&weights, &keys)).unwrap();
    assert_eq!((brought.stage, brought.regime.as_str(), &brought.origin), (1, "city", &None));
    assert_eq!(brought.regimes[0].memory, None);
    assert_eq!((brought.weights, brought.settings), (weights.clone(), settings()));
    assert_eq!((brought.scaling.low[3], brought.scaling.high[0]), (-6.0, 20.0), "four spreads around the mean");
    let wrong = |keys: &[(&str, &str)]| defect(&theirs(&weights, keys));
    assert_eq!(wrong(&keys[1..]), ("/__metadata__/scaling".to_owned(), "missing"));
    assert_eq!(wrong(&keys[..1]), ("/__metadata__/accel_limit_mps2".to_owned(), "missing"));
    let other = [keys[0], ("accel_limit_mps2", "3"), ("horizon", "9")];
    assert_eq!(wrong(&other), ("/__metadata__/accel_limit_mps2".to_owned(), "other_shape"));
    let flat = json!({"mean": [8.0, 8.5, 0.25, 14.0], "spread": [3.0, 0.0, 1.25, 5.0]}).to_string();
    assert_eq!(wrong(&[("scaling", &flat), keys[1]]), ("/__metadata__/scaling".to_owned(), "invalid_value"));
}

#[test]
fn a_second_bias_is_added_to_the_first() {
    let layout = settings().shape().layout();
    let weights = initial_weights(layout, 4);
    let keys = [("scaling", &*scaling().to_string()), ("accel_limit_mps2", "4")];
    let mut file = theirs(&weights, &keys);
    let second = file.len() - 4 * (layout.len() - layout.bias().end + layout.gates());
    file[second..second + 4].copy_from_slice(&0.5_f32.to_le_bytes());
    let brought = taken(&file).unwrap();
    assert_eq!(brought.weights[layout.bias().start], weights[layout.bias().start] + 0.5);
}

#[test]
fn what_does_not_fit_the_model_is_named() {
    let (file, _) = ours();
    assert_eq!(
        read(&file, Method::Mas, &settings()).unwrap_err().to_string(),
        "method: the file's is ewc, the model's mas; a model has one"
    );
    let other = ModelSettings { hidden: 4, accel_limit_mps2: 3.0, ..settings() };
    let ArtifactError::Unusable(defects) = read(&file, Method::Ewc, &other).unwrap_err() else { panic!() };
    let pointers: Vec<_> = defects.iter().map(|defect| defect.pointer.as_str()).collect();
    assert_eq!(pointers, ["/__metadata__/settings/hidden", "/__metadata__/settings/accel_limit_mps2"]);
}

#[test]
fn metadata_that_lies_is_refused_by_key() {
    let (file, _) = ours();
    for (key, value, code) in [
        ("headway_format", "2", "unknown_format"),
        ("method", "none", "invalid_value"),
        ("stage", "0", "invalid_value"),
        ("stage", "-1", "invalid_value"),
        ("version", "many", "invalid_value"),
        ("regime", "a b", "invalid_value"),
        ("regime", "fast", "invalid_value"),
        ("regimes", "[]", "invalid_value"),
        ("settings", "{\"hiden\": 3}", "invalid_setting"),
        ("settings", "[", "invalid_value"),
        ("strength", "-1", "invalid_value"),
        ("lambda", "inf", "invalid_value"),
        ("kernel", "", "invalid_value"),
        ("train_events", "18446744073709551615", "invalid_value"),
        ("events_sha256", "00", "invalid_value"),
        ("weights_sha256", &hex::encode([0; 32]), "digest"),
        ("scaling", "{}", "invalid_value"),
        ("tainted", "perhaps", "invalid_value"),
    ] {
        let (pointer, found) = defect(&with_key(&file, key, value));
        assert_eq!(found, code, "{key} = {value}");
        // What a version's own regime is, is told of the list.
        assert!(pointer.starts_with("/__metadata__/"), "{pointer}");
    }
    let missing = with_header(&file, |members| {
        members["__metadata__"].as_object_mut().unwrap().remove("kernel");
    });
    assert_eq!(defect(&missing), ("/__metadata__/kernel".to_owned(), "missing"));
}

#[test]
fn tensors_that_are_missing_others_or_not_numbers_are_refused_by_name() {
    let (file, _) = ours();
    let renamed = |from: &str, to: &str| {
        with_header(&file, |members| {
            let moved = members.remove(from).unwrap();
            members.insert(to.to_owned(), moved);
        })
    };
    assert_eq!(defect(&renamed("head.bias", "head.b/a~s")), ("/head.b~1a~0s".to_owned(), "unknown_tensor"));
    let gone = with_header(&file, |members| {
        // Its bytes are another's, which is otherwise as it should be.
        let bias = members.remove("lstm.bias_hh_l0").unwrap();
        members.insert("lstm.bias_ih_l1".to_owned(), bias);
    });
    assert_eq!(defect(&gone).1, "unknown_tensor");
    let reshaped = with_header(&file, |members| members["lstm.weight_ih_l0"]["shape"] = json!([7, 12]));
    assert_eq!(defect(&reshaped), ("/lstm.weight_ih_l0".to_owned(), "wrong_shape"));
    let integers = with_header(&file, |members| members["head.weight"]["dtype"] = json!("I32"));
    assert_eq!(defect(&integers), ("/head.weight".to_owned(), "wrong_type"));
    let length = 8 + u64::from_le_bytes(*file.first_chunk::<8>().unwrap()) as usize;
    for bad in [f32::NAN, f32::INFINITY] {
        let mut file = file.clone();
        file[length..length + 4].copy_from_slice(&bad.to_le_bytes());
        assert_eq!(defect(&file), ("/lstm.weight_ih_l0".to_owned(), "not_finite"));
    }
    let mut flipped = file.clone();
    *flipped.last_mut().unwrap() ^= 1;
    assert_eq!(defect(&flipped), ("/__metadata__/regimes/1/anchor_sha256".to_owned(), "digest"));
}

#[test]
fn files_that_are_none_are_told_so() {
    let (file, _) = ours();
    let of_length = |length: u64| [&length.to_le_bytes(), &file[8..]].concat();
    assert!(malformed(&file[..5]).contains("shorter than 8 bytes"));
    assert!(malformed(&of_length(u64::MAX)).contains("more than 4194304"));
    assert!(malformed(&of_length(MAX_HEADER_BYTES)).contains("within its header"));
    assert!(malformed(&file[..file.len() - 1]).contains("not fully covered"));
    assert!(malformed(&[&file[..], b"x"].concat()).contains("not fully covered"));
    assert!(malformed(&behind("no JSON", b"")).contains("its header"));
    assert!(malformed(&behind("[]", b"")).contains("an object"));
    assert!(malformed(&behind(&"[".repeat(5000), b"")).contains("its header"));
    let deep = format!("{{\"a\":{}{}}}", "[".repeat(5000), "]".repeat(5000));
    assert!(malformed(&behind(&deep, b"")).contains("recursion"));
    assert!(malformed(&behind("{\"__metadata__\":{\"a\":1}}", b"")).contains("a string"));
    let twice = "{\"a\":{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]},\"a\":{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]}}";
    assert!(malformed(&behind(twice, b"")).contains("a is there twice"));
    assert!(malformed(&behind("{\"__metadata__\":{\"a\":\"1\",\"a\":\"2\"}}", b"")).contains("a is there twice"));
    let overlapping = with_header(&file, |members| members["head.bias"]["data_offsets"] = json!([0, 4]));
    assert!(malformed(&overlapping).contains("offset"));
    let lying = with_header(&file, |members| members["head.bias"]["shape"] = json!([u64::MAX, 2]));
    assert!(malformed(&lying).contains("overflow"));
    let entries: Vec<_> = (0..1_000_000).map(|i| format!("\"t{i}\":0")).collect();
    assert!(malformed(&behind(&format!("{{{}}}", entries.join(",")), b"")).contains("more than 4194304"));
}

#[test]
fn a_network_of_another_precision_or_without_one_of_its_tensors_is_told_so() {
    let weights = initial_weights(settings().shape().layout(), 4);
    let file = theirs(&weights, &[("scaling", &*scaling().to_string()), ("accel_limit_mps2", "4")]);
    for (kind, bytes) in [("BF16", 2), ("F16", 2), ("F64", 8)] {
        let other = with_header(&file, |members| {
            for entry in members.iter_mut().filter(|(name, _)| *name != "__metadata__").map(|(_, entry)| entry) {
                let at = |place: usize| entry["data_offsets"][place].as_u64().unwrap() / 4 * bytes;
                let offsets = json!([at(0), at(1)]);
                entry["data_offsets"] = offsets;
                entry["dtype"] = json!(kind);
            }
        });
        let head = 8 + u64::from_le_bytes(*other.first_chunk::<8>().unwrap()) as usize;
        let numbers = (weights.len() + settings().shape().layout().gates()) * bytes as usize;
        let ArtifactError::Unusable(defects) = taken(&[&other[..head], &vec![0; numbers]].concat()).unwrap_err() else {
            panic!("{kind}")
        };
        assert_eq!(defects[0].code, "wrong_type");
        assert!(defects[0].detail.contains(kind) && defects[0].detail.contains("F32"), "{}", defects[0].detail);
    }
    // The last of the tensors, so that nothing is left uncovered.
    let cut = with_header(&file, |members| drop(members.remove("head.bias")));
    assert_eq!(defect(&cut[..cut.len() - 4]), ("/head.bias".to_owned(), "missing"));
}

#[test]
fn no_importance_is_negative() {
    let (mut file, _) = ours();
    let weights = settings().shape().layout();
    let first = file.len() - 4 * 4 * weights.len();
    file[first..first + 4].copy_from_slice(&(-1.0_f32).to_le_bytes());
    assert_eq!(defect(&file).1, "negative");
}
