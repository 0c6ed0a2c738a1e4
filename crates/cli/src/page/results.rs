//! A folder of results, as a page is made of it.

use crate::failure::Failure;
use crate::session::{AnySession, read_any_session};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// What robots that share a map leave of it.
pub(crate) const FLEET: &str = "fleet.json";

/// What lies in a folder of results. Of a run that was killed there is a session alone.
pub(super) struct Results {
    pub(super) folder: PathBuf,
    pub(super) session: AnySession,
    /// `report.json` and `timing.json`, null where they are not there.
    pub(super) report: Value,
    pub(super) timing: Value,
    /// What of it could not be read, in words.
    pub(super) losses: Vec<String>,
}

impl Results {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let (session, mut losses) = read_any_session(path)?;
        let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
        let mut beside = |name: &str| -> Result<Value, Failure> {
            let value = json_file(&folder.join(name))?;
            if value.is_null() {
                losses.push(format!("{name} is not in the folder: what it tells is not on the page"));
            }
            Ok(value)
        };
        // What is told of robots that share a map stands in a file of its own.
        let fleet = json_file(&folder.join(FLEET))?;
        let (report, timing) = match fleet {
            Value::Null => (beside("report.json")?, beside("timing.json")?),
            fleet => (fleet, Value::Null),
        };
        Ok(Self { folder: folder.to_owned(), session, report, timing, losses })
    }

    /// The name of the log, or of the folder where that is not known.
    pub(super) fn name(&self) -> String {
        let folder = || self.folder.display().to_string();
        self.report["log"].as_str().map_or_else(folder, str::to_owned)
    }

    /// A file that a run may have left beside, such as the truth of a simulated one.
    pub(super) fn beside(&self, name: &str) -> Option<PathBuf> {
        Some(self.folder.join(name)).filter(|path| path.is_file())
    }
}

/// What a file says; null where there is none.
fn json_file(path: &Path) -> Result<Value, Failure> {
    if !path.is_file() {
        return Ok(Value::Null);
    }
    let text = fs::read(path).map_err(|error| Failure::open(path, error))?;
    serde_json::from_slice(&text).map_err(|error| Failure::Read { path: path.to_owned(), cause: error.to_string() })
}
