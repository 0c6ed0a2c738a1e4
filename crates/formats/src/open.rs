//! Logs as they lie on disk: plain, gzip or bzip2, told by their first bytes.

use crate::compression::Compression;
use crate::error::FormatError;
use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::MultiGzDecoder;
use std::fmt;
use std::io::{self, BufRead, BufReader, Chain, Cursor, Read};

/// Bytes decoded in one go: at damage a decoder drops what the call had decoded, so this bounds what is lost with it.
const DECODED_PIECE_BYTES: usize = 4096;

/// Opens a log, decompressing it on the fly where its first bytes say gzip or bzip2.
///
/// A compressed stream that is cut short or damaged delivers everything before the tear; then reading fails once with
/// an [`io::Error`] that wraps [`FormatError::Torn`]. The readers of this crate turn that into an entry of their report.
///
/// # Errors
///
/// [`FormatError::Io`] where the first bytes cannot be read.
pub fn open_log<R: Read>(mut reader: R) -> Result<LogStream<R>, FormatError> {
    let mut first_bytes = Vec::with_capacity(4);
    reader.by_ref().take(4).read_to_end(&mut first_bytes)?;
    let compression = Compression::of(&first_bytes);
    let source = CountingBuffer {
        inner: BufReader::with_capacity(1 << 16, Cursor::new(first_bytes).chain(reader)),
        consumed: 0,
    };
    let decoder = match compression {
        Compression::Plain => Decoder::Plain(source),
        Compression::Gzip => Decoder::Gzip(Box::new(MultiGzDecoder::new(source))),
        Compression::Bzip2 => Decoder::Bzip2(Box::new(MultiBzDecoder::new(source))),
    };
    Ok(LogStream { decoder, compression, delivered_bytes: 0, ended: false })
}

/// The bytes of a log, decompressed; made by [`open_log`].
pub struct LogStream<R> {
    decoder: Decoder<R>,
    compression: Compression,
    delivered_bytes: u64,
    ended: bool,
}

impl<R> fmt::Debug for LogStream<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LogStream").field("compression", &self.compression).finish_non_exhaustive()
    }
}

enum Decoder<R> {
    Plain(CountingBuffer<R>),
    Gzip(Box<MultiGzDecoder<CountingBuffer<R>>>),
    Bzip2(Box<MultiBzDecoder<CountingBuffer<R>>>),
}

impl<R: Read> LogStream<R> {
    /// How the stream is compressed.
    #[must_use]
    pub fn compression(&self) -> Compression {
        self.compression
    }

    fn compressed_offset_bytes(&self) -> u64 {
        match &self.decoder {
            Decoder::Plain(source) => source.consumed,
            Decoder::Gzip(decoder) => decoder.get_ref().consumed,
            Decoder::Bzip2(decoder) => decoder.get_ref().consumed,
        }
    }

    /// The decoder's complaint as a tear; failures of the stream below stay what they are.
    fn torn(&mut self, error: io::Error) -> io::Error {
        use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        let of_decoder = matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof);
        if self.compression == Compression::Plain || !of_decoder {
            return error;
        }
        self.ended = true;
        io::Error::other(FormatError::Torn {
            compression: self.compression,
            compressed_offset_bytes: self.compressed_offset_bytes(),
            delivered_bytes: self.delivered_bytes,
            cause: error.to_string(),
        })
    }
}

impl<R: Read> Read for LogStream<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.ended {
            return Ok(0);
        }
        let piece = out.len().min(DECODED_PIECE_BYTES);
        let got = match &mut self.decoder {
            Decoder::Plain(source) => source.inner.read(out),
            Decoder::Gzip(decoder) => decoder.read(&mut out[..piece]),
            Decoder::Bzip2(decoder) => decoder.read(&mut out[..piece]),
        };
        match got {
            Ok(got) => {
                self.delivered_bytes += got as u64;
                Ok(got)
            }
            Err(error) => Err(self.torn(error)),
        }
    }
}

/// Counts what a decoder has consumed, so that a tear can be given its place.
#[derive(Debug)]
struct CountingBuffer<R> {
    inner: BufReader<Chain<Cursor<Vec<u8>>, R>>,
    consumed: u64,
}

impl<R: Read> Read for CountingBuffer<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let got = self.inner.read(out)?;
        self.consumed += got as u64;
        Ok(got)
    }
}

impl<R: Read> BufRead for CountingBuffer<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.consumed += amount as u64;
        self.inner.consume(amount);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn text() -> Vec<u8> {
        (0..20_000).flat_map(|i| format!("line {i} of some text {}\n", i * i % 977).into_bytes()).collect()
    }

    fn gzip(content: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn bzip2(content: &[u8]) -> Vec<u8> {
        let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn read_all(compressed: &[u8]) -> (Vec<u8>, Option<FormatError>) {
        let mut stream = open_log(compressed).unwrap();
        let mut content = Vec::new();
        let error = stream.read_to_end(&mut content).err();
        (content, error.map(|e| e.downcast::<FormatError>().unwrap()))
    }

    #[test]
    fn plain_gzip_and_bzip2_are_told_apart_and_members_follow_each_other() {
        let (whole, half) = (text(), text().len() / 2);
        for content in [&b""[..], b"B", b"BZ", b"ODOM 1 2 3\n", &whole] {
            assert_eq!(read_all(content).0, content);
            assert_eq!(read_all(&gzip(content)).0, content);
            assert_eq!(read_all(&bzip2(content)).0, content);
        }
        for compress in [gzip, bzip2] {
            let members = [compress(&whole[..half]), compress(&whole[half..])].concat();
            let (content, tear) = read_all(&members);
            assert!(content == whole && tear.is_none());
        }
    }

    #[test]
    fn a_torn_stream_delivers_what_lies_before_the_tear_and_says_where_it_is() {
        let whole = text();
        for compressed in [gzip(&whole), bzip2(&whole)] {
            let cut = compressed.len() * 2 / 3;
            let (content, tear) = read_all(&compressed[..cut]);
            assert!(whole.starts_with(&content));
            assert!(content.len() > whole.len() / 5, "{} of {}", content.len(), whole.len());
            match tear {
                Some(FormatError::Torn { compressed_offset_bytes, delivered_bytes, .. }) => {
                    assert_eq!(compressed_offset_bytes, cut as u64);
                    assert_eq!(delivered_bytes, content.len() as u64);
                }
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn a_damaged_stream_is_a_tear_too() {
        for mut compressed in [gzip(&text()), bzip2(&text())] {
            let at = compressed.len() / 2;
            compressed[at..at + 40].fill(0xA5);
            let (content, tear) = read_all(&compressed);
            assert!(content.len() < text().len() && tear.is_some());
        }
    }
}
