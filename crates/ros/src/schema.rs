//! What a message consists of.

use std::fmt;
use std::sync::Arc;

/// A number's type on the wire. `byte` and `char` are `uint8`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names say it
pub enum Primitive {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Primitive {
    /// Bytes on the wire.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Name in a definition.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::I8 => "int8",
            Self::U8 => "uint8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::I32 => "int32",
            Self::U32 => "uint32",
            Self::I64 => "int64",
            Self::U64 => "uint64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }

    pub(crate) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Self::Bool,
            "int8" => Self::I8,
            "uint8" | "byte" | "char" => Self::U8,
            "int16" => Self::I16,
            "uint16" => Self::U16,
            "int32" => Self::I32,
            "uint32" => Self::U32,
            "int64" => Self::I64,
            "uint64" => Self::U64,
            "float32" => Self::F32,
            "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// What one element of a field is.
#[derive(Debug, Clone, PartialEq)]
pub enum Base {
    /// A number.
    Number(Primitive),
    /// Bytes that should be UTF-8.
    String,
    /// Wide characters, whose encoding differs between middlewares; never decoded.
    WString,
    /// Another message.
    Struct(Arc<StructType>),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// One, not a list.
    One,
    /// Always as many.
    Fixed(usize),
    /// Up to as many.
    AtMost(usize),
    /// Any number.
    Any,
}

/// Type of a field.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldType {
    /// What one element is.
    pub base: Base,
    /// How many there are.
    pub arity: Arity,
}

impl FieldType {
    pub(crate) fn one(base: Base) -> Self {
        Self { base, arity: Arity::One }
    }

    /// The fewest bytes a field of this type takes.
    pub(crate) fn min_bytes(&self) -> usize {
        match self.arity {
            Arity::One => self.base.min_bytes(),
            Arity::Fixed(count) => self.base.min_bytes().saturating_mul(count),
            Arity::AtMost(_) | Arity::Any => 4,
        }
    }
}

impl Base {
    /// The fewest bytes an element takes.
    pub(crate) fn min_bytes(&self) -> usize {
        match self {
            Self::Number(primitive) => primitive.size(),
            Self::String | Self::WString => 4,
            Self::Struct(kind) => kind.min_bytes,
        }
    }
}

impl fmt::Display for FieldType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.base {
            Base::Number(primitive) => f.write_str(primitive.name())?,
            Base::String => f.write_str("string")?,
            Base::WString => f.write_str("wstring")?,
            Base::Struct(kind) => f.write_str(&kind.name)?,
        }
        match self.arity {
            Arity::One => Ok(()),
            Arity::Fixed(count) => write!(f, "[{count}]"),
            Arity::AtMost(count) => write!(f, "[<={count}]"),
            Arity::Any => f.write_str("[]"),
        }
    }
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldDef {
    /// Its name.
    pub name: String,
    /// Its type.
    pub ty: FieldType,
}

/// A named number or text in a definition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Constant {
    /// Its type, as written.
    pub type_name: String,
    /// Its name.
    pub name: String,
    /// Its value, as written.
    pub value: String,
}

/// A message's fields in the order in which they are on the wire.
///
/// ROS 1's `time` and `duration` appear as `builtin_interfaces/Time` and `Duration`, with fields `sec` and `nanosec`.
#[derive(Debug, Clone, PartialEq)]
pub struct StructType {
    /// `package/Type`, without the `msg` that ROS 2 puts between.
    pub name: String,
    /// Its fields.
    pub fields: Vec<FieldDef>,
    /// Its constants.
    pub constants: Vec<Constant>,
    /// The fewest bytes it takes, padding not counted.
    pub(crate) min_bytes: usize,
}

impl StructType {
    pub(crate) fn new(name: String, fields: Vec<FieldDef>, constants: Vec<Constant>) -> Self {
        let min_bytes = fields.iter().fold(0usize, |sum, field| sum.saturating_add(field.ty.min_bytes()));
        Self { name, fields, constants, min_bytes }
    }

    /// Place of the field with this name; letters that differ in case only are equal where no other field is (ROS 1 has
    /// `CameraInfo.K`, ROS 2 has `k`).
    #[must_use]
    pub fn position(&self, name: &str) -> Option<usize> {
        let exact = self.fields.iter().position(|field| field.name == name);
        exact.or_else(|| self.fields.iter().position(|field| field.name.eq_ignore_ascii_case(name)))
    }

    /// Names of the fields, for messages.
    pub(crate) fn field_names(&self) -> String {
        let names: Vec<_> = self.fields.iter().map(|field| field.name.as_str()).collect();
        if names.is_empty() { "no fields".to_owned() } else { names.join(", ") }
    }

    /// `sec` and `nanosec` of the given types.
    pub(crate) fn time(name: &str, sec: Primitive, nanosec: Primitive) -> Self {
        let field =
            |name: &str, primitive| FieldDef { name: name.to_owned(), ty: FieldType::one(Base::Number(primitive)) };
        Self::new(name.to_owned(), vec![field("sec", sec), field("nanosec", nanosec)], Vec::new())
    }
}
