//! A member of an answer, as a table shows it.

use serde_json::Value;

/// Nothing for null, text without quotes, and lists with commas.
pub(super) fn text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Array(items) => items.iter().map(text).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

/// A number with this many digits behind the point; what is none, as [`text`] has it.
pub(super) fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| text(value), |value| format!("{value:.digits$}"))
}

/// A time to the second.
pub(super) fn time(value: &Value) -> String {
    let text = text(value);
    match text.split_once('.') {
        Some((seconds, _)) => format!("{seconds}Z"),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_times_are_short() {
        assert_eq!(number(&serde_json::json!(1.23456), 2), "1.23");
        assert_eq!(number(&Value::Null, 2), "");
        assert_eq!(time(&serde_json::json!("2026-11-27T06:17:53.252027Z")), "2026-11-27T06:17:53Z");
    }
}
