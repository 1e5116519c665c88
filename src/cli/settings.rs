//! The settings that a server would find, for commands that work where it does.

use std::path::Path;

use anyhow::Context;

use crate::config::{Config, Layer};

/// What a file and the environment say.
pub(super) fn layers(file: Option<&Path>) -> anyhow::Result<Vec<Layer>> {
    let mut layers = Vec::new();
    if let Some(path) = file {
        layers.push(Layer::file(path)?);
    }
    let variables = std::env::vars_os();
    let readable = variables.filter_map(|(name, text)| Some((name.into_string().ok()?, text.into_string().ok()?)));
    layers.extend(Layer::variables(readable)?);
    Ok(layers)
}

/// What `--database` says.
pub(super) fn database(path: &Path) -> anyhow::Result<Layer> {
    let path = path.to_str().context("--database: the path is not UTF-8")?;
    Ok(Layer::string("--database", "database.path", path))
}

/// All of them, for a command that is told no more than its database.
pub(super) fn of_a_server(path: Option<&Path>) -> anyhow::Result<Config> {
    let file = std::env::var_os("HEADWAY_CONFIG");
    let mut layers = layers(file.as_deref().map(Path::new))?;
    layers.extend(path.map(database).transpose()?);
    Ok(Config::resolve(layers)?)
}
