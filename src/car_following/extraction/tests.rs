use proptest::prelude::*;

use super::*;

/// One event needs ten steps of 0.1 s and has at most twenty.
fn settings() -> ExtractionSettings {
    ExtractionSettings { min_duration_s: 1.0, max_duration_s: 2.0, ..ExtractionSettings::default() }
}

fn behind(leader: u32, spacing_m: f64) -> Ahead<u32> {
    Ahead::Leader { leader, spacing_m, speed_mps: 9.0 }
}

/// First times and lengths of the events of one vehicle with a row every 0.1 s, and the counts.
fn extracted(rows: impl IntoIterator<Item = (i64, Ahead<u32>)>) -> (Vec<(u32, i64, usize)>, Extraction) {
    let (mut extractor, mut follower) = (Extractor::new(&settings(), 6000), Follower::default());
    let (mut found, mut before) = (Vec::new(), None);
    for (row, (step, ahead)) in (1..).zip(rows) {
        let follows = before.is_some_and(|before| step == before + 1);
        before = Some(step);
        let sighting = Sighting { row, time_ms: 100 * step, follows, speed_mps: 8.0, ahead };
        found.extend(extractor.see(&mut follower, sighting));
    }
    found.extend(extractor.end(&mut follower));
    let told = |segment: Segment<u32>| {
        let (leader, first_ms) = (segment.leader, segment.first_ms);
        let recording = segment.into_recording();
        assert_eq!(recording.dt_s, Some(0.1));
        (leader, first_ms / 100, recording.spacing_m.len())
    };
    (found.into_iter().map(told).collect(), extractor.counts)
}

/// Reasons with their counts, as text.
fn told(counts: &std::collections::BTreeMap<&'static str, u64>) -> String {
    counts.iter().map(|(reason, count)| format!("{reason} {count}")).collect::<Vec<_>>().join(", ")
}

#[test]
fn the_same_leader_for_long_enough_is_an_event() {
    let (events, counts) = extracted((0..10).map(|step| (step, behind(7, 20.0))));
    assert_eq!(events, [(7, 0, 10)]);
    assert_eq!((counts.rows, counts.segments, counts.events), (10, 1, 1));
    assert_eq!(told(&counts.cut), "row_missing 1");
    let (events, counts) = extracted((0..9).map(|step| (step, behind(7, 20.0))));
    assert!(events.is_empty());
    assert_eq!((told(&counts.dropped), told(&counts.dropped_steps)), ("too_short 1".into(), "too_short 9".into()));
}

#[test]
fn another_leader_begins_another_event() {
    let (events, counts) = extracted((0..25).map(|step| (step, behind(if step < 12 { 7 } else { 8 }, 20.0))));
    assert_eq!(events, [(7, 0, 12), (8, 12, 13)]);
    assert_eq!(told(&counts.cut), "leader_changed 1, row_missing 1");
}

#[test]
fn a_gap_in_time_ends_an_event() {
    let (events, counts) = extracted((0..25).filter(|step| *step != 12).map(|step| (step, behind(7, 20.0))));
    assert_eq!(events, [(7, 0, 12), (7, 13, 12)]);
    assert_eq!(told(&counts.cut), "row_missing 2");
}

#[test]
fn a_step_that_can_be_in_no_event_is_counted_by_its_reason() {
    let ahead = |step| match step {
        12 => Ahead::Nobody,
        13 | 14 => Ahead::Unknown,
        15 | 17 => behind(7, 0.4),
        16 => behind(7, 120.1),
        _ => behind(7, 120.0),
    };
    let (events, counts) = extracted((0..28).map(|step| (step, ahead(step))));
    assert_eq!(events, [(7, 0, 12), (7, 18, 10)]);
    assert_eq!(told(&counts.cut), "no_leader 1, row_missing 1");
    assert_eq!(told(&counts.dropped), "leader_missing 1, no_leader 1, too_close 2, too_far 1");
    assert_eq!(told(&counts.dropped_steps), "leader_missing 2, no_leader 1, too_close 2, too_far 1");
}

#[test]
fn what_is_too_long_is_cut_and_goes_on() {
    let (events, counts) = extracted((0..55).map(|step| (step, behind(7, 20.0))));
    assert_eq!(events, [(7, 0, 20), (7, 20, 20), (7, 40, 15)]);
    assert_eq!(told(&counts.cut), "row_missing 1, too_long 2");
    let (events, counts) = extracted((0..45).map(|step| (step, behind(7, 20.0))));
    assert_eq!(events.len(), 2);
    assert_eq!(told(&counts.dropped_steps), "too_short 5");
}

#[test]
fn criteria_that_make_no_sense_are_named() {
    assert!(ExtractionSettings::default().checked().is_ok());
    let name = |settings: ExtractionSettings| settings.checked().unwrap_err().name;
    assert_eq!(name(ExtractionSettings { min_duration_s: 61.0, ..ExtractionSettings::default() }), "min_duration_s");
    assert_eq!(name(ExtractionSettings { max_spacing_m: f64::NAN, ..ExtractionSettings::default() }), "max_spacing_m");
    assert_eq!(name(ExtractionSettings { max_rows: 0, ..ExtractionSettings::default() }), "max_rows");
}

proptest! {
    #[test]
    fn every_row_is_in_an_event_or_dropped_for_a_reason(
        rows in proptest::collection::vec((1_i64..14, 0_u32..40), 1..200),
    ) {
        let mut at = 0;
        let (events, counts) = extracted(rows.iter().map(|&(gap, kind)| {
            // Mostly no gap, and mostly the same leader.
            at += if gap > 12 { 2 } else { 1 };
            let ahead = match kind {
                0 => Ahead::Nobody,
                1 => Ahead::Unknown,
                2 => behind(7, 0.1),
                3 => behind(8, 20.0),
                _ => behind(7, 20.0),
            };
            (at, ahead)
        }));
        let kept: usize = events.iter().map(|(_, _, steps)| steps).sum();
        let dropped: u64 = counts.dropped_steps.values().sum();
        prop_assert_eq!(rows.len() as u64, kept as u64 + dropped);
        prop_assert_eq!(counts.rows, rows.len() as u64);
        prop_assert_eq!(counts.cut.values().sum::<u64>(), counts.segments);
        prop_assert_eq!(counts.events, events.len() as u64);
        prop_assert!(events.iter().all(|(_, _, steps)| (10..=20).contains(steps)));
    }
}
