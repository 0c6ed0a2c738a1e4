//! Voxels by their places.

/// Voxels along an axis to either side of the origin.
const HALF: i64 = 1 << 20;

/// A voxel's place, packed: 21 bits each of x, y and z.
pub(crate) type Key = u64;

/// The voxel that a point lies in, in voxels of side one; none beyond 2^20 voxels from the origin or where it is no point.
#[inline]
pub(crate) fn key_of(scaled: [f64; 3]) -> Option<Key> {
    let [x, y, z] = scaled.map(|v| v.floor());
    let inside = |v: f64| v >= -(HALF as f64) && v < HALF as f64;
    (inside(x) && inside(y) && inside(z)).then(|| pack([x as i64, y as i64, z as i64]))
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
