//! Chunks and messages decompressed, however they lie about their size.

use crate::lz4;
use crate::window::Memory;
use lz4_flex::frame::FrameDecoder;
use std::io::{self, Read};
use zstd::stream::raw::{Decoder as ZstdDecoder, InBuffer, Operation, OutBuffer};

/// A chunk may always grow to this; recorders make chunks of 1 to 4 MiB, or as large as one message.
const ALWAYS_ALLOWED_BYTES: u64 = 128 << 20;
/// Beyond it, it may grow to this many times its compressed size. lz4 cannot do better than 255.
const RATIO_MAX: u64 = 256;
/// First guess at the ratio; what grows beyond it is decoded in growing steps.
const RATIO_USUAL: usize = 4;
/// Decoded in one go by bzip2, which at damage drops what a call had decoded.
const BZIP2_PIECE_BYTES: usize = 4096;

/// How a chunk is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Codec {
    None,
    Lz4,
    Bz2,
    Zstd,
}

impl Codec {
    pub(crate) fn from_name(name: &[u8]) -> Option<Self> {
        match name {
            b"" | b"none" => Some(Self::None),
            b"lz4" => Some(Self::Lz4),
            b"bz2" => Some(Self::Bz2),
            b"zstd" => Some(Self::Zstd),
            _ => None,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lz4 => "lz4",
            Self::Bz2 => "bz2",
            Self::Zstd => "zstd",
        }
    }
}

/// Why a chunk did not decompress to what it should.
#[derive(Debug)]
pub(crate) enum Problem {
    /// It says that it is larger than believed.
    TooLarge {
        limit_bytes: u64,
    },
    Broken {
        reason: String,
    },
}

/// The most that so many compressed bytes may become.
pub(crate) fn limit_bytes(compressed: u64) -> u64 {
    ALWAYS_ALLOWED_BYTES.max(compressed.saturating_mul(RATIO_MAX))
}

/// Decompresses into a buffer that is kept, as is zstd's state.
#[derive(Default)]
pub(crate) struct Decoder {
    zstd: Option<ZstdDecoder<'static>>,
}

impl std::fmt::Debug for Decoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Decoder").finish_non_exhaustive()
    }
}

impl Decoder {
    /// Decompresses to `declared` bytes; less where there is a problem, and `out` then has what lies before it.
    /// Memory grows with what comes out, not with what was declared.
    pub(crate) fn decode(
        &mut self,
        codec: Codec,
        compressed: &[u8],
        declared: u64,
        out: &mut Memory,
    ) -> Result<(), Problem> {
        out.filled = 0;
        let limit_bytes = limit_bytes(compressed.len() as u64);
        if declared > limit_bytes {
            return Err(Problem::TooLarge { limit_bytes });
        }
        let declared = declared as usize;
        let done = match codec {
            Codec::None => return copy(compressed, declared, out),
            Codec::Lz4 => read_all(FrameDecoder::new(compressed), compressed.len(), declared, usize::MAX, out),
            Codec::Bz2 => {
                let decoder = bzip2::bufread::BzDecoder::new(compressed);
                read_all(decoder, compressed.len(), declared, BZIP2_PIECE_BYTES, out)
            }
            Codec::Zstd => self.zstd(compressed, declared, out),
        };
        let broken = |reason: String| Err(Problem::Broken { reason });
        if done.is_err() && codec == Codec::Lz4 {
            out.reach(declared.min(out.filled + compressed.len().saturating_mul(RATIO_USUAL)));
            let end = out.buffer.len().min(declared);
            out.filled = lz4::finish_cut(compressed, &mut out.buffer[..end], out.filled);
        }
        match done {
            Err(error) => broken(error.to_string()),
            Ok(()) if out.filled < declared => broken(format!("{} bytes", out.filled)),
            Ok(()) => Ok(()),
        }
    }

    /// A single frame or several, decoded straight into `out`.
    fn zstd(&mut self, compressed: &[u8], declared: usize, out: &mut Memory) -> io::Result<()> {
        let decoder = match &mut self.zstd {
            Some(decoder) => decoder,
            none => none.insert(ZstdDecoder::new()?),
        };
        decoder.reinit()?;
        let mut input = InBuffer::around(compressed);
        while out.filled < declared {
            let room = room(out, compressed.len(), declared);
            let mut output = OutBuffer::around(room);
            let consumed_before = input.pos();
            decoder.run(&mut input, &mut output)?;
            let got = output.pos();
            out.filled += got;
            if got == 0 && input.pos() == consumed_before {
                break;
            }
        }
        Ok(())
    }

    /// A message compressed by itself: one zstd frame of a size that it may or may not declare.
    pub(crate) fn message(&mut self, compressed: &[u8], out: &mut Memory) -> Result<(), Problem> {
        out.filled = 0;
        let limit_bytes = limit_bytes(compressed.len() as u64);
        let declared = zstd::zstd_safe::get_frame_content_size(compressed)
            .map_err(|error| Problem::Broken { reason: error.to_string() })?;
        match declared {
            Some(declared) => self.decode(Codec::Zstd, compressed, declared, out),
            None => match self.zstd(compressed, limit_bytes as usize, out) {
                Ok(()) if out.filled as u64 == limit_bytes => Err(Problem::TooLarge { limit_bytes }),
                Ok(()) => Ok(()),
                Err(error) => Err(Problem::Broken { reason: error.to_string() }),
            },
        }
    }
}

/// Where the next bytes go: as much as is likely to come, and never beyond `declared`.
fn room(out: &mut Memory, compressed: usize, declared: usize) -> &mut [u8] {
    if out.buffer.len() == out.filled {
        let likely = (out.filled * 2).max(compressed.saturating_mul(RATIO_USUAL)).max(1 << 16).min(declared);
        out.reach(likely);
    }
    let end = out.buffer.len().min(declared);
    &mut out.buffer[out.filled..end]
}

fn read_all(
    mut decoder: impl Read,
    compressed: usize,
    declared: usize,
    piece: usize,
    out: &mut Memory,
) -> io::Result<()> {
    while out.filled < declared {
        let room = room(out, compressed, declared);
        let piece = piece.min(room.len());
        match decoder.read(&mut room[..piece])? {
            0 => return Ok(()),
            got => out.filled += got,
        }
    }
    // the checksum of the whole stands behind the last byte
    match decoder.read(&mut [0])? {
        0 => Ok(()),
        _ => Err(io::Error::other(format!("more than {declared} bytes"))),
    }
}

fn copy(content: &[u8], declared: usize, out: &mut Memory) -> Result<(), Problem> {
    let n = content.len().min(declared);
    out.reach(n);
    out.buffer[..n].copy_from_slice(&content[..n]);
    out.filled = n;
    if content.len() == declared { Ok(()) } else { Err(Problem::Broken { reason: format!("{} bytes", content.len()) }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn text() -> Vec<u8> {
        (0..20_000_u32).flat_map(|i| format!("line {i} of text {}\n", i.wrapping_mul(i) % 977).into_bytes()).collect()
    }

    fn lz4(content: &[u8]) -> Vec<u8> {
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn bz2(content: &[u8]) -> Vec<u8> {
        let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn zstd(content: &[u8]) -> Vec<u8> {
        zstd::bulk::compress(content, 1).unwrap()
    }

    type Compress = fn(&[u8]) -> Vec<u8>;
    const CODECS: [(Codec, Compress); 3] = [(Codec::Lz4, lz4), (Codec::Bz2, bz2), (Codec::Zstd, zstd)];

    #[test]
    fn what_was_compressed_comes_back_and_a_torn_chunk_up_to_its_tear() {
        let (content, mut out, mut decoder) = (text(), Memory::default(), Decoder::default());
        for (codec, compress) in CODECS {
            let compressed = compress(&content);
            decoder.decode(codec, &compressed, content.len() as u64, &mut out).unwrap();
            assert!(out.buffer[..out.filled] == content);
            let torn = &compressed[..compressed.len() * 3 / 4];
            decoder.decode(codec, torn, content.len() as u64, &mut out).unwrap_err();
            assert!(out.filled > content.len() / 5, "{codec:?} {}", out.filled);
            assert!(content.starts_with(&out.buffer[..out.filled]));
        }
    }

    #[test]
    fn bombs_and_lies_take_no_memory() {
        let compressed = zstd(&vec![0; 64 << 20]);
        for (declared, capacity) in [(u64::MAX, 0), (1 << 40, 0), (1000, 1000), (limit_bytes(0), 128 << 20)] {
            let mut out = Memory::default();
            let _ = Decoder::default().decode(Codec::Zstd, &compressed, declared, &mut out);
            assert!(out.buffer.capacity() <= capacity, "{declared}: {}", out.buffer.capacity());
        }
        let mut out = Memory::default();
        for (codec, compress) in CODECS {
            let small = compress(b"small");
            Decoder::default().decode(codec, &small, 100 << 20, &mut out).unwrap_err();
            assert!(out.buffer.capacity() <= 1 << 16);
        }
    }
}
