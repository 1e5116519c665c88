//! What is wrong with a pickle.

use crate::formats::FormatError;

/// It contradicts itself, or ends too early.
pub(super) fn broken(what: &str) -> FormatError {
    FormatError::malformed(None, &format!("the pickle is broken: {what}"))
}

/// It would do something else than build arrays.
pub(super) fn forbidden(what: &str) -> FormatError {
    let detail = format!("the pickle {what}; lists, numbers and arrays are read and nothing else, and nothing is run");
    FormatError::invalid(super::whole(), "forbidden_pickle", detail)
}
