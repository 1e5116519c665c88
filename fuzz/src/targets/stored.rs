use std::fmt::Debug;

use headway::access::Scopes;
use headway::car_following::Event;
use headway::driver::Scaling;
use headway::ingest::UploadOptions;
use headway::lineage::{ModelName, ModelSettings, Promotion, ReplayReport, StrengthSearch, TaskError};
use headway::scheduler::SearchState;
use headway::store::array::{floats, integers, stored_floats, stored_integers};
use headway::training::Checkpoint;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

const KINDS: [fn(&[u8]); 13] = [
    event,
    array,
    checkpoint,
    search,
    json::<ModelSettings>,
    json::<Scaling>,
    json::<StrengthSearch>,
    json::<Promotion>,
    json::<ReplayReport>,
    json::<TaskError>,
    json::<Scopes>,
    json::<Vec<ModelName>>,
    json::<UploadOptions>,
];

/// What was stored and what the disk made of it.
pub(super) fn run(data: &[u8]) {
    let Some((choice, bytes)) = super::chosen(data, KINDS.len() + 1) else { return };
    let most = 64 * bytes.len() as u64 + (64 << 10);
    super::within(most, || KINDS.get(choice).copied().unwrap_or(settings)(bytes));
}

fn event(bytes: &[u8]) {
    let Some((dt_s, arrays)) = bytes.split_first_chunk::<8>() else { return };
    let dt_s = f64::from_le_bytes(*dt_s);
    match Event::from_bytes(dt_s, arrays) {
        Some(event) => {
            assert_eq!(12 * event.steps(), arrays.len());
            assert_eq!(event.to_bytes(), arrays);
            assert_eq!(event.content_sha256(), Event::digest_of(dt_s, arrays));
        }
        None => assert_ne!(arrays.len() % 12, 0),
    }
}

fn array(bytes: &[u8]) {
    match floats("weights", bytes) {
        Ok(values) => assert_eq!(stored_floats(&values), bytes),
        Err(_) => assert_ne!(bytes.len() % 4, 0),
    }
    match integers("reservoir", bytes) {
        Ok(values) => assert_eq!(stored_integers(&values), bytes),
        Err(_) => assert_ne!(bytes.len() % 8, 0),
    }
}

/// With the fingerprint that the bytes carry: any other is refused before anything else is read.
fn checkpoint(bytes: &[u8]) {
    let Some(fingerprint) = bytes.get(8..40).and_then(|bytes| bytes.try_into().ok()) else { return };
    let Ok(read) = Checkpoint::from_bytes(bytes, &fingerprint) else { return };
    let stored = read.to_bytes();
    assert_eq!(stored.len(), bytes.len());
    // Of an evaluation in epoch 0, which stands for none, the rest is not kept.
    let again = Checkpoint::from_bytes(&stored, &fingerprint).expect("what was read can be read");
    assert_eq!(again.to_bytes(), stored);
    let mut other = fingerprint;
    other[0] ^= 1;
    assert!(Checkpoint::from_bytes(bytes, &other).is_err());
}

fn search(bytes: &[u8]) {
    let Some(fingerprint) = bytes.get(8..40).and_then(|bytes| bytes.try_into().ok()) else { return };
    let Ok(read) = SearchState::from_bytes(bytes, fingerprint) else { return };
    let stored = read.to_bytes(read.stage().unwrap_or_default());
    assert_eq!(SearchState::from_bytes(&stored, fingerprint).as_ref(), Ok(&read));
}

fn json<T: DeserializeOwned + Serialize + PartialEq + Debug>(text: &[u8]) {
    let Ok(read) = serde_json::from_slice::<T>(text) else { return };
    let stored = serde_json::to_string(&read).expect("it is plain data");
    // A number beyond 32 bits is none in 32, and JSON has no word for it.
    if format!("{read:?}").contains("inf") {
        return;
    }
    assert_eq!(serde_json::from_str::<T>(&stored).expect("what was read can be read"), read, "{stored}");
}

/// Settings over others: those that are taken are usable, and are what a version is stored with.
fn settings(text: &[u8]) {
    let Ok(overrides) = serde_json::from_slice::<Value>(text) else { return };
    match ModelSettings::default().overridden(&overrides) {
        Ok(settings) => {
            assert_eq!(settings.check(), Ok(()));
            let stored = serde_json::to_value(&settings).expect("settings are plain data");
            assert_eq!(serde_json::from_value::<ModelSettings>(stored.clone()).expect("it was stored"), settings);
            assert_eq!(ModelSettings::default().overridden(&stored), Ok(settings));
        }
        Err(error) => assert_eq!(error.code, "invalid_setting"),
    }
}
