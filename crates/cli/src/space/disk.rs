//! A folder or file on disk, as readers of clouds ask for it.

use crate::failure::Failure;
use crate::session::SESSION;
use mapwright_clouds::{Folder, Recording, recognise};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// So many files are listed, and folders within folders, at most: a recording has no more.
const FILES_AT_MOST: usize = 2_000_000;
const DEPTH_AT_MOST: usize = 6;
/// Files with such endings may be recordings of space by themselves.
const ENDINGS: [&str; 6] = [".pcap", ".pcapng", ".pcd", ".ply", ".bin", ".zst"];

/// The files below a path.
pub(crate) struct Disk {
    path: PathBuf,
    root: PathBuf,
    names: Vec<String>,
}

impl Disk {
    /// Lists what is there; a file is a folder with nothing else in it. None where it cannot be a recording of space.
    pub(crate) fn open(path: &Path) -> Result<Option<Self>, Failure> {
        if path.is_file() {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let lower = name.to_lowercase();
            if !ENDINGS.iter().any(|ending| lower.ends_with(ending)) {
                return Ok(None);
            }
            let root = path.parent().unwrap_or(Path::new("")).to_owned();
            let names = [Some(name), metadata_beside(path)].into_iter().flatten().collect();
            return Ok(Some(Self { path: path.to_owned(), root, names }));
        }
        // what was exported into a folder of results is no recording
        if !path.is_dir() || path.join(SESSION).exists() {
            return Ok(None);
        }
        let mut names = Vec::new();
        list(path, "", DEPTH_AT_MOST, &mut names)
            .map_err(|error| Failure::Open { path: path.to_owned(), reason: error.to_string() })?;
        Ok(Some(Self { path: path.to_owned(), root: path.to_owned(), names }))
    }

    /// The recording that it holds, if it holds one.
    pub(crate) fn recording(&self) -> Result<Option<Recording<'_>>, Failure> {
        recognise(self).map_err(|cause| Failure::Log(format!("{}: {cause}", self.path.display())))
    }
}

/// A capture of packets may have what its sensor says of itself beside it, in a file of its name.
fn metadata_beside(path: &Path) -> Option<String> {
    let is_capture = path.extension().is_some_and(|ending| ending.to_string_lossy().to_lowercase().starts_with("pcap"));
    let metadata = path.with_extension("json");
    (is_capture && metadata.is_file()).then(|| metadata.file_name().map(|name| name.to_string_lossy().into_owned()))?
}

fn list(folder: &Path, before: &str, depth: usize, names: &mut Vec<String>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        let kind = entry.file_type()?;
        if kind.is_dir() && depth > 0 {
            list(&entry.path(), &format!("{name}/"), depth - 1, names)?;
        } else if !kind.is_dir() && names.len() < FILES_AT_MOST {
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
        let mut file = File::open(self.root.join(name))?;
        file.seek(SeekFrom::Start(offset_bytes))?;
        let mut part = Vec::new();
        file.take(count as u64).read_to_end(&mut part)?;
        Ok(part)
    }
}
