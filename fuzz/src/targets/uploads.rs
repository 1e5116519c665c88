use std::cell::RefCell;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::ops::ControlFlow;

use headway::car_following::{CheckSettings, Conversion, Event, Extraction, ExtractionSettings, Target};
use headway::formats::{BodyKind, Encoding, Format, FormatError, FormatLimits, Preset, RawEvent, decode};
use headway::lineage::Rejection;
use serde_json::{Value, json};

/// Small, so that a few kilobytes can reach each of them.
pub(super) const LIMITS: FormatLimits = FormatLimits {
    max_decompressed_bytes: 1 << 20,
    max_event_bytes: 32 << 10,
    max_page_bytes: 256 << 10,
    max_zstd_window_bytes: 1 << 20,
    max_steps: 200,
    max_events: 100,
    max_text_bytes: 64,
};

/// Small too: three steps of 0.1 s are an event.
const EXTRACTION: ExtractionSettings = ExtractionSettings {
    min_duration_s: 0.3,
    max_duration_s: 2.0,
    min_spacing_m: 0.5,
    max_spacing_m: 120.0,
    max_rows: 2000,
};

/// Most that reading text may hold: a few buffers, one event and those that were read.
const TEXT_BYTES: u64 = 2 << 20;
/// Most that reading Parquet may hold: a page of each column, its dictionary, and what the file says of itself.
const PARQUET_BYTES: u64 = 32 << 20;

type Decoded = Vec<Result<RawEvent, Rejection>>;

pub(super) fn json(data: &[u8]) {
    one_way(data, Format::Json);
}

pub(super) fn ndjson(data: &[u8]) {
    one_way(data, Format::Ndjson);
}

pub(super) fn csv(data: &[u8]) {
    one_way(data, Format::Csv);
}

pub(super) fn parquet(data: &[u8]) {
    one_way(data, Format::Parquet);
}

pub(super) fn fcd(data: &[u8]) {
    one_way(data, Format::Xml);
}

pub(super) fn npy(data: &[u8]) {
    one_way(data, Format::Npy);
}

/// A body in one format and, where that can say the same, what it says in all the others.
fn one_way(data: &[u8], format: Format) {
    // Tabular bodies under every preset: the first byte of neither format is so small.
    let (preset, data) = match (data, format) {
        ([0, rest @ ..], Format::Csv | Format::Parquet) => (Preset::Follownet, rest),
        ([1, rest @ ..], Format::Csv | Format::Parquet) => (Preset::Ngsim, rest),
        ([2, rest @ ..], Format::Csv) => (Preset::Fcd, rest),
        _ => (Preset::Headway, data),
    };
    let Ok(decoded) = read(data, BodyKind { format, encoding: Encoding::Identity, preset }) else { return };
    let events: Vec<&RawEvent> = decoded.iter().flatten().collect();
    for event in &events {
        checked(event);
    }
    if !events.is_empty() && events.iter().all(|event| is_json(event)) {
        for other in [Format::Json, Format::Ndjson] {
            same(&events, &json_body(&events, other), other);
        }
    }
    if !events.is_empty() && is_table(&events) {
        same(&events, &csv_body(&events), Format::Csv);
    }
}

/// Decodes within the limits, and looks that nothing else came out than what may.
pub(super) fn read(body: &[u8], kind: BodyKind) -> Result<Decoded, FormatError> {
    let file = file(body);
    let mut decoded = Vec::new();
    let most = if kind.format == Format::Parquet { PARQUET_BYTES } else { TEXT_BYTES };
    let end = super::within(most, || {
        decode(file, kind, &LIMITS, &EXTRACTION, &mut |event| {
            decoded.push(event);
            ControlFlow::Continue(())
        })
    });
    if let Err(error) = &end {
        assert!(!matches!(error, FormatError::Io(_) | FormatError::Stopped), "{error}");
        assert!(error.to_string().len() < 4096, "{error}");
    }
    assert!(decoded.len() <= LIMITS.max_events as usize);
    for (index, event) in (0..).zip(&decoded) {
        match event {
            Ok(event) => {
                assert_eq!(event.index, index);
                within_limits(event);
            }
            Err(rejection) => {
                assert_eq!(rejection.index, index);
                assert!(!rejection.code.is_empty() && rejection.detail.len() < 4096, "{rejection:?}");
            }
        }
    }
    let counts = end?;
    assert_eq!(counts.is_some(), kind.preset.is_of_road(kind.format));
    if let Some(counts) = counts {
        extracted(&decoded, &counts);
    }
    Ok(decoded)
}

/// Every row is accounted for, and every event keeps the criteria.
fn extracted(decoded: &Decoded, counts: &Extraction) {
    assert_eq!(counts.events, decoded.len() as u64);
    assert_eq!(counts.cut.values().sum::<u64>(), counts.segments);
    let dropped: u64 = counts.dropped_steps.values().sum();
    let whole = decoded.iter().all(Result::is_ok);
    let steps: usize = decoded.iter().flatten().map(|event| event.recording.spacing_m.len()).sum();
    assert!(!whole || counts.rows == dropped + steps as u64, "{counts:?}, {steps} steps");
    for event in decoded.iter().flatten() {
        let recording = &event.recording;
        let within = EXTRACTION.min_spacing_m..=EXTRACTION.max_spacing_m;
        assert!(recording.spacing_m.iter().all(|spacing| within.contains(spacing)), "{event:?}");
        let dt_s = recording.dt_s.expect("an event has a step");
        let duration_s = recording.spacing_m.len() as f64 * dt_s;
        assert!(duration_s > EXTRACTION.min_duration_s - 1e-9, "{event:?}");
        assert!(duration_s < EXTRACTION.max_duration_s.max(2.0 * dt_s) + 1e-9, "{event:?}");
    }
}

thread_local! {
    static FILE: RefCell<Option<File>> = const { RefCell::new(None) };
}

/// A file that holds `body`: the same one again, since making one takes longer than reading it.
fn file(body: &[u8]) -> File {
    FILE.with_borrow_mut(|kept| {
        let file = kept.get_or_insert_with(|| tempfile::tempfile().expect("a file can be made"));
        file.set_len(0).and_then(|()| file.seek(SeekFrom::Start(0))).expect("it can be emptied");
        file.write_all(body).expect("it can be written");
        file.try_clone().expect("it can be opened twice")
    })
}

fn within_limits(event: &RawEvent) {
    let texts = [Some(&event.event_id), event.source.as_ref(), event.run.as_ref()];
    for text in texts.into_iter().flatten() {
        assert!((1..=LIMITS.max_text_bytes as usize).contains(&text.len()), "{text:?}");
    }
    let recording = &event.recording;
    let arrays = [&recording.spacing_m, &recording.follower_speed_mps, &recording.leader_speed_mps];
    for array in arrays.into_iter().chain(&recording.rel_speed_mps).chain(&recording.t_s) {
        assert!(array.len() <= LIMITS.max_steps as usize, "{} steps", array.len());
    }
}

/// What the physics checks let through is an event that can be stored and learned.
fn checked(event: &RawEvent) {
    let settings = CheckSettings::default();
    let target = Target { dt_s: 0.1, min_steps: 3, max_steps: LIMITS.max_steps as usize };
    match settings.check(&event.recording, &Conversion::default(), &target) {
        Ok(checked) => {
            assert!((settings.min_dt_s..=settings.max_dt_s).contains(&checked.dt_s()));
            assert!(checked.spacing_m().iter().all(|&x| x > 0.0 && f64::from(x) <= settings.max_spacing_m + 1e-3));
            let mut speeds = checked.follower_speed_mps().iter().chain(checked.leader_speed_mps());
            assert!(speeds.all(|&v| v >= 0.0 && f64::from(v) <= settings.max_speed_mps + 1e-3));
            assert_eq!(Event::from_bytes(checked.dt_s(), &checked.to_bytes()).as_ref(), Some(&checked));
        }
        Err(defects) => {
            assert!(!defects.is_empty());
            let rejection = event.reject(defects);
            assert_eq!(rejection.index, event.index);
        }
    }
}

/// Whether JSON can say the event: it has no times and no numbers that are none.
fn is_json(event: &RawEvent) -> bool {
    let recording = &event.recording;
    let arrays = [&recording.spacing_m, &recording.follower_speed_mps, &recording.leader_speed_mps];
    let mut numbers = arrays.into_iter().chain(&recording.rel_speed_mps).flatten().chain(&recording.dt_s);
    recording.t_s.is_none() && numbers.all(|number| number.is_finite())
}

fn json_body(events: &[&RawEvent], format: Format) -> Vec<u8> {
    let events: Vec<Value> = events
        .iter()
        .map(|event| {
            let recording = &event.recording;
            json!({
                "event_id": event.event_id,
                "source": event.source,
                "run": event.run,
                "split": event.split,
                "dt_s": recording.dt_s,
                "spacing_m": recording.spacing_m,
                "follower_speed_mps": recording.follower_speed_mps,
                "leader_speed_mps": recording.leader_speed_mps,
                "rel_speed_mps": recording.rel_speed_mps,
            })
        })
        .collect();
    match format {
        Format::Ndjson => events.iter().map(|event| format!("{event}\n")).collect::<Vec<_>>().concat().into_bytes(),
        _ => json!({"events": events}).to_string().into_bytes(),
    }
}

/// Whether rows can say the events: each has steps, all of them the same columns, no two the same id, no text ends in blanks.
fn is_table(events: &[&RawEvent]) -> bool {
    let mut ids: Vec<_> = events.iter().map(|event| &event.event_id).collect();
    ids.sort_unstable();
    ids.dedup();
    let plain = |event: &&&RawEvent| {
        let recording = &event.recording;
        let steps = recording.spacing_m.len();
        let lengths = [&recording.follower_speed_mps, &recording.leader_speed_mps];
        let mut lengths = lengths.into_iter().chain(&recording.rel_speed_mps).chain(&recording.t_s).map(Vec::len);
        let mut texts = [Some(&event.event_id), event.source.as_ref(), event.run.as_ref()].into_iter().flatten();
        steps > 0 && lengths.all(|length| length == steps) && texts.all(|text| text.trim() == text)
    };
    let optional = |event: &RawEvent| (event.recording.rel_speed_mps.is_some(), event.recording.t_s.is_some());
    ids.len() == events.len()
        && events.iter().filter(plain).count() == events.len()
        && events.iter().all(|event| optional(event) == optional(events[0]))
}

fn csv_body(events: &[&RawEvent]) -> Vec<u8> {
    let recording = |event: &'_ RawEvent| event.recording.clone();
    let (rel, times) = (recording(events[0]).rel_speed_mps.is_some(), recording(events[0]).t_s.is_some());
    let mut body = "event_id,source,run,split,dt_s,spacing_m,follower_speed_mps,leader_speed_mps".to_owned();
    body.push_str(if rel { ",rel_speed_mps" } else { "" });
    body.push_str(if times { ",t\n" } else { "\n" });
    for event in events {
        let recording = &event.recording;
        let split = event.split.map(|split| split.as_str().to_owned());
        let texts = [Some(event.event_id.clone()), event.source.clone(), event.run.clone(), split];
        let texts = texts.map(|text| format!("\"{}\"", text.unwrap_or_default().replace('"', "\"\""))).join(",");
        let dt_s = recording.dt_s.map(|dt_s| format!("{dt_s:?}")).unwrap_or_default();
        for step in 0..recording.spacing_m.len() {
            write!(body, "{texts},{dt_s}").expect("memory");
            let arrays = [&recording.spacing_m, &recording.follower_speed_mps, &recording.leader_speed_mps];
            for array in arrays.into_iter().chain(&recording.rel_speed_mps).chain(&recording.t_s) {
                write!(body, ",{:?}", array[step]).expect("memory");
            }
            body.push('\n');
        }
    }
    body.into_bytes()
}

/// The body in another format says the same events.
fn same(events: &[&RawEvent], body: &[u8], format: Format) {
    // Written out again they may be longer than an event or a body may be.
    if body.len() > LIMITS.max_event_bytes as usize {
        return;
    }
    let again = read(body, BodyKind { format, encoding: Encoding::Identity, preset: Preset::Headway });
    let again = again.unwrap_or_else(|error| panic!("as {format:?}: {error}\n{}", String::from_utf8_lossy(body)));
    assert_eq!(again.len(), events.len());
    for (event, again) in events.iter().zip(again) {
        let again = again.unwrap_or_else(|rejection| panic!("as {format:?}: {rejection:?}"));
        // Debug tells numbers that are none apart from others, and is the same for the same bits but those of such numbers.
        let told =
            |event: &RawEvent| format!("{:?} {:?}", (&event.event_id, &event.source, &event.run), event.recording);
        assert_eq!(told(event), told(&again), "as {format:?}");
        assert_eq!(event.split, again.split);
    }
}
