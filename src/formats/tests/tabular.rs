use super::*;

const HEADER: &str = "event_id,t,spacing_m,follower_speed_mps,leader_speed_mps";

fn csv(body: &str) -> Result<DecodedBody, FormatError> {
    decoded(body, Format::Csv)
}

#[test]
fn rows_become_events() {
    let (events, rejections) = csv(&format!("{HEADER}\na,0,20,5,6\na,0.1,20.1,5,6\nb, 0 ,30,5,6\n")).unwrap();
    assert!(rejections.is_empty());
    assert_eq!(events.len(), 2);
    assert_eq!(events[0].recording.t_s.as_deref(), Some(&[0.0, 0.1][..]));
    assert_eq!(events[0].recording.spacing_m, [20.0, 20.1]);
    assert_eq!((events[1].event_id.as_str(), events[1].origin), ("b", Origin::Row(3)));
}

#[test]
fn columns_are_found_by_name_in_any_order_and_preset() {
    let follownet = "lv_speed,pair,rel_speed,event_id,follower,sv_speed,run,spacing,source,t\n6,p,1,a,human,5,r,20,s,0";
    let (events, _) =
        decode_file(file(follownet.as_bytes()), kind(Format::Csv, Preset::Follownet), &FormatLimits::default())
            .unwrap();
    let recording = &events[0].recording;
    assert_eq!((recording.spacing_m[0], recording.leader_speed_mps[0]), (20.0, 6.0));
    assert_eq!(recording.rel_speed_mps.as_deref(), Some(&[1.0][..]));
    assert_eq!((events[0].source.as_deref(), events[0].run.as_deref()), (Some("s"), Some("r")));
}

#[test]
fn unknown_missing_and_doubled_columns_are_named() {
    let error = |header: &str| {
        let error = csv(&format!("{header}\n")).unwrap_err();
        (error.code(), error.to_string())
    };
    let (code, detail) = error(&format!("{HEADER},lane,foo"));
    assert_eq!(code, "unknown_column");
    assert!(detail.contains("\"lane\", \"foo\""), "{detail}");
    let (code, detail) = error("event_id,t,spacing_m,follower_speed_mps");
    assert_eq!(code, "missing_column");
    assert!(detail.contains("leader_speed_mps"), "{detail}");
    assert_eq!(error(&format!("{HEADER},t")).0, "duplicate_column");
    assert_eq!(csv(&format!("{HEADER}\n")).unwrap(), (vec![], vec![]));
    assert_eq!(csv("").unwrap_err().code(), "truncated_body");
}

#[test]
fn a_bad_row_refuses_its_event_by_row() {
    let bad = |row: &str, at: &str, code: &str| {
        let body = format!("{HEADER}\na,0,20,5,6\na,0.1,20,5,6\nb,0,20,5,6\n{row}\nc,0,20,5,6\n");
        let (events, rejections) = csv(&body).unwrap();
        assert_eq!(events.iter().map(|e| e.event_id.as_str()).collect::<Vec<_>>(), ["a", "c"], "{row}");
        assert_eq!(reasons(&rejections), [(at.to_owned(), code)], "{row}");
        assert_eq!(rejections[0].event_id.as_deref(), Some("b"));
    };
    bad("b,0.1,x,5,6", "4", "wrong_type");
    bad("b,0.1,,5,6", "4", "missing_value");
    bad("b,0.1,20,5", "4", "missing_value");
    bad("b,0.1,20,5,6,7", "4", "wrong_cell_count");
}

#[test]
fn rows_of_an_event_say_the_same() {
    let body = format!("{HEADER},split,dt_s\na,0,20,5,6,test,0.1\na,1,20,5,6,train,0.2\n");
    let (_, rejections) = csv(&body).unwrap();
    assert_eq!(reasons(&rejections), [("2".to_owned(), "inconsistent_rows")]);
    assert!(rejections[0].detail.contains("split at step 1 is \"train\""), "{}", rejections[0].detail);
    assert!(rejections[0].detail.contains("dt_s at step 1"), "{}", rejections[0].detail);
}

#[test]
fn rows_without_an_id_are_refused_together() {
    let (events, rejections) = csv(&format!("{HEADER}\n,0,20,5,6\n,1,20,5,6\na,0,20,5,6\n")).unwrap();
    assert_eq!(events.len(), 1);
    assert_eq!(reasons(&rejections), [("1".to_owned(), "missing_field")]);
}

#[test]
fn rows_that_are_not_together_spoil_the_body() {
    let error = csv(&format!("{HEADER}\na,0,20,5,6\nb,0,20,5,6\na,0.1,20,5,6\n")).unwrap_err();
    assert_eq!((error.code(), error.place().unwrap().to_string()), ("rows_apart", "3".to_owned()));
}

#[test]
fn a_csv_body_that_ends_within_a_row_is_truncated() {
    assert_eq!(csv(&format!("{HEADER}\na,0,20,5,6\na,0.1,20")).unwrap_err().code(), "truncated_body");
    assert_eq!(csv(&format!("{HEADER}\na,0,20,5,6\n\"a,0.1,20")).unwrap_err().code(), "truncated_body");
    assert!(csv(&format!("{HEADER}\na,0,20,5,6")).is_ok());
    let not_utf8 = [HEADER.as_bytes(), b"\na\xff,0,20,5,6\n"].concat();
    assert_eq!(decoded(not_utf8, Format::Csv).unwrap_err().code(), "malformed_body");
}

#[test]
fn a_parquet_body_that_was_cut_is_truncated() {
    let (events, _) = csv(&format!("{HEADER}\na,0,20,5,6\na,0.1,20.1,5,6\nb,0,30,5,6\n")).unwrap();
    let body = encode::encode(&events, Format::Parquet);
    assert_eq!(decoded(&body, Format::Parquet).unwrap().0.len(), 2);
    for cut in [0, 3, 100, body.len() - 1] {
        assert_eq!(decoded(&body[..cut], Format::Parquet).unwrap_err().code(), "truncated_body", "{cut}");
    }
    assert_eq!(decoded("event_id,spacing_m\n", Format::Parquet).unwrap_err().code(), "malformed_body");
    let limits = FormatLimits { max_decompressed_bytes: 100, ..FormatLimits::default() };
    let error = decode_file(file(&body), kind(Format::Parquet, Preset::Headway), &limits).unwrap_err();
    assert_eq!(error.code(), "body_too_large");
    let error =
        decode_file(file(&body), kind(Format::Parquet, Preset::Follownet), &FormatLimits::default()).unwrap_err();
    assert_eq!(error.code(), "unknown_column");
}
