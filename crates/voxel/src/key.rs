//! Voxels by their places.

/// Voxels along an axis to either side of the origin.
const HALF: i64 = 1 << 20;

/// A voxel's place, packed: 21 bits each of x, y and z.
pub(crate) type Key = u64;

/// The voxel that a point lies in, in voxels of side one; none beyond 2^20 voxels from the origin or where it is no point.
#[inline]
pub(crate) fn key_of(scaled: [f64; 3]) -> Option<Key> {
    let inside = |v: f64| v >= -(HALF as f64) && v < HALF as f64;
    (inside(scaled[0]) && inside(scaled[1]) && inside(scaled[2])).then(|| pack(scaled.map(floor)))
}

/// Of a number that a voxel's place can be.
#[inline]
fn floor(v: f64) -> i64 {
    let whole = v as i64;
    whole - i64::from(v < whole as f64)
}

#[inline]
pub(crate) fn pack([x, y, z]: [i64; 3]) -> Key {
    let part = |v: i64| (v + HALF) as u64 & 0x1f_ffff;
    part(x) << 42 | part(y) << 21 | part(z)
}

/// Its least corner, in voxels.
#[inline]
pub(crate) fn corner(key: Key) -> [f64; 3] {
    let part = |shift: u32| ((key >> shift & 0x1f_ffff) as i64 - HALF) as f64;
    [part(42), part(21), part(0)]
}

/// A voxel's place, in voxels.
#[inline]
pub(crate) fn unpack(key: Key) -> [i32; 3] {
    let part = |shift: u32| ((key >> shift & 0x1f_ffff) as i64 - HALF) as i32;
    [part(42), part(21), part(0)]
}
