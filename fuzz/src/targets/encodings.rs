use std::io::Write;

use headway::formats::{BodyKind, Encoding, Format, Preset};

use super::uploads::read;

/// Bytes that are said to be compressed, and bytes that are.
pub(super) fn run(data: &[u8]) {
    let Some((choice, rest)) = super::chosen(data, 8) else { return };
    let encoding = if choice & 1 == 0 { Encoding::Gzip } else { Encoding::Zstd };
    let format = if choice & 2 == 0 { Format::Ndjson } else { Format::Parquet };
    let kind = |encoding| BodyKind { format, encoding, preset: Preset::Headway };
    if choice & 4 == 0 {
        let _ = read(rest, kind(encoding));
        return;
    }
    let told = |body: &[u8], encoding| match read(body, kind(encoding)) {
        Ok(decoded) => format!("{decoded:?}"),
        Err(error) => error.code().to_owned(),
    };
    assert_eq!(told(rest, Encoding::Identity), told(&compressed(rest, encoding), encoding));
}

fn compressed(body: &[u8], encoding: Encoding) -> Vec<u8> {
    match encoding {
        Encoding::Identity => body.to_vec(),
        Encoding::Gzip => {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(body).and_then(|()| encoder.finish()).expect("memory")
        }
        Encoding::Zstd => zstd::encode_all(body, 1).expect("memory"),
    }
}
