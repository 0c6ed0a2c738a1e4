//! Messages of any definition with random content, serialized without the crate's encoder.

use mapwright_ros::Encoding;
use mapwright_ros::schema::{Arity, Base, FieldType, Primitive, StructType};

/// A sequence of numbers that depends on its seed only (SplitMix64).
#[derive(Clone)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit as u64) as usize
    }
}

/// The three ways in which messages come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Style {
    Ros1,
    CdrLittle,
    CdrBig,
}

impl Style {
    pub(crate) const ALL: [Self; 3] = [Self::Ros1, Self::CdrLittle, Self::CdrBig];

    pub(crate) fn encoding(self) -> Encoding {
        if self == Self::Ros1 { Encoding::Ros1 } else { Encoding::Cdr }
    }
}

/// A message with random content.
pub(crate) fn message(kind: &StructType, style: Style, random: &mut Random) -> Vec<u8> {
    let mut writer = Writer { body: Vec::new(), style, random };
    writer.structure(kind);
    let body = writer.body;
    match style {
        Style::Ros1 => body,
        Style::CdrLittle => [&[0, 1, 0, 0], body.as_slice()].concat(),
        Style::CdrBig => [&[0, 0, 0, 0], body.as_slice()].concat(),
    }
}

struct Writer<'r> {
    body: Vec<u8>,
    style: Style,
    random: &'r mut Random,
}

impl Writer<'_> {
    fn structure(&mut self, kind: &StructType) {
        for field in &kind.fields {
            if kind.name == "builtin_interfaces/Time" && field.name == "nanosec" {
                let nanosec = self.random.next() % 1_000_000_000;
                self.put(&(nanosec as u32).to_le_bytes());
            } else {
                self.field(&field.ty);
            }
        }
    }

    fn field(&mut self, ty: &FieldType) {
        let count = match ty.arity {
            Arity::One => return self.one(&ty.base),
            Arity::Fixed(count) => count,
            Arity::AtMost(limit) => self.count(limit.min(3) + 1),
            Arity::Any => self.count(if matches!(ty.base, Base::Number(_)) { 40 } else { 4 }),
        };
        (0..count).for_each(|_| self.one(&ty.base));
    }

    fn count(&mut self, limit: usize) -> usize {
        let count = self.random.below(limit);
        self.put(&(count as u32).to_le_bytes());
        count
    }

    fn one(&mut self, base: &Base) {
        match base {
            Base::Number(primitive) => self.number(*primitive),
            Base::String => self.text(),
            Base::WString => panic!("no wstring in the built-in types"),
            Base::Struct(kind) => self.structure(kind),
        }
    }

    /// Floats are ordinary numbers: those that are not lose digits on their way through other languages.
    fn number(&mut self, primitive: Primitive) {
        let bits = self.random.next();
        let ordinary = f64::from(bits as i32) * 1e-3;
        match primitive {
            Primitive::Bool => self.put(&[bits as u8 & 1]),
            Primitive::F32 => self.put(&(ordinary as f32).to_le_bytes()),
            Primitive::F64 => self.put(&ordinary.to_le_bytes()),
            _ => self.put(&bits.to_le_bytes()[..primitive.size()]),
        }
    }

    fn text(&mut self) {
        let length = self.random.below(9);
        let text: String = (0..length).map(|_| ["a", "/", "ß", "x"][self.random.below(4)]).collect();
        let cdr = self.style != Style::Ros1;
        self.put(&(text.len() as u32 + u32::from(cdr)).to_le_bytes());
        self.body.extend_from_slice(text.as_bytes());
        self.body.extend_from_slice(&[0][..usize::from(cdr)]);
    }

    fn put(&mut self, little: &[u8]) {
        if self.style != Style::Ros1 {
            self.body.resize(self.body.len().next_multiple_of(little.len()), 0);
        }
        let at = self.body.len();
        self.body.extend_from_slice(little);
        if self.style == Style::CdrBig {
            self.body[at..].reverse();
        }
    }
}
