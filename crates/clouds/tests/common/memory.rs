//! A folder that is not on disk.

use mapwright_clouds::Folder;
use std::collections::BTreeMap;
use std::io;

/// Files by name, before those of another folder.
#[derive(Default)]
pub(crate) struct Memory<'a> {
    pub(crate) files: BTreeMap<String, Vec<u8>>,
    pub(crate) behind: Option<&'a dyn Folder>,
}

impl Memory<'_> {
    pub(crate) fn with(mut self, name: &str, bytes: impl Into<Vec<u8>>) -> Self {
        self.files.insert(name.to_owned(), bytes.into());
        self
    }
}

impl Folder for Memory<'_> {
    fn names(&self) -> Vec<String> {
        let behind = self.behind.map_or_else(Vec::new, Folder::names);
        self.files.keys().cloned().chain(behind).collect()
    }

    fn read(&self, name: &str) -> io::Result<Vec<u8>> {
        match (self.files.get(name), self.behind) {
            (Some(bytes), _) => Ok(bytes.clone()),
            (None, Some(behind)) => behind.read(name),
            (None, None) => Err(io::ErrorKind::NotFound.into()),
        }
    }
}
