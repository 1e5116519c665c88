use headway::config::{Config, ConfigError, Layer};

/// A file, a flag or variables over the defaults.
pub(super) fn run(data: &[u8]) {
    let Some((choice, text)) = super::chosen(data, 3) else { return };
    let Ok(text) = std::str::from_utf8(text) else { return };
    let layers = match choice {
        0 => Layer::text("site.toml", text).map(|layer| vec![layer]),
        1 => {
            let (key, value) = text.split_once('=').unwrap_or((text, ""));
            Ok(vec![Layer::one("--set", key, value)])
        }
        _ => Layer::variables(text.lines().take(32).map(|line| {
            let (name, value) = line.split_once('=').unwrap_or((line, ""));
            (format!("HEADWAY_{name}"), value.to_owned())
        })),
    };
    match layers.and_then(|layers| Config::resolve(layers.clone()).map(|config| (config, layers))) {
        Ok((config, layers)) => {
            assert_eq!(config.model.check(), Ok(()));
            let told = format!("{config:?}");
            assert!(!told.contains("NaN") && !told.contains("inf,"), "{told}");
            assert_eq!(Config::resolve(layers).expect("as before"), config);
        }
        Err(ConfigError::Read { .. }) => unreachable!("no file was read"),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
