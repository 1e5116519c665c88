use super::*;

const GOOD: &str = r#"{"event_id": "a", "dt_s": 0.1, "spacing_m": [20, 20.5], "follower_speed_mps": [5, 5.0],
    "leader_speed_mps": [6, 6e0], "source": "s", "run": null, "split": "test"}"#;

fn line(event: &str) -> String {
    event.replace('\n', " ")
}

#[test]
fn a_document_gives_its_events_in_order() {
    let (events, rejections) = decoded(format!(r#"{{"events": [{GOOD}, {GOOD}]}}"#), Format::Json).unwrap();
    assert!(rejections.is_empty());
    assert_eq!(events.iter().map(|e| e.index).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(events[1].recording.spacing_m, [20.0, 20.5]);
    assert_eq!((events[0].run.as_deref(), events[0].split), (None, Some(crate::lineage::Split::Test)));
    assert_eq!(events[1].origin, Origin::Element(1));
}

#[test]
fn a_bad_event_is_refused_by_pointer_and_the_next_one_read() {
    let bad = |event: &str, pointer: &str, code: &str| {
        let (events, rejections) = decoded(format!(r#"{{"events": [{event}, {GOOD}]}}"#), Format::Json).unwrap();
        assert_eq!(events.len(), 1, "{event}");
        assert_eq!(reasons(&rejections), [(pointer.to_owned(), code)], "{event}");
    };
    bad("[1, [2], {}]", "/events/0", "wrong_type");
    bad("null", "/events/0", "wrong_type");
    bad(&GOOD.replace("\"run\"", "\"lane/x\""), "/events/0/lane~1x", "unknown_field");
    bad(&GOOD.replace("\"run\"", "\"source\""), "/events/0/source", "duplicate_field");
    bad(&GOOD.replace("20.5", "null"), "/events/0/spacing_m/1", "wrong_type");
    bad(&GOOD.replace("20.5", "1e999"), "/events/0/spacing_m/1", "not_finite");
    bad(&GOOD.replace("0.1", "-1e999"), "/events/0/dt_s", "not_finite");
    bad(&GOOD.replace("\"s\"", "\"\\ud800\""), "/events/0", "malformed_event");
    bad(&GOOD.replace("20.5", "\"20.5\""), "/events/0/spacing_m/1", "wrong_type");
    bad(&GOOD.replace("20.5", "[20.5]"), "/events/0/spacing_m/1", "wrong_type");
    bad(&GOOD.replace("[20, 20.5]", "{\"a\": [1]}"), "/events/0/spacing_m", "wrong_type");
    bad(&GOOD.replace("[20, 20.5]", "null"), "/events/0", "missing_field");
    bad(&GOOD.replace("\"test\"", "\"all\""), "/events/0/split", "invalid_split");
    bad(&GOOD.replace("\"a\"", "true"), "/events/0/event_id", "wrong_type");
    bad(&GOOD.replace("\"event_id\": \"a\",", ""), "/events/0", "missing_field");
    bad(&GOOD.replace("\"a\"", "\"\""), "/events/0/event_id", "missing_field");
    bad(&GOOD.replace("0.1", "\"0.1\""), "/events/0/dt_s", "wrong_type");
    bad(&GOOD.replace("\"a\"", &format!("{:?}", "x".repeat(513))), "/events/0/event_id", "text_too_long");
}

#[test]
fn a_refusal_names_every_flaw() {
    let event = GOOD.replace("20.5", "null").replace("6e0", "true");
    let (_, rejections) = decoded(format!(r#"{{"events": [{event}]}}"#), Format::Json).unwrap();
    assert_eq!(rejections[0].event_id.as_deref(), Some("a"));
    assert_eq!(
        rejections[0].detail,
        "spacing_m at step 1 is null, not a number; also, leader_speed_mps at step 1 is a boolean, not a number"
    );
}

#[test]
fn a_document_that_is_none_is_an_error() {
    let code = |body: &str| decoded(body, Format::Json).unwrap_err().code();
    assert_eq!(code(""), "truncated_body");
    assert_eq!(code(r#"{"events": ["#), "truncated_body");
    assert_eq!(code(&format!(r#"{{"events": [{GOOD}"#)), "truncated_body");
    assert_eq!(code(&format!(r#"{{"events": [{GOOD}]"#)), "truncated_body");
    assert_eq!(code(r#"{"events": [}"#), "malformed_body");
    assert_eq!(code(r#"{"events": [NaN]}"#), "malformed_body");
    assert_eq!(code(r#"{"events": []} x"#), "malformed_body");
    assert_eq!(code("{}"), "missing_field");
    let wrong = |body: &str| {
        let error = decoded(body, Format::Json).unwrap_err();
        (error.code(), error.place().unwrap().to_string())
    };
    assert_eq!(wrong(r#"{"event": [1]}"#), ("unknown_field", "/event".to_owned()));
    assert_eq!(wrong(r#"{"events": 3}"#), ("wrong_type", "/events".to_owned()));
    assert_eq!(wrong("[]"), ("wrong_type", String::new()));
}

#[test]
fn a_body_may_hold_no_event() {
    assert_eq!(decoded(r#"{"events": []}"#, Format::Json).unwrap(), (vec![], vec![]));
    assert_eq!(decoded("\n\n", Format::Ndjson).unwrap(), (vec![], vec![]));
}

#[test]
fn a_malformed_line_is_refused_and_the_next_one_read() {
    let good = line(GOOD);
    let body = format!("{good}\n\n{{\"event_id\": \"b\", oops}}\n{good} {good}\n{{\"events\": [\n{good}");
    let (events, rejections) = decoded(body, Format::Ndjson).unwrap();
    assert_eq!(events.iter().map(|e| e.origin).collect::<Vec<_>>(), [Origin::Line(1), Origin::Line(6)]);
    let lines = ["3", "4", "5"].map(|line| (line.to_owned(), "malformed_line"));
    assert_eq!(reasons(&rejections), lines);
    assert_eq!(rejections[0].event_id.as_deref(), Some("b"));
    assert_eq!(rejections.iter().map(|r| r.index).collect::<Vec<_>>(), [1, 2, 3]);
}

#[test]
fn a_number_beyond_every_range_refuses_its_line() {
    let body = format!("{}\n{}\n", line(GOOD).replace("6e0", "6e400"), line(GOOD));
    let (events, rejections) = decoded(body, Format::Ndjson).unwrap();
    assert_eq!((events.len(), reasons(&rejections)), (1, vec![("1".to_owned(), "not_finite")]));
    assert_eq!(rejections[0].detail, "leader_speed_mps at step 1 is beyond the range of 64-bit numbers");
}

#[test]
fn an_ndjson_body_that_ends_within_an_event_is_truncated() {
    let good = line(GOOD);
    let body = format!("{good}\n{}", &good[..good.len() - 5]);
    assert_eq!(decoded(&body, Format::Ndjson).unwrap_err().code(), "truncated_body");
    assert_eq!(decoded(body + "\n", Format::Ndjson).unwrap().1.len(), 1);
}

#[test]
fn limits_hold() {
    let limited = |limits: FormatLimits, body: String, format| {
        decode_file(file(body.as_bytes()), kind(format, Preset::Headway), &limits)
    };
    let limits = FormatLimits { max_steps: 1, ..FormatLimits::default() };
    let (_, rejections) = limited(limits, line(GOOD), Format::Ndjson).unwrap();
    assert_eq!(reasons(&rejections), [("1".to_owned(), "too_many_steps")]);
    let limits = FormatLimits { max_events: 1, ..FormatLimits::default() };
    let two = format!(r#"{{"events": [{GOOD}, {GOOD}]}}"#);
    assert_eq!(limited(limits, two.clone(), Format::Json).unwrap_err().code(), "too_many_events");
    let limits = FormatLimits { max_decompressed_bytes: 300, ..FormatLimits::default() };
    assert_eq!(limited(limits, two, Format::Json).unwrap_err().code(), "body_too_large");
    let limits = FormatLimits { max_event_bytes: 1000, ..FormatLimits::default() };
    let long = line(GOOD).replace("\"a\"", &format!("{:?}", "x".repeat(200_000)));
    assert_eq!(limited(limits, long, Format::Ndjson).unwrap_err().code(), "event_too_large");
}

#[test]
fn a_zstd_frame_whose_window_is_larger_than_the_limit_is_refused() {
    // What is compressed as a stream does not say how long it is, and wants the window of its level, 512 KiB.
    let body = super::encode::zstd(format!("{}{}", "\n".repeat(2 << 20), line(GOOD)).as_bytes());
    let kind = BodyKind { encoding: Encoding::Zstd, ..kind(Format::Ndjson, Preset::Headway) };
    for (max_zstd_window_bytes, is_taken) in [(32 << 20, true), (512 << 10, true), ((512 << 10) - 1, false), (1, false)]
    {
        let limits = FormatLimits { max_zstd_window_bytes, ..FormatLimits::default() };
        let decoded = decode_file(file(&body), kind, &limits);
        assert_eq!(decoded.is_ok(), is_taken, "{max_zstd_window_bytes}: {decoded:?}");
        if let Err(error) = decoded {
            assert_eq!(error.code(), "malformed_body");
        }
    }
}

#[test]
fn presets_that_name_columns_are_for_tables() {
    let error = decode_file(file(b""), kind(Format::Json, Preset::Follownet), &FormatLimits::default()).unwrap_err();
    assert_eq!(error.code(), "preset_not_applicable");
    let error = decode_file(file(b""), kind(Format::Ndjson, Preset::Ngsim), &FormatLimits::default()).unwrap_err();
    assert_eq!(error.code(), "preset_not_applicable");
}
