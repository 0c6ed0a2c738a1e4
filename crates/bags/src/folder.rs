//! Recordings by their path: a file or a folder of several. The only place of this crate that opens files.

use crate::catalog::Catalog;
use crate::contents::{FolderContents, METADATA, Metadata};
use crate::decode::limit_bytes;
use crate::error::BagError;
use crate::message::{Connection, RawMessage};
use crate::reader::{BagReader, SQLITE_MAGIC, ZSTD_MAGIC, first_bytes};
use crate::report::{DamageKind, ReadReport};
#[cfg(feature = "sqlite")]
use crate::sqlite::SqliteReader;
use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// No `metadata.yaml` is larger.
const METADATA_BYTES_MAX: u64 = 16 << 20;

/// A recording on disk: a ROS 1 bag, an MCAP file, a database, or a folder of a ROS 2 bag with `metadata.yaml` or without.
///
/// The files of a split recording are read one after the other; a connection that is the same in several of them keeps its
/// id. Files compressed as a whole by zstd, gzip or bzip2 are decompressed into the system's folder for temporary files.
///
/// ```no_run
/// let mut recording = mapwright_bags::Recording::open("drive".as_ref())?;
/// while let Some(message) = recording.next_message()? {
///     println!("{} {}: {} bytes", message.log_stamp.0, message.connection.topic, message.data.len());
/// }
/// for (kind, damages) in &recording.report().damages {
///     eprintln!("{kind}: {} times, first at {}", damages.count, damages.first[0]);
/// }
/// # Ok::<(), mapwright_bags::BagError>(())
/// ```
#[derive(Debug)]
pub struct Recording {
    /// Files still to come.
    parts: VecDeque<PathBuf>,
    part: Option<Part>,
    /// What all files read so far have left, while none is open.
    catalog: Catalog,
}

/// An open file, and the temporary one it was decompressed to.
#[derive(Debug)]
struct Part {
    reader: BagReader<File>,
    _scratch: Option<Scratch>,
}

impl Recording {
    /// Opens a file or a folder.
    ///
    /// # Errors
    ///
    /// [`BagError`] where no file of it can be opened: that of the first.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let mut catalog = Catalog::default();
        let parts = if path.is_dir() { parts_of(path, &mut catalog)? } else { vec![path.to_owned()] };
        let mut recording = Self { parts: parts.into(), part: None, catalog };
        let mut first_error = None;
        while recording.part.is_none() && !recording.parts.is_empty() {
            first_error = first_error.or(recording.open_next());
        }
        match first_error {
            Some(error) if recording.part.is_none() => Err(error),
            _ => Ok(recording),
        }
    }

    /// The connections known so far: from the beginning all those of the first file that its index names.
    #[must_use]
    pub fn connections(&self) -> &[Connection] {
        self.part.as_ref().map_or(&self.catalog.connections, |part| part.reader.connections())
    }

    /// What was read so far, and what was lost.
    #[must_use]
    pub fn report(&self) -> &ReadReport {
        self.part.as_ref().map_or(&self.catalog.report, |part| part.reader.report())
    }

    /// The next message in order of arrival, or none at the end of the last file.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`] where a file fails. Damage is no error: it is in the [`report`](Self::report).
    pub fn next_message(&mut self) -> Result<Option<RawMessage<'_>>, BagError> {
        loop {
            match &mut self.part {
                Some(part) => {
                    if part.reader.advance()? {
                        break;
                    }
                    self.close();
                }
                None if self.parts.is_empty() => return Ok(None),
                None => drop(self.open_next()),
            }
        }
        self.part.as_mut().map_or(Ok(None), |part| part.reader.lend())
    }

    /// Bytes of memory that buffers hold now: never more than a chunk or message, compressed and not.
    #[must_use]
    pub fn held_bytes(&self) -> usize {
        self.part.as_ref().map_or(0, |part| part.reader.held_bytes())
    }

    fn close(&mut self) {
        if let Some(part) = self.part.take() {
            self.catalog = part.reader.into_catalog();
        }
    }

    /// Opens the next file; where that fails, it is damage, and the error is returned.
    fn open_next(&mut self) -> Option<BagError> {
        let path = self.parts.pop_front()?;
        let mut catalog = std::mem::take(&mut self.catalog);
        catalog.report.parts.push(path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        match open_file(&path, catalog) {
            Ok(part) => {
                self.part = Some(part);
                None
            }
            Err((error, catalog)) => {
                self.catalog = *catalog;
                self.catalog.damage(DamageKind::BadPart, 0, "a readable file", error.to_string(), 0);
                Some(error)
            }
        }
    }
}

/// The files of a folder in their order.
fn parts_of(folder: &Path, catalog: &mut Catalog) -> Result<Vec<PathBuf>, BagError> {
    let names = names_in(folder).map_err(|cause| BagError::at(folder, cause))?;
    let mut contents = FolderContents::of(&names);
    if contents.has_metadata {
        match read_metadata(&folder.join(METADATA)) {
            Ok(metadata) => {
                for missing in contents.arrange(&metadata) {
                    catalog.damage(DamageKind::BadPart, 0, format!("file {missing} of {METADATA}"), "none", 0);
                }
            }
            Err(found) => catalog.damage(DamageKind::BadMetadata, 0, format!("a readable {METADATA}"), found, 0),
        }
    }
    if contents.parts.is_empty() {
        let found = if names.is_empty() { "nothing".to_owned() } else { names.join(", ").chars().take(200).collect() };
        return Err(BagError::EmptyFolder { path: folder.display().to_string(), found });
    }
    Ok(contents.parts.iter().map(|name| folder.join(name)).collect())
}

fn names_in(folder: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        names.extend(entry?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

fn read_metadata(path: &Path) -> Result<Metadata, String> {
    let mut text = Vec::new();
    let read = File::open(path).and_then(|file| file.take(METADATA_BYTES_MAX).read_to_end(&mut text));
    read.map_err(|error| error.to_string())?;
    Metadata::parse(&String::from_utf8_lossy(&text))
}

fn open_file(path: &Path, mut catalog: Catalog) -> Result<Part, (BagError, Box<Catalog>)> {
    match File::open(path)
        .map_err(|cause| BagError::at(path, cause))
        .and_then(|file| unpacked(path, file, &mut catalog))
    {
        Ok((file, scratch)) => {
            let path = scratch.as_ref().map_or(path, |scratch| &scratch.path);
            Ok(Part { reader: open_plain(path, file, catalog)?, _scratch: scratch })
        }
        Err(error) => Err((error, Box::new(catalog))),
    }
}

fn open_plain(path: &Path, mut file: File, catalog: Catalog) -> Result<BagReader<File>, (BagError, Box<Catalog>)> {
    match first_bytes(&mut file) {
        Ok(first) if first == SQLITE_MAGIC => open_database(path, catalog),
        Ok(_) => BagReader::open_part(file, catalog),
        Err(error) => Err((error, Box::new(catalog))),
    }
}

#[cfg(feature = "sqlite")]
fn open_database(path: &Path, catalog: Catalog) -> Result<BagReader<File>, (BagError, Box<Catalog>)> {
    Ok(SqliteReader::open_part(path, catalog)?.into())
}

#[cfg(not(feature = "sqlite"))]
fn open_database(_: &Path, catalog: Catalog) -> Result<BagReader<File>, (BagError, Box<Catalog>)> {
    Err((BagError::WithoutSqlite, Box::new(catalog)))
}

/// A temporary file that is gone when it is no longer used.
#[derive(Debug)]
struct Scratch {
    path: PathBuf,
}

impl Scratch {
    fn create() -> Result<(Self, File), BagError> {
        let folder = std::env::temp_dir();
        let mut number = 0_u64;
        loop {
            let path = folder.join(format!("mapwright-bags-{number}"));
            match File::options().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => return Ok((Self { path }, file)),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists && number < 1 << 20 => number += 1,
                Err(cause) => return Err(BagError::at(&path, cause)),
            }
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path); // nothing can be done about it
    }
}

/// Compressions of whole files, each with its first bytes.
#[derive(Debug, Clone, Copy)]
enum Packing {
    Zstd,
    Gzip,
    Bzip2,
}

impl Packing {
    fn of(first: &[u8]) -> Option<Self> {
        let known: [(&[u8], Self); 3] =
            [(ZSTD_MAGIC, Self::Zstd), (&[0x1f, 0x8b, 8], Self::Gzip), (b"BZh", Self::Bzip2)];
        known.into_iter().find(|(magic, _)| first.starts_with(magic)).map(|(_, packing)| packing)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Zstd => "zstd",
            Self::Gzip => "gzip",
            Self::Bzip2 => "bzip2",
        }
    }

    fn decoder(self, file: File) -> io::Result<Box<dyn Read>> {
        Ok(match self {
            Self::Zstd => Box::new(zstd::stream::read::Decoder::new(file)?),
            Self::Gzip => Box::new(flate2::read::MultiGzDecoder::new(file)),
            Self::Bzip2 => Box::new(bzip2::read::MultiBzDecoder::new(file)),
        })
    }
}

/// The file itself, or what it decompresses to where it is compressed as a whole.
fn unpacked(path: &Path, mut file: File, catalog: &mut Catalog) -> Result<(File, Option<Scratch>), BagError> {
    let Some(packing) = Packing::of(&first_bytes(&mut file)?) else { return Ok((file, None)) };
    let packed_bytes = file.metadata().map_err(|cause| BagError::at(path, cause))?.len();
    let limit_bytes = limit_bytes(packed_bytes);
    let (scratch, mut out) = Scratch::create()?;
    let mut decoder = packing.decoder(file)?;
    let (mut piece, mut written) = (vec![0; 1 << 17], 0_u64);
    loop {
        match decoder.read(&mut piece) {
            Ok(0) => break,
            Ok(got) => {
                written += got as u64;
                if written > limit_bytes {
                    return Err(BagError::Bomb { path: path.display().to_string(), limit_bytes });
                }
                out.write_all(&piece[..got])?;
            }
            Err(error) => {
                let expected = format!("{} to the end, after {written} bytes of content", packing.name());
                catalog.damage(DamageKind::Truncated, packed_bytes, expected, error.to_string(), 0);
                break;
            }
        }
    }
    Ok((out, Some(scratch)))
}
