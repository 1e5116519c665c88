//! Recorded events: accepted by the default checks, and the same bytes from every format.
//!
//! They are not part of the project: `HEADWAY_RECORDED_DATA` names the folder that holds them.

#![expect(clippy::print_stderr, reason = "tells what was refused, and what was not there to look at")]

use std::fs::File;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;

use headway::car_following::{CheckSettings, Conversion, Event, ExtractionSettings, Target};
use headway::formats::{BodyKind, Encoding, Format, FormatLimits, Preset, RawEvent, decode};

const TARGET: Target = Target { dt_s: 0.1, min_steps: 12, max_steps: 6000 };

fn recorded(name: &str) -> Option<File> {
    let folder =
        std::env::var_os("HEADWAY_RECORDED_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let file = File::open(folder.join(name)).ok();
    if file.is_none() {
        eprintln!("skipped: {} is not there; set HEADWAY_RECORDED_DATA", folder.join(name).display());
    }
    file
}

fn raw_events(file: File, format: Format) -> Vec<RawEvent> {
    raw_events_with(file, format, Preset::Follownet)
}

fn raw_events_with(file: File, format: Format, preset: Preset) -> Vec<RawEvent> {
    let kind = BodyKind { format, encoding: Encoding::Identity, preset };
    let mut events = Vec::new();
    decode(file, kind, &FormatLimits::default(), &ExtractionSettings::default(), &mut |decoded| {
        events.push(decoded.expect("a recorded event can be read"));
        ControlFlow::Continue(())
    })
    .expect("a recorded file can be read");
    events
}

fn checked(event: &RawEvent) -> Result<Event, String> {
    let checked = CheckSettings::default().check(&event.recording, &Conversion::default(), &TARGET);
    checked.map_err(|defects| {
        let defects: Vec<_> = defects.into_iter().map(|d| format!("{}: {}", d.code, d.detail)).collect();
        format!("{}: {}", event.event_id, defects.join("; "))
    })
}

#[test]
fn the_default_checks_accept_nearly_every_recorded_event() {
    let (mut accepted_of_all, mut all) = (0, 0);
    for name in ["waymo.parquet", "ngsim_i80.parquet", "openacc_zalazone.parquet", "napoli.parquet"] {
        let Some(file) = recorded(name) else { return };
        let events = raw_events(file, Format::Parquet);
        let refused: Vec<_> = events.iter().filter_map(|event| checked(event).err()).collect();
        let accepted = events.len() - refused.len();
        eprintln!(
            "{name}: {accepted} of {} accepted, {:.2} %",
            events.len(),
            100.0 * accepted as f64 / events.len() as f64
        );
        for reason in refused {
            eprintln!("  {reason}");
        }
        accepted_of_all += accepted;
        all += events.len();
    }
    eprintln!("together: {accepted_of_all} of {all}, {:.2} %", 100.0 * f64::from(accepted_of_all as u32) / all as f64);
    assert!(accepted_of_all as f64 >= 0.99 * all as f64);
}

/// `{"events": […]}`, or one event a line.
fn written(events: &[RawEvent], format: Format) -> File {
    let event = |event: &RawEvent| {
        let recording = &event.recording;
        serde_json::json!({
            "event_id": event.event_id,
            "dt_s": 0.1,
            "spacing_m": recording.spacing_m,
            "follower_speed_mps": recording.follower_speed_mps,
            "rel_speed_mps": recording.rel_speed_mps,
            "leader_speed_mps": recording.leader_speed_mps,
        })
    };
    let mut file = tempfile::tempfile().expect("a file can be made");
    let body = match format {
        Format::Ndjson => events.iter().map(|it| event(it).to_string() + "\n").collect::<String>(),
        _ => serde_json::json!({"events": events.iter().map(event).collect::<Vec<_>>()}).to_string(),
    };
    file.write_all(body.as_bytes()).expect("it can be written");
    file
}

#[test]
fn recorded_events_are_the_same_bytes_in_every_format() {
    let (Some(npy), Some(parquet)) = (recorded("waymo_follownet.npy"), recorded("waymo.parquet")) else { return };
    let Some(csv) = recorded("waymo_60_events.csv") else { return };
    let parquet = raw_events(parquet, Format::Parquet);
    let ways = [
        ("npy", raw_events(npy, Format::Npy), 449),
        ("csv", raw_events(csv, Format::Csv), 60),
        ("json", raw_events_with(written(&parquet, Format::Json), Format::Json, Preset::Headway), 449),
        ("ndjson", raw_events_with(written(&parquet, Format::Ndjson), Format::Ndjson, Preset::Headway), 449),
    ];
    // The step of an array is the upload's.
    let conversion = Conversion { dt_s: Some(0.1), ..Conversion::default() };
    let check = |event: &RawEvent| CheckSettings::default().check(&event.recording, &conversion, &TARGET);
    for (name, events, count) in ways {
        assert_eq!(events.len(), count, "{name}");
        let mut accepted = 0;
        for (index, (left, right)) in events.iter().zip(&parquet).enumerate() {
            assert_eq!(left.index, index as u64);
            match (check(left), checked(right)) {
                (Ok(left), Ok(right)) => {
                    assert_eq!(left.to_bytes(), right.to_bytes(), "{name}, event {index}");
                    assert_eq!(left.content_sha256(), right.content_sha256(), "{name}, event {index}");
                    accepted += 1;
                }
                (left, right) => assert_eq!(left.is_ok(), right.is_ok(), "{name}, event {index}"),
            }
        }
        eprintln!("{name}: {accepted} of {count} accepted events have the bytes that they have in Parquet");
    }
}

#[test]
fn a_recorded_csv_holds_the_events_of_the_recorded_parquet() {
    let (Some(csv), Some(parquet)) = (recorded("waymo_60_events.csv"), recorded("waymo.parquet")) else { return };
    let (csv, parquet) = (raw_events(csv, Format::Csv), raw_events(parquet, Format::Parquet));
    assert_eq!(csv.len(), 60);
    for (left, right) in csv.iter().zip(&parquet) {
        assert_eq!((&left.event_id, &left.source, &left.run), (&right.event_id, &right.source, &right.run));
        let (left, right) = (checked(left).unwrap(), checked(right).unwrap());
        assert_eq!(left.to_bytes(), right.to_bytes());
        assert_eq!(left.content_sha256(), right.content_sha256());
    }
}
