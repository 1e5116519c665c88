use std::fmt::Write as _;
use std::sync::Arc;

use ::parquet::basic::{ConvertedType, Repetition, Type as Physical};
use ::parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::SerializedFileWriter;
use ::parquet::schema::types::Type;
use proptest::prelude::*;

use super::*;

const TEXTS: [&str; 4] = ["event_id", "source", "run", "split"];
const NUMBERS: [&str; 6] = ["t", "dt_s", "spacing_m", "follower_speed_mps", "leader_speed_mps", "rel_speed_mps"];

/// A row of a table that may say anything.
#[derive(Debug, Clone)]
struct Row {
    texts: [Option<&'static str>; 4],
    numbers: [Option<f64>; 6],
}

/// Most rows say nothing that is worth a rejection; now and then a cell is missing or differs from the others of its event.
fn rows() -> impl Strategy<Value = Vec<Row>> {
    let seldom = || (0_u8..40).prop_map(|draw| draw == 0);
    let cells = (seldom(), seldom(), seldom(), seldom(), seldom(), 0_usize..6);
    let row = (0_u8..8, cells, proptest::array::uniform6(-2.0..2.0_f64));
    (any::<[bool; 3]>(), proptest::collection::vec(row, 1..60)).prop_map(|([with_source, with_dt, with_rel], draws)| {
        let (mut rows, mut event) = (Vec::new(), 0);
        for (turn, (odd_source, odd_split, odd_dt, missing, odd_id, column), mut numbers) in draws {
            event += usize::from(turn == 0);
            let id = if odd_id { None } else { Some(["a", "b", "c", "d", "too-long-a-name", "e", "f"][event % 7]) };
            let source = if odd_source { Some("other") } else { with_source.then_some("site") };
            let split = if odd_split { Some("no-split") } else { Some("train") };
            numbers[1] = if odd_dt { 0.2 } else { 0.1 };
            let mut numbers = numbers.map(Some);
            if !with_dt {
                numbers[1] = None;
            }
            if !with_rel {
                numbers[5] = None;
            }
            if missing {
                numbers[column] = None;
            }
            rows.push(Row { texts: [id, source, Some("run"), split], numbers });
        }
        rows
    })
}

fn csv(rows: &[Row]) -> Vec<u8> {
    let mut body = format!("{},{}\n", TEXTS.join(","), NUMBERS.join(","));
    for row in rows {
        body.push_str(&row.texts.map(Option::unwrap_or_default).join(","));
        for number in row.numbers {
            body.push(',');
            if let Some(number) = number {
                write!(body, "{number:?}").unwrap();
            }
        }
        body.push('\n');
    }
    body.into_bytes()
}

/// In row groups of `group` rows.
fn parquet(rows: &[Row], group: usize) -> Vec<u8> {
    let column = |name: &str, physical, converted| {
        let builder = Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL);
        Arc::new(builder.with_converted_type(converted).build().unwrap())
    };
    let mut columns: Vec<_> = TEXTS.map(|name| column(name, Physical::BYTE_ARRAY, ConvertedType::UTF8)).to_vec();
    columns.extend(NUMBERS.map(|name| column(name, Physical::DOUBLE, ConvertedType::NONE)));
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(columns).build().unwrap());
    let properties = Arc::new(WriterProperties::builder().build());
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, properties).unwrap();
    for rows in rows.chunks(group) {
        let mut written = writer.next_row_group().unwrap();
        for text in 0..TEXTS.len() {
            let levels: Vec<i16> = rows.iter().map(|row| i16::from(row.texts[text].is_some())).collect();
            let values: Vec<_> = rows.iter().filter_map(|row| row.texts[text]).map(ByteArray::from).collect();
            let mut column = written.next_column().unwrap().unwrap();
            column.typed::<ByteArrayType>().write_batch(&values, Some(&levels), None).unwrap();
            column.close().unwrap();
        }
        for number in 0..NUMBERS.len() {
            let levels: Vec<i16> = rows.iter().map(|row| i16::from(row.numbers[number].is_some())).collect();
            let values: Vec<_> = rows.iter().filter_map(|row| row.numbers[number]).collect();
            let mut column = written.next_column().unwrap().unwrap();
            column.typed::<DoubleType>().write_batch(&values, Some(&levels), None).unwrap();
            column.close().unwrap();
        }
        written.close().unwrap();
    }
    writer.into_inner().unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// CSV is read row by row, Parquet by columns and an event's rows at once wherever that can be: whatever a table says,
    /// events, rejections with their places and words, and what makes the body unusable are those of the rows.
    #[test]
    fn rows_taken_together_say_what_they_say_one_by_one(rows in rows(), group in 1_usize..50, max_steps in 3_u32..30) {
        let limits = FormatLimits { max_steps, max_text_bytes: 12, ..FormatLimits::default() };
        let decoded = |body: Vec<u8>, format| {
            let decoded = decode_file(file(&body), kind(format, Preset::Headway), &limits);
            decoded.map_err(|error| (error.code(), error.place().cloned(), error.to_string()))
        };
        prop_assert_eq!(decoded(parquet(&rows, group), Format::Parquet), decoded(csv(&rows), Format::Csv));
    }
}
