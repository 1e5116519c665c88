//! What is fuzzed, and what must hold whatever the bytes are.

/// Files of versions.
mod artifact;
/// JSON bodies of calls that change something.
mod bodies;
/// Settings from files, flags and variables.
mod config;
/// Bodies compressed with gzip and zstd.
mod encodings;
/// Bodies of the inference protocol.
mod infer;
/// Bodies of predictions and simulations.
mod predict;
/// Queries, headers and ids.
mod requests;
/// Bytes and JSON in the database.
mod stored;
/// Bodies of events.
mod uploads;

/// A function of bytes, and the name of its corpus.
pub struct Target {
    /// Of the libFuzzer binary and of the folder in `fuzz/corpus`.
    pub name: &'static str,
    /// Panics when a promise is broken.
    pub run: fn(&[u8]),
}

const fn target(name: &'static str, run: fn(&[u8])) -> Target {
    Target { name, run }
}

/// Every target.
pub const ALL: [Target; 14] = [
    target("json", uploads::json),
    target("ndjson", uploads::ndjson),
    target("csv", uploads::csv),
    target("parquet", uploads::parquet),
    target("fcd", uploads::fcd),
    target("npy", uploads::npy),
    target("encodings", encodings::run),
    target("predict", predict::run),
    target("infer", infer::run),
    target("bodies", bodies::run),
    target("requests", requests::run),
    target("artifact", artifact::run),
    target("stored", stored::run),
    target("config", config::run),
];

/// What `run` gives, which must not have held more than `most` bytes at once. What C libraries hold is not counted: the
/// process's own limit is for that.
fn within<T>(most: u64, run: impl FnOnce() -> T) -> T {
    let mut given = None;
    let held = allocation_counter::measure(|| given = Some(run())).bytes_max;
    assert!(held <= most, "{held} bytes were held at once, more than {most}");
    given.expect("it ran")
}

/// The first byte, as one of `count` choices, and the others.
fn chosen(data: &[u8], count: usize) -> Option<(usize, &[u8])> {
    let (first, rest) = data.split_first()?;
    Some((usize::from(*first) % count, rest))
}
