//! PCD, the Point Cloud Library's files: ascii, binary and binary_compressed.

mod lzf;

use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::points::{Field, Points, assemble, is_packed_colour};
use crate::scalar::{Scalar, array};
use crate::text::{Row, excerpt, rows};

/// No header has more lines.
const HEADER_LINES_MAX: usize = 1000;
/// No point has more numbers.
const COLUMNS_MAX: usize = 4096;

/// A header, and where its data begin.
struct Header {
    fields: Vec<Field>,
    /// How many numbers each field has.
    counts: Vec<usize>,
    points: usize,
    viewpoint: Option<String>,
    data: Data,
    data_at: usize,
}

#[derive(Clone, Copy)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

/// Whether bytes begin as a PCD file does.
pub(crate) fn is_pcd(bytes: &[u8]) -> bool {
    let head = bytes.get(..4096).unwrap_or(bytes);
    let first = rows(head).next().and_then(|row| row.fields().next());
    head.starts_with(b"# .PCD") || matches!(first, Some("VERSION" | "FIELDS" | "COLUMNS"))
}

/// Reads a PCD file: fields `x y z` of any type, colours (`rgb`, `rgba` packed or a field each) and times if there are any.
///
/// A file that ends early gives the points before; what was lost is noted with its place.
///
/// # Errors
/// [`CloudError::Content`] where the header is none, or compressed data do not unpack.
pub fn read_pcd(file: &str, bytes: &[u8], notes: &mut Notes) -> Result<Points, CloudError> {
    let header = Header::parse(file, bytes)?;
    let data = bytes.get(header.data_at..).unwrap_or_default();
    if let Some(viewpoint) = &header.viewpoint {
        notes.note(NoteKind::Viewpoint, file, 0, || ("VIEWPOINT 0 0 0 1 0 0 0", viewpoint.clone()));
    }
    let points = match header.data {
        Data::Ascii => header.ascii(file, data, notes),
        Data::Binary => header.binary(file, data, notes),
        Data::Compressed => header.compressed(file, data)?,
    };
    points.map_err(|axis| CloudError::content(file, 0, "FIELDS with x, y and z", format!("no {axis}")))
}

impl Header {
    fn parse(file: &str, bytes: &[u8]) -> Result<Self, CloudError> {
        let mut words: [Vec<&str>; 8] = Default::default();
        let keys = ["FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "POINTS", "VIEWPOINT"];
        let mut data = None;
        for row in rows(bytes).take(HEADER_LINES_MAX) {
            let mut fields = row.fields();
            let key = match fields.next() {
                Some("COLUMNS") => "FIELDS",
                key => key.unwrap_or_default(),
            };
            if let Some(place) = keys.iter().position(|k| *k == key) {
                words[place] = fields.collect();
            } else if key == "DATA" {
                data = Some((row, fields.next().unwrap_or_default()));
                break;
            } else if key != "VERSION" {
                return Err(CloudError::content(file, row.offset_bytes, "a line of a PCD header", row.excerpt()));
            }
        }
        let Some((row, kind)) = data else {
            return Err(CloudError::content(file, bytes.len(), "a PCD header with DATA", excerpt(bytes)));
        };
        let [names, sizes, types, counts, width, height, points, viewpoint] = words;
        let fail = |expected: &str, found: &[&str]| {
            CloudError::content(file, 0, expected, if found.is_empty() { "none".to_owned() } else { found.join(" ") })
        };
        let scalars = (sizes.len() == names.len() && types.len() == names.len())
            .then(|| sizes.iter().zip(&types).map(|(size, kind)| scalar(kind, size)).collect::<Option<Vec<_>>>())
            .flatten()
            .ok_or_else(|| fail("SIZE and TYPE of each field", &[&sizes[..], &types[..]].concat()))?;
        let fields =
            names.iter().zip(scalars).map(|(name, scalar)| Field { name: (*name).to_owned(), scalar }).collect();
        let columns = if counts.is_empty() { Some(vec![1; names.len()]) } else { numbers(&counts) };
        let is_sensible = |all: &Vec<usize>| {
            all.len() == names.len()
                && all.iter().try_fold(0, |sum: usize, n| sum.checked_add(*n)).is_some_and(|n| n <= COLUMNS_MAX)
        };
        let columns = columns.filter(is_sensible).ok_or_else(|| fail("COUNT of each field", &counts))?;
        let area = || numbers(&[&width[..], &height[..]].concat())?.into_iter().try_fold(1, usize::checked_mul);
        let given = numbers(&points).and_then(|points| points.first().copied());
        let points = given.or_else(|| area().filter(|_| !width.is_empty()));
        let data = match kind {
            "ascii" => Data::Ascii,
            "binary" => Data::Binary,
            "binary_compressed" => Data::Compressed,
            _ => {
                return Err(CloudError::content(
                    file,
                    row.offset_bytes,
                    "DATA ascii, binary or binary_compressed",
                    row.excerpt(),
                ));
            }
        };
        let line_end = bytes[row.offset_bytes..].iter().position(|byte| *byte == b'\n'); // the row is one of these bytes
        let viewpoint = viewpoint.join(" ");
        let is_identity = numbers_f64(&viewpoint).is_none_or(|v| v == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        Ok(Self {
            fields,
            counts: columns,
            points: points.ok_or_else(|| fail("POINTS, or WIDTH and HEIGHT", &[]))?,
            viewpoint: (!is_identity).then_some(viewpoint),
            data,
            data_at: line_end.map_or(bytes.len(), |end| row.offset_bytes + end + 1),
        })
    }

    /// Bytes of a point; at most 8 times 4096.
    fn point_bytes(&self) -> usize {
        self.fields.iter().zip(&self.counts).map(|(field, count)| field.scalar.size() * count).sum()
    }

    /// The type a field's bytes are read as.
    fn scalar_in_bytes(&self, field: usize) -> Scalar {
        let Field { name, scalar } = &self.fields[field];
        if *scalar == Scalar::F32 && is_packed_colour(name) { Scalar::U32 } else { *scalar }
    }

    fn fields_in_bytes(&self) -> Vec<Field> {
        let field = |at: usize| Field { name: self.fields[at].name.clone(), scalar: self.scalar_in_bytes(at) };
        (0..self.fields.len()).map(field).collect()
    }

    fn ascii(&self, file: &str, data: &[u8], notes: &mut Notes) -> Result<Points, &'static str> {
        let columns: usize = self.counts.iter().sum();
        let mut table: Vec<f64> = Vec::new();
        let mut found = 0;
        for row in rows(data) {
            if found == self.points {
                let at = self.data_at + row.offset_bytes;
                notes.note(NoteKind::Surplus, file, at, || (format!("the end after {found} points"), row.excerpt()));
                break;
            }
            found += 1;
            if !push_row(&mut table, row, columns) {
                let at = self.data_at + row.offset_bytes;
                notes.note(NoteKind::BadRow, file, at, || (format!("{columns} numbers"), row.excerpt()));
            }
        }
        self.note_missing(file, found, self.data_at + data.len(), notes);
        let first_columns = firsts(&self.counts, |_| 1);
        let count = table.len().checked_div(columns).unwrap_or(0);
        // a field of no numbers, the last of a row, has none behind the table's end
        let value =
            |at: usize, field: usize| table.get(at * columns + first_columns[field]).copied().unwrap_or(f64::NAN);
        assemble(&self.fields, count, value)
    }

    fn binary(&self, file: &str, data: &[u8], notes: &mut Notes) -> Result<Points, &'static str> {
        let stride = self.point_bytes();
        let whole = data.len().checked_div(stride).unwrap_or(0);
        let count = self.points.min(whole);
        self.note_missing(file, count, self.data_at + count * stride, notes);
        let fields = self.fields_in_bytes();
        let offsets = firsts(&self.counts, |field| fields[field].scalar.size());
        assemble(&fields, count, |at, field| fields[field].scalar.read(data, at * stride + offsets[field], false))
    }

    /// All numbers of a field stand together.
    fn compressed(&self, file: &str, data: &[u8]) -> Result<Result<Points, &'static str>, CloudError> {
        let fail = |at: usize, expected: String, found: String| {
            Err(CloudError::content(file, self.data_at + at, expected, found))
        };
        let size = |at: usize| array(data, at).map(|bytes| u32::from_le_bytes(bytes) as usize);
        let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
            return fail(0, "two lengths of 4 bytes".into(), format!("{} bytes", data.len()));
        };
        let wanted = self.points.checked_mul(self.point_bytes());
        if wanted != Some(unpacked) {
            return fail(
                4,
                format!("{} points of {} bytes", self.points, self.point_bytes()),
                format!("{unpacked} bytes"),
            );
        }
        let Some(packed) = data[8..].get(..packed) else {
            return fail(0, format!("{packed} compressed bytes"), format!("{} bytes", data.len() - 8));
        };
        let columns = match lzf::decompress(packed, unpacked) {
            Ok(columns) => columns,
            Err((at, found)) => return fail(8 + at, format!("LZF of {unpacked} bytes"), found),
        };
        let fields = self.fields_in_bytes();
        // the sums are at most `unpacked`
        let starts = firsts(&self.counts, |field| fields[field].scalar.size() * self.points);
        let strides: Vec<usize> = fields.iter().zip(&self.counts).map(|(f, count)| f.scalar.size() * count).collect();
        let value =
            |at: usize, field: usize| fields[field].scalar.read(&columns, starts[field] + at * strides[field], false);
        Ok(assemble(&fields, if unpacked == 0 { 0 } else { self.points }, value))
    }

    fn note_missing(&self, file: &str, found: usize, at: usize, notes: &mut Notes) {
        if found < self.points {
            notes.note(NoteKind::Truncated, file, at, || (format!("{} points", self.points), format!("{found}")));
        }
    }
}

/// Where each field begins if each number takes `size`.
fn firsts(counts: &[usize], size: impl Fn(usize) -> usize) -> Vec<usize> {
    let mut next = 0;
    let first = |(field, count): (usize, &usize)| {
        let first = next;
        next += count * size(field);
        first
    };
    counts.iter().enumerate().map(first).collect()
}

/// Appends a row's numbers, if they are as many as there are columns.
fn push_row(table: &mut Vec<f64>, row: Row<'_>, columns: usize) -> bool {
    let before = table.len();
    for field in row.fields() {
        match field.parse() {
            Ok(number) if table.len() - before < columns => table.push(number),
            _ => {
                table.truncate(before);
                return false;
            }
        }
    }
    let is_whole = table.len() - before == columns;
    if !is_whole {
        table.truncate(before);
    }
    is_whole
}

fn scalar(kind: &str, size: &str) -> Option<Scalar> {
    Some(match (kind, size) {
        ("I", "1") => Scalar::I8,
        ("U", "1") => Scalar::U8,
        ("I", "2") => Scalar::I16,
        ("U", "2") => Scalar::U16,
        ("I", "4") => Scalar::I32,
        ("U", "4") => Scalar::U32,
        ("I", "8") => Scalar::I64,
        ("U", "8") => Scalar::U64,
        ("F", "4") => Scalar::F32,
        ("F", "8") => Scalar::F64,
        _ => return None,
    })
}

fn numbers(words: &[&str]) -> Option<Vec<usize>> {
    words.iter().map(|word| word.parse().ok()).collect()
}

fn numbers_f64(text: &str) -> Option<Vec<f64>> {
    let all: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    all.filter(|all| all.len() == 7)
}

#[cfg(test)]
mod tests;
