//! KITTI's clouds: four floats a point, perhaps compressed by zstd.

use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::text::excerpt;
use std::io::Read;

/// `x y z intensity`, little endian.
pub(crate) const POINT_BYTES: usize = 16;
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// A frame may always become so many bytes: two million points; or so many times those in the file.
const ALWAYS_ALLOWED_BYTES: u64 = 32 << 20;
const RATIO_MAX: u64 = 64;
/// So many points tell whether they are such.
const LOOKED_AT: usize = 2000;
/// No lidar sees farther, metres.
const FARTHEST_M: f32 = 2000.0;

/// Reads `x y z intensity` as float32, little endian, compressed by zstd or not.
///
/// # Errors
/// [`CloudError::Content`] where zstd's bytes break before the first point, or the numbers are none that a lidar gives.
pub fn read_bin(file: &str, bytes: &[u8], notes: &mut Notes) -> Result<Vec<[f32; 3]>, CloudError> {
    BinReader::default().read(file, bytes, notes)
}

/// Reads one file after the other; keeps the room for what is decompressed, and zstd's state.
#[derive(Default)]
pub(crate) struct BinReader {
    unpacked: Vec<u8>,
    zstd: Option<zstd::bulk::Decompressor<'static>>,
}

impl BinReader {
    pub(crate) fn read(&mut self, file: &str, bytes: &[u8], notes: &mut Notes) -> Result<Vec<[f32; 3]>, CloudError> {
        let bytes = if bytes.starts_with(&ZSTD_MAGIC) { self.unpacked(file, bytes, notes)? } else { bytes };
        let (points, rest) = bytes.as_chunks::<POINT_BYTES>();
        if is_foreign(points) || (points.is_empty() && !rest.is_empty()) {
            return Err(CloudError::content(file, 0, "points as float32 x y z intensity", excerpt(bytes)));
        }
        if !rest.is_empty() {
            let at = bytes.len() - rest.len();
            notes.note(NoteKind::Truncated, file, at, || ("points of 16 bytes", format!("{} bytes more", rest.len())));
        }
        Ok(points.iter().map(|point| [0, 4, 8].map(|at| number(point, at))).collect())
    }

    fn unpacked(&mut self, file: &str, bytes: &[u8], notes: &mut Notes) -> Result<&[u8], CloudError> {
        if self.unpack_at_once(bytes).is_none() {
            self.unpack_stream(file, bytes, notes)?;
        }
        Ok(&self.unpacked)
    }

    /// A whole stream that says how long it is becomes so long in one go; none where it is anything else.
    fn unpack_at_once(&mut self, bytes: &[u8]) -> Option<usize> {
        let length = zstd::zstd_safe::get_frame_content_size(bytes).ok()??;
        if length > bytes.len() as u64 * RATIO_MAX {
            return None;
        }
        if self.zstd.is_none() {
            self.zstd = zstd::bulk::Decompressor::new().ok();
        }
        self.unpacked.clear();
        self.unpacked.reserve(length as usize);
        self.zstd.as_mut()?.decompress_to_buffer(bytes, &mut self.unpacked).ok()
    }

    /// Piece by piece, so that what comes before damage is not lost.
    fn unpack_stream(&mut self, file: &str, bytes: &[u8], notes: &mut Notes) -> Result<(), CloudError> {
        let fail = |found: String| CloudError::content(file, 0, "a stream of zstd", found);
        let most = ALWAYS_ALLOWED_BYTES.max(bytes.len() as u64 * RATIO_MAX);
        let decoder = zstd::stream::read::Decoder::with_buffer(bytes).map_err(|cause| fail(cause.to_string()))?;
        let out = &mut self.unpacked;
        out.clear();
        if let Err(cause) = decoder.take(most + 1).read_to_end(out) {
            if out.len() < POINT_BYTES {
                return Err(fail(cause.to_string()));
            }
            notes.note(NoteKind::Truncated, file, out.len(), || ("zstd to the end", cause.to_string()));
            out.truncate(out.len() - out.len() % POINT_BYTES);
        }
        if out.len() as u64 > most {
            return Err(fail(format!("{} bytes that become more than {most}", bytes.len())));
        }
        Ok(())
    }
}

fn number(bytes: &[u8; POINT_BYTES], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Whether the first points are something else: places that are too far or of tiny numbers, or intensities below zero, as where
/// points have three or five numbers.
fn is_foreign(points: &[[u8; POINT_BYTES]]) -> bool {
    let looked_at = points.get(..LOOKED_AT).unwrap_or(points);
    let is_no_place = |v: f32| v.is_finite() && (v.abs() > FARTHEST_M || (v != 0.0 && v.abs() < 1e-20));
    let count = |is_strange: &dyn Fn(&[u8; POINT_BYTES]) -> bool| looked_at.iter().filter(|p| is_strange(p)).count();
    let far = count(&|point| [0, 4, 8].iter().any(|at| is_no_place(number(point, *at))));
    let below_zero = count(&|point| number(point, 12) < 0.0);
    far * 100 > looked_at.len() || below_zero * 20 > looked_at.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bytes(points: &[[f32; 3]]) -> Vec<u8> {
        points.iter().flat_map(|[x, y, z]| [*x, *y, *z, 0.5].into_iter().flat_map(f32::to_le_bytes)).collect()
    }

    #[test]
    fn what_is_torn_gives_what_came_before() {
        let points = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
        let plain = bytes(&points);
        let mut notes = Notes::default();
        assert_eq!(read_bin("a", &plain[..31], &mut notes).unwrap(), points[..1]);
        assert_eq!(notes.kinds[&NoteKind::Truncated].first[0].offset_bytes, 16);
        let many: Vec<[f32; 3]> = (0..100_000_u32).map(|k| [0.01 * k as f32, (k as f32).sin(), 1.0]).collect();
        let packed = zstd::encode_all(bytes(&many).as_slice(), 3).unwrap();
        let torn = read_bin("a", &packed[..packed.len() / 2], &mut notes).unwrap();
        assert!(!torn.is_empty() && torn == many[..torn.len()]);
        assert_eq!(notes.count(NoteKind::Truncated), 2);
    }

    #[test]
    fn bombs_and_foreign_files_are_refused() {
        let bomb = zstd::encode_all(std::io::repeat(0).take(64 << 20), 3).unwrap();
        let error = read_bin("a", &bomb, &mut Notes::default()).unwrap_err().to_string();
        assert!(error.contains("become more than"), "{error}");
        let read = |bytes: &[u8]| read_bin("a", bytes, &mut Notes::default());
        assert!(read(b"version https://git-lfs.github.com/spec/v1 oid sha256:4d7a2146 size 12").is_err());
        assert!(read(b"short").is_err());
        assert!(read(&bytes(&[[1.0, -2.0, 0.0], [f32::NAN; 3]])).is_ok());
        assert!(read(b"").is_ok());
        let three: Vec<u8> =
            (0..400).flat_map(|k| [k as f32, -3.0, -1.0].into_iter().flat_map(f32::to_le_bytes)).collect();
        assert!(read(&three).is_err());
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(points in prop::collection::vec(prop::array::uniform3(-100.0..100.0_f32), 0..50)) {
            let plain = bytes(&points);
            let packed = zstd::encode_all(plain.as_slice(), 1).unwrap();
            for file in [plain, packed] {
                let mut notes = Notes::default();
                prop_assert_eq!(read_bin("a", &file, &mut notes).unwrap(), points.clone());
                prop_assert_eq!(notes, Notes::default());
            }
        }

        #[test]
        fn any_bytes(bytes: Vec<u8>) {
            let _ = read_bin("a", &bytes, &mut Notes::default());
            let _ = read_bin("a", &[&ZSTD_MAGIC[..], &bytes].concat(), &mut Notes::default());
        }
    }
}
