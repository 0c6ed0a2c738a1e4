//! Numbers within the points of a cloud.

use crate::error::RosError;
use crate::messages::PointField;
use crate::schema::Primitive;
use crate::wire::Scalar;

/// Where in a point a number is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Access {
    pub(super) offset: usize,
    pub(super) primitive: Primitive,
    pub(super) big_endian: bool,
}

impl Access {
    /// As a `sensor_msgs/PointField` says, whose datatypes are numbers from 1 to 8.
    pub(super) fn of(field: &PointField<'_>, point_step: usize, big_endian: bool) -> Result<Self, RosError> {
        use Primitive::{F32, F64, I8, I16, I32, U8, U16, U32};
        let refuse = |expected: &str, found: String| RosError::Cloud {
            what: format!("field `{}`", field.name),
            expected: expected.to_owned(),
            found,
        };
        let types = [I8, U8, I16, U16, I32, U32, F32, F64];
        let primitive = usize::from(field.datatype).checked_sub(1).and_then(|index| types.get(index).copied());
        let primitive = primitive.ok_or_else(|| refuse("a datatype from 1 to 8", field.datatype.to_string()))?;
        let offset = field.offset as usize;
        let end = offset.saturating_add(primitive.size());
        if end > point_step {
            return Err(refuse(
                &format!("a place within the {point_step} bytes of a point"),
                format!("bytes {offset} to {end}"),
            ));
        }
        Ok(Self { offset, primitive, big_endian })
    }

    /// The number; zero where the point is too short, which [`Cloud::new`](super::Cloud::new) has checked.
    #[inline]
    pub(super) fn read(self, point: &[u8]) -> f64 {
        let bytes = point.get(self.offset..).unwrap_or_default();
        let big = self.big_endian;
        match self.primitive {
            Primitive::F32 => f64::from(f32::decode(bytes, big)),
            Primitive::F64 => f64::decode(bytes, big),
            Primitive::U8 | Primitive::Bool => f64::from(u8::decode(bytes, big)),
            Primitive::I8 => f64::from(i8::decode(bytes, big)),
            Primitive::U16 => f64::from(u16::decode(bytes, big)),
            Primitive::I16 => f64::from(i16::decode(bytes, big)),
            Primitive::U32 => f64::from(u32::decode(bytes, big)),
            Primitive::I32 => f64::from(i32::decode(bytes, big)),
            Primitive::U64 | Primitive::I64 => 0.0, // no datatype of a cloud
        }
    }
}
