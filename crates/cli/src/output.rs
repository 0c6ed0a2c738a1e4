//! The folder of results: files appear under their names only when all of them are complete.

use crate::failure::Failure;
use mapwright_formats::FormatError;
use std::borrow::Cow;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Held while a folder is being filled; the system lets go of it when a run is killed.
const LOCK: &str = ".mapwright.lock";

/// A folder that is being filled, by one run at a time. Dropped without [`OutputFolder::commit`], it leaves nothing behind, but where a file
/// could not be written what was mapped: `--continue` goes on with that.
#[derive(Debug)]
pub(crate) struct OutputFolder {
    folder: PathBuf,
    made: bool,
    names: Vec<Cow<'static, str>>,
    /// Files of an earlier run that this one has none of.
    outdated: Vec<String>,
    committed: bool,
    /// A file could not be written, as on a full disk; and what stays then.
    is_unwritten: bool,
    kept: Option<Cow<'static, str>>,
    /// The lock, for as long as the file is open.
    _lock: File,
}

impl OutputFolder {
    /// Makes the folder if need be.
    pub(crate) fn create(folder: &Path) -> Result<Self, Failure> {
        let made = !folder.exists();
        if !made && !folder.is_dir() {
            let cause = std::io::Error::other("expected a folder for the results, found a file");
            return Err(Failure::write(folder, cause));
        }
        fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
        let _lock = lock(folder)?;
        let (names, outdated) = (Vec::new(), Vec::new());
        Ok(Self {
            folder: folder.to_owned(),
            made,
            names,
            outdated,
            committed: false,
            is_unwritten: false,
            kept: None,
            _lock,
        })
    }

    /// Begins a file; it takes its name at [`OutputFolder::commit`].
    pub(crate) fn begin(&mut self, name: impl Into<Cow<'static, str>>) -> Result<File, Failure> {
        let name = name.into();
        let file = File::create(self.part(&name)).map_err(|error| Failure::write(self.path(&name), error));
        if !self.has_begun(&name) {
            self.names.push(name);
        }
        file
    }

    /// Writes a whole file.
    pub(crate) fn write(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        write: impl FnOnce(&mut BufWriter<File>) -> Result<(), FormatError>,
    ) -> Result<(), Failure> {
        let name = name.into();
        let mut writer = BufWriter::with_capacity(1 << 16, self.begin(name.clone())?);
        let written = write(&mut writer).and_then(|()| Ok(writer.flush()?));
        self.is_unwritten |= written.is_err();
        written.map_err(|cause| Failure::write(self.path(&name), cause))
    }

    /// Begins a file that stays as it is where another one cannot be written.
    pub(crate) fn begin_kept(&mut self, name: &'static str) -> Result<File, Failure> {
        self.kept = Some(Cow::Borrowed(name));
        self.begin(name)
    }

    /// A file that was begun, and will be begun anew, stays as well, under a name that no other has: which one.
    pub(crate) fn keep(&self, name: &str) -> Result<PathBuf, Failure> {
        let (stem, ending) = name.rsplit_once('.').unwrap_or((name, "part"));
        let free = (1..).map(|number| self.path(&format!("{stem}-{number}.{ending}"))).find(|path| !path.exists());
        let kept = free.unwrap_or_else(|| self.path(name));
        fs::rename(self.part(name), &kept).map_err(|error| Failure::write(&kept, error))?;
        Ok(kept)
    }

    /// Where everything lies.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// A file that the caller writes could not be written.
    pub(crate) fn failed_to_write(&mut self) {
        self.is_unwritten = true;
    }

    /// Writes a value as indented JSON.
    pub(crate) fn write_json(&mut self, name: &'static str, value: &serde_json::Value) -> Result<(), Failure> {
        self.write(name, |writer| Ok(writeln!(writer, "{value:#}")?))
    }

    /// With [`OutputFolder::commit`] a file goes that an earlier run has left and this one does not replace. Whether there is one.
    pub(crate) fn remove_outdated(&mut self, name: String) -> bool {
        let is_there = !self.has_begun(&name) && self.path(&name).is_file();
        if is_there {
            self.outdated.push(name);
        }
        is_there
    }

    /// Whether a file of that name is begun.
    pub(crate) fn has_begun(&self, name: &str) -> bool {
        self.names.iter().any(|begun| begun == name)
    }

    /// The files that are begun, in order.
    pub(crate) fn names(&self) -> &[Cow<'static, str>] {
        &self.names
    }

    /// Gives every file its name.
    pub(crate) fn commit(mut self) -> Result<Vec<Cow<'static, str>>, Failure> {
        for name in &self.names {
            let path = self.path(name);
            fs::rename(self.part(name), &path).map_err(|error| Failure::write(path, error))?;
        }
        for name in &self.outdated {
            let path = self.path(name);
            fs::remove_file(&path).map_err(|error| Failure::write(path, error))?;
        }
        self.committed = true;
        Ok(std::mem::take(&mut self.names))
    }

    /// Where a file will lie.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn part(&self, name: &str) -> PathBuf {
        part_of(&self.folder, name)
    }
}

/// Takes the folder, which another run may be filling.
fn lock(folder: &Path) -> Result<File, Failure> {
    let path = folder.join(LOCK);
    loop {
        let file = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|error| Failure::write(folder, error))?;
        match file.try_lock() {
            // Whoever had it may have removed the file in between: then it keeps nobody else out.
            Ok(()) if is_removed(&file) => {}
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) => {
                let cause =
                    "another run of mapwright is writing its results there; wait for it, or choose another folder";
                return Err(Failure::write(folder, std::io::Error::other(cause)));
            }
            Err(TryLockError::Error(error)) => return Err(Failure::write(folder, error)),
        }
    }
}

#[cfg(unix)]
fn is_removed(file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.metadata().is_ok_and(|known| known.nlink() == 0)
}

/// Elsewhere a file that is open keeps its name.
#[cfg(not(unix))]
fn is_removed(_: &File) -> bool {
    false
}

/// Where a file of a folder lies until all are complete.
pub(crate) fn part_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.part"))
}

/// Writes a file that appears under its name only when it is complete.
pub(crate) fn write_whole<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let Some(name) = path.file_name() else {
        return Err(Failure::write(path, std::io::Error::other("expected a file's name")));
    };
    let part = path.with_file_name(format!(".{}.part", name.to_string_lossy()));
    let failed = |error| Failure::write(path, error);
    let file = File::create(&part).map_err(failed)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    let written = write(&mut writer).and_then(|made| writer.flush().map_err(failed).map(|()| made));
    drop(writer);
    let named = written.and_then(|made| fs::rename(&part, path).map_err(failed).map(|()| made));
    if named.is_err() {
        let _ = fs::remove_file(&part); // nothing helps where that fails as well
    }
    named
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        // Nothing helps where cleaning up fails as well.
        let is_kept = |name: &Cow<'static, str>| self.is_unwritten && self.kept.as_ref() == Some(name);
        for name in self.names.iter().filter(|name| !self.committed && !is_kept(name)) {
            let _ = fs::remove_file(self.part(name));
        }
        let _ = fs::remove_file(self.folder.join(LOCK));
        if self.committed {
            return;
        }
        if self.made {
            let _ = fs::remove_dir(&self.folder);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    #[test]
    fn what_was_mapped_stays_where_another_file_cannot_be_written() {
        let folder = std::env::temp_dir().join(format!("mapwright-output-{}", std::process::id()));
        for is_full in [false, true] {
            let _ = fs::remove_dir_all(&folder);
            let mut output = OutputFolder::create(&folder).unwrap();
            output.begin_kept("session.mapwright").unwrap().write_all(b"a session").unwrap();
            if is_full {
                let full = |_: &mut BufWriter<File>| Err(std::io::Error::from(std::io::ErrorKind::StorageFull).into());
                assert!(output.write("map.pgm", full).is_err());
            }
            drop(output);
            let left: Vec<_> =
                fs::read_dir(&folder).into_iter().flatten().map(|file| file.unwrap().file_name()).collect();
            assert_eq!(left.len(), usize::from(is_full), "{left:?}");
        }
        fs::remove_dir_all(&folder).unwrap();
    }
}
