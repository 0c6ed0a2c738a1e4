//! What typed messages are put together from: how a field fits a definition, is read and is written.

mod fit;

pub use fit::{Fit, FitCheck};

use crate::encoder::Encoder;
use crate::error::RosError;
use crate::schema::{Arity, Base, FieldDef, FieldType, Primitive};
use crate::slice::Slice;
use crate::value::Value;
use crate::wire::{Cursor, Scalar};
use mapwright_geom::Stamp;
use std::borrow::Cow;

/// A field of a typed message, or a whole message.
pub trait Field<'a>: Sized + Default {
    /// The fewest bytes it takes.
    const MIN_BYTES: usize;
    /// Whether a definition has the field as this type, and exactly so.
    ///
    /// # Errors
    /// [`RosError::FieldType`] and [`RosError::MissingField`].
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError>;
    /// Reads it where the definition is exactly this type's.
    ///
    /// # Errors
    /// [`RosError::Cut`] with the field's path and the byte.
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError>;
    /// Takes it by name from a message decoded by its own definition.
    ///
    /// # Errors
    /// [`RosError::FieldType`] where the value is of another type.
    fn pick(value: &Value<'a>) -> Result<Self, RosError>;
    /// Writes it.
    fn write(&self, out: &mut Encoder);
}

/// That a picked value is of another type than the field; a definition that was checked before has none.
pub(crate) fn mismatch(expected: &str, found: &Value<'_>) -> RosError {
    let found = match found {
        Value::Text(_) => "a text".to_owned(),
        Value::Numbers(numbers) => format!("{}[]", numbers.primitive.name()),
        Value::List(_) => "a list".to_owned(),
        Value::Struct(record) => record.kind().name.clone(),
        _ => "another number".to_owned(),
    };
    RosError::FieldType { message: "a message".to_owned(), field: String::new(), expected: expected.to_owned(), found }
}

macro_rules! scalar_fields {
    ($($number:ty => $variant:ident),*) => {$(
        impl<'a> Field<'a> for $number {
            const MIN_BYTES: usize = size_of::<$number>();
            fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
                let expected = FieldType::one(Base::Number(<$number>::PRIMITIVE));
                if *ty == expected { Ok(()) } else { Err(check.refuse(ty, &expected.to_string())) }
            }
            #[inline]
            fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
                cursor.scalar()
            }
            fn pick(value: &Value<'a>) -> Result<Self, RosError> {
                match value {
                    Value::$variant(number) => Ok(*number),
                    other => Err(mismatch(<$number>::PRIMITIVE.name(), other)),
                }
            }
            fn write(&self, out: &mut Encoder) {
                out.scalar(*self);
            }
        }
    )*};
}

scalar_fields!(bool => Bool, i8 => I8, u8 => U8, i16 => I16, u16 => U16, i32 => I32, u32 => U32, i64 => I64,
    u64 => U64, f32 => F32, f64 => F64);

impl<'a> Field<'a> for Cow<'a, str> {
    const MIN_BYTES: usize = 4;
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        if *ty == FieldType::one(Base::String) { Ok(()) } else { Err(check.refuse(ty, "string")) }
    }
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        cursor.text()
    }
    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        match value {
            Value::Text(text) => Ok(text.clone()),
            other => Err(mismatch("string", other)),
        }
    }
    fn write(&self, out: &mut Encoder) {
        out.text(self);
    }
}

/// Time as ROS 1's `time` or ROS 2's `builtin_interfaces/Time`.
impl<'a> Field<'a> for Stamp {
    const MIN_BYTES: usize = 8;
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        let time = "builtin_interfaces/Time";
        let Base::Struct(kind) = &ty.base else { return Err(check.refuse(ty, time)) };
        let is = |index: usize, name: &str, primitives: &[Primitive]| {
            let of = |field: &FieldDef| primitives.iter().any(|p| field.ty == FieldType::one(Base::Number(*p)));
            kind.fields.get(index).is_some_and(|field| field.name == name && of(field))
        };
        let parts = is(0, "sec", &[Primitive::I32, Primitive::U32]) && is(1, "nanosec", &[Primitive::U32]);
        let same = ty.arity == Arity::One && kind.name == time && parts && kind.fields.len() == 2;
        if same { Ok(()) } else { Err(check.refuse(ty, &format!("{time} of int32 sec and uint32 nanosec"))) }
    }
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        let sec = match cursor.encoding() {
            crate::Encoding::Ros1 => i64::from(cursor.scalar::<u32>()?),
            crate::Encoding::Cdr => i64::from(cursor.scalar::<i32>()?),
        };
        Ok(Self(sec * 1_000_000_000 + i64::from(cursor.scalar::<u32>()?)))
    }
    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        let part = |name| match value {
            Value::Struct(record) => match record.field(name) {
                Some(Value::U32(number)) => Some(i64::from(*number)),
                Some(Value::I32(number)) => Some(i64::from(*number)),
                _ => None,
            },
            _ => None,
        };
        match (part("sec"), part("nanosec")) {
            (Some(sec), Some(nanosec)) => Ok(Self(sec * 1_000_000_000 + nanosec)),
            _ => Err(mismatch("builtin_interfaces/Time", value)),
        }
    }
    /// Stamps that 32 bits of seconds cannot carry are written as the nearest that they can.
    fn write(&self, out: &mut Encoder) {
        let (sec, nanosec) = (self.0.div_euclid(1_000_000_000), self.0.rem_euclid(1_000_000_000));
        match out.encoding() {
            crate::Encoding::Ros1 => out.scalar(sec.clamp(0, i64::from(u32::MAX)) as u32),
            crate::Encoding::Cdr => out.scalar(sec.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32),
        }
        out.scalar(nanosec as u32);
    }
}

impl<'a, T: Scalar> Field<'a> for Slice<'a, T> {
    const MIN_BYTES: usize = 4;
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        let listed = matches!(ty.arity, Arity::Any | Arity::AtMost(_));
        if listed && ty.base == Base::Number(T::PRIMITIVE) {
            return Ok(());
        }
        Err(check.refuse(ty, &format!("{}[]", T::PRIMITIVE.name())))
    }
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        let size = T::PRIMITIVE.size();
        let count = cursor.count(size)?;
        Ok(Self::Wire { bytes: cursor.numbers(size, count)?, big_endian: cursor.big_endian() })
    }
    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        let numbers = if let Value::Numbers(numbers) = value { numbers.as_slice() } else { None };
        numbers.ok_or_else(|| mismatch(T::PRIMITIVE.name(), value))
    }
    fn write(&self, out: &mut Encoder) {
        out.count(self.len());
        out.numbers(self.iter());
    }
}

impl<'a> Field<'a> for &'a [u8] {
    const MIN_BYTES: usize = 4;
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        Slice::<u8>::fit(ty, check)
    }
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        let count = cursor.count(1)?;
        cursor.numbers(1, count)
    }
    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        match value {
            Value::Numbers(numbers) if numbers.primitive == Primitive::U8 => Ok(numbers.bytes),
            other => Err(mismatch("uint8[]", other)),
        }
    }
    fn write(&self, out: &mut Encoder) {
        out.count(self.len());
        out.bytes(self);
    }
}

impl<'a, T: Field<'a>> Field<'a> for Vec<T> {
    const MIN_BYTES: usize = 4;
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        if !matches!(ty.arity, Arity::Any | Arity::AtMost(_)) {
            return Err(check.refuse(ty, "a list"));
        }
        T::fit(&FieldType::one(ty.base.clone()), check)
    }
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        let count = cursor.count(T::MIN_BYTES)?;
        // a wrong count must not allocate more than the message; the list grows as elements are found
        let mut list = Vec::with_capacity(count.min(cursor.left_bytes() / size_of::<T>().max(1) + 1));
        for index in 0..count {
            list.push(T::read(cursor).map_err(|e| e.inside(&format!("[{index}]")))?);
        }
        Ok(list)
    }
    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        match value {
            Value::List(values) => values.iter().map(T::pick).collect(),
            other => Err(mismatch("a list", other)),
        }
    }
    fn write(&self, out: &mut Encoder) {
        out.count(self.len());
        self.iter().for_each(|element| element.write(out));
    }
}

/// A list of always as many doubles, such as a covariance (row by row).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fixed<const N: usize>(pub [f64; N]);

impl<const N: usize> Default for Fixed<N> {
    fn default() -> Self {
        Self([0.0; N])
    }
}

impl<'a, const N: usize> Field<'a> for Fixed<N> {
    const MIN_BYTES: usize = 8 * N;
    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        let expected = FieldType { base: Base::Number(Primitive::F64), arity: Arity::Fixed(N) };
        if *ty == expected { Ok(()) } else { Err(check.refuse(ty, &expected.to_string())) }
    }
    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        let (bytes, big_endian) = (cursor.numbers(8, N)?, cursor.big_endian());
        Ok(Self::from_slice(&Slice::Wire { bytes, big_endian }))
    }
    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        let numbers = if let Value::Numbers(numbers) = value { numbers.as_slice::<f64>() } else { None };
        let numbers = numbers.filter(|numbers| numbers.len() == N);
        numbers.map(|numbers| Self::from_slice(&numbers)).ok_or_else(|| mismatch("float64[]", value))
    }
    fn write(&self, out: &mut Encoder) {
        out.numbers(self.0.iter().copied());
    }
}

impl<const N: usize> Fixed<N> {
    fn from_slice(numbers: &Slice<'_, f64>) -> Self {
        let mut values = [0.0; N];
        values.iter_mut().zip(numbers.iter()).for_each(|(value, number)| *value = number);
        Self(values)
    }
}
