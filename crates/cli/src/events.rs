//! Logs as they are read: from files or the standard input, until they or the user end.

use crate::failure::Failure;
use crate::foreign::{HEAD_BYTES, folder_in_words, kind_of, plain_beginning, plain_head};
pub(crate) use crate::interrupt::Interrupt;
use crate::reading::{Reading, found_instead};
use mapwright_formats::LogEvent;
use mapwright_logs::{Choice, Drive, Input, LogReport};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Logs that are being read.
pub(crate) struct Log {
    names: Vec<String>,
    sizes_bytes: Vec<Option<u64>>,
    drive: Drive,
    takes_sonars: bool,
}

/// How reading ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// At the log's end, or at its tear.
    OfLog,
    /// By Ctrl-C.
    Interrupted,
}

impl Log {
    /// Opens a log, or the standard input for `-`, and takes what is found in it, with the stamps that it has.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        let choice = Choice { odometry_as_stamped: true, ..Choice::default() };
        Self::open_all(&[path.to_owned()], &choice, &mut |_, _| true)
    }

    /// Opens logs of one drive; while recordings are looked through, `watch` hears their names and how many messages were.
    pub(crate) fn open_all(
        paths: &[PathBuf],
        choice: &Choice,
        watch: &mut dyn FnMut(&str, u64) -> bool,
    ) -> Result<Self, Failure> {
        let inputs: Result<Vec<_>, Failure> = paths.iter().map(|path| Ok((name_of(path), input(path)?))).collect();
        Self::of(inputs?, paths, choice, watch)
    }

    /// Reads inputs that are found at these paths.
    pub(crate) fn of(
        inputs: Vec<(String, Input)>,
        paths: &[PathBuf],
        choice: &Choice,
        watch: &mut dyn FnMut(&str, u64) -> bool,
    ) -> Result<Self, Failure> {
        let names = inputs.iter().map(|(name, _)| name.clone()).collect();
        let sizes_bytes = paths.iter().map(|path| size_bytes(path)).collect();
        let drive = Drive::open_watched(inputs, choice, watch).map_err(Failure::log)?;
        Ok(Self { names, sizes_bytes, drive, takes_sonars: false })
    }

    /// The same, where readings of sonars are of use without a laser's scans.
    pub(crate) fn taking_sonars(mut self) -> Self {
        self.takes_sonars = true;
        self
    }

    /// Size on disk, where that is known of all.
    pub(crate) fn size_bytes(&self) -> Option<u64> {
        self.sizes_bytes.iter().copied().sum()
    }

    /// Name for reports.
    pub(crate) fn name(&self) -> String {
        self.names.join(", ")
    }

    /// By how much odometry was found to lag behind the scans, seconds, and was put right.
    pub(crate) fn lag_s(&self) -> f64 {
        self.drive.lag().map_or(0.0, |lag| lag.lag_s)
    }

    /// The next event, or none at the end of the last log.
    pub(crate) fn next_event(&mut self) -> Result<Option<LogEvent<'_>>, Failure> {
        self.drive.next_event().map_err(Failure::log)
    }

    /// Hands each event to `take`, with the number of bytes read of the files so far.
    pub(crate) fn for_each(
        &mut self,
        interrupt: &Interrupt,
        mut take: impl FnMut(LogEvent<'_>, u64) -> Result<(), Failure>,
    ) -> Result<Ending, Failure> {
        loop {
            let position = self.position();
            let Some(event) = self.next_event()? else { return Ok(Ending::OfLog) };
            take(event, position)?;
            if interrupt.came() {
                return Ok(Ending::Interrupted);
            }
        }
    }

    fn position(&self) -> u64 {
        let part = self.drive.part();
        let before: u64 = self.sizes_bytes.iter().take(part).flatten().sum();
        before + self.drive.read_of_part(self.sizes_bytes.get(part).copied().flatten().unwrap_or(0))
    }

    /// The readers' reports; logs without a single scan are a failure that says what was found instead.
    pub(crate) fn finish(self) -> Result<Reading, Failure> {
        let (name, notes) = (self.name(), self.drive.notes().to_vec());
        let logs = self.drive.into_reports();
        let is_of_use = |report: &LogReport| report.scans() > 0 || self.takes_sonars && report.sonar_readings() > 0;
        if !logs.iter().any(|(_, report)| is_of_use(report)) {
            return Err(Failure::NoScan { name, found: found_instead(&logs) });
        }
        Ok(Reading { logs, notes })
    }
}

/// A log's name for reports.
pub(crate) fn name_of(path: &Path) -> String {
    if path == Path::new("-") { "standard input".to_owned() } else { path.display().to_string() }
}

fn size_bytes(path: &Path) -> Option<u64> {
    let metadata = fs::metadata(path).ok().filter(|_| path != Path::new("-"))?;
    if !metadata.is_dir() {
        return metadata.is_file().then_some(metadata.len());
    }
    let files = fs::read_dir(path).ok()?.filter_map(|entry| entry.ok()?.metadata().ok());
    Some(files.filter(fs::Metadata::is_file).map(|file| file.len()).sum())
}

/// What lies at a path, told by its first bytes; all that is no recording is read as a CARMEN log.
pub(crate) fn input(path: &Path) -> Result<Input, Failure> {
    let failed = |error| Failure::open(path, error);
    if path == Path::new("-") {
        return streamed(io::stdin(), path, false);
    }
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_dir() {
        return streamed(File::open(path).map_err(failed)?, path, metadata.is_file());
    }
    let names = names_in(path);
    let is_results = names.iter().any(|name| name == "session.mapwright");
    if !is_results && !mapwright_bags::FolderContents::of(&names).parts.is_empty() {
        return Ok(Input::Recording(path.to_owned()));
    }
    Err(Failure::open(path, folder_in_words(path, &names)))
}

fn streamed(mut source: impl Read + 'static, path: &Path, is_file: bool) -> Result<Input, Failure> {
    let mut head = Vec::new();
    let read = source.by_ref().take(HEAD_BYTES).read_to_end(&mut head);
    read.map_err(|error| Failure::Read { path: path.to_owned(), cause: error.to_string() })?;
    let plain = if is_file && is_named_recording(path) { plain_beginning(path) } else { plain_head(&head) };
    if Input::is_recording(&head) || Input::is_recording(&plain) {
        return match is_file {
            true => Ok(Input::Recording(path.to_owned())),
            false => Err(Failure::open(path, "expected a file, found a stream: recordings are read twice")),
        };
    }
    match kind_of(&plain).filter(|kind| !kind.is_log()) {
        Some(kind) => Err(Failure::Log(kind.instead(&name_of(path), "a log of laser scans"))),
        None => Ok(Input::Carmen(Box::new(io::Cursor::new(head).chain(source)))),
    }
}

/// Whether the name says so of a file compressed by bzip2, of which little can be known from its first bytes.
fn is_named_recording(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    [".bag.bz2", ".mcap.bz2", ".db3.bz2"].iter().any(|ending| name.ends_with(ending))
}

fn names_in(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<_> = names.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    names.sort();
    names
}
