//! A folder or file on disk.

use mapwright_clouds::Folder;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The files below a path.
pub(crate) struct Disk {
    root: PathBuf,
    names: Vec<String>,
}

impl Disk {
    /// Lists what is there; a file is a folder with nothing else in it.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        if path.is_file() {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Ok(Self { root: path.parent().unwrap_or(Path::new("")).to_owned(), names: vec![name] });
        }
        let mut names = Vec::new();
        list(path, "", &mut names)?;
        Ok(Self { root: path.to_owned(), names })
    }
}

fn list(folder: &Path, before: &str, names: &mut Vec<String>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            list(&entry.path(), &format!("{name}/"), names)?;
        } else {
            names.push(name);
        }
    }
    Ok(())
}

impl Folder for Disk {
    fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    fn read(&self, name: &str) -> io::Result<Vec<u8>> {
        std::fs::read(self.root.join(name))
    }

    fn read_part(&self, name: &str, offset_bytes: u64, count: usize) -> io::Result<Vec<u8>> {
        let mut part = Vec::new();
        let mut file = File::open(self.root.join(name))?;
        file.seek(SeekFrom::Start(offset_bytes))?;
        file.take(count as u64).read_to_end(&mut part)?;
        Ok(part)
    }
}
