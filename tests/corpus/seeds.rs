//! The seeds of the corpus: one or more of every kind that a decoder tells apart. What libFuzzer made of them lies beside.

mod artifact;
mod inference;
mod text;
mod npy;
mod parquet;
mod road;

use std::io::Write;
use std::path::Path;
use std::{env, fs};

use headway::lineage::ModelSettings;
use serde_json::json;

/// `fuzz/corpus/TARGET/seed-NAME`; with `HEADWAY_FUZZ_SEEDS=write` they are written first.
#[test]
fn the_seeds_of_the_corpus_are_those_that_are_written_here() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let writing = env::var("HEADWAY_FUZZ_SEEDS").is_ok_and(|wish| wish == "write");
    for (target, name, bytes) in all() {
        let file = corpus.join(target).join(format!("seed-{name}"));
        if writing {
            fs::create_dir_all(corpus.join(target)).unwrap();
            fs::write(&file, &bytes).unwrap();
        }
        assert!(
            fs::read(&file).is_ok_and(|kept| kept == bytes),
            "{} is another: HEADWAY_FUZZ_SEEDS=write writes it",
            file.display()
        );
    }
}

type Seed = (&'static str, String, Vec<u8>);

fn all() -> Vec<Seed> {
    let mut seeds = Vec::new();
    let mut add = |target, name: &str, bytes: Vec<u8>| seeds.push((target, name.to_owned(), bytes));
    for (name, body) in text::documents() {
        add("json", name, body.into_bytes());
    }
    for (name, body) in text::lines() {
        add("ndjson", name, body.into_bytes());
    }
    for (name, body) in text::tables() {
        add("csv", name, body.into_bytes());
    }
    for (name, body) in road::tables() {
        add("csv", name, body.into_bytes());
    }
    for (name, body) in road::documents() {
        add("fcd", name, body.into_bytes());
    }
    for (name, body) in npy::good() {
        add("npy", &name, body);
    }
    for (name, body) in npy::lies() {
        add("npy", &format!("lie-{name}"), body);
    }
    for (name, body) in npy::gadgets() {
        add("npy", &format!("gadget-{name}"), body);
    }
    for (name, body) in npy::bombs() {
        add("npy", &format!("bomb-{name}"), body);
    }
    for (name, body) in parquet::files() {
        add("parquet", &name, body);
    }
    for (name, body) in text::predictions() {
        add("predict", name, body.into_bytes());
    }
    for (name, body) in inference::bodies() {
        add("infer", name, body);
    }
    for (choice, name, text) in text::bodies() {
        add("bodies", name, behind(choice, text.as_bytes()));
    }
    for (choice, name, text) in text::requests() {
        add("requests", name, behind(choice, text.as_bytes()));
    }
    for (choice, name, text) in text::settings() {
        add("config", name, behind(choice, text.as_bytes()));
    }
    let (lines, table) = (text::event("e", 3).to_string(), parquet::plain());
    for (format, name, body) in [(0, "lines", lines.as_bytes()), (2, "parquet", &table)] {
        for (encoding, kind, compressed) in [(0, "gzip", gzip(body)), (1, "zstd", zstd::encode_all(body, 1).unwrap())] {
            add("encodings", &format!("{kind}-{name}"), behind(format | encoding, &compressed));
            let twice = [compressed.clone(), compressed].concat();
            add("encodings", &format!("{kind}-{name}-twice"), behind(format | encoding, &twice));
            add("encodings", &format!("{kind}-{name}-whole"), behind(format | encoding | 4, body));
        }
    }
    let bomb = vec![b'1'; 4 << 20];
    add("encodings", "gzip-bomb", behind(0, &gzip(&bomb)));
    add("encodings", "zstd-bomb", behind(1, &zstd::encode_all(&bomb[..], 19).unwrap()));
    for (choice, name, bytes) in artifact::files() {
        add("artifact", name, behind(choice, &bytes));
    }
    for (choice, name, bytes) in stored() {
        add("stored", name, behind(choice, &bytes));
    }
    seeds
}

fn behind(choice: u8, bytes: &[u8]) -> Vec<u8> {
    [&[choice], bytes].concat()
}

fn gzip(body: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(body).unwrap();
    encoder.finish().unwrap()
}

/// What the database holds, as `fuzz/src/targets/stored.rs` counts its kinds.
fn stored() -> Vec<(u8, &'static str, Vec<u8>)> {
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let event = [&0.1_f64.to_le_bytes()[..], &floats(&[20.0, 20.1, 5.0, 5.1, 6.0, 6.1])].concat();
    let rows = json!([{"measured": [{"spacing_sq": 1.5, "speed_sq": 0.25, "collisions": 1, "events": 2, "steps": 30}]},
        {"diverged": {"update": 7, "detail": "as told"}}]);
    let rows = rows.to_string().into_bytes();
    let search = [b"HWSRCH01", &[7; 32][..], &(rows.len() as u64).to_le_bytes(), &rows, b"stage"].concat();
    let scaling = json!({"mean": [8.0, 8.5, 0.3, 14.0], "spread": [3.0, 3.5, 1.2, 5.0], "low": [0.0, 0.0, -5.0, 1.0],
        "high": [30.0, 30.0, 5.0, 90.0], "motion": {"mean": [0.0, 0.1, 0.2], "spread": [1.0, 1.0, 0.5]}});
    let search_record = json!({"strength": 1.0, "regimes": ["fast"], "none": null, "tried": []});
    let promotion = json!({"decision": "promoted", "policy": "gate", "reason": "better", "regimes": []});
    let report = json!({"before": 2, "after": 3, "stages": [{"version": 2, "regime": "fast", "replayed_as": 3}],
        "regimes": [{"regime": "fast", "before": null, "after": null}],
        "live": {"from": 2, "to": 3, "tainted": false, "decision": "promoted", "reason": "so"}});
    let settings = serde_json::to_vec(&ModelSettings::default()).unwrap();
    vec![
        (0, "event", event),
        (1, "weights", floats(&[0.5, -0.25, f32::NAN, f32::INFINITY])),
        (2, "checkpoint", checkpoint(0, 0)),
        (2, "checkpoint-evaluated", checkpoint(2, 0)),
        (2, "checkpoint-path", checkpoint(2, 3)),
        (3, "search", search),
        (4, "settings", settings.clone()),
        (5, "scaling", scaling.to_string().into_bytes()),
        (6, "strength-search", search_record.to_string().into_bytes()),
        (7, "promotion", promotion.to_string().into_bytes()),
        (8, "report", report.to_string().into_bytes()),
        (9, "task-error", json!({"code": "diverged", "detail": "so"}).to_string().into_bytes()),
        (10, "scopes", json!(["predict", "train"]).to_string().into_bytes()),
        (11, "models", json!(["a", "site-12"]).to_string().into_bytes()),
        (12, "options", json!({"preset": "follownet", "dt_s": 0.1, "spacing": "front"}).to_string().into_bytes()),
        (13, "overrides", settings),
        (13, "overrides-few", json!({"preset": "paper", "hidden": 8, "strength": "auto"}).to_string().into_bytes()),
    ]
}

/// A checkpoint of three weights, evaluated in this epoch, with so many sums of a path.
fn checkpoint(epoch: u32, path: u64) -> Vec<u8> {
    let mut bytes = b"HWCKPT03".to_vec();
    bytes.extend([7; 32]);
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend(9_u64.to_le_bytes());
    bytes.extend([0.1_f64, 2.5].map(f64::to_le_bytes).concat());
    bytes.extend(11_u64.to_le_bytes());
    bytes.extend(epoch.to_le_bytes());
    bytes.extend([1.5_f64, 0.1].map(f64::to_le_bytes).concat());
    bytes.extend([3_u32, 4].map(u32::to_le_bytes).concat());
    bytes.extend([5_u64, 3, path].map(u64::to_le_bytes).concat());
    let floats = 9 + usize::try_from(path).unwrap();
    bytes.extend((0..floats).flat_map(|i| (i as f32).to_le_bytes()));
    bytes
}
