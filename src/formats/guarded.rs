//! Code of libraries that fails on some malformed bodies by panicking.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

use parquet::errors::ParquetError;

use super::FormatError;
use super::excerpt::excerpt;

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Whether a panic of this thread would be the answer of a library to a malformed body, which is caught and told to the client
/// as any other fault of the body. What notes panics asks for it.
#[must_use]
pub fn is_guarded() -> bool {
    GUARDED.get()
}

/// Runs code of the Parquet library.
///
/// # Errors
/// When the library refuses the file, in whichever way.
pub(super) fn guarded<T>(run: impl FnOnce() -> Result<T, ParquetError>) -> Result<T, FormatError> {
    GUARDED.set(true);
    let ran = catch_unwind(AssertUnwindSafe(run));
    GUARDED.set(false);
    match ran {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(ParquetError::EOF(detail))) => Err(FormatError::Truncated { detail: excerpt(&detail) }),
        Ok(Err(error)) => Err(FormatError::malformed(None, &error)),
        Err(_) => Err(FormatError::malformed(None, &"the file contradicts itself")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_library_does_is_guarded_and_what_comes_after_it_is_not() {
        assert!(!is_guarded());
        guarded(|| {
            assert!(is_guarded());
            Ok(())
        })
        .unwrap();
        assert!(!is_guarded());
        // What is raised here passes by the hook, which would print it.
        let caught = guarded::<()>(|| std::panic::resume_unwind(Box::new("the library gives up")));
        assert!(matches!(caught, Err(FormatError::Malformed { .. })), "{caught:?}");
        assert!(!is_guarded());
    }
}
