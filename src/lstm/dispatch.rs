//! One choice of instruction set for every vectorised loop of the process.

use pulp::Arch;

/// Runs `op`, compiled for the best instruction set this machine has. `op` and what it calls must be `#[inline(always)]`.
#[inline(always)]
pub fn vectorised<R>(op: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(op)
}

/// Name of the arithmetic, stored with every version: bits are equal for the same build and name.
#[must_use]
pub fn kernel_name() -> &'static str {
    match Arch::new() {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) => "lines-avx512",
        #[cfg(target_arch = "x86_64")]
        Arch::V3(_) => "lines-avx2",
        #[cfg(target_arch = "aarch64")]
        Arch::Neon(_) => "lines-neon",
        _ => "lines-portable",
    }
}
