//! The folder of results: files appear under their names only when all of them are complete.

use crate::failure::Failure;
use mapwright_formats::FormatError;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A folder that is being filled. Dropped without [`OutputFolder::commit`], it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct OutputFolder {
    folder: PathBuf,
    made: bool,
    names: Vec<&'static str>,
    committed: bool,
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
        Ok(Self { folder: folder.to_owned(), made, names: Vec::new(), committed: false })
    }

    /// Begins a file; it takes its name at [`OutputFolder::commit`].
    pub(crate) fn begin(&mut self, name: &'static str) -> Result<File, Failure> {
        self.names.push(name);
        File::create(self.part(name)).map_err(|error| Failure::write(self.path(name), error))
    }

    /// Writes a whole file.
    pub(crate) fn write(
        &mut self,
        name: &'static str,
        write: impl FnOnce(&mut BufWriter<File>) -> Result<(), FormatError>,
    ) -> Result<(), Failure> {
        let mut writer = BufWriter::with_capacity(1 << 16, self.begin(name)?);
        let written = write(&mut writer).and_then(|()| Ok(writer.flush()?));
        written.map_err(|cause| Failure::write(self.path(name), cause))
    }

    /// Writes a value as indented JSON.
    pub(crate) fn write_json(&mut self, name: &'static str, value: &serde_json::Value) -> Result<(), Failure> {
        self.write(name, |writer| Ok(writeln!(writer, "{value:#}")?))
    }

    /// Gives every file its name.
    pub(crate) fn commit(mut self) -> Result<Vec<&'static str>, Failure> {
        for name in &self.names {
            let path = self.path(name);
            fs::rename(self.part(name), &path).map_err(|error| Failure::write(path, error))?;
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
        if self.committed {
            return;
        }
        // Nothing helps where cleaning up fails as well.
        for name in &self.names {
            let _ = fs::remove_file(self.part(name));
        }
        if self.made {
            let _ = fs::remove_dir(&self.folder);
        }
    }
}
