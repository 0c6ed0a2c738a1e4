//! Colours of points.

use super::access::Access;
use crate::messages::PointField;
use crate::schema::Primitive;

/// How points say what colour they are.
#[derive(Debug, Clone, Copy)]
pub(super) enum Colour {
    /// `0xAARRGGBB` in four bytes, which PCL calls a float.
    Packed(Access),
    /// A number from 0 to 255 each.
    Apart([Access; 3]),
}

impl Colour {
    /// None where there is none, or none that lies within the point.
    pub(super) fn of(fields: &[PointField<'_>], point_step: usize, big_endian: bool) -> Option<Self> {
        let find = |name: &str| fields.iter().find(|field| field.name == name);
        let access = |field: &PointField<'_>| Access::of(field, point_step, big_endian).ok();
        if let Some(packed) = find("rgb").or_else(|| find("rgba")).and_then(access) {
            let is_whole = packed.primitive.size() == 4;
            return is_whole.then_some(Self::Packed(Access { primitive: Primitive::U32, ..packed }));
        }
        let apart = [["r", "g", "b"], ["red", "green", "blue"]];
        apart.iter().find_map(|[r, g, b]| Some(Self::Apart([access(find(r)?)?, access(find(g)?)?, access(find(b)?)?])))
    }

    /// Red, green and blue.
    pub(super) fn read(&self, point: &[u8]) -> [u8; 3] {
        match self {
            Self::Packed(access) => {
                let [_, r, g, b] = (access.read(point) as u32).to_be_bytes();
                [r, g, b]
            }
            Self::Apart(rgb) => rgb.map(|access| access.read(point) as u8),
        }
    }
}
