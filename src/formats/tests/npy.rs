use std::fs;
use std::path::{Path, PathBuf};

use super::encode::{gzip, zstd};
use super::*;
use crate::car_following::Recording;
use crate::lineage::Place;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// Files whose name begins so, in order.
fn files(folder: &Path, beginning: &str) -> Vec<(String, Vec<u8>)> {
    let named = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = paths.map(|path| (named(&path), fs::read(&path).unwrap())).collect();
    files.retain(|(name, _)| name.starts_with(beginning));
    files.sort();
    files
}

fn npy(body: &[u8]) -> Result<DecodedBody, FormatError> {
    decoded(body, Format::Npy)
}

/// An array of objects with the numbers of `events`, pickled by protocol 4; nothing else of them can be said.
pub(crate) fn array(events: &[RawEvent]) -> Vec<u8> {
    let header = format!("{{'descr': '|O', 'fortran_order': False, 'shape': ({}, 4), }}", events.len());
    let mut body = b"\x93NUMPY\x01\0\x76\0".to_vec();
    body.extend(format!("{header:<117}\n").bytes());
    body.extend(b"\x80\x04\x8c\x16numpy._core.multiarray\x94\x8c\x0c_reconstruct\x94\x93\x94");
    body.extend(b"\x8c\x05numpy\x94\x8c\x07ndarray\x94\x93\x94K\0\x85\x94C\x01b\x94\x87\x94R\x94(K\x01J");
    body.extend((events.len() as u32).to_le_bytes());
    body.extend(
        b"K\x04\x86\x94h\x03\x8c\x05dtype\x94\x93\x94\x8c\x02O8\x94\x89\x88\x87\x94R\x94(K\x03\x8c\x01|\x94NNN",
    );
    body.extend(b"J\xff\xff\xff\xffJ\xff\xff\xff\xffK?t\x94b\x89]\x94(");
    for event in events {
        let Recording { spacing_m, follower_speed_mps, leader_speed_mps, rel_speed_mps, .. } = &event.recording;
        let rel_speed_mps = rel_speed_mps.as_ref().expect("arrays have a column for it");
        for column in [spacing_m, follower_speed_mps, rel_speed_mps, leader_speed_mps] {
            body.extend(b"]\x94(");
            for number in column {
                body.push(b'G');
                body.extend(number.to_be_bytes());
            }
            body.push(b'e');
        }
    }
    body.extend(b"et\x94b.");
    body
}

/// The events of `tests/golden/npy.py`.
fn golden(steps: impl Fn(u8) -> u8) -> Vec<Recording> {
    let recording = |event: u8| {
        let (steps, event_f) = (steps(event), f64::from(event));
        Recording {
            dt_s: None,
            t_s: None,
            spacing_m: (0..steps).map(|step| 20.0 + event_f + f64::from(step) / 8.0).collect(),
            follower_speed_mps: vec![10.0 + event_f / 4.0; steps.into()],
            leader_speed_mps: vec![11.25 + event_f / 4.0; steps.into()],
            rel_speed_mps: Some(vec![1.25; steps.into()]),
        }
    };
    (0..3).map(recording).collect()
}

#[test]
fn whatever_numpy_makes_of_the_same_events_says_the_same() {
    let files = files(&folder("tests/golden/npy"), "");
    assert_eq!(files.len(), 40);
    for (name, body) in files {
        for (encoding, body) in
            [(Encoding::Identity, body.clone()), (Encoding::Gzip, gzip(&body)), (Encoding::Zstd, zstd(&body))]
        {
            let kind = BodyKind { format: Format::Npy, encoding, preset: Preset::Follownet };
            let (events, rejections) =
                decode_file(file(&body), kind, &FormatLimits::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert!(rejections.is_empty(), "{name}: {rejections:?}");
            let ids: Vec<_> = events.iter().map(|event| (event.index, event.event_id.as_str())).collect();
            assert_eq!(ids, [(0, "0"), (1, "1"), (2, "2")], "{name}");
            let recordings: Vec<_> = events.into_iter().map(|event| event.recording).collect();
            let expected = match &name[..5] {
                "numbe" => golden(|_| 12),
                "whole" => golden(|_| 12).into_iter().map(rounded).collect(),
                _ => golden(|event| 12 + event),
            };
            assert_eq!(recordings, expected, "{name}");
        }
    }
}

fn rounded(mut recording: Recording) -> Recording {
    let arrays = [&mut recording.spacing_m, &mut recording.follower_speed_mps, &mut recording.leader_speed_mps];
    for array in arrays.into_iter().chain(&mut recording.rel_speed_mps) {
        for number in array.iter_mut() {
            *number = number.round_ties_even();
        }
    }
    recording
}

#[test]
fn a_pickle_that_would_run_something_is_refused() {
    let gadgets = files(&folder("fuzz/corpus/npy"), "seed-gadget-");
    assert!(gadgets.len() > 60, "{}", gadgets.len());
    for (name, body) in gadgets {
        let error = npy(&body).unwrap_err();
        assert_eq!(error.code(), "forbidden_pickle", "{name}: {error}");
        assert_eq!(error.place(), Some(&Place::Pointer(String::new())));
        assert!(error.to_string().contains("nothing is run"), "{name}: {error}");
    }
    assert!(!Path::new("headway-ran-this").exists());
}

#[test]
fn a_pickle_that_would_take_all_the_memory_takes_little() {
    let bombs = files(&folder("fuzz/corpus/npy"), "seed-bomb-");
    assert!(bombs.len() > 40, "{}", bombs.len());
    for (name, body) in bombs {
        let (length, mut said) = (body.len() as u64, None);
        let held = allocation_counter::measure(|| said = Some(npy(&body))).bytes_max;
        assert!(held < (2 << 20) + 64 * length, "{name}: {held} bytes");
        let error = said.unwrap().unwrap_err();
        let code = error.code();
        let known = ["forbidden_pickle", "malformed_body", "truncated_body", "event_too_large"];
        assert!(known.contains(&code), "{name}: {code}, {error}");
    }
}

#[test]
fn an_array_that_is_cut_anywhere_is_truncated() {
    for name in ["lists-4-numpy2.npy", "arrays-5-numpy1.npy", "scalars-2-numpy1.npy", "numbers-little-f8.npy"] {
        let body = fs::read(folder("tests/golden/npy").join(name)).unwrap();
        for length in 0..body.len() {
            let error = npy(&body[..length]).unwrap_err();
            assert_eq!(error.code(), "truncated_body", "{name}, {length}: {error}");
        }
    }
}

#[test]
fn a_header_that_lies_is_found_out() {
    let lies = files(&folder("fuzz/corpus/npy"), "seed-lie-");
    assert!(lies.len() > 30, "{}", lies.len());
    let told: Vec<_> = lies
        .iter()
        .map(|(name, body)| {
            let error = npy(body).unwrap_err();
            (name.trim_start_matches("seed-lie-"), error.code(), error.to_string())
        })
        .collect();
    let of = |name: &str| {
        let (_, code, detail) = told.iter().find(|(known, ..)| *known == name).unwrap_or_else(|| panic!("{name}"));
        (*code, detail.as_str())
    };
    for (name, code, part) in [
        ("version-9", "malformed_body", "version 9"),
        ("header-length", "malformed_body", "65535 bytes"),
        ("header-cut", "truncated_body", ""),
        ("fortran", "wrong_order", "ascontiguousarray"),
        ("negative", "malformed_body", "-1"),
        ("huge", "malformed_body", ""),
        ("call", "malformed_body", "__import__"),
        ("too-many", "too_many_events", ""),
        ("larger", "truncated_body", ""),
        ("smaller", "malformed_body", "bytes come after"),
        ("type", "wrong_type", "<c16"),
        ("structure", "wrong_type", "structures"),
        ("columns", "wrong_shape", "[4, 1, 4]"),
        ("objects-3", "wrong_shape", "[1, 4, 4]"),
        ("objects-2", "forbidden_pickle", "another array"),
        ("behind", "malformed_body", "bytes come after"),
    ] {
        let (told, detail) = of(name);
        assert_eq!(told, code, "{name}: {detail}");
        assert!(detail.contains(part), "{name}: {detail}");
    }
}

#[test]
fn one_bad_event_among_good_ones_is_refused_alone() {
    let body = fs::read(folder("fuzz/corpus/npy/seed-too-long-an-event")).unwrap();
    let limits = FormatLimits { max_steps: 200, ..FormatLimits::default() };
    let (events, rejections) = decode_file(file(&body), kind(Format::Npy, Preset::Headway), &limits).unwrap();
    assert_eq!(events.iter().map(|event| event.event_id.as_str()).collect::<Vec<_>>(), ["1"]);
    assert_eq!(reasons(&rejections), [("/0".to_owned(), "too_many_steps")]);
    for (limits, code) in [
        (FormatLimits { max_event_bytes: 1, max_steps: 1, ..limits.clone() }, "event_too_large"),
        (FormatLimits { max_page_bytes: 1600, ..limits.clone() }, "event_too_large"),
        (FormatLimits { max_events: 1, ..limits.clone() }, "too_many_events"),
        (FormatLimits { max_decompressed_bytes: 1000, ..limits.clone() }, "body_too_large"),
    ] {
        let error = decode_file(file(&body), kind(Format::Npy, Preset::Headway), &limits).unwrap_err();
        assert_eq!(error.code(), code, "{error}");
    }
    let error = decode_file(file(&body), kind(Format::Npy, Preset::Ngsim), &limits).unwrap_err();
    assert_eq!(error.code(), "preset_not_applicable");
}
