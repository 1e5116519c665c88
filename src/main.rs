//! The `headway` binary; everything is in the library.

fn main() -> anyhow::Result<()> {
    headway::cli::run()
}
