//! Events into bodies, for the tests.

use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::Arc;

use ::parquet::basic::{ConvertedType, Repetition, Type as Physical};
use ::parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::SerializedFileWriter;
use ::parquet::schema::types::Type;
use serde_json::{Map, Value, json};

use crate::formats::{Format, RawEvent};

/// The body that holds `events`, whatever their indices and origins; tabular ones carry `dt_s` and every column.
pub(crate) fn encode(events: &[RawEvent], format: Format) -> Vec<u8> {
    match format {
        Format::Json => json!({"events": events.iter().map(json_event).collect::<Vec<_>>()}).to_string().into_bytes(),
        Format::Ndjson => events.iter().flat_map(|event| format!("{}\n", json_event(event)).into_bytes()).collect(),
        Format::Csv => csv(events),
        Format::Parquet => parquet(events),
        Format::Npy => super::npy::array(events),
        Format::Xml => unreachable!("events cannot be said in it"),
    }
}

pub(crate) fn gzip(body: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(body).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn zstd(body: &[u8]) -> Vec<u8> {
    ::zstd::encode_all(body, 1).unwrap()
}

fn json_event(event: &RawEvent) -> Value {
    let mut json = Map::new();
    let recording = &event.recording;
    json.insert("event_id".to_owned(), json!(event.event_id));
    json.insert("source".to_owned(), json!(event.source));
    json.insert("run".to_owned(), json!(event.run));
    json.insert("split".to_owned(), json!(event.split));
    json.insert("dt_s".to_owned(), json!(recording.dt_s));
    json.insert("spacing_m".to_owned(), json!(recording.spacing_m));
    json.insert("follower_speed_mps".to_owned(), json!(recording.follower_speed_mps));
    json.insert("leader_speed_mps".to_owned(), json!(recording.leader_speed_mps));
    json.insert("rel_speed_mps".to_owned(), json!(recording.rel_speed_mps));
    Value::Object(json)
}

const TEXTS: [&str; 4] = ["event_id", "source", "run", "split"];
const NUMBERS: [&str; 5] = ["dt_s", "spacing_m", "follower_speed_mps", "leader_speed_mps", "rel_speed_mps"];

fn texts(event: &RawEvent) -> [String; 4] {
    let or_empty = |text: &Option<String>| text.clone().unwrap_or_default();
    let split = event.split.map(|split| split.as_str().to_owned()).unwrap_or_default();
    [event.event_id.clone(), or_empty(&event.source), or_empty(&event.run), split]
}

fn numbers(event: &RawEvent, step: usize) -> [Option<f64>; 5] {
    let recording = &event.recording;
    [
        recording.dt_s,
        Some(recording.spacing_m[step]),
        Some(recording.follower_speed_mps[step]),
        Some(recording.leader_speed_mps[step]),
        recording.rel_speed_mps.as_ref().map(|rel| rel[step]),
    ]
}

fn csv(events: &[RawEvent]) -> Vec<u8> {
    // A column that some events lack cannot be told from one they all lack.
    let with_rel = events.iter().any(|event| event.recording.rel_speed_mps.is_some());
    let columns = if with_rel { 5 } else { 4 };
    let mut body = format!("{},{}\n", TEXTS.join(","), NUMBERS[..columns].join(","));
    for event in events {
        let quoted = texts(event).map(|text| format!("\"{}\"", text.replace('"', "\"\"")));
        for step in 0..event.recording.spacing_m.len() {
            body.push_str(&quoted.join(","));
            for number in &numbers(event, step)[..columns] {
                match number {
                    Some(number) => write!(body, ",{number:?}").unwrap(),
                    None => body.push(','),
                }
            }
            body.push('\n');
        }
    }
    body.into_bytes()
}

/// Several small row groups, dictionary-encoded strings, nullable columns.
fn parquet(events: &[RawEvent]) -> Vec<u8> {
    let with_rel = events.iter().any(|event| event.recording.rel_speed_mps.is_some());
    let numeric = if with_rel { 5 } else { 4 };
    let column = |name: &str, physical, converted| {
        let repetition = if name == "event_id" { Repetition::REQUIRED } else { Repetition::OPTIONAL };
        let builder = Type::primitive_type_builder(name, physical).with_repetition(repetition);
        Arc::new(builder.with_converted_type(converted).build().unwrap())
    };
    let mut columns: Vec<_> = TEXTS.map(|name| column(name, Physical::BYTE_ARRAY, ConvertedType::UTF8)).to_vec();
    columns.extend(NUMBERS[..numeric].iter().map(|name| column(name, Physical::DOUBLE, ConvertedType::NONE)));
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(columns).build().unwrap());
    let properties = WriterProperties::builder()
        .set_compression(::parquet::basic::Compression::SNAPPY)
        .set_data_page_row_count_limit(1000)
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties)).unwrap();
    for group in events.chunks(7) {
        let mut rows = writer.next_row_group().unwrap();
        let steps = |event: &RawEvent| 0..event.recording.spacing_m.len();
        for text in 0..TEXTS.len() {
            let cells: Vec<_> = group.iter().flat_map(|e| steps(e).map(|_| texts(e)[text].clone())).collect();
            let mut column = rows.next_column().unwrap().unwrap();
            let levels: Vec<i16> = cells.iter().map(|cell| i16::from(!cell.is_empty())).collect();
            let present = |cell: &&String| text == 0 || !cell.is_empty();
            let values: Vec<_> = cells.iter().filter(present).map(|cell| ByteArray::from(cell.as_str())).collect();
            let levels = (text > 0).then_some(levels.as_slice());
            column.typed::<ByteArrayType>().write_batch(&values, levels, None).unwrap();
            column.close().unwrap();
        }
        for number in 0..numeric {
            let cells: Vec<_> = group.iter().flat_map(|e| steps(e).map(|step| numbers(e, step)[number])).collect();
            let mut column = rows.next_column().unwrap().unwrap();
            let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
            let values: Vec<f64> = cells.iter().flatten().copied().collect();
            column.typed::<DoubleType>().write_batch(&values, Some(&levels), None).unwrap();
            column.close().unwrap();
        }
        rows.close().unwrap();
    }
    writer.into_inner().unwrap()
}
