//! Threads that leave the cores to others when those want them.

/// Lets the calling thread, and those it starts, yield to threads of a smaller niceness. Linux alone has a niceness of each
/// thread; elsewhere nothing happens.
pub fn step_back(niceness: u8) {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::setpriority_process(None, niceness.into()) {
        tracing::warn!(%error, niceness, "a thread keeps its priority");
    }
    #[cfg(not(target_os = "linux"))]
    let _ = niceness;
}
