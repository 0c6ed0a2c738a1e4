//! KITTI's clouds, four floats a point, and nuScenes', five; perhaps compressed by zstd.

use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::points::{Points, telling};
use crate::text::excerpt;
use std::io::Read;

const FLOAT_BYTES: usize = 4;
/// `x y z intensity`, little endian.
pub(crate) const POINT_BYTES: usize = 4 * FLOAT_BYTES;
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// A frame may always become so many bytes: two million points; or so many times those in the file.
const ALWAYS_ALLOWED_BYTES: u64 = 32 << 20;
const RATIO_MAX: u64 = 64;
/// So many points tell whether they are such, in so many runs from all of a file: what a lidar sees first may lie on one side of it.
const LOOKED_AT: usize = 2000;
const RUNS: usize = 20;
/// No lidar sees farther, metres.
const FARTHEST_M: f32 = 2000.0;

/// Reads `x y z intensity` as float32, little endian, compressed by zstd or not.
///
/// # Errors
/// [`CloudError::Content`] where zstd's bytes break before the first point, or the numbers are none that a lidar gives.
pub fn read_bin(file: &str, bytes: &[u8], notes: &mut Notes) -> Result<Vec<[f32; 3]>, CloudError> {
    BinReader::default().read(file, bytes, Columns::Four, notes).map(|points| points.points_m)
}

/// What a point's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Columns {
    /// `x y z intensity`.
    Four,
    /// `x y z intensity ring`.
    Five,
}

impl Columns {
    fn point_bytes(self) -> usize {
        match self {
            Self::Four => POINT_BYTES,
            Self::Five => POINT_BYTES + FLOAT_BYTES,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Four => "points as float32 x y z intensity",
            Self::Five => "points as float32 x y z intensity ring",
        }
    }
}

/// Reads one file after the other; keeps the room for what is decompressed, and zstd's state.
#[derive(Default)]
pub(crate) struct BinReader {
    unpacked: Vec<u8>,
    zstd: Option<zstd::bulk::Decompressor<'static>>,
}

impl BinReader {
    pub(crate) fn read(
        &mut self,
        file: &str,
        bytes: &[u8],
        columns: Columns,
        notes: &mut Notes,
    ) -> Result<Points, CloudError> {
        let bytes = if bytes.starts_with(&ZSTD_MAGIC) { self.unpacked(file, bytes, notes)? } else { bytes };
        let size = columns.point_bytes();
        let points = bytes.chunks_exact(size);
        let rest = points.remainder();
        if is_foreign(bytes, size) || (points.len() == 0 && !rest.is_empty()) {
            return Err(CloudError::content(file, 0, columns.words(), foreign_words(bytes, columns)));
        }
        if !rest.is_empty() {
            let at = bytes.len() - rest.len();
            let expected = || (format!("points of {size} bytes"), format!("{} bytes more", rest.len()));
            notes.note(NoteKind::Truncated, file, at, expected);
        }
        let intensities = points.clone().map(|point| number(point, 3)).collect();
        let points_m = points.map(|point| [0, 1, 2].map(|column| number(point, column))).collect();
        Ok(Points { points_m, intensities: telling(intensities), ..Points::default() })
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

/// The number in a column of a point.
fn number(point: &[u8], column: usize) -> f32 {
    let bytes = point.get(FLOAT_BYTES * column..).and_then(|rest| rest.first_chunk::<FLOAT_BYTES>());
    bytes.map_or(f32::NAN, |bytes| f32::from_le_bytes(*bytes))
}

/// Whether points are something else: places that are too far or of tiny numbers, or intensities below zero, as where points have
/// another count of numbers.
fn is_foreign(bytes: &[u8], size: usize) -> bool {
    let looked_at: Vec<&[u8]> = spread(bytes, size).collect();
    let is_no_place = |v: f32| v.is_finite() && (v.abs() > FARTHEST_M || (v != 0.0 && v.abs() < 1e-20));
    let count = |is_strange: &dyn Fn(&[u8]) -> bool| looked_at.iter().filter(|point| is_strange(point)).count();
    let far = count(&|point| (0..3).any(|column| is_no_place(number(point, column))));
    let below_zero = count(&|point| number(point, 3) < 0.0);
    far * 100 > looked_at.len() || below_zero * 20 > looked_at.len()
}

/// [`LOOKED_AT`] points in [`RUNS`] runs of successive ones: those of a fixed distance might all begin at the same column of a point of
/// another size.
fn spread(bytes: &[u8], size: usize) -> impl Iterator<Item = &[u8]> {
    let points = bytes.len() / size;
    let (run, apart) = ((LOOKED_AT / RUNS).min(points), (points / RUNS).max(LOOKED_AT / RUNS));
    let runs = (0..points).step_by(apart.max(1));
    runs.flat_map(move |begin| bytes.get(begin * size..).unwrap_or_default().chunks_exact(size).take(run))
}

/// Text as it stands, or of what size points may be instead.
fn foreign_words(bytes: &[u8], columns: Columns) -> String {
    let head = bytes.get(..64).unwrap_or(bytes);
    let is_text = head.iter().all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace());
    if is_text || bytes.len() < POINT_BYTES {
        return excerpt(bytes);
    }
    let count = |floats: usize| bytes.len().is_multiple_of(FLOAT_BYTES * floats).then(|| floats.to_string());
    let counts: Vec<String> = [3, 5, 6, 7, 8].into_iter().filter_map(count).collect();
    let floats = if counts.is_empty() { "another count of".to_owned() } else { counts.join(" or ") };
    let named = match columns {
        Columns::Four => {
            "; five floats, x y z intensity ring, are read where files are named as in nuScenes, NAME.pcd.bin"
        }
        Columns::Five => "",
    };
    format!(
        "{} bytes that are no such points: {floats} floats a point{named}; PCD and PLY files say what is in them",
        bytes.len()
    )
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

    /// Points of a lidar that turns, with so many floats each.
    fn turning(floats: usize) -> Vec<u8> {
        let point = |k: usize| {
            let angle = k as f32 * std::f32::consts::TAU / 6000.0;
            let all = [8.0 * angle.cos(), 8.0 * angle.sin(), -1.0, 0.4, 17.0, 0.05];
            all.into_iter().take(floats).flat_map(f32::to_le_bytes)
        };
        (0..6000).flat_map(point).collect()
    }

    #[test]
    fn points_of_another_size_are_refused_wherever_in_the_file_they_tell() {
        let mut notes = Notes::default();
        for floats in [3, 5, 6] {
            let error = read_bin("a", &turning(floats), &mut notes).unwrap_err().to_string();
            assert!(error.contains(&format!("{floats} ")) && error.contains("NAME.pcd.bin"), "{error}");
        }
        assert_eq!(read_bin("a", &turning(4), &mut notes).unwrap().len(), 6000);
        let five = BinReader::default().read("a", &turning(5), Columns::Five, &mut notes).unwrap();
        assert_eq!((five.points_m.len(), five.points_m[0], notes), (6000, [8.0, 0.0, -1.0], Notes::default()));
        assert!(BinReader::default().read("a", &turning(4), Columns::Five, &mut Notes::default()).is_err());
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
