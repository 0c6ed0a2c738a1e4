//! What can be told of a database without SQLite.

use crate::error::BagError;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// What the beginning and the end of a database and its folder say.
#[derive(Debug, Clone)]
pub(super) struct DatabaseHead {
    pub(super) file_bytes: u64,
    /// Pages times their size, where the header says so.
    pub(super) expected_bytes: u64,
    /// Whether changes are kept beside the database that are not yet in it.
    pub(super) has_log: bool,
    /// Where the first bytes are not those of a database.
    pub(super) strange_byte: Option<usize>,
    /// The last bytes before the tear, without zeros at their end, where the file ends within a page.
    pub(super) torn_tail: Option<Vec<u8>>,
}

pub(super) fn database_head(path: &Path) -> Result<DatabaseHead, BagError> {
    let read = || -> io::Result<DatabaseHead> {
        let mut file = File::open(path)?;
        let file_bytes = file.metadata()?.len();
        let mut head = Vec::new();
        Read::by_ref(&mut file).take(100).read_to_end(&mut head)?;
        let number = |at: usize, n: usize| {
            head.get(at..at + n).map_or(0, |bytes| bytes.iter().fold(0_u64, |sum, byte| sum << 8 | u64::from(*byte)))
        };
        // the number of pages counts where the change counter agrees; 1 stands for pages of 64 KiB
        let page_bytes = if number(16, 2) == 1 { 1 << 16 } else { number(16, 2) };
        let expected_bytes = if number(24, 4) == number(92, 4) { number(28, 4) * page_bytes } else { 0 };
        let is_torn = page_bytes > 0 && file_bytes % page_bytes > 0;
        let strange_byte = head.iter().zip(b"SQLite format 3\0").position(|(found, expected)| found != expected);
        let torn_tail = if is_torn { Some(tail(&mut file, file_bytes, page_bytes)?) } else { None };
        let mut log = path.as_os_str().to_owned();
        log.push("-wal");
        let has_log = fs::metadata(log).is_ok_and(|log| log.len() > 0);
        Ok(DatabaseHead { file_bytes, expected_bytes, has_log, strange_byte, torn_tail })
    };
    read().map_err(|cause| BagError::at(path, cause))
}

/// The last bytes of a torn page that are not zero.
fn tail(file: &mut File, file_bytes: u64, page_bytes: u64) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    file.seek(SeekFrom::Start(file_bytes / page_bytes * page_bytes))?;
    file.take(page_bytes).read_to_end(&mut page)?;
    let end = page.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    Ok(page[end.saturating_sub(16)..end].to_vec())
}
