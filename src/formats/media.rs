//! Content types and encodings.

use std::path::Path;

use super::FormatError;

/// A content type that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `{"events": […]}`.
    Json,
    /// One JSON event a line.
    Ndjson,
    /// One step a row, comma-separated, with a header.
    Csv,
    /// One step a row.
    Parquet,
    /// SUMO's floating-car data: every vehicle of a road at every time.
    Xml,
    /// `FollowNet`'s arrays.
    Npy,
}

const READ: &str = "application/json, application/x-ndjson, text/csv, application/vnd.apache.parquet, application/x-npy \
                    (FollowNet) and application/xml (SUMO FCD)";

impl Format {
    /// The format a `Content-Type` header names; its parameters are ignored.
    ///
    /// # Errors
    /// `unsupported_media_type`.
    pub fn from_content_type(header: &str) -> Result<Self, FormatError> {
        let media = header.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
        match media.as_str() {
            "application/json" => Ok(Self::Json),
            "application/x-ndjson" => Ok(Self::Ndjson),
            "text/csv" => Ok(Self::Csv),
            "application/vnd.apache.parquet" => Ok(Self::Parquet),
            "application/xml" | "text/xml" => Ok(Self::Xml),
            "application/x-npy" => Ok(Self::Npy),
            _ => Err(FormatError::Unsupported {
                code: "unsupported_media_type",
                detail: format!("content type {media:?} is not read; {READ} are"),
            }),
        }
    }

    /// What a file of this name holds, and how it is compressed; none where the name does not say.
    #[must_use]
    pub fn of_file(path: &Path) -> Option<(Self, Encoding)> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let (name, encoding) = match name.rsplit_once('.')? {
            (name, "gz") => (name, Encoding::Gzip),
            (name, "zst") => (name, Encoding::Zstd),
            _ => (name.as_str(), Encoding::Identity),
        };
        let format = match name.rsplit_once('.')?.1 {
            "json" => Self::Json,
            "ndjson" | "jsonl" => Self::Ndjson,
            "csv" => Self::Csv,
            "parquet" => Self::Parquet,
            "xml" => Self::Xml,
            "npy" => Self::Npy,
            _ => return None,
        };
        Some((format, encoding))
    }

    /// Its media type.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Ndjson => "application/x-ndjson",
            Self::Csv => "text/csv",
            Self::Parquet => "application/vnd.apache.parquet",
            Self::Xml => "application/xml",
            Self::Npy => "application/x-npy",
        }
    }
}

/// A content encoding that is undone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// None.
    Identity,
    /// gzip, one or more members.
    Gzip,
    /// Zstandard, one or more frames, with a window of at most 2²⁵ bytes.
    Zstd,
}

impl Encoding {
    /// The encoding a `Content-Encoding` header names.
    ///
    /// # Errors
    /// `unsupported_encoding`, also for several at once.
    pub fn from_content_encoding(header: Option<&str>) -> Result<Self, FormatError> {
        match header.map(|h| h.trim().to_ascii_lowercase()).as_deref() {
            None | Some("" | "identity") => Ok(Self::Identity),
            Some("gzip" | "x-gzip") => Ok(Self::Gzip),
            Some("zstd") => Ok(Self::Zstd),
            Some(other) => Err(FormatError::Unsupported {
                code: "unsupported_encoding",
                detail: format!("content encoding {other:?} is not undone; gzip and zstd are"),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_types_are_read_without_their_parameters() {
        assert_eq!(Format::from_content_type("Text/CSV; charset=utf-8").unwrap(), Format::Csv);
        for format in [Format::Json, Format::Ndjson, Format::Csv, Format::Parquet, Format::Xml, Format::Npy] {
            assert_eq!(Format::from_content_type(format.media_type()).unwrap(), format);
        }
        assert_eq!(Format::from_content_type("text/xml").unwrap(), Format::Xml);
        let code = |header| Format::from_content_type(header).unwrap_err().code();
        assert_eq!(code("text/plain"), "unsupported_media_type");
        assert_eq!(code(""), "unsupported_media_type");
    }

    #[test]
    fn a_files_name_says_what_it_holds() {
        let of = |name: &str| Format::of_file(Path::new(name));
        assert_eq!(of("a/b.c/events.CSV"), Some((Format::Csv, Encoding::Identity)));
        assert_eq!(of("fcd.xml.gz"), Some((Format::Xml, Encoding::Gzip)));
        assert_eq!(of("waymo.npy"), Some((Format::Npy, Encoding::Identity)));
        assert_eq!(of("x.jsonl.zst"), Some((Format::Ndjson, Encoding::Zstd)));
        assert_eq!([of("events"), of("events.gz"), of("events.txt"), of("csv/")], [None; 4]);
    }

    #[test]
    fn one_encoding_is_undone() {
        assert_eq!(Encoding::from_content_encoding(None).unwrap(), Encoding::Identity);
        assert_eq!(Encoding::from_content_encoding(Some("GZIP")).unwrap(), Encoding::Gzip);
        assert_eq!(Encoding::from_content_encoding(Some("zstd")).unwrap(), Encoding::Zstd);
        assert_eq!(Encoding::from_content_encoding(Some("gzip, zstd")).unwrap_err().code(), "unsupported_encoding");
    }
}
