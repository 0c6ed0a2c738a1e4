//! A large file, of which a piece is held.

use crate::error::CloudError;
use crate::folder::Folder;

/// So many bytes are read at once.
const PIECE_BYTES: usize = 4 << 20;
/// Of these, so many lie before the place that was asked for: who looks for the next packet goes back and forth by two packets.
const BACK_BYTES: usize = 1 << 20;

/// A file that is read piece by piece.
pub(crate) struct Window<'a> {
    folder: &'a dyn Folder,
    pub(crate) file: String,
    begin: usize,
    piece: Vec<u8>,
    /// Where the file ends, once that was seen.
    end: Option<usize>,
    failure: Option<CloudError>,
}

impl<'a> Window<'a> {
    pub(crate) fn open(folder: &'a dyn Folder, file: &str) -> Self {
        Self { folder, file: file.to_owned(), begin: 0, piece: Vec::new(), end: None, failure: None }
    }

    /// Bytes from a place on; none where the file ends before `count` of them, or cannot be read there.
    pub(crate) fn get(&mut self, at: usize, count: usize) -> Option<&[u8]> {
        let is_there = at >= self.begin && at.checked_add(count)? <= self.begin + self.piece.len();
        if !is_there && !self.load(at, count) {
            return None;
        }
        self.piece.get(at.checked_sub(self.begin)?..)?.get(..count)
    }

    /// Loads a piece with `count` bytes from a place on.
    fn load(&mut self, at: usize, count: usize) -> bool {
        if self.failure.is_some() || self.end.is_some_and(|end| at.saturating_add(count) > end) {
            return false;
        }
        let begin = at.saturating_sub(BACK_BYTES);
        let wanted = (at - begin).saturating_add(count).max(PIECE_BYTES);
        match self.folder.read_part(&self.file, begin as u64, wanted) {
            Ok(piece) => {
                if piece.len() < wanted {
                    self.end = Some(begin + piece.len());
                }
                (self.begin, self.piece) = (begin, piece);
                at.saturating_add(count) <= self.begin + self.piece.len()
            }
            // what is not there is not asked for again
            Err(cause) => {
                self.failure = Some(CloudError::Io { file: self.file.clone(), cause });
                false
            }
        }
    }

    /// Whether the file goes on at a place.
    pub(crate) fn goes_on(&mut self, at: usize) -> bool {
        self.get(at, 1).is_some()
    }

    /// Why it could not be read to its end.
    pub(crate) fn failure(&self) -> Option<&CloudError> {
        self.failure.as_ref()
    }

    pub(crate) fn take_failure(&mut self) -> Option<CloudError> {
        self.failure.take()
    }
}

/// A file in memory, for tests.
#[cfg(test)]
pub(super) mod in_memory {
    use crate::folder::Folder;
    use std::io;

    pub(crate) struct File<'a>(pub(crate) &'a [u8]);

    impl Folder for File<'_> {
        fn names(&self) -> Vec<String> {
            vec!["a.pcap".to_owned()]
        }

        fn read(&self, _: &str) -> io::Result<Vec<u8>> {
            Ok(self.0.to_vec())
        }
    }
}
