//! What a robot must not forget: how often it was switched on.
//!
//! A robot that said under one number what it has said differently before would be taken for a liar, and not be heard any more. So each time
//! has a number of its own, which is on the disk before anything is said.

use crate::failure::Failure;
use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

const NUMBER: &str = "session";
const LOCK: &str = "lock";

/// The folder, held for as long as the robot runs.
pub(super) struct State {
    /// The number of this time.
    pub(super) session: u32,
    _lock: File,
}

/// Why there is no number.
pub(super) enum NoState {
    /// This robot runs already, or the folder cannot be used.
    Failure(Failure),
    /// The number could not be kept: the robot may map, but not speak.
    Unwritten(Failure),
}

impl State {
    /// The next number: one more than the last one, or the seconds since 1970 where these are more, so that a robot whose disk was lost does
    /// not begin anew.
    pub(super) fn begin(folder: &Path) -> Result<Self, NoState> {
        make_private(folder).map_err(NoState::Unwritten)?;
        let lock = folder.join(LOCK);
        let file = private().open(&lock).map_err(|error| NoState::Unwritten(Failure::write(&lock, error)))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let cause = "this robot runs already: two robots of one name would be taken for liars".to_owned();
                return Err(NoState::Failure(Failure::Config { path: folder.to_owned(), cause }));
            }
            Err(TryLockError::Error(error)) => return Err(NoState::Failure(Failure::write(&lock, error))),
        }
        let path = folder.join(NUMBER);
        let last = last(&path).map_err(NoState::Failure)?;
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let now = u32::try_from(since.as_secs()).unwrap_or(0);
        let Some(after) = last.map_or(Some(0), |last| last.checked_add(1)) else {
            let cause = "expected a number below 4294967295, found the last one".to_owned();
            return Err(NoState::Failure(Failure::Config { path, cause }));
        };
        let session = after.max(now);
        keep(&path, session).map_err(|error| NoState::Unwritten(Failure::write(&path, error)))?;
        Ok(Self { session, _lock: file })
    }
}

fn last(path: &PathBuf) -> Result<Option<u32>, Failure> {
    match fs::read_to_string(path) {
        Ok(text) => text.trim().parse().map(Some).map_err(|_| Failure::Config {
            path: path.clone(),
            cause: format!(
                "expected how often this robot was switched on, found {:?}; write a number there that is larger than any before",
                text.chars().take(40).collect::<String>()
            ),
        }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Failure::open(path, error)),
    }
}

/// On the disk, under its name, before this returns.
fn keep(path: &Path, session: u32) -> std::io::Result<()> {
    let part = path.with_extension("part");
    let mut file = private().truncate(true).open(&part)?;
    writeln!(file, "{session}")?;
    file.sync_all()?;
    fs::rename(&part, path)?;
    sync_folder(path)
}

#[cfg(unix)]
fn sync_folder(path: &Path) -> std::io::Result<()> {
    path.parent().map_or(Ok(()), |folder| File::open(folder)?.sync_all())
}

/// Elsewhere a folder cannot be opened.
#[cfg(not(unix))]
fn sync_folder(_: &Path) -> std::io::Result<()> {
    Ok(())
}

/// Makes a folder that its owner alone may look into, unless it is there.
pub(super) fn make_private(folder: &Path) -> Result<(), Failure> {
    let mut builder = DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder).map_err(|error| Failure::write(folder, error))
}

/// A file to be written that its owner alone may read.
pub(super) fn private() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.write(true).create(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    #[test]
    fn each_time_has_a_larger_number_whatever_the_clock_says() {
        let folder = std::env::temp_dir().join(format!("mapwright-state-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        let begin = || State::begin(&folder).ok().unwrap();
        let first = begin();
        assert!(matches!(State::begin(&folder), Err(NoState::Failure(_))), "two at once");
        let number = first.session;
        drop(first);
        assert!(begin().session > number);
        // The clock was years ahead the last time.
        fs::write(folder.join(NUMBER), "4000000000\n").unwrap();
        assert_eq!(begin().session, 4_000_000_001);
        fs::write(folder.join(NUMBER), "no number").unwrap();
        assert!(matches!(State::begin(&folder), Err(NoState::Failure(_))));
        fs::remove_dir_all(&folder).unwrap();
    }
}
