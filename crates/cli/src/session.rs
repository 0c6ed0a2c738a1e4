//! `session.mapwright`: the log of a run, written while it maps, and what `mapwright export` makes of it.

use crate::drawing::draw_map;
use crate::failure::Failure;
use crate::image::{MapImage, map_image};
use crate::output::{OutputFolder, part_of};
use mapwright::{Entry, SeparateMap, Session, Settings, SpaceSweep, Sweep};
use mapwright_record::{LogError, LogReport, LogWriter, Measurement, SESSION_MAGIC, checkpoint_end, read_log};
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Its name in the folder of results.
pub(crate) const SESSION: &str = "session.mapwright";
/// What is not in the file yet is written after so much time, or once there is so much of it, bytes.
const WRITE_AFTER: Duration = Duration::from_millis(250);
const WRITE_FROM_BYTES: usize = 1 << 18;

/// A run's log, as it grows: the session so far, and its file.
pub(crate) struct SessionLog<M: Measurement = Sweep> {
    session: Session<M>,
    writer: LogWriter<M>,
    file: File,
    path: PathBuf,
    unwritten: Vec<u8>,
    written: Instant,
    /// Bytes so far.
    bytes: usize,
    /// Of these, how many are in the file, whole entries.
    in_file: u64,
}

impl<M: Measurement> SessionLog<M> {
    /// A new log, or one that begins with all of an earlier session.
    pub(crate) fn begin(output: &mut OutputFolder, earlier: Option<&Session<M>>) -> Result<Self, Failure> {
        let mut log = Self {
            session: earlier.cloned().unwrap_or_default(),
            writer: earlier.map_or_else(LogWriter::new, LogWriter::resume),
            file: output.begin_kept(SESSION)?,
            path: output.path(SESSION),
            unwritten: earlier.map_or_else(Vec::new, Session::encode),
            written: Instant::now(),
            bytes: 0,
            in_file: 0,
        };
        // From now on it is a log, be it empty.
        log.finish()?;
        Ok(log)
    }

    /// All that was recorded.
    pub(crate) fn session(&self) -> &Session<M> {
        &self.session
    }

    /// Takes entries down, and writes them before long.
    pub(crate) fn add(&mut self, entries: Vec<Entry<M>>) -> Result<(), Failure> {
        let before = self.unwritten.len();
        for entry in entries {
            let appended = self.writer.append(&mut self.unwritten, &entry).and_then(|()| self.session.add(entry));
            appended.map_err(|cause| Failure::write(&self.path, std::io::Error::other(cause)))?;
        }
        self.bytes += self.unwritten.len() - before;
        if self.unwritten.len() >= WRITE_FROM_BYTES || self.written.elapsed() >= WRITE_AFTER {
            self.write()?;
        }
        Ok(())
    }

    /// Bytes of all that was added to what it began with.
    pub(crate) fn added_bytes(&self) -> usize {
        self.bytes
    }

    /// Nothing more comes: writes all that is left.
    pub(crate) fn finish(&mut self) -> Result<(), Failure> {
        self.writer.finish(&mut self.unwritten);
        self.write()
    }

    /// What cannot be written now is tried again with what comes next; of what was written in part nothing stays, so that the file is whole.
    fn write(&mut self) -> Result<(), Failure> {
        self.written = Instant::now();
        if let Err(error) = self.file.write_all(&self.unwritten) {
            // nothing helps where that fails as well
            let _ = self.file.set_len(self.in_file).and_then(|()| self.file.seek(SeekFrom::Start(self.in_file)));
            return Err(Failure::write(&self.path, error));
        }
        self.in_file += self.unwritten.len() as u64;
        self.unwritten.clear();
        Ok(())
    }
}

/// A session of either kind.
#[derive(Debug)]
pub enum AnySession {
    /// Of planar lasers or sonars.
    Plane(Session),
    /// Of sensors in space.
    Space(Session<SpaceSweep>),
}

/// The session of a folder of results, that of a run that was cut short in it, or that file itself, and what was lost of it in
/// words. A log's entries belong to runs, and runs have a kind.
pub(crate) fn read_any_session(path: &Path) -> Result<(AnySession, Vec<String>), Failure> {
    let (path, bytes) = read_bytes(path)?;
    let (plane, losses) = in_words(&path, Session::read(&bytes))?;
    if plane.runs().len() == 0 {
        let (space, losses) = in_words(&path, read_log::<SpaceSweep>(&bytes))?;
        if space.runs().len() > 0 {
            return Ok((AnySession::Space(space), losses));
        }
    }
    Ok((AnySession::Plane(plane), losses))
}

/// The planar session of a folder of results that another run is about to write to.
pub(crate) fn to_go_on_with(folder: &Path) -> Result<(Session, Vec<String>), Failure> {
    newest_of(folder, &earlier_in_plane, |(session, _)| session.scans().len())
}

/// The session in space of such a folder.
pub(crate) fn to_go_on_with_in_space(folder: &Path) -> Result<EarlierInSpace, Failure> {
    newest_of(folder, &earlier_in_space, |earlier| earlier.session.scans().len())
}

/// What a folder's session is: that of a run that was killed in it, where there is more of it. From now on it is the folder's, whatever
/// becomes of what comes.
fn newest_of<T>(
    folder: &Path,
    read: &dyn Fn(&Path) -> Result<T, Failure>,
    scans: impl Fn(&T) -> usize,
) -> Result<T, Failure> {
    let (whole, part) = (folder.join(SESSION), part_of(folder, SESSION));
    let killed = if part.exists() { Some(read(&part)?) } else { None };
    let finished = if whole.exists() || killed.is_none() { Some(read(&whole)?) } else { None };
    match (killed, finished) {
        (Some(killed), finished) if finished.as_ref().is_none_or(|finished| scans(finished) < scans(&killed)) => {
            fs::rename(&part, &whole).map_err(|error| Failure::write(&whole, error))?;
            Ok(killed)
        }
        (_, Some(finished)) => Ok(finished),
        (_, None) => Err(Failure::open(&whole, "there is no session to go on with")),
    }
}

/// Whether a session is what lies at a path, told by its first bytes, or in a folder.
pub(crate) fn is_session(path: &Path) -> Result<bool, Failure> {
    if path.is_dir() {
        return Ok(in_folder(path).exists());
    }
    let mut first = Vec::new();
    let read = File::open(path).and_then(|file| file.take(SESSION_MAGIC.len() as u64).read_to_end(&mut first));
    read.map_err(|error| Failure::open(path, error))?;
    Ok(first == SESSION_MAGIC)
}

/// The planar session that a run goes on with.
pub(crate) fn earlier_in_plane(path: &Path) -> Result<(Session, Vec<String>), Failure> {
    match read_any_session(path)? {
        (AnySession::Plane(session), losses) => Ok((session, losses)),
        (AnySession::Space(_), _) => Err(of_other_kind(path, "space", "a planar laser")),
    }
}

/// A session in space that a run goes on with.
pub(crate) struct EarlierInSpace {
    /// All of it.
    pub(crate) session: Session<SpaceSweep>,
    /// Up to where its mapper last took down all that it knew, where more came after.
    pub(crate) at_checkpoint: Option<Session<SpaceSweep>>,
    /// What of it was lost, in words.
    pub(crate) losses: Vec<String>,
}

/// The session in space that a run goes on with.
pub(crate) fn earlier_in_space(path: &Path) -> Result<EarlierInSpace, Failure> {
    match read_any_session(path)? {
        (AnySession::Space(session), losses) => {
            let (_, bytes) = read_bytes(path)?;
            let end = checkpoint_end(&bytes).filter(|end| *end < bytes.len()).and_then(|end| bytes.get(..end));
            let at_checkpoint = end.map(|bytes| in_words(path, read_log::<SpaceSweep>(bytes))).transpose()?;
            let at_checkpoint = at_checkpoint.map(|(session, _)| session);
            Ok(EarlierInSpace { session, at_checkpoint, losses })
        }
        (AnySession::Plane(session), losses) if session.runs().len() == 0 => {
            Ok(EarlierInSpace { session: Session::default(), at_checkpoint: None, losses })
        }
        (AnySession::Plane(_), _) => Err(of_other_kind(path, "the plane", "a sensor in space")),
    }
}

fn of_other_kind(path: &Path, kind: &str, log: &str) -> Failure {
    let cause = format!("it is of {kind}, and a log of {log} cannot go on with it");
    Failure::Session { path: path.to_owned(), cause }
}

/// The bytes of a folder's session, or of that file.
pub(crate) fn read_bytes(path: &Path) -> Result<(PathBuf, Vec<u8>), Failure> {
    let path = if path.is_dir() { in_folder(path) } else { path.to_owned() };
    let bytes = fs::read(&path).map_err(|error| Failure::open(&path, format!("{error}; `mapwright map` writes it")))?;
    Ok((path, bytes))
}

fn in_words<M: Measurement>(
    path: &Path,
    read: Result<(Session<M>, LogReport), LogError>,
) -> Result<(Session<M>, Vec<String>), Failure> {
    let (session, report) =
        read.map_err(|cause| Failure::Session { path: path.to_owned(), cause: cause.to_string() })?;
    let losses = report.losses.iter().map(|loss| format!("{}: {loss}", path.display())).collect();
    Ok((session, losses))
}

fn in_folder(folder: &Path) -> PathBuf {
    let (whole, part) = (folder.join(SESSION), part_of(folder, SESSION));
    if !whole.exists() && part.exists() { part } else { whole }
}

/// One of the maps of a session, drawn anew.
pub(crate) fn map_of(session: &Session, map: &SeparateMap, path: &Path) -> Result<MapImage, Failure> {
    let settings = settings_of(session, path)?;
    let counts = draw_map(&settings, session, map);
    Ok(map_image(&counts, settings.map.passes_per_hit))
}

/// The settings of the last run; files of version 1 have them as JSON.
pub(crate) fn settings_of<M: Measurement>(session: &Session<M>, path: &Path) -> Result<Settings, Failure> {
    let failed = |cause: String| Failure::Session { path: path.to_owned(), cause: format!("its settings: {cause}") };
    let text = session.runs().last().map_or("", |run| run.settings.as_str());
    if !text.starts_with('{') {
        return Settings::from_text(text).map_err(|error| failed(error.to_string()));
    }
    let settings: Settings = serde_json::from_str(text).map_err(|error| failed(error.to_string()))?;
    settings.validate()?;
    Ok(settings)
}
