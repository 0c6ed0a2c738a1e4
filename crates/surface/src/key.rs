//! Blocks and cells by their places.

/// A place of three whole numbers, packed: 21 bits each of x, y and z. Sorted keys are sorted places.
pub(crate) type Key = u64;

/// A block is 2^3 voxels a side.
pub(crate) const BLOCK_BITS: u32 = 3;
/// Voxels along a block's side.
pub(crate) const BLOCK_SIDE: i32 = 1 << BLOCK_BITS;
/// Voxels of a block.
pub(crate) const BLOCK_VOXELS: usize = 1 << (3 * BLOCK_BITS);

/// Places along an axis to either side of the origin.
const HALF: i32 = 1 << 20;
/// What is farther from the origin along an axis is left out, in cells of a cloud and in voxels of a map. A power below [`HALF`], so that
/// whatever is written around a point has a place.
pub(crate) const FARTHEST: f64 = (HALF / 2) as f64;

#[inline]
pub(crate) fn pack([x, y, z]: [i32; 3]) -> Key {
    let part = |v: i32| (v.wrapping_add(HALF) & 0x1f_ffff) as u64;
    part(x) << 42 | part(y) << 21 | part(z)
}

#[inline]
pub(crate) fn unpack(key: Key) -> [i32; 3] {
    let part = |shift: u32| (key >> shift & 0x1f_ffff) as i32 - HALF;
    [part(42), part(21), part(0)]
}

/// What is asked along each axis; inlined where arrays' own `map` is not, which took two fifths of the time of drawing a cloud.
#[inline]
pub(crate) fn along<T>(of: impl Fn(usize) -> T) -> [T; 3] {
    [of(0), of(1), of(2)]
}

/// Of a number within [`FARTHEST`].
#[inline]
pub(crate) fn floor(v: f64) -> i32 {
    let whole = v as i32;
    whole - i32::from(v < f64::from(whole))
}

/// Whether a place, in cells or voxels, is one; what is not finite is none.
#[inline]
pub(crate) fn is_within(at: [f64; 3]) -> bool {
    at.iter().all(|v| v.abs() < FARTHEST)
}

/// The number of a voxel within its block.
#[inline]
pub(crate) fn within_block([x, y, z]: [i32; 3]) -> usize {
    let part = |v: i32| (v & (BLOCK_SIDE - 1)) as usize;
    part(x) | part(y) << BLOCK_BITS | part(z) << (2 * BLOCK_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_come_back_and_keep_their_order() {
        let places = [[-5, 0, 7], [-5, 0, 8], [-5, 1, -9], [0, -1, 0], [0, 0, 0], [1, -HALF, HALF - 1]];
        assert!(places.iter().all(|&place| unpack(pack(place)) == place));
        assert!(places.is_sorted_by_key(|&place| pack(place)));
        assert_eq!((floor(-1.5), floor(-2.0), floor(1.5)), (-2, -2, 1));
        assert!(!is_within([f64::NAN, 0.0, 0.0]) && !is_within([1e300, 0.0, 0.0]) && is_within([-5e5, 0.0, 0.0]));
    }
}
