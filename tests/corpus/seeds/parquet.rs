//! Seeds that are Parquet: every type, encoding and compression that the reader takes.

use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, Encoding, GzipLevel, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::properties::{WriterProperties, WriterPropertiesBuilder, WriterVersion};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

type Properties = fn(WriterPropertiesBuilder) -> WriterPropertiesBuilder;

/// A column: its name, what it is, and whether cells may be missing.
type Column = (&'static str, Physical, Repetition);

const NEEDED: Repetition = Repetition::REQUIRED;
const OPTIONAL: Repetition = Repetition::OPTIONAL;
const COLUMNS: [Column; 4] = [
    ("event_id", Physical::BYTE_ARRAY, NEEDED),
    ("spacing_m", Physical::DOUBLE, NEEDED),
    ("follower_speed_mps", Physical::DOUBLE, NEEDED),
    ("leader_speed_mps", Physical::DOUBLE, NEEDED),
];

pub(super) fn plain() -> Vec<u8> {
    file(&COLUMNS, |properties| properties.set_dictionary_enabled(false))
}

pub(super) fn files() -> Vec<(String, Vec<u8>)> {
    let optional = COLUMNS.map(|(name, kind, _)| (name, kind, OPTIONAL));
    let all = [
        ("event_id", Physical::INT64, OPTIONAL),
        ("source", Physical::BYTE_ARRAY, OPTIONAL),
        ("run", Physical::INT32, NEEDED),
        ("split", Physical::BYTE_ARRAY, OPTIONAL),
        ("t", Physical::FLOAT, NEEDED),
        ("dt_s", Physical::DOUBLE, OPTIONAL),
        ("pair", Physical::INT32, OPTIONAL),
        ("spacing_m", Physical::INT32, NEEDED),
        ("follower_speed_mps", Physical::FLOAT, NEEDED),
        ("leader_speed_mps", Physical::INT64, NEEDED),
        ("rel_speed_mps", Physical::DOUBLE, NEEDED),
    ];
    let ids = [
        ("event_id", Physical::DOUBLE, NEEDED),
        ("run", Physical::FLOAT, OPTIONAL),
        COLUMNS[1],
        COLUMNS[2],
        COLUMNS[3],
    ];
    let wrong = [COLUMNS[0], ("spacing_m", Physical::BOOLEAN, NEEDED), COLUMNS[2], COLUMNS[3]];
    let follownet = ["event_id", "spacing", "sv_speed", "lv_speed"].map(|name| (name, Physical::DOUBLE, NEEDED));
    let cases: [(&str, &[Column], Properties); 16] = [
        ("plain", &COLUMNS, |p| p.set_dictionary_enabled(false)),
        ("dictionary", &COLUMNS, |p| p),
        ("optional", &optional, |p| p),
        ("all", &all, |p| p),
        ("ids", &ids, |p| p),
        ("wrong", &wrong, |p| p),
        ("missing", &COLUMNS[..3], |p| p),
        ("snappy", &COLUMNS, |p| p.set_compression(Compression::SNAPPY)),
        ("gzip", &COLUMNS, |p| p.set_compression(Compression::GZIP(GzipLevel::default()))),
        ("zstd", &COLUMNS, |p| p.set_compression(Compression::ZSTD(ZstdLevel::default()))),
        ("lz4", &COLUMNS, |p| p.set_compression(Compression::LZ4_RAW)),
        ("v2", &optional, |p| p.set_writer_version(WriterVersion::PARQUET_2_0).set_compression(Compression::SNAPPY)),
        ("v2-delta", &all, |p| p.set_writer_version(WriterVersion::PARQUET_2_0).set_dictionary_enabled(false)),
        ("split", &COLUMNS, |p| {
            p.set_dictionary_enabled(false)
                .set_encoding(Encoding::BYTE_STREAM_SPLIT)
                .set_column_encoding("event_id".into(), Encoding::DELTA_BYTE_ARRAY)
        }),
        ("pages", &optional, |p| p.set_data_page_row_count_limit(2).set_write_batch_size(1)),
        ("groups", &COLUMNS, |p| p.set_max_row_group_row_count(Some(2))),
    ];
    let mut files: Vec<_> =
        cases.into_iter().map(|(name, columns, properties)| (name.to_owned(), file(columns, properties))).collect();
    files.push(("follownet".to_owned(), [&[0], &file(&follownet, |p| p)[..]].concat()));
    let plain = plain();
    files.push(("cut".to_owned(), plain[..plain.len() - 1].to_vec()));
    files.push(("cut-early".to_owned(), b"PAR1".to_vec()));
    files.push(("not-parquet".to_owned(), b"event_id,spacing_m\n".to_vec()));
    files
}

/// Two events of three and two rows.
fn file(columns: &[Column], properties: Properties) -> Vec<u8> {
    const ROWS: [i32; 5] = [0, 0, 0, 1, 1];
    let field = |&(name, physical, repetition): &Column| {
        let text = if physical == Physical::BYTE_ARRAY { ConvertedType::UTF8 } else { ConvertedType::NONE };
        let builder = Type::primitive_type_builder(name, physical).with_repetition(repetition);
        Arc::new(builder.with_converted_type(text).build().unwrap())
    };
    let fields = columns.iter().map(field).collect();
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(fields).build().unwrap());
    let properties = Arc::new(properties(WriterProperties::builder()).build());
    let groups: Vec<&[i32]> =
        if properties.max_row_group_row_count() == Some(2) { ROWS.chunks(2).collect() } else { vec![&ROWS] };
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, properties).unwrap();
    for rows in groups {
        let mut group = writer.next_row_group().unwrap();
        for &(name, physical, repetition) in columns {
            let number = |event: i32| if name == "event_id" { event } else { 7 };
            // Of what may be missing, the second row is.
            let levels: Vec<i16> = (0..rows.len()).map(|row| i16::from(row != 1 || name == "event_id")).collect();
            let levels = (repetition == OPTIONAL).then_some(levels.as_slice());
            let present = |row: usize| levels.is_none_or(|levels| levels[row] == 1);
            let rows = rows.iter().enumerate().filter(|(row, _)| present(*row)).map(|(_, &event)| event);
            let mut column = group.next_column().unwrap().unwrap();
            match physical {
                Physical::BYTE_ARRAY => {
                    let text = |event| if name == "split" { "test".to_owned() } else { format!("{name}-{event}") };
                    let values: Vec<_> = rows.map(|event| ByteArray::from(text(event).as_str())).collect();
                    column.typed::<ByteArrayType>().write_batch(&values, levels, None).unwrap();
                }
                Physical::INT32 => {
                    let values: Vec<_> = rows.map(number).collect();
                    column.typed::<Int32Type>().write_batch(&values, levels, None).unwrap();
                }
                Physical::INT64 => {
                    let values: Vec<_> = rows.map(|event| i64::from(number(event))).collect();
                    column.typed::<Int64Type>().write_batch(&values, levels, None).unwrap();
                }
                Physical::FLOAT => {
                    let values: Vec<_> = rows.map(|event| number(event) as f32).collect();
                    column.typed::<FloatType>().write_batch(&values, levels, None).unwrap();
                }
                Physical::BOOLEAN => {
                    let values: Vec<_> = rows.map(|event| event == 0).collect();
                    column.typed::<parquet::data_type::BoolType>().write_batch(&values, levels, None).unwrap();
                }
                _ => {
                    let values: Vec<_> = rows.map(|event| f64::from(number(event))).collect();
                    column.typed::<DoubleType>().write_batch(&values, levels, None).unwrap();
                }
            }
            column.close().unwrap();
        }
        group.close().unwrap();
    }
    writer.into_inner().unwrap()
}
