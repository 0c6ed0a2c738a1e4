//! Settings from defaults, file and command line, and back into a file.

use crate::args::SettingsArgs;
use crate::failure::Failure;
use mapwright::Settings;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Defaults, then the file, then each `--set`; all ranges checked.
pub(crate) fn load(args: &SettingsArgs) -> Result<Settings, Failure> {
    let mut settings = match &args.config {
        Some(path) => read(path)?,
        None => Settings::default(),
    };
    for (key, value) in &args.set {
        settings.set(key, value)?;
    }
    settings.validate()?;
    Ok(settings)
}

/// As [`load`], on top of other values than the defaults: only what file and command line name is changed.
pub(crate) fn load_over(base: Settings, args: &SettingsArgs) -> Result<Settings, Failure> {
    let mut settings = base;
    if let Some(path) = &args.config {
        let asked = read(path)?;
        let text = fs::read_to_string(path).map_err(|error| Failure::open(path, error))?;
        let named: toml::Table = text.parse().unwrap_or_default();
        let is_named = |section: &str, key: &str| {
            named.get(section).and_then(toml::Value::as_table).is_some_and(|section| section.contains_key(key))
        };
        for line in asked.lines().iter().filter(|line| is_named(line.section, line.key)) {
            settings.set(&format!("{}.{}", line.section, line.key), &line.value)?;
        }
    }
    for (key, value) in &args.set {
        settings.set(key, value)?;
    }
    settings.validate()?;
    Ok(settings)
}

fn read(path: &Path) -> Result<Settings, Failure> {
    let text = fs::read_to_string(path).map_err(|error| Failure::open(path, error))?;
    let parsed: Result<Settings, toml::de::Error> = toml::from_str(&text);
    parsed.map_err(|error| Failure::Config { path: path.to_owned(), cause: error.to_string().trim_end().to_owned() })
}

/// Every setting with unit and meaning, as TOML that `--config` reads back.
pub(crate) fn to_toml(settings: &Settings) -> String {
    let mut text = String::from("# Every setting of mapwright; what is left out keeps its default.\n");
    let mut section = "";
    for line in settings.lines() {
        if line.section != section {
            section = line.section;
            let _ = write!(text, "\n[{section}]\n");
        }
        let unit = if line.unit.is_empty() { String::new() } else { format!("[{}] ", line.unit) };
        let _ = writeln!(text, "{} = {} # {unit}{}", line.key, line.value, line.meaning);
    }
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_reads_back_as_it_was() {
        let mut settings = Settings::default();
        settings.set("map.resolution_m", "0.1").unwrap();
        settings.set("live.policy", "gated").unwrap();
        assert_eq!(toml::from_str::<Settings>(&to_toml(&settings)).unwrap(), settings);
    }
}
