//! A log as it is read: from a file or the standard input, until it or the user ends.

use crate::failure::Failure;
use crate::terminal::count;
use mapwright_formats::{CarmenReader, FormatError, LogEvent, LogStream, ReadReport, open_log};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::cell::Cell;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a process that a second Ctrl-C ends at once.
const KILLED_BY_INTERRUPT: i32 = 130;

/// A log that is being read.
pub(crate) struct Log {
    path: PathBuf,
    /// Size on disk, where that is known.
    pub(crate) size_bytes: Option<u64>,
    read_bytes: Rc<Cell<u64>>,
    reader: CarmenReader<LogStream<Counted>>,
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
    /// Opens a file, or the standard input for `-`.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        let (source, size_bytes): (Box<dyn Read>, _) = if path == Path::new("-") {
            (Box::new(io::stdin()), None)
        } else {
            let (file, size_bytes) = open_file(path)?;
            (Box::new(file), size_bytes)
        };
        let read_bytes = Rc::new(Cell::new(0));
        let counted = Counted { source, read_bytes: Rc::clone(&read_bytes) };
        let stream = open_log(counted).map_err(|cause| Failure::read(path, cause))?;
        Ok(Self { path: path.to_owned(), size_bytes, read_bytes, reader: CarmenReader::new(stream) })
    }

    /// Name for reports.
    pub(crate) fn name(&self) -> String {
        if self.path == Path::new("-") { "standard input".to_owned() } else { self.path.display().to_string() }
    }

    /// The next event, or none at the end of the log.
    pub(crate) fn next_event(&mut self) -> Result<Option<LogEvent<'_>>, Failure> {
        self.reader.next_event().map_err(|cause| Failure::read(&self.path, cause))
    }

    /// Hands each event to `take`, with the number of bytes read of the file so far.
    pub(crate) fn for_each(
        &mut self,
        interrupt: &Interrupt,
        mut take: impl FnMut(LogEvent<'_>, u64) -> Result<(), Failure>,
    ) -> Result<Ending, Failure> {
        let read_bytes = Rc::clone(&self.read_bytes);
        while let Some(event) = self.next_event()? {
            take(event, read_bytes.get())?;
            if interrupt.came() {
                return Ok(Ending::Interrupted);
            }
        }
        Ok(Ending::OfLog)
    }

    /// The reader's report; a log without a single scan is a failure that says what was found instead.
    pub(crate) fn finish(self) -> Result<ReadReport, Failure> {
        let name = self.name();
        let report = self.reader.into_report();
        if report.has_scans() { Ok(report) } else { Err(Failure::NoScan { name, found: found_instead(&report) }) }
    }
}

fn open_file(path: &Path) -> Result<(File, Option<u64>), Failure> {
    let metadata = fs::metadata(path).map_err(|error| Failure::open(path, error))?;
    if metadata.is_dir() {
        return Err(Failure::open(path, "expected a log, found a directory"));
    }
    let file = File::open(path).map_err(|error| Failure::open(path, error))?;
    Ok((file, metadata.is_file().then_some(metadata.len())))
}

fn found_instead(report: &ReadReport) -> String {
    if report.bytes == 0 && report.lines == 0 && report.tear.is_none() {
        return "an empty file".to_owned();
    }
    let mut found = vec![count(report.lines, "line")];
    if report.odometry > 0 {
        found.push(count(report.odometry, "odometry reading"));
    }
    found.extend(report.tear.as_ref().map(FormatError::to_string));
    if let Some(first) = report.drops.values().flat_map(|drops| &drops.first).min_by_key(|dropped| dropped.line) {
        found.push(format!("{} dropped, first {first}", report.dropped_lines()));
    }
    found.join(", ")
}

/// Counts the bytes taken from a source.
struct Counted {
    source: Box<dyn Read>,
    read_bytes: Rc<Cell<u64>>,
}

impl Read for Counted {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let got = self.source.read(out)?;
        self.read_bytes.set(self.read_bytes.get() + got as u64);
        Ok(got)
    }
}

/// Ctrl-C (or a request to terminate): the first asks to stop, the second ends the process at once.
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    pub(crate) fn watch() -> Result<Self, Failure> {
        let asked = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            flag::register_conditional_shutdown(signal, KILLED_BY_INTERRUPT, Arc::clone(&asked))
                .and_then(|_| flag::register(signal, Arc::clone(&asked)))
                .map_err(Failure::Signals)?;
        }
        Ok(Self(asked))
    }

    pub(crate) fn came(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
