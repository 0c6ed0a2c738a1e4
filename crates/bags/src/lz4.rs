//! The last block of an lz4 frame that was cut short.
//!
//! Decoders give a block or nothing, and recorders write a chunk of a megabyte as one block: decoded up to the tear, it
//! yields what was recorded last. Formats: <https://github.com/lz4/lz4/tree/dev/doc>.

use crate::window::u32_at;

const MAGIC: u32 = 0x184d_2204;
/// Of a block's size, set where the block is not compressed.
const PLAIN: u32 = 1 << 31;

/// The part of the last block that is there, and whether it is compressed; none where no block is cut.
fn cut_block(frame: &[u8]) -> Option<(&[u8], bool)> {
    let flags = *frame.get(4).filter(|_| u32_at(frame, 0) == Some(MAGIC))?;
    let has = |bit: u8| usize::from(flags >> bit & 1);
    let mut at = 7 + 8 * has(3) + 4 * has(0);
    loop {
        let size = u32_at(frame, at).filter(|size| *size != 0)?;
        let (start, length) = (at + 4, (size & !PLAIN) as usize);
        let block = frame.get(start..)?;
        if block.len() < length {
            return Some((block, size & PLAIN == 0));
        }
        at = start + length + 4 * has(4);
    }
}

/// Decodes a block that is cut short behind `filled` bytes of `out`, and returns how many are filled then.
pub(crate) fn finish_cut(frame: &[u8], out: &mut [u8], filled: usize) -> usize {
    match cut_block(frame) {
        Some((block, true)) => Sequences { block, out, filled }.decode(),
        Some((block, false)) => Sequences { block, out, filled }.literals(block.len()),
        None => filled,
    }
}

struct Sequences<'a> {
    block: &'a [u8],
    out: &'a mut [u8],
    filled: usize,
}

impl Sequences<'_> {
    fn decode(mut self) -> usize {
        while let Some(token) = self.byte() {
            let Some(length) = self.length(token >> 4) else { break };
            let whole = self.block.len() > length;
            self.filled = self.literals(length);
            if !whole || self.copy_match(token & 15).is_none() {
                break;
            }
        }
        self.filled
    }

    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.block.split_first()?;
        self.block = rest;
        Some(*first)
    }

    /// Fifteen goes on in bytes, the last of which is not 255.
    fn length(&mut self, nibble: u8) -> Option<usize> {
        let mut length = usize::from(nibble);
        let mut more = nibble == 15;
        while more {
            let byte = self.byte()?;
            length += usize::from(byte);
            more = byte == 255;
        }
        Some(length)
    }

    fn literals(&mut self, length: usize) -> usize {
        let length = length.min(self.block.len()).min(self.out.len() - self.filled);
        let (literals, rest) = self.block.split_at(length);
        self.out[self.filled..self.filled + length].copy_from_slice(literals);
        self.block = rest;
        self.filled + length
    }

    /// Repeats earlier bytes; they may overlap with what they become.
    fn copy_match(&mut self, nibble: u8) -> Option<()> {
        let offset = usize::from(u16::from_le_bytes([self.byte()?, self.byte()?]));
        let length = self.length(nibble)? + 4;
        let from = self.filled.checked_sub(offset).filter(|_| offset > 0)?;
        let length = length.min(self.out.len() - self.filled);
        for place in 0..length {
            self.out[self.filled + place] = self.out[from + place];
        }
        self.filled += length;
        Some(())
    }
}
