//! Where the bytes come from.

use crate::error::CloudError;
use std::collections::BTreeSet;
use std::io;

/// The files of a recording: those below a folder, or a single one. Implemented by who may open files.
pub trait Folder: Sync {
    /// The paths of all files below the folder, with `/` between the names of folders; in any order.
    fn names(&self) -> Vec<String>;

    /// All bytes of one of them.
    ///
    /// # Errors
    /// Whatever keeps the file from being read.
    fn read(&self, name: &str) -> io::Result<Vec<u8>>;

    /// A part of one of them: `count` bytes from a place on, fewer only where it ends before. Worth writing where files are large:
    /// this one reads all.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    fn read_part(&self, name: &str, offset_bytes: u64, count: usize) -> io::Result<Vec<u8>> {
        let bytes = self.read(name)?;
        let begin = usize::try_from(offset_bytes).unwrap_or(usize::MAX).min(bytes.len());
        let end = begin.saturating_add(count).min(bytes.len());
        Ok(bytes[begin..end].to_vec())
    }
}

/// So many files tell what the others are: the first may be damaged.
const LOOKED_AT: usize = 3;
/// So many bytes tell what a file is.
const HEAD_BYTES: usize = 4096;

/// A folder and what it holds, sorted.
pub(crate) struct Listing<'a> {
    pub(crate) folder: &'a dyn Folder,
    names: BTreeSet<String>,
}

impl<'a> Listing<'a> {
    pub(crate) fn of(folder: &'a dyn Folder) -> Self {
        Self { folder, names: folder.names().into_iter().collect() }
    }

    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.names.contains(name)
    }

    /// The only file, if there is but one.
    pub(crate) fn only(&self) -> Option<&str> {
        self.names().next().filter(|_| self.names.len() == 1)
    }

    pub(crate) fn read(&self, name: &str) -> Result<Vec<u8>, CloudError> {
        read(self.folder, name)
    }

    /// Enough of a file to know it by.
    pub(crate) fn head(&self, name: &str) -> Result<Vec<u8>, CloudError> {
        let head = self.folder.read_part(name, 0, HEAD_BYTES);
        head.map_err(|cause| CloudError::Io { file: name.to_owned(), cause })
    }

    /// Whether one of the first files at least is what it should be.
    ///
    /// # Errors
    /// What is wrong with the first of them.
    pub(crate) fn check_first(
        &self,
        names: &[String],
        check: impl Fn(&str) -> Result<(), CloudError>,
    ) -> Result<(), CloudError> {
        let mut first = None;
        for name in names.iter().take(LOOKED_AT) {
            match check(name) {
                Ok(()) => return Ok(()),
                Err(error) => first = first.or(Some(error)),
            }
        }
        first.map_or(Ok(()), Err)
    }

    /// The files that `is_wanted` takes, of one folder: the topmost if there are any in it, else the only one.
    ///
    /// # Errors
    /// [`CloudError::Several`] where several folders have some.
    pub(crate) fn in_one_folder(&self, is_wanted: impl Fn(&str) -> bool) -> Result<Vec<String>, CloudError> {
        let wanted: Vec<&str> = self.names().filter(|name| is_wanted(parts(name).1)).collect();
        let parents: BTreeSet<&str> = wanted.iter().map(|name| parts(name).0).collect();
        let parent = match parents.first() {
            Some(first) if first.is_empty() || parents.len() == 1 => *first,
            Some(_) => {
                let folders = parents.iter().take(10).map(|parent| parent.trim_end_matches('/').to_owned()).collect();
                return Err(CloudError::Several { folders });
            }
            None => return Ok(Vec::new()),
        };
        let mut names: Vec<String> =
            wanted.into_iter().filter(|name| parts(name).0 == parent).map(str::to_owned).collect();
        names.sort_by_cached_key(|name| natural_key(name));
        Ok(names)
    }
}

pub(crate) fn read(folder: &dyn Folder, name: &str) -> Result<Vec<u8>, CloudError> {
    folder.read(name).map_err(|cause| CloudError::Io { file: name.to_owned(), cause })
}

/// A path's folder, with the last `/`, and its file's name.
pub(crate) fn parts(name: &str) -> (&str, &str) {
    name.rfind('/').map_or(("", name), |slash| name.split_at(slash + 1))
}

/// Whether a file's name ends so, in letters of any case.
pub(crate) fn ends_with(name: &str, ending: &str) -> bool {
    let (name, ending) = (name.as_bytes(), ending.as_bytes());
    name.len() > ending.len() && name[name.len() - ending.len()..].eq_ignore_ascii_case(ending)
}

/// The decimal number that `text` is, if it is one.
pub(crate) fn number(text: &str) -> Option<u64> {
    let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    digits.then(|| text.parse().ok()).flatten()
}

/// Orders names as people count: `a2` before `a10`. Runs of digits compare by length without zeros in front, then by digits.
pub(crate) fn natural_key(name: &str) -> Vec<(usize, String)> {
    let mut key = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let digits = first.is_ascii_digit();
        let end = rest.find(|c: char| c.is_ascii_digit() != digits).unwrap_or(rest.len());
        let (run, behind) = rest.split_at(end);
        let run = if digits { run.trim_start_matches('0') } else { run };
        key.push((if digits { run.len() } else { usize::MAX }, run.to_owned()));
        rest = behind;
    }
    key.push((0, name.to_owned()));
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_as_people_count() {
        let mut names = ["b10", "b9", "b09", "a", "b100", "10.5", "9.25"];
        names.sort_by_cached_key(|name| natural_key(name));
        assert_eq!(names, ["9.25", "10.5", "a", "b09", "b9", "b10", "b100"]);
        assert!(ends_with("a.PCD", ".pcd") && !ends_with(".pcd", ".pcd") && !ends_with("ü.pc", ".pcd"));
        assert_eq!((parts("a/b/c.d"), parts("c")), (("a/b/", "c.d"), ("", "c")));
    }
}
