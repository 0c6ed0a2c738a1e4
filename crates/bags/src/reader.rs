//! Any of the containers, told by its first bytes.

use crate::bag1::{self, Bag1Reader};
use crate::catalog::Catalog;
use crate::decode::{Decoder, Problem};
use crate::error::BagError;
use crate::mcap::{self, McapReader};
use crate::message::{Connection, Encoding, RawMessage};
use crate::report::{DamageKind, ReadReport};
#[cfg(feature = "sqlite")]
use crate::sqlite::SqliteReader;
use crate::window::{Memory, excerpt};
use std::io::{Read, Seek, SeekFrom};

/// The first bytes of a database.
pub(crate) const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// The first bytes of what zstd compressed. CDR begins with a zero.
pub(crate) const ZSTD_MAGIC: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// Messages out of any container, in the order of their arrival.
///
/// In ROS 1 bags and MCAP that is the order of the file, in databases the order of timestamps and, among equal ones, of
/// rows, as `ros2 bag` plays them. Messages that rosbag2 compressed one by one come decompressed.
#[derive(Debug)]
pub struct BagReader<R> {
    inner: Inner<R>,
    decoder: Decoder,
    message: Memory,
    is_unpacked: bool,
}

#[derive(Debug)]
enum Inner<R> {
    Bag1(Box<Bag1Reader<R>>),
    Mcap(Box<McapReader<R>>),
    #[cfg(feature = "sqlite")]
    Sqlite(Box<SqliteReader>),
}

/// Calls the same for each container.
macro_rules! each {
    ($inner:expr, $reader:ident => $call:expr) => {
        match $inner {
            Inner::Bag1($reader) => $call,
            Inner::Mcap($reader) => $call,
            #[cfg(feature = "sqlite")]
            Inner::Sqlite($reader) => $call,
        }
    };
}

impl<R: Read + Seek> BagReader<R> {
    /// Opens a ROS 1 bag or an MCAP file. Databases must be opened by path, as a [`Recording`](crate::Recording).
    ///
    /// # Errors
    ///
    /// [`BagError::Io`], and what says that the stream cannot be read at all.
    pub fn open(reader: R) -> Result<Self, BagError> {
        Self::open_part(reader, Catalog::default()).map_err(|(error, _)| error)
    }

    pub(crate) fn open_part(mut reader: R, catalog: Catalog) -> Result<Self, (BagError, Box<Catalog>)> {
        let first = match first_bytes(&mut reader) {
            Ok(first) => first,
            Err(error) => return Err((error, Box::new(catalog))),
        };
        if first.starts_with(bag1::MAGIC) || first.starts_with(b"#ROS") {
            return Ok(Inner::Bag1(Box::new(Bag1Reader::open_part(reader, catalog)?)).into());
        }
        if first.starts_with(&mcap::MAGIC[..5]) {
            return Ok(Inner::Mcap(Box::new(McapReader::open_part(reader, catalog)?)).into());
        }
        let is_database = first == SQLITE_MAGIC;
        let found = excerpt(&first);
        Err((if is_database { BagError::NeedsPath } else { BagError::UnknownContainer { found } }, Box::new(catalog)))
    }

    /// The connections known so far: from the beginning all that an index names, or a database.
    #[must_use]
    pub fn connections(&self) -> &[Connection] {
        each!(&self.inner, reader => reader.connections())
    }

    /// What was read so far, and what was lost.
    #[must_use]
    pub fn report(&self) -> &ReadReport {
        each!(&self.inner, reader => reader.report())
    }

    /// Bytes of memory that buffers hold now: never more than a chunk or message, compressed and not.
    #[must_use]
    pub fn held_bytes(&self) -> usize {
        self.message.buffer.capacity() + each!(&self.inner, reader => reader.held_bytes())
    }

    pub(crate) fn catalog_mut(&mut self) -> &mut Catalog {
        each!(&mut self.inner, reader => reader.catalog_mut())
    }

    pub(crate) fn into_catalog(self) -> Catalog {
        each!(self.inner, reader => reader.into_catalog())
    }

    /// The next message, or none at the end or where the way is lost.
    ///
    /// # Errors
    ///
    /// [`BagError::Io`] where the stream fails. Damage is no error: it is in the [`report`](Self::report).
    pub fn next_message(&mut self) -> Result<Option<RawMessage<'_>>, BagError> {
        if self.advance()? { self.lend() } else { Ok(None) }
    }

    /// Goes on to the next message that can be used, if there is one.
    pub(crate) fn advance(&mut self) -> Result<bool, BagError> {
        loop {
            self.is_unpacked = false;
            let is_there = match &mut self.inner {
                Inner::Bag1(reader) => reader.advance()?,
                Inner::Mcap(reader) => reader.advance()?,
                #[cfg(feature = "sqlite")]
                Inner::Sqlite(reader) => reader.advance(),
            };
            if !is_there || self.unpack()? {
                return Ok(is_there);
            }
        }
    }

    /// The message gone to last.
    pub(crate) fn lend(&mut self) -> Result<Option<RawMessage<'_>>, BagError> {
        let message = lend(&mut self.inner)?;
        let unpacked = self.is_unpacked.then(|| &self.message.buffer[..self.message.filled]);
        Ok(message.map(|message| RawMessage { data: unpacked.unwrap_or(message.data), ..message }))
    }

    /// Decompresses a message that is compressed by itself; false where it is damaged.
    fn unpack(&mut self) -> Result<bool, BagError> {
        let message = lend(&mut self.inner)?;
        let is_packed = |m: &RawMessage<'_>| m.connection.encoding == Encoding::Cdr && m.data.starts_with(ZSTD_MAGIC);
        let Some(message) = message.filter(is_packed) else { return Ok(true) };
        let (offset_bytes, length) = (message.offset_bytes, message.data.len() as u64);
        let Err(problem) = self.decoder.message(message.data, &mut self.message) else {
            self.is_unpacked = true;
            return Ok(true);
        };
        let (kind, expected, found) = match problem {
            Problem::TooLarge { limit_bytes } => {
                (DamageKind::TooLarge, format!("a message of at most {limit_bytes} bytes"), "more".to_owned())
            }
            Problem::Broken { reason } => (DamageKind::BadMessage, "a message compressed by zstd".to_owned(), reason),
        };
        self.catalog_mut().damage(kind, offset_bytes, expected, found, length);
        Ok(false)
    }
}

#[cfg(feature = "sqlite")]
impl<R> From<SqliteReader> for BagReader<R> {
    fn from(reader: SqliteReader) -> Self {
        Inner::Sqlite(Box::new(reader)).into()
    }
}

impl<R> From<Inner<R>> for BagReader<R> {
    fn from(inner: Inner<R>) -> Self {
        Self { inner, decoder: Decoder::default(), message: Memory::default(), is_unpacked: false }
    }
}

fn lend<R: Read + Seek>(inner: &mut Inner<R>) -> Result<Option<RawMessage<'_>>, BagError> {
    match inner {
        Inner::Bag1(reader) => reader.lend(),
        Inner::Mcap(reader) => reader.lend(),
        #[cfg(feature = "sqlite")]
        Inner::Sqlite(reader) => Ok(reader.lend()),
    }
}

/// Enough of the beginning to tell what it is.
pub(crate) fn first_bytes(reader: &mut (impl Read + Seek)) -> Result<Vec<u8>, BagError> {
    let mut first = Vec::with_capacity(SQLITE_MAGIC.len());
    reader.seek(SeekFrom::Start(0))?;
    reader.by_ref().take(SQLITE_MAGIC.len() as u64).read_to_end(&mut first)?;
    reader.seek(SeekFrom::Start(0))?;
    Ok(first)
}
