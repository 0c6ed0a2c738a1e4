//! Files out of a tar archive, plain or compressed with zstd.

use std::collections::BTreeMap;
use std::io::{BufRead, Read};

const BLOCK_BYTES: usize = 512;
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Larger files are no logs of robots that see each other.
const LARGEST_FILE_BYTES: u64 = 1 << 30;
const ENDING: &str = ".dat";

/// The contents of all files whose names end in `.dat`, by their names without folders; otherwise why there are none.
pub(super) fn read(mut reader: impl BufRead) -> Result<BTreeMap<String, Vec<u8>>, String> {
    let is_zstd = reader.fill_buf().map_err(|error| error.to_string())?.starts_with(&ZSTD_MAGIC);
    if is_zstd {
        let decoder = zstd::Decoder::with_buffer(reader).map_err(|error| error.to_string())?;
        return read_tar(decoder);
    }
    read_tar(reader)
}

fn read_tar(mut reader: impl Read) -> Result<BTreeMap<String, Vec<u8>>, String> {
    let mut contents = BTreeMap::new();
    let mut block = [0; BLOCK_BYTES];
    for number in 1_u32.. {
        let torn = |error: std::io::Error| format!("the archive is torn in file {number}: {error}");
        reader.read_exact(&mut block).map_err(torn)?;
        if block.iter().all(|byte| *byte == 0) {
            break; // two empty blocks end an archive
        }
        let (name, bytes) = head(&block).ok_or_else(|| not_an_archive(number))?;
        let padded = bytes.next_multiple_of(BLOCK_BYTES as u64);
        let is_wanted = name.ends_with(ENDING) && matches!(block[156], b'0' | 0);
        let mut content = Vec::new();
        if is_wanted && bytes <= LARGEST_FILE_BYTES {
            reader.by_ref().take(padded).read_to_end(&mut content).map_err(torn)?;
        } else {
            std::io::copy(&mut reader.by_ref().take(padded), &mut std::io::sink()).map_err(torn)?;
        }
        if is_wanted {
            content.truncate(bytes.min(LARGEST_FILE_BYTES) as usize);
            contents.insert(name, content);
        }
    }
    Ok(contents)
}

fn not_an_archive(number: u32) -> String {
    match number {
        1 => "expected a folder or an archive (.tar, .tar.zst), found something else".to_owned(),
        _ => format!("the archive is damaged at file {number}"),
    }
}

/// Name without folders and size in bytes; none where the checksum says that this is no head of a file.
fn head(block: &[u8; BLOCK_BYTES]) -> Option<(String, u64)> {
    let sum: u64 =
        block.iter().enumerate().map(|(at, byte)| u64::from(if (148..156).contains(&at) { b' ' } else { *byte })).sum();
    let name = block[..100].split(|byte| *byte == 0).next()?;
    let name = String::from_utf8_lossy(name).rsplit('/').next()?.to_owned();
    (octal(&block[148..156])? == sum).then_some((name, octal(&block[124..136])?))
}

fn octal(field: &[u8]) -> Option<u64> {
    let text = std::str::from_utf8(field).ok()?.trim_matches(|c: char| c == '\0' || c == ' ');
    u64::from_str_radix(text, 8).ok()
}
