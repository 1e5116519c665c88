//! Every setting of the server: `default.toml`, then a file, then `HEADWAY_…` variables, then flags.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::{Table, Value};

use crate::access::AccessSettings;
use crate::http::ServerSettings;
use crate::ingest::IngestSettings;
use crate::lineage::{ModelSettings, SettingsError};
use crate::predictor::{PredictorSettings, TrialSettings};
use crate::scheduler::SchedulerSettings;
use crate::store::StoreSettings;
use crate::store::backup::BackupSettings;
use crate::telemetry::LogSettings;
use crate::upkeep::UpkeepSettings;

/// The embedded defaults: the manual.
pub const DEFAULTS: &str = include_str!("default.toml");

const PREFIX: &str = "HEADWAY_";

/// The settings of each layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// The interface.
    pub server: ServerSettings,
    /// Keys.
    pub access: AccessSettings,
    /// The database.
    pub database: StoreSettings,
    /// Where copies of it go.
    pub backup: BackupSettings,
    /// What an upload may be.
    pub ingest: IngestSettings,
    /// What trains at once.
    pub training: SchedulerSettings,
    /// What is kept loaded.
    pub predict: PredictorSettings,
    /// How much is computed for an evaluation on events that are not kept.
    pub evaluate: TrialSettings,
    /// What goes, and how much at once.
    pub upkeep: UpkeepSettings,
    /// Defaults of new models.
    pub model: ModelSettings,
    /// The log.
    pub log: LogSettings,
}

/// Why the settings cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is not TOML.
    #[error("{origin}: {detail}")]
    Syntax {
        /// Where it came from.
        origin: String,
        /// What is wrong.
        detail: String,
    },
    /// No such setting.
    #[error("{origin}: there is no setting {key}")]
    Unknown {
        /// Where it came from.
        origin: String,
        /// Its dotted name.
        key: String,
    },
    /// A value of the wrong type or out of range.
    #[error("{origin}: {detail}")]
    Value {
        /// Where it came from.
        origin: String,
        /// Which and what is wrong.
        detail: String,
    },
}

/// Settings from one place.
#[derive(Debug, Clone)]
pub struct Layer {
    origin: String,
    table: Table,
}

impl Layer {
    /// A TOML file.
    ///
    /// # Errors
    /// When it cannot be read or is not TOML.
    pub fn file(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::text(&path.display().to_string(), &text)
    }

    /// TOML text from `origin`.
    ///
    /// # Errors
    /// When it is not TOML.
    pub fn text(origin: &str, text: &str) -> Result<Self, ConfigError> {
        let table = text
            .parse()
            .map_err(|e: toml::de::Error| ConfigError::Syntax { origin: origin.to_owned(), detail: e.to_string() })?;
        Ok(Self { origin: origin.to_owned(), table })
    }

    /// One setting by its dotted name, its value as a person writes it in a variable or flag.
    #[must_use]
    pub fn one(origin: &str, key: &str, text: &str) -> Self {
        Self::value(origin, key, value_from(text))
    }

    /// One setting by its dotted name, its value a string whatever it looks like.
    #[must_use]
    pub fn string(origin: &str, key: &str, text: &str) -> Self {
        Self::value(origin, key, Value::String(text.to_owned()))
    }

    fn value(origin: &str, key: &str, mut value: Value) -> Self {
        for part in key.rsplit('.') {
            value = Value::Table(Table::from_iter([(part.to_owned(), value)]));
        }
        let Value::Table(table) = value else { unreachable!("a key has at least one part") };
        Self { origin: origin.to_owned(), table }
    }

    /// The settings among `variables`. Other `HEADWAY_` variables are left alone, unless they look like a misspelt setting.
    ///
    /// # Errors
    /// Names a variable that begins like a setting and is none.
    pub fn variables(variables: impl IntoIterator<Item = (String, String)>) -> Result<Vec<Self>, ConfigError> {
        let defaults = defaults();
        let mut layers = Vec::new();
        for (name, text) in variables {
            let Some(rest) = name.strip_prefix(PREFIX) else { continue };
            let key = rest.to_ascii_lowercase();
            if key.contains("__") {
                layers.push(Self::one(&name, &key.replace("__", "."), &text));
            } else if key.split('_').next().is_some_and(|section| defaults.contains_key(section)) && key.contains('_') {
                return Err(ConfigError::Unknown {
                    origin: name.clone(),
                    key: format!("{key} (two underscores part section and key)"),
                });
            }
        }
        // The environment has no order; errors should.
        layers.sort_by(|a, b| a.origin.cmp(&b.origin));
        Ok(layers)
    }
}

/// `text` as TOML where it is that (a number, a boolean, a quoted string, an array), else as a string.
fn value_from(text: &str) -> Value {
    format!("value = {text}")
        .parse::<Table>()
        .ok()
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_owned()))
}

fn defaults() -> Table {
    DEFAULTS.parse().expect("the embedded defaults are TOML")
}

impl Config {
    /// The defaults overlaid with `layers`, the last winning. Settings that only go together may come one by one.
    ///
    /// # Errors
    /// Names the first setting that is unknown, or that made the whole unusable for good, and where it came from.
    pub fn resolve(layers: impl IntoIterator<Item = Layer>) -> Result<Self, ConfigError> {
        let mut merged = defaults();
        let mut config = Self::from_table(&merged, "default.toml")?;
        let mut unusable = None;
        for Layer { origin, table } in layers {
            refuse_unusable(&table, &known(), "", &origin)?;
            merge(&mut merged, table);
            match Self::from_table(&merged, &origin) {
                Ok(usable) => (config, unusable) = (usable, None),
                Err(error) => _ = unusable.get_or_insert(error),
            }
        }
        unusable.map_or(Ok(config), Err)
    }

    fn from_table(table: &Table, origin: &str) -> Result<Self, ConfigError> {
        let wrong = |detail: String| ConfigError::Value { origin: origin.to_owned(), detail };
        let model = serde_json::to_value(&table["model"]).map_err(|e| wrong(e.to_string()))?;
        let model = ModelSettings::default()
            .overridden(&model)
            .map_err(|SettingsError { name, detail, .. }| wrong(format!("model.{name}: {detail}")))?;
        let config = Self {
            server: section(table, "server").map_err(wrong)?,
            access: section(table, "access").map_err(wrong)?,
            database: section(table, "database").map_err(wrong)?,
            backup: section(table, "backup").map_err(wrong)?,
            ingest: section(table, "ingest").map_err(wrong)?,
            training: section(table, "training").map_err(wrong)?,
            predict: section(table, "predict").map_err(wrong)?,
            evaluate: section(table, "evaluate").map_err(wrong)?,
            upkeep: section(table, "upkeep").map_err(wrong)?,
            model,
            log: section(table, "log").map_err(wrong)?,
        };
        config.server.check().map_err(wrong)?;
        within("server", &config.server.numbers()).map_err(wrong)?;
        within("access", &config.access.numbers()).map_err(wrong)?;
        within("database", &config.database.numbers()).map_err(wrong)?;
        within("backup", &config.backup.numbers()).map_err(wrong)?;
        within("training", &config.training.numbers()).map_err(wrong)?;
        within("predict", &config.predict.numbers()).map_err(wrong)?;
        within("evaluate", &config.evaluate.numbers()).map_err(wrong)?;
        within("upkeep", &config.upkeep.numbers()).map_err(wrong)?;
        config.ingest.clone().checked().map_err(|e| wrong(format!("ingest.{e}")))?;
        Ok(config)
    }
}

fn section<'de, T: Deserialize<'de>>(table: &Table, name: &str) -> Result<T, String> {
    serde_path_to_error::deserialize(table[name].clone())
        .map_err(|e| format!("{name}.{}: {}", e.path(), e.inner().to_string().trim()))
}

/// Whether each number of a section lies in its range.
fn within(section: &str, numbers: &[(&str, f64, RangeInclusive<f64>)]) -> Result<(), String> {
    match numbers.iter().find(|(_, value, range)| !range.contains(value)) {
        Some((name, value, range)) => {
            Err(format!("{section}.{name}: {value} is not within {} to {}", range.start(), range.end()))
        }
        None => Ok(()),
    }
}

/// Every name that may be set: those of the defaults, and the model's that have no default value.
fn known() -> Table {
    let mut known = defaults();
    let settings = serde_json::to_value(ModelSettings::default()).expect("settings are plain data");
    let model = known.get_mut("model").and_then(Value::as_table_mut).expect("a section");
    add_names(model, settings.as_object().expect("an object"));
    known
}

fn add_names(known: &mut Table, settings: &serde_json::Map<String, serde_json::Value>) {
    for (name, setting) in settings {
        let known = known.entry(name.clone()).or_insert(Value::Boolean(false));
        if let (Value::Table(known), Some(settings)) = (known, setting.as_object()) {
            add_names(known, settings);
        }
    }
}

/// Refuses names that no setting has, and numbers that are none.
fn refuse_unusable(given: &Table, known: &Table, above: &str, origin: &str) -> Result<(), ConfigError> {
    for (name, value) in given {
        let key = format!("{above}{name}");
        let Some(known) = known.get(name) else {
            return Err(ConfigError::Unknown { origin: origin.to_owned(), key });
        };
        match (value, known) {
            (Value::Float(number), _) if !number.is_finite() => {
                let detail = format!("{key}: {number} is not a finite number");
                return Err(ConfigError::Value { origin: origin.to_owned(), detail });
            }
            (Value::Table(value), Value::Table(known)) => refuse_unusable(value, known, &format!("{key}."), origin)?,
            (_, Value::Table(_)) if above.is_empty() => {
                return Err(ConfigError::Value { origin: origin.to_owned(), detail: format!("{key} is a section") });
            }
            _ => {}
        }
    }
    Ok(())
}

fn merge(below: &mut Table, above: Table) {
    for (name, value) in above {
        match (below.get_mut(&name), value) {
            (Some(Value::Table(below)), Value::Table(above)) => merge(below, above),
            (_, value) => drop(below.insert(name, value)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consolidation::Method;
    use crate::lineage::Strength;

    fn variables(given: &[(&str, &str)]) -> Result<Vec<Layer>, ConfigError> {
        Layer::variables(given.iter().map(|&(name, text)| (name.to_owned(), text.to_owned())))
    }

    #[test]
    fn the_manual_states_the_defaults_of_the_code() {
        let config = Config::resolve([]).unwrap();
        assert_eq!(config.model, ModelSettings::default());
        assert_eq!(config.ingest, IngestSettings::default());
    }

    #[test]
    fn later_layers_win_and_leave_the_rest() {
        let file =
            Layer::text("site.toml", "[server]\npage_size = 5\n[model]\nschedule = \"manual\"\nhidden = 8").unwrap();
        let variables =
            variables(&[("HEADWAY_SERVER__PAGE_SIZE", "6"), ("HEADWAY_DATABASE__PATH", "/data/h.db"), ("HOME", "/")]);
        let flag = Layer::one("--listen", "server.listen", "127.0.0.1:0");
        let config = Config::resolve([file].into_iter().chain(variables.unwrap()).chain([flag])).unwrap();
        assert_eq!(config.server.page_size, 6);
        assert_eq!(config.server.listen.port(), 0);
        assert_eq!(config.database.path, Path::new("/data/h.db"));
        assert_eq!((config.model.hidden, config.model.epochs), (8, 5));
        assert!(!config.model.schedule.is_due(u64::MAX, 1e9));
    }

    #[test]
    fn settings_that_go_together_come_in_any_order() {
        let window = || Layer::one("--a", "model.memory", "window");
        let raw = || Layer::one("--b", "model.features", "raw");
        let resolved = Config::resolve([window(), raw()]).unwrap();
        assert_eq!(resolved, Config::resolve([raw(), window()]).unwrap());
        // What stays unusable is told by what made it so.
        let other = Layer::one("--c", "server.page_size", "7");
        assert!(Config::resolve([window(), other]).unwrap_err().to_string().starts_with("--a: model."));
    }

    #[test]
    fn a_setting_without_a_default_can_be_set() {
        let config = Config::resolve([Layer::one("--x", "model.strength", "2.5")]).unwrap();
        assert_eq!(config.model.strength, Some(Strength::Fixed(2.5)));
        let config = Config::resolve([Layer::one("--x", "model.strength", "auto")]).unwrap();
        assert!(config.model.searches_strength(Method::Ewc));
    }

    #[test]
    fn what_the_manual_shows_without_a_default_can_be_set() {
        let mut tried = 0;
        let mut section = "";
        for line in DEFAULTS.lines() {
            section = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')).unwrap_or(section);
            let Some((name, value)) = line.strip_prefix("# ").and_then(|line| line.split_once(" = ")) else { continue };
            if name.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'_') {
                let shown = Layer::text("site.toml", &format!("[{section}]\n{name} = {value}")).unwrap();
                Config::resolve([shown]).unwrap();
                tried += 1;
            }
        }
        assert_eq!(tried, 6);
    }

    #[test]
    fn an_unknown_or_unusable_setting_is_named_with_its_origin() {
        for (layer, named) in [
            (
                Layer::text("site.toml", "[server]\npage_sise = 5").unwrap(),
                "site.toml: there is no setting server.page_sise",
            ),
            (Layer::text("site.toml", "[sever]\nx = 5").unwrap(), "site.toml: there is no setting sever"),
            (Layer::one("HEADWAY_SERVER__PAGE_SIZE", "server.page_size", "many"), "HEADWAY_SERVER__PAGE_SIZE: server"),
            (Layer::one("--x", "model.hidden", "0"), "--x: model.hidden"),
            (Layer::one("--x", "server", "0"), "--x: server is a section"),
            (Layer::one("--x", "server.drain_s", "-1.0"), "--x: server.drain_s"),
            (Layer::one("--x", "server.listen", "localhost"), "--x: server.listen"),
            (Layer::one("--x", "server.cors_origins", "[\"*\"]"), "--x: server.cors_origins"),
            (Layer::one("--x", "server.tls.look_s", "0"), "--x: server.tls.look_s"),
        ] {
            let message = Config::resolve([layer]).unwrap_err().to_string();
            assert!(message.starts_with(named), "{message}");
        }
        assert!(variables(&[("HEADWAY_SERVER_LISTEN", "x")]).is_err());
        assert!(variables(&[("HEADWAY_RECORDED_DATA", "x"), ("HEADWAY_CONFIG", "x")]).unwrap().is_empty());
    }

    /// Dotted names and defaults of every number in the manual.
    fn numbers(table: &Table, above: &str) -> Vec<(String, Value)> {
        let named = |(name, value): (&String, &Value)| {
            let key = format!("{above}{name}");
            match value {
                Value::Table(below) => numbers(below, &format!("{key}.")),
                Value::Integer(_) | Value::Float(_) => vec![(key, value.clone())],
                _ => Vec::new(),
            }
        };
        table.iter().flat_map(named).collect()
    }

    #[test]
    fn every_number_is_refused_when_it_cannot_be_used_with_its_name_and_origin() {
        let numbers = numbers(&defaults(), "");
        assert!(numbers.len() > 50, "{numbers:?}");
        for (key, default) in numbers {
            let nonsense: &[&str] = if default.is_float() { &["-1", "nan", "inf", "\"1\""] } else { &["-1", "0.5"] };
            for text in nonsense {
                let message = Config::resolve([Layer::one("--x", &key, text)]).unwrap_err().to_string();
                // What is nested in a model's setting is told under that setting.
                let named: Vec<_> = key.split('.').take(if key.starts_with("model") { 2 } else { 3 }).collect();
                assert!(
                    message.starts_with("--x: ") && message.contains(&named.join(".")),
                    "{key} = {text}: {message}"
                );
            }
        }
    }

    #[test]
    fn numbers_that_would_stop_the_server_later_are_refused_at_the_start() {
        for (key, text) in [
            ("database.readers", "0"),
            ("database.writer_wait_s", "1e300"),
            ("training.parallel_tasks", "0"),
            ("training.trigger_interval_s", "0"),
            ("server.concurrent_uploads", "9000000000000000000"),
            ("ingest.max_listed_rejections", "1001"),
        ] {
            let message = Config::resolve([Layer::one("HEADWAY_X", key, text)]).unwrap_err().to_string();
            assert!(message.starts_with("HEADWAY_X: ") && message.contains(key), "{message}");
        }
    }
}
