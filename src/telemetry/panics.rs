//! Panics in the log.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::panic::{PanicHookInfo, set_hook};

use crate::formats;

/// Has panics noted in the log of the process, one line each whatever its format, instead of printed beside it. Those by which
/// a library refuses a malformed body are told to the client, and are for `debug`: anybody can cause as many as he likes.
pub fn log_panics() {
    set_hook(Box::new(log));
}

fn log(panic: &PanicHookInfo<'_>) {
    let place = panic.location().map(ToString::to_string).unwrap_or_default();
    let cause = panic.payload_as_str().unwrap_or("no message");
    if formats::is_guarded() {
        tracing::debug!(cause, place, "a library refused a body by panicking");
        return;
    }
    let current = std::thread::current();
    let thread = current.name().unwrap_or_default();
    let backtrace = Backtrace::capture();
    if backtrace.status() == BacktraceStatus::Captured {
        tracing::error!(cause, place, thread, backtrace = backtrace.to_string(), "panicked");
    } else {
        tracing::error!(cause, place, thread, "panicked");
    }
}
