//! Recordings of whole roads, against an independent extraction (`tests/golden/scenes.py`) and by hand.

use std::fmt::Write as _;
use std::io::Read;
use std::sync::Arc;

use ::parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use ::parquet::file::writer::SerializedFileWriter;
use ::parquet::schema::parser::parse_message_type;
use serde_json::Value;

use super::*;
use crate::car_following::{Extraction, ExtractionSettings};

type Scene = (Vec<RawEvent>, Extraction);

/// Everything in a recording.
fn road(body: &[u8], kind: BodyKind, extraction: &ExtractionSettings) -> Result<Scene, FormatError> {
    let mut events = Vec::new();
    let counts = decode(file(body), kind, &FormatLimits::default(), extraction, &mut |decoded| {
        events.push(decoded.unwrap());
        ControlFlow::Continue(())
    })?;
    Ok((events, counts.expect("a road has counts")))
}

fn golden(name: &str) -> Vec<u8> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/scenes").join(name);
    std::fs::read(path).unwrap()
}

fn unzipped(name: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(&golden(name)[..]).read_to_end(&mut bytes).unwrap();
    bytes
}

/// The same events, by their ids, with the same numbers to 1e-9, and the same counts.
fn assert_same_as_the_script(name: &str, (mut events, counts): Scene) {
    let expected: Value = serde_json::from_slice(&unzipped("events.json.gz")).unwrap();
    let expected = &expected[name];
    assert_eq!(serde_json::to_value(&counts.dropped_steps).unwrap(), expected["dropped_steps"], "{name}");
    for (count, key) in [(counts.rows, "rows"), (counts.vehicles, "vehicles"), (counts.pairs, "pairs")] {
        assert_eq!(count, expected[key].as_u64().unwrap(), "{name}: {key}");
    }
    let mut expected = expected["events"].as_array().unwrap().clone();
    expected.sort_by_key(|event| event["event_id"].as_str().unwrap().to_owned());
    events.sort_by_key(|event| event.event_id.clone());
    let ids: Vec<_> = events.iter().map(|event| event.event_id.as_str()).collect();
    let wanted: Vec<_> = expected.iter().map(|event| event["event_id"].as_str().unwrap()).collect();
    assert_eq!(ids, wanted, "{name}");
    for (event, wanted) in events.iter().zip(&expected) {
        assert_eq!(
            (event.run.as_deref(), event.source.as_deref()),
            (wanted["run"].as_str(), wanted["source"].as_str())
        );
        let recording = &event.recording;
        assert_eq!(recording.dt_s, wanted["dt_s"].as_f64());
        for (array, member) in [
            (&recording.spacing_m, "spacing_m"),
            (&recording.follower_speed_mps, "follower_speed_mps"),
            (&recording.leader_speed_mps, "leader_speed_mps"),
        ] {
            let wanted: Vec<f64> = wanted[member].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
            assert_eq!(array.len(), wanted.len(), "{} {member}", event.event_id);
            let close = array.iter().zip(&wanted).all(|(ours, theirs)| (ours - theirs).abs() <= 1e-9);
            assert!(close, "{} {member}", event.event_id);
        }
    }
}

fn gzipped(format: Format, preset: Preset) -> BodyKind {
    BodyKind { format, encoding: Encoding::Gzip, preset }
}

#[test]
fn events_out_of_ngsim_are_those_of_an_independent_script() {
    let settings = ExtractionSettings::default();
    let scene = road(&golden("ngsim.csv.gz"), gzipped(Format::Csv, Preset::Ngsim), &settings).unwrap();
    // What the made-up road has to show.
    for reason in ["no_leader", "leader_missing", "too_short", "repeated"] {
        assert!(scene.1.dropped_steps.contains_key(reason), "{:?}", scene.1);
    }
    for why in ["leader_changed", "row_missing", "leader_missing"] {
        assert!(scene.1.cut.contains_key(why), "{:?}", scene.1);
    }
    let (events, mut counts) = scene;
    // The script leaves rows that are repeated out before it counts.
    counts.rows -= counts.dropped_steps.remove("repeated").unwrap();
    assert_same_as_the_script("ngsim", (events, counts));
}

#[test]
fn events_out_of_what_sumo_writes_are_those_of_an_independent_script() {
    let settings = ExtractionSettings::default();
    let xml = road(&golden("fcd.xml.gz"), gzipped(Format::Xml, Preset::Headway), &settings).unwrap();
    assert!(xml.1.dropped_steps.contains_key("too_far"), "{:?}", xml.1);
    let csv = road(&golden("fcd.csv.gz"), gzipped(Format::Csv, Preset::Fcd), &settings).unwrap();
    let untold = |event: &RawEvent| RawEvent { origin: Origin::Among(0), ..event.clone() };
    assert!(xml.0.iter().map(untold).eq(csv.0.iter().map(untold)));
    assert_eq!(xml.1, csv.1);
    assert_same_as_the_script("fcd", xml);
}

#[test]
fn rows_of_ngsim_may_come_in_any_order() {
    let settings = ExtractionSettings::default();
    let text = String::from_utf8(unzipped("ngsim.csv.gz")).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let mut backwards: Vec<_> = rows.lines().collect();
    backwards.reverse();
    let backwards = format!("{header}\n{}\n", backwards.join("\n"));
    let read = |text: &str| road(text.as_bytes(), kind(Format::Csv, Preset::Ngsim), &settings).unwrap();
    // Roads are numbered as they come, and rows are others.
    let untold = |(events, counts): Scene| {
        let untold = |event: RawEvent| RawEvent { origin: Origin::Among(0), index: 0, ..event };
        let mut events: Vec<_> = events.into_iter().map(untold).collect();
        events.sort_by_key(|event| event.event_id.clone());
        (events, counts)
    };
    assert!(untold(read(&text)) == untold(read(&backwards)));
}

/// The same table as Parquet: whole numbers, numbers and texts as such, in groups that part vehicles.
fn as_parquet(csv: &str) -> Vec<u8> {
    let mut lines = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let rows: Vec<_> = lines.collect();
    let kind = |name: &str| match name {
        "Location" => "binary Location (utf8)".to_owned(),
        "v_Length" | "v_Vel" | "Space_Headway" => format!("double {name}"),
        _ => format!("int64 {name}"),
    };
    let kept: Vec<_> = (0..names.len()).filter(|&i| !names[i].contains("al_") || names[i] == "Global_Time").collect();
    let fields: String = kept.iter().map(|&i| format!("required {}; ", kind(names[i]))).collect::<Vec<_>>().concat();
    let schema = parse_message_type(&format!("message rows {{ {fields} }}")).unwrap();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::default()).unwrap();
    for rows in rows.chunks(700) {
        let mut group = writer.next_row_group().unwrap();
        for &i in &kept {
            let cells = rows.iter().map(|row| row[i]);
            let mut column = group.next_column().unwrap().unwrap();
            let numbers = cells.clone().map(|cell| cell.parse::<f64>().unwrap_or_default());
            if names[i] == "Location" {
                let texts: Vec<_> = cells.map(ByteArray::from).collect();
                column.typed::<ByteArrayType>().write_batch(&texts, None, None).unwrap();
            } else if kind(names[i]).starts_with("double") {
                column.typed::<DoubleType>().write_batch(&numbers.collect::<Vec<_>>(), None, None).unwrap();
            } else {
                let numbers: Vec<_> = numbers.map(|number| number as i64).collect();
                column.typed::<Int64Type>().write_batch(&numbers, None, None).unwrap();
            }
            column.close().unwrap();
        }
        group.close().unwrap();
    }
    writer.into_inner().unwrap()
}

#[test]
fn ngsim_is_read_from_parquet_too() {
    let settings = ExtractionSettings::default();
    let csv = String::from_utf8(unzipped("ngsim.csv.gz")).unwrap();
    let read = |body: &[u8], format| road(body, kind(format, Preset::Ngsim), &settings).unwrap();
    assert!(read(csv.as_bytes(), Format::Csv) == read(&as_parquet(&csv), Format::Parquet));
}

/// Three steps are enough.
fn short() -> ExtractionSettings {
    ExtractionSettings { min_duration_s: 0.3, ..ExtractionSettings::default() }
}

fn ngsim(text: &str) -> Result<Scene, FormatError> {
    road(text.as_bytes(), kind(Format::Csv, Preset::Ngsim), &short())
}

const NGSIM: &str = "vehicle_id,FRAME_ID,v_length,v_Vel,Preceding,Space_Hdwy";

/// Vehicle 2 behind vehicle 1, 20 feet long, at these frames.
fn two(frames: std::ops::Range<u32>, tail: &str) -> String {
    let mut text = String::new();
    for frame in frames.clone() {
        writeln!(text, "1,{frame},20,30,0,0{tail}").unwrap();
    }
    for frame in frames {
        writeln!(text, "2,{frame},15,31,1,70{tail}").unwrap();
    }
    text
}

#[test]
fn feet_become_metres_and_the_leaders_length_is_taken_off() {
    let (events, counts) = ngsim(&format!("{NGSIM}\n{}", two(10..14, ""))).unwrap();
    assert_eq!(events.len(), 1);
    let RawEvent { event_id, run, source, origin, recording, .. } = &events[0];
    assert_eq!((event_id.as_str(), run.as_deref(), source), ("2>1@10", Some("2"), &None));
    assert_eq!(*origin, Origin::Among(5));
    assert!((recording.spacing_m[0] - 50.0 * 0.3048).abs() < 1e-12);
    assert_eq!((recording.follower_speed_mps[0], recording.leader_speed_mps[3]), (31.0 * 0.3048, 30.0 * 0.3048));
    assert_eq!((counts.rows, counts.vehicles, counts.pairs, counts.dropped_steps["no_leader"]), (8, 2, 1, 4));
}

#[test]
fn vehicles_of_the_same_number_are_told_apart_by_place_and_period() {
    let header = format!("{NGSIM},Location,Global_Time");
    let mut later = String::new();
    for line in two(10..14, ",us-101").lines() {
        let frame: i64 = line.split(',').nth(1).unwrap().parse().unwrap();
        writeln!(later, "{line},{}", 9_000_000 + 100 * frame).unwrap();
    }
    let early = later.replace(",90", ",40");
    let other = later.replace("us-101", "i-80");
    let (events, counts) = ngsim(&format!("{header}\n{early}{later}{other}")).unwrap();
    let ids: Vec<_> = events.iter().map(|event| event.event_id.as_str()).collect();
    assert_eq!(ids, ["us-101/2>1@4001000", "us-101/2>1@9001000", "i-80/2>1@9001000"]);
    assert_eq!((counts.vehicles, events[2].source.as_deref()), (4, Some("i-80")));
    let error = ngsim(&format!("{NGSIM}\n{}{}", two(10..14, ""), two(10..14, "").replace(",31,", ",32,"))).unwrap_err();
    assert_eq!((error.code(), error.place().unwrap().to_string().as_str()), ("contradicting_rows", "13"));
    assert!(error.to_string().contains("Global_Time"), "{error}");
}

#[test]
fn a_reused_number_is_told_apart_by_the_gap_and_a_row_may_name_its_run() {
    let (events, counts) =
        ngsim(&format!("{NGSIM},run,split\n{}{}", two(10..14, ",a,test"), two(50..53, ",b,"))).unwrap();
    let told: Vec<_> = events.iter().map(|e| (e.event_id.as_str(), e.run.as_deref(), e.split)).collect();
    assert_eq!(told, [("2>1@10", Some("a"), Some(crate::lineage::Split::Test)), ("2>1@50", Some("b"), None)]);
    assert_eq!(counts.cut["row_missing"], 2);
}

#[test]
fn a_road_that_cannot_be_read_says_where_and_why() {
    let code = |text: String| ngsim(&text).unwrap_err();
    let error = code("Vehicle_ID,Frame_ID,v_Vel,Lane_ID\n".to_owned());
    assert_eq!(error.code(), "missing_column");
    assert!(error.to_string().contains("v_Length, Preceding, Space_Headway of preset ngsim are missing"), "{error}");
    assert_eq!(code(format!("{NGSIM},Space_Headway\n")).code(), "duplicate_column");
    for (row, wanted) in [
        ("1,1,20,fast,0,0", "wrong_type"),
        ("1,1,20,inf,0,0", "wrong_type"),
        ("1,1.5,20,3,0,0", "wrong_type"),
        ("-1,1,20,3,0,0", "wrong_type"),
        ("1,1,20,,0,0", "missing_value"),
        ("1,1,20,3,0,0,9", "wrong_cell_count"),
        ("1,1,20,3,0", "wrong_cell_count"),
    ] {
        let error = code(format!("{NGSIM}\n{row}\n{}", two(10..14, "")));
        let place = error.place().map(ToString::to_string);
        assert_eq!((error.code(), place.as_deref()), (wanted, Some("1")), "{row}: {error}");
    }
    assert_eq!(code(format!("{NGSIM}\n{}1,90,20", two(10..14, ""))).code(), "truncated_body");
    let not_utf8 = [NGSIM.as_bytes(), b"\n1,1,20,3\xff,0,0\n"].concat();
    let error = road(&not_utf8, kind(Format::Csv, Preset::Ngsim), &short()).unwrap_err();
    assert_eq!(error.code(), "malformed_body");
    let few = ExtractionSettings { max_rows: 20, ..short() };
    let error =
        road(format!("{NGSIM}\n{}", two(0..11, "")).as_bytes(), kind(Format::Csv, Preset::Ngsim), &few).unwrap_err();
    assert_eq!(error.code(), "too_many_rows");
}

fn fcd(timesteps: &str) -> Result<Scene, FormatError> {
    let body = format!("<?xml version=\"1.0\"?><fcd-export>{timesteps}</fcd-export>");
    road(body.as_bytes(), kind(Format::Xml, Preset::Fcd), &short())
}

/// A time at which `b` follows.
fn timestep(time: &str, leader: &str) -> String {
    let leads = r#"<vehicle id="a" speed="9" leaderID="" leaderSpeed="-1" leaderGap="-1"/>"#;
    format!(r#"<timestep time="{time}">{leads}<vehicle id="b&amp;" x="1" speed="8" {leader}/></timestep>"#)
}

const BEHIND: &str = r#"leaderID="a" leaderSpeed="9" leaderGap="20.5""#;

#[test]
fn who_changes_lanes_behind_another_leader_begins_anew() {
    let other = BEHIND.replace("\"a\"", "\"c\"");
    let steps = ["0.1", "0.2", "0.3"].map(|time| timestep(time, BEHIND)).concat();
    let more = ["0.4", "0.5", "0.6"].map(|time| timestep(time, &other)).concat();
    let (events, counts) = fcd(&(steps + &more)).unwrap();
    let told: Vec<_> = events.iter().map(|e| (e.event_id.as_str(), e.origin, e.recording.dt_s)).collect();
    assert_eq!(told, [("b&>a@0.1", Origin::Among(2), Some(0.1)), ("b&>c@0.4", Origin::Among(8), Some(0.1))]);
    assert_eq!((counts.rows, counts.pairs, counts.cut["leader_changed"]), (12, 2, 1));
}

#[test]
fn a_time_that_is_missing_or_a_vehicle_that_is_ends_an_event() {
    let times = ["0.1", "0.2", "0.3", "0.5", "0.6", "0.7"].map(|time| timestep(time, BEHIND)).concat();
    assert_eq!(fcd(&times).unwrap().0.len(), 2);
    let hidden = ["0.1", "0.2", "0.3"].map(|time| timestep(time, BEHIND)).concat() + r#"<timestep time="0.4"/>"#;
    let again = ["0.5", "0.6", "0.7"].map(|time| timestep(time, BEHIND)).concat();
    let (events, counts) = fcd(&(hidden + &again)).unwrap();
    assert_eq!((events.len(), counts.vehicles, counts.cut["row_missing"]), (2, 2, 2));
    let far = BEHIND.replace("20.5", "120.5");
    let (events, counts) = fcd(&["0.1", "0.2", "0.3"].map(|time| timestep(time, &far)).concat()).unwrap();
    assert_eq!((events.len(), counts.dropped_steps["too_far"]), (0, 3));
}

#[test]
fn floating_car_data_without_leaders_say_what_would_give_them() {
    let error = fcd(&timestep("0.1", "")).map_err(|error| (error.code(), error.to_string()));
    let alone = r#"<timestep time="0"><vehicle id="a" speed="1"/></timestep>"#;
    let (code, detail) = fcd(alone).map_err(|error| (error.code(), error.to_string())).unwrap_err();
    assert_eq!(code, "no_leaders");
    assert!(detail.contains("--fcd-output.max-leader-distance"), "{detail}");
    // Somebody says who leads, and that is enough.
    assert!(error.is_ok());
    let columns = road(b"timestep_time;vehicle_id;vehicle_speed\n", kind(Format::Csv, Preset::Fcd), &short());
    let error = columns.unwrap_err();
    assert_eq!(error.code(), "missing_column");
    assert!(error.to_string().contains("--fcd-output.attributes"), "{error}");
    assert_eq!(fcd("").unwrap().1, Extraction::default());
}

#[test]
fn xml_that_is_cut_is_truncated_wherever_it_is_cut() {
    let body = format!("<fcd-export>{}</fcd-export>", timestep("0.1", BEHIND));
    let read = |body: &str| road(body.as_bytes(), kind(Format::Xml, Preset::Headway), &short());
    assert!(read(&body).is_ok());
    for cut in (0..body.len()).filter(|&cut| body.is_char_boundary(cut)) {
        let error = read(&body[..cut]).unwrap_err();
        assert_eq!(error.code(), "truncated_body", "{}: {error}", &body[..cut]);
    }
}

#[test]
fn xml_expands_nothing_and_fetches_nothing() {
    let good = format!("<fcd-export>{}</fcd-export>", timestep("0.1", BEHIND));
    let laughs = r#"<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;"><!ENTITY c "&b;&b;&b;">]>"#;
    let external = r#"<!DOCTYPE l SYSTEM "http://example.org/fcd.dtd">"#;
    for (body, wanted) in [
        (format!("{laughs}{good}"), "document type"),
        (format!("{external}{good}"), "document type"),
        (good.replace("0.1", "&c;"), "c"),
        (good.replace("<timestep", "&c;<timestep"), "entity"),
        (good.replace("<timestep", "text<timestep"), "text"),
        (good.replace("<timestep", "<![CDATA[text]]><timestep"), "text"),
        (format!("<?xml version=\"1.0\" encoding=\"latin-1\"?>{good}"), "UTF-8"),
        (format!("{good}{good}"), "outermost"),
        (format!("<fcd-export>{}", "<a>".repeat(17)), "deep"),
        (
            format!(
                "<fcd-export><a {}/></fcd-export>",
                (0..65).fold(String::new(), |all, i| all + &format!("a{i}='' "))
            ),
            "64",
        ),
        (format!("<fcd-export><a b='{}'/></fcd-export>", "x".repeat(20_000)), "bytes"),
        (good.replace("id=\"a\"", "id=\"a\" id=\"b\""), "duplicated"),
        (good.replace("</timestep>", "</vehicle>"), "</vehicle>"),
    ] {
        let error = road(body.as_bytes(), kind(Format::Xml, Preset::Headway), &short()).unwrap_err();
        assert_eq!(error.code(), "malformed_body", "{body}: {error}");
        assert!(error.to_string().contains(wanted), "{wanted}: {error}");
    }
    let not_utf8 = [&b"<fcd-export><a b='\xff'/>"[..], b"</fcd-export>"].concat();
    assert_eq!(road(&not_utf8, kind(Format::Xml, Preset::Fcd), &short()).unwrap_err().code(), "malformed_body");
    let codes = |body: &str| road(body.as_bytes(), kind(Format::Xml, Preset::Fcd), &short()).unwrap_err().code();
    assert_eq!(codes("<tripinfos/>"), "not_fcd");
    assert_eq!(codes(&good.replace("speed=\"8\"", "")), "missing_value");
    assert_eq!(codes(&good.replace("speed=\"8\"", "speed=\"quick\"")), "wrong_type");
    assert_eq!(codes(&good.replace("id=\"b&amp;\"", "id=\"a\"")), "contradicting_rows");
    let twice = format!("<fcd-export>{0}{0}</fcd-export>", timestep("0.1", BEHIND));
    assert_eq!(codes(&twice), "time_not_increasing");
    let few = ExtractionSettings { max_rows: 50, ..short() };
    let more = (0..10).map(|i| timestep(&i.to_string(), BEHIND)).collect::<String>();
    let body = format!("<fcd-export>{more}</fcd-export>");
    let error = road(body.as_bytes(), kind(Format::Xml, Preset::Fcd), &few).unwrap_err();
    assert_eq!(error.code(), "too_many_rows");
}

#[test]
fn a_preset_has_its_formats() {
    let code = |format, preset: Preset| preset.check(format).map_err(|error| error.code()).err();
    assert_eq!(code(Format::Json, Preset::Ngsim), Some("preset_not_applicable"));
    assert_eq!(code(Format::Xml, Preset::Ngsim), Some("preset_not_applicable"));
    assert_eq!(code(Format::Parquet, Preset::Fcd), Some("preset_not_applicable"));
    assert_eq!(
        [code(Format::Xml, Preset::Fcd), code(Format::Csv, Preset::Fcd), code(Format::Parquet, Preset::Ngsim)],
        [None; 3]
    );
}
