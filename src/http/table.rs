//! In what a table is answered: by `?format=`, else by `Accept`.

use axum::body::Body;
use axum::http::HeaderMap;
use axum::http::header::ACCEPT;
use axum::response::Response;
use serde::Deserialize;

use super::accept::weight;
use super::download;
use super::problem::{Code, InputError, Problem};
use crate::formats::{Format, Sheet, SheetFormat, whole_sheet};

/// The query of what can be answered as a table.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    format: Option<String>,
}

/// A form of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Json,
    Lines,
    Csv,
    Parquet,
}

/// What events are handed out as, that which is meant by nothing first.
pub(super) const EVENTS: [Form; 3] = [Form::Lines, Form::Csv, Form::Parquet];
/// What measures and predictions are answered as.
pub(super) const FIGURES: [Form; 3] = [Form::Json, Form::Csv, Form::Parquet];

impl Form {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Lines => "ndjson",
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }

    pub(super) fn media_type(self) -> &'static str {
        match self {
            Self::Json => Format::Json.media_type(),
            Self::Lines => Format::Ndjson.media_type(),
            Self::Csv => Format::Csv.media_type(),
            Self::Parquet => Format::Parquet.media_type(),
        }
    }

    pub(super) fn sheet(self) -> Option<SheetFormat> {
        match self {
            Self::Json | Self::Lines => None,
            Self::Csv => Some(SheetFormat::Csv),
            Self::Parquet => Some(SheetFormat::Parquet),
        }
    }

    /// The one of `offers` that `Accept` prefers; of those that it likes as well, the first.
    pub(super) fn accepted(headers: &HeaderMap, offers: [Self; 3]) -> Self {
        let mut best = (offers[0], 0.0);
        let given = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok());
        let ranges: Vec<_> = given.flat_map(|value| value.split(',')).collect();
        for form in offers {
            let weights = ranges.iter().map(|range| weight(range, form.media_type()));
            let liked = weights.fold(0.0, f32::max);
            if liked > best.1 {
                best = (form, liked);
            }
        }
        best.0
    }
}

impl Wanted {
    /// The form that is asked for.
    pub(super) fn form(&self, headers: &HeaderMap, offers: [Form; 3]) -> Result<Form, Problem> {
        let Some(name) = self.format.as_deref() else { return Ok(Form::accepted(headers, offers)) };
        offers.into_iter().find(|form| form.name() == name).ok_or_else(|| {
            let detail = format!("{}, not {name:.64}", offers.map(Form::name).join(", "));
            let error = InputError::parameter("format", "invalid_value", detail.clone());
            Code::InvalidQuery.because(format!("format is to be one of {detail}")).with_error(error)
        })
    }
}

/// A table that is in memory, as a file of this name.
pub(super) fn answer(form: Form, format: SheetFormat, name: &str, sheet: &Sheet) -> Result<Response, Problem> {
    let bytes = whole_sheet(format, sheet).map_err(Problem::internal)?;
    Ok(file(form, name, Body::from(bytes)))
}

/// A body as a file of this name and form.
pub(super) fn file(form: Form, name: &str, body: Body) -> Response {
    download::file(&format!("{name}.{}", form.name()), form.media_type(), body)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    #[test]
    fn accept_chooses_and_format_decides() {
        let form = |accept: &'static str, format: Option<&str>| {
            let headers = HeaderMap::from_iter([(ACCEPT, HeaderValue::from_static(accept))]);
            Wanted { format: format.map(str::to_owned) }.form(&headers, EVENTS)
        };
        for (accept, expected) in [
            ("*/*", Form::Lines),
            ("text/csv", Form::Csv),
            ("text/*", Form::Csv),
            ("application/vnd.apache.parquet, */*;q=0.1", Form::Parquet),
            ("text/csv;q=0.2, application/vnd.apache.parquet;q=0.9", Form::Parquet),
            ("text/csv;q=0, application/*", Form::Lines),
        ] {
            assert_eq!(form(accept, None).unwrap(), expected, "{accept}");
            assert_eq!(form(accept, Some("parquet")).unwrap(), Form::Parquet);
        }
        assert_eq!(form("*/*", Some("json")).unwrap_err().code(), Code::InvalidQuery);
        assert_eq!(Wanted { format: None }.form(&HeaderMap::new(), FIGURES).unwrap(), Form::Json);
    }
}
