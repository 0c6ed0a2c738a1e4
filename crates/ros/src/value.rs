//! Any message as a tree of values, by its definition.

use crate::error::RosError;
use crate::schema::{Arity, Base, FieldType, Primitive, StructType};
use crate::slice::Slice;
use crate::wire::{Cursor, Encoding, Scalar};
use std::borrow::Cow;
use std::sync::Arc;

/// A field's value. Arrays of numbers stay where they are.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // the numbers' names say it
pub enum Value<'a> {
    Bool(bool),
    I8(i8),
    U8(u8),
    I16(i16),
    U16(u16),
    I32(i32),
    U32(u32),
    I64(i64),
    U64(u64),
    F32(f32),
    F64(f64),
    /// A text; what was no UTF-8 is replaced.
    Text(Cow<'a, str>),
    /// An array of numbers.
    Numbers(Numbers<'a>),
    /// A list of texts or messages.
    List(Box<[Value<'a>]>),
    /// A message.
    Struct(Record<'a>),
}

/// An array of numbers as it is in the message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numbers<'a> {
    /// Their type.
    pub primitive: Primitive,
    /// Their bytes.
    pub bytes: &'a [u8],
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
}

impl<'a> Numbers<'a> {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bytes.len() / self.primitive.size()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The numbers, if they are of that type.
    #[must_use]
    pub fn as_slice<T: Scalar>(&self) -> Option<Slice<'a, T>> {
        (T::PRIMITIVE == self.primitive).then_some(Slice::Wire { bytes: self.bytes, big_endian: self.big_endian })
    }
}

/// A message's values with their names.
#[derive(Debug, Clone, PartialEq)]
pub struct Record<'a> {
    kind: Arc<StructType>,
    values: Box<[Value<'a>]>,
}

impl<'a> Record<'a> {
    /// What it consists of.
    #[must_use]
    pub fn kind(&self) -> &Arc<StructType> {
        &self.kind
    }

    /// Names and values in the order of the definition.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value<'a>)> {
        self.kind.fields.iter().map(|field| field.name.as_str()).zip(self.values.iter())
    }

    /// The value of a field of this message.
    #[must_use]
    pub fn field(&self, name: &str) -> Option<&Value<'a>> {
        self.kind.position(name).and_then(|index| self.values.get(index))
    }

    /// The value at a path such as `header.stamp.sec`; no way into lists.
    #[must_use]
    pub fn get(&self, path: &str) -> Option<&Value<'a>> {
        match path.split_once('.') {
            None => self.field(path),
            Some((first, rest)) => match self.field(first)? {
                Value::Struct(record) => record.get(rest),
                _ => None,
            },
        }
    }
}

/// Values that one message may make: a definition of empty messages would otherwise make any number from nothing.
fn value_limit(message_bytes: usize) -> usize {
    1024 + 4 * message_bytes
}

/// Decodes the message at the cursor.
///
/// # Errors
/// [`RosError::Cut`], [`RosError::Bound`] and [`RosError::Unsupported`], with the field's path and the byte.
pub fn decode_record<'a>(kind: &Arc<StructType>, cursor: &mut Cursor<'a>) -> Result<Record<'a>, RosError> {
    let values_left = value_limit(cursor.left_bytes());
    Dynamic { cursor, values_left }.record(kind)
}

struct Dynamic<'c, 'a> {
    cursor: &'c mut Cursor<'a>,
    values_left: usize,
}

impl<'a> Dynamic<'_, 'a> {
    fn record(&mut self, kind: &Arc<StructType>) -> Result<Record<'a>, RosError> {
        if kind.fields.is_empty() && self.cursor.encoding() == Encoding::Cdr {
            self.cursor.scalar::<u8>()?; // IDL has no empty struct; ROS 2 puts a byte there
        }
        // a definition may have more fields than the message has bytes
        let mut values = Vec::with_capacity(kind.fields.len().min(64));
        for field in &kind.fields {
            values.push(self.field(&field.ty).map_err(|e| e.inside(&field.name))?);
        }
        let values = values.into_boxed_slice();
        Ok(Record { kind: kind.clone(), values })
    }

    fn field(&mut self, ty: &FieldType) -> Result<Value<'a>, RosError> {
        let count = match ty.arity {
            Arity::One => return self.one(&ty.base),
            Arity::Fixed(count) => count,
            Arity::Any => self.cursor.count(ty.base.min_bytes())?,
            Arity::AtMost(limit) => self.bounded(limit, ty.base.min_bytes())?,
        };
        if let Base::Number(primitive) = ty.base {
            let (bytes, big_endian) = (self.cursor.numbers(primitive.size(), count)?, self.cursor.big_endian());
            return Ok(Value::Numbers(Numbers { primitive, bytes, big_endian }));
        }
        let mut values = Vec::with_capacity(count.min(self.cursor.left_bytes() / size_of::<Value<'_>>() + 1));
        for index in 0..count {
            values.push(self.one(&ty.base).map_err(|e| e.inside(&format!("[{index}]")))?);
        }
        Ok(Value::List(values.into_boxed_slice()))
    }

    fn bounded(&mut self, limit: usize, min_bytes: usize) -> Result<usize, RosError> {
        let found = self.cursor.count(min_bytes)?;
        let offset_bytes = self.cursor.offset_bytes() - 4;
        if found <= limit {
            Ok(found)
        } else {
            Err(RosError::Bound { field: String::new(), offset_bytes, limit, found })
        }
    }

    fn one(&mut self, base: &Base) -> Result<Value<'a>, RosError> {
        let reason = "the message makes more values than its bytes can hold";
        self.values_left =
            self.values_left.checked_sub(1).ok_or_else(|| unsupported("list of empty messages", reason))?;
        Ok(match base {
            Base::Number(primitive) => self.number(*primitive)?,
            Base::String => Value::Text(self.cursor.text()?),
            Base::WString => return Err(unsupported("wstring", "middlewares encode it differently")),
            Base::Struct(kind) => Value::Struct(self.record(kind)?),
        })
    }

    fn number(&mut self, primitive: Primitive) -> Result<Value<'a>, RosError> {
        Ok(match primitive {
            Primitive::Bool => Value::Bool(self.cursor.scalar()?),
            Primitive::I8 => Value::I8(self.cursor.scalar()?),
            Primitive::U8 => Value::U8(self.cursor.scalar()?),
            Primitive::I16 => Value::I16(self.cursor.scalar()?),
            Primitive::U16 => Value::U16(self.cursor.scalar()?),
            Primitive::I32 => Value::I32(self.cursor.scalar()?),
            Primitive::U32 => Value::U32(self.cursor.scalar()?),
            Primitive::I64 => Value::I64(self.cursor.scalar()?),
            Primitive::U64 => Value::U64(self.cursor.scalar()?),
            Primitive::F32 => Value::F32(self.cursor.scalar()?),
            Primitive::F64 => Value::F64(self.cursor.scalar()?),
        })
    }
}

fn unsupported(kind: &'static str, reason: &'static str) -> RosError {
    RosError::Unsupported { field: String::new(), kind, reason }
}
