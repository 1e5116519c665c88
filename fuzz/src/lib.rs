//! Decoders of Headway under libFuzzer: each target in `targets` is a function of bytes that panics when a promise is broken.

use std::cell::RefCell;
use std::panic::{catch_unwind, set_hook};

/// Functions of bytes, one for each group of decoders.
pub mod targets;

#[doc(hidden)]
pub use libfuzzer_sys;

thread_local! {
    static LAST_PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Makes a libFuzzer binary of the target of this name.
#[macro_export]
macro_rules! fuzz {
    ($name:literal) => {
        use $crate::libfuzzer_sys;

        libfuzzer_sys::fuzz_target!(init: $crate::init(), |data: &[u8]| $crate::run($name, data));
    };
}

/// Lets a panic that is caught be one, as in the server: libFuzzer's own hook ends the process at any.
pub fn init() {
    set_hook(Box::new(|panic| LAST_PANIC.set(panic.to_string())));
}

/// Runs the target of this name; a panic that it does not catch ends the process.
pub fn run(name: &str, data: &[u8]) {
    let target = targets::ALL.iter().find(|target| target.name == name).expect("a target");
    if catch_unwind(|| (target.run)(data)).is_err() {
        eprintln!("{}", LAST_PANIC.take());
        std::process::abort();
    }
}
