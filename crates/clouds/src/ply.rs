//! PLY, the Stanford polygon format: ascii, and binary of either byte order.

use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::points::{Field, Points, assemble};
use crate::scalar::Scalar;
use crate::text::{Row, excerpt};

/// No header has more lines.
const HEADER_LINES_MAX: usize = 1000;

#[derive(Clone, Copy, PartialEq)]
enum Order {
    Ascii,
    Little,
    Big,
}

/// A property of an element.
struct Property {
    field: Field,
    /// Type of the length, where it is a list.
    list: Option<Scalar>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Header {
    order: Order,
    elements: Vec<Element>,
    data_at: usize,
}

/// Whether bytes begin as a PLY file does.
pub(crate) fn is_ply(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")
}

/// Reads the vertices of a PLY file: properties `x y z` of any type, colours and times if there are any. Lists are skipped.
///
/// A file that ends early gives the points before; what was lost is noted with its place.
///
/// # Errors
/// [`CloudError::Content`] where the header is none, or there are no vertices with `x`, `y` and `z`.
pub fn read_ply(file: &str, bytes: &[u8], notes: &mut Notes) -> Result<Points, CloudError> {
    let header = Header::parse(file, bytes)?;
    let Some(place) = header.elements.iter().position(|element| element.name == "vertex") else {
        return Err(CloudError::content(file, 0, "`element vertex`", "none"));
    };
    let (before, vertex) = (&header.elements[..place], &header.elements[place]);
    let mut cursor = Cursor { bytes, at: header.data_at, order: header.order };
    let skipped = before.iter().try_for_each(|element| cursor.skip(element));
    let fields: Vec<Field> = vertex.properties.iter().map(|property| property.field.clone()).collect();
    let has_lists = vertex.properties.iter().any(|property| property.list.is_some());
    let points = if skipped.is_none() {
        assemble(&fields, 0, |_, _| f64::NAN)
    } else if header.order == Order::Ascii || has_lists {
        let table = cursor.table(file, vertex, notes);
        let columns = fields.len().max(1);
        assemble(&fields, table.len() / columns, |at, field| table[at * columns + field])
    } else {
        cursor.records(&fields, vertex.count)
    };
    let points =
        points.map_err(|axis| CloudError::content(file, 0, "vertices with x, y and z", format!("no {axis}")))?;
    let found = points.points_m.len() as u64 + notes.count(NoteKind::BadRow);
    if found < vertex.count as u64 {
        let words = || (format!("{} vertices", vertex.count), format!("{}", points.points_m.len()));
        notes.note(NoteKind::Truncated, file, bytes.len(), words);
    }
    Ok(points)
}

impl Header {
    fn parse(file: &str, bytes: &[u8]) -> Result<Self, CloudError> {
        if !is_ply(bytes) {
            return Err(CloudError::content(file, 0, "`ply`", excerpt(bytes)));
        }
        let mut order = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut cursor = Cursor { bytes, at: 4, order: Order::Ascii };
        for _ in 0..HEADER_LINES_MAX {
            let Some(row) = cursor.line() else { break };
            let words: Vec<&str> = row.fields().collect();
            let done = match words.as_slice() {
                ["format", word, _] => {
                    order = order_of(word);
                    order.map(|_| ())
                }
                ["comment" | "obj_info", ..] | [] => Some(()),
                ["element", name, count] => count.parse().ok().map(|count| {
                    elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
                }),
                ["property", words @ ..] => property(words)
                    .zip(elements.last_mut())
                    .map(|(property, element)| element.properties.push(property)),
                ["end_header"] => {
                    let order = order.ok_or_else(|| CloudError::content(file, 4, "`format`", "none"))?;
                    return Ok(Self { order, elements, data_at: cursor.at });
                }
                _ => None,
            };
            done.ok_or_else(|| CloudError::content(file, row.offset_bytes, "a line of a PLY header", row.excerpt()))?;
        }
        Err(CloudError::content(file, cursor.at, "`end_header`", "none"))
    }
}

fn order_of(word: &str) -> Option<Order> {
    match word {
        "ascii" => Some(Order::Ascii),
        "binary_little_endian" => Some(Order::Little),
        "binary_big_endian" => Some(Order::Big),
        _ => None,
    }
}

fn property(words: &[&str]) -> Option<Property> {
    match words {
        ["list", length, kind, name] => {
            let length = scalar(length).filter(|length| length.is_integer())?;
            Some(Property { field: Field { name: (*name).to_owned(), scalar: scalar(kind)? }, list: Some(length) })
        }
        [kind, name] => Some(Property { field: Field { name: (*name).to_owned(), scalar: scalar(kind)? }, list: None }),
        _ => None,
    }
}

fn scalar(word: &str) -> Option<Scalar> {
    Some(match word {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "int64" | "long" => Scalar::I64,
        "uint64" | "ulong" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

/// A place in the bytes.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    order: Order,
}

impl<'a> Cursor<'a> {
    /// The next line; none at the end.
    fn line(&mut self) -> Option<Row<'a>> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
        let row = Row { offset_bytes: self.at, text: rest[..length].trim_ascii() };
        self.at += length + 1;
        Some(row)
    }

    /// The next line that is not empty.
    fn full_line(&mut self) -> Option<Row<'a>> {
        std::iter::from_fn(|| self.line()).find(|row| !row.text.is_empty())
    }

    /// A number, behind which it goes on; none at the end.
    fn number(&mut self, scalar: Scalar) -> Option<f64> {
        let next = self.at.checked_add(scalar.size()).filter(|next| *next <= self.bytes.len())?;
        let number = scalar.read(self.bytes, self.at, self.order == Order::Big);
        self.at = next;
        Some(number)
    }

    /// Goes behind so many numbers.
    fn pass(&mut self, scalar: Scalar, count: usize) -> Option<()> {
        let length = scalar.size().checked_mul(count)?;
        self.at = self.at.checked_add(length).filter(|next| *next <= self.bytes.len())?;
        Some(())
    }

    /// Goes behind an element; none where the file ends before.
    fn skip(&mut self, element: &Element) -> Option<()> {
        let has_lists = element.properties.iter().any(|property| property.list.is_some());
        if self.order == Order::Ascii {
            (0..element.count).try_for_each(|_| self.full_line().map(|_| ()))
        } else if has_lists {
            // each row takes a byte at least, so that this ends with the file
            (0..element.count).try_for_each(|_| self.row(element, |_| {}))
        } else {
            element.properties.iter().try_for_each(|property| self.pass(property.field.scalar, element.count))
        }
    }

    /// One binary row; lists give not a number.
    fn row(&mut self, element: &Element, mut take: impl FnMut(f64)) -> Option<()> {
        for property in &element.properties {
            match property.list {
                Some(length) => {
                    let length = self.number(length)?;
                    self.pass(property.field.scalar, length.max(0.0) as usize)?;
                    take(f64::NAN);
                }
                None => take(self.number(property.field.scalar)?),
            }
        }
        Some(())
    }

    /// Rows that are read one after the other, as a table.
    fn table(&mut self, file: &str, vertex: &Element, notes: &mut Notes) -> Vec<f64> {
        let mut table = Vec::new();
        for _ in 0..vertex.count {
            let before = table.len();
            if self.order == Order::Ascii {
                let Some(row) = self.full_line() else { break };
                if ascii_row(row, vertex, &mut table).is_none() {
                    table.truncate(before);
                    let words = || (format!("numbers of {} properties", vertex.properties.len()), row.excerpt());
                    notes.note(NoteKind::BadRow, file, row.offset_bytes, words);
                }
            } else if self.row(vertex, |number| table.push(number)).is_none() {
                table.truncate(before);
                break;
            }
        }
        table
    }

    /// Records of one length, as far as the file goes.
    fn records(&self, fields: &[Field], count: usize) -> Result<Points, &'static str> {
        let mut stride = 0;
        let mut offsets = Vec::with_capacity(fields.len());
        for field in fields {
            offsets.push(stride);
            stride += field.scalar.size();
        }
        let data = self.bytes.get(self.at..).unwrap_or_default();
        let count = count.min(data.len().checked_div(stride).unwrap_or(0));
        let is_big = self.order == Order::Big;
        assemble(fields, count, |at, field| fields[field].scalar.read(data, at * stride + offsets[field], is_big))
    }
}

fn ascii_row(row: Row<'_>, vertex: &Element, table: &mut Vec<f64>) -> Option<()> {
    let mut fields = row.fields();
    for property in &vertex.properties {
        let number: f64 = fields.next()?.parse().ok()?;
        if property.list.is_none() {
            table.push(number);
            continue;
        }
        for _ in 0..number.max(0.0) as usize {
            fields.next()?;
        }
        table.push(f64::NAN);
    }
    Some(())
}

#[cfg(test)]
mod tests;
