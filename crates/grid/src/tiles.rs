//! Sparse tiles of 64 x 64 cells, unbounded in extent.

use rustc_hash::FxHashMap;

/// Cells along a tile's side, as a power of two.
pub(crate) const TILE_BITS: u32 = 6;
/// Cells along a tile's side.
pub(crate) const TILE_SIDE: i32 = 1 << TILE_BITS;
/// Cells in a tile.
pub(crate) const TILE_CELLS: usize = 1 << (2 * TILE_BITS);
/// No tile.
pub(crate) const NO_TILE: u32 = u32::MAX;

const CACHE_BITS: u32 = 5;
const CACHE: usize = 1 << (2 * CACHE_BITS);

/// The cell of a coordinate given in cells: rounded down. Coordinates beyond 2^30 cells are clamped to the edge.
///
/// To a millionth of a cell: what is less than half of that below a whole number counts as that number.
#[inline]
#[must_use]
pub fn floor_cell(cells: f64) -> i32 {
    const EDGE: f64 = 1_073_741_824.0;
    // In 1.5 * 2^32 + cells the mantissa's lowest 20 bits are the fraction and the 32 above them 2^31 + floor(cells).
    const BIAS: f64 = 6_442_450_944.0;
    let biased = cells.clamp(-EDGE, EDGE) + BIAS;
    ((biased.to_bits() >> 20) as u32 ^ 1 << 31) as i32
}

/// The tile that holds a cell.
pub(crate) fn tile_of(cell_x: i32, cell_y: i32) -> (i32, i32) {
    (cell_x >> TILE_BITS, cell_y >> TILE_BITS)
}

/// Index of a cell within its tile, row by row.
pub(crate) fn cell_in_tile(cell_x: i32, cell_y: i32) -> usize {
    (((cell_y & (TILE_SIDE - 1)) << TILE_BITS) | (cell_x & (TILE_SIDE - 1))) as usize
}

#[derive(Debug, Clone, Copy)]
struct CacheEntry {
    tile: (i32, i32),
    number: u32,
}

/// From tile coordinates to tile numbers: a hash map behind a small direct-mapped table of the tiles used last.
#[derive(Debug, Clone)]
pub(crate) struct TileIndex {
    numbers: FxHashMap<(i32, i32), u32>,
    cache: Box<[CacheEntry; CACHE]>,
}

impl TileIndex {
    pub(crate) fn new() -> Self {
        let empty = CacheEntry { tile: (i32::MIN, i32::MIN), number: NO_TILE };
        Self { numbers: FxHashMap::default(), cache: Box::new([empty; CACHE]) }
    }

    fn slot(tile: (i32, i32)) -> usize {
        const MASK: i32 = (1 << CACHE_BITS) - 1;
        (((tile.1 & MASK) << CACHE_BITS) | (tile.0 & MASK)) as usize
    }

    /// Number of the tile, or [`NO_TILE`].
    #[inline]
    pub(crate) fn find(&self, tile: (i32, i32)) -> u32 {
        let entry = &self.cache[Self::slot(tile)];
        if entry.tile == tile { entry.number } else { self.numbers.get(&tile).copied().unwrap_or(NO_TILE) }
    }

    /// Number of the tile, which becomes `next` where there is none yet; true where it is new.
    #[inline]
    pub(crate) fn find_or_insert(&mut self, tile: (i32, i32), next: u32) -> (u32, bool) {
        let entry = &self.cache[Self::slot(tile)];
        if entry.tile == tile { (entry.number, false) } else { self.enter(tile, next) }
    }

    #[cold]
    fn enter(&mut self, tile: (i32, i32), next: u32) -> (u32, bool) {
        let number = *self.numbers.entry(tile).or_insert(next);
        self.cache[Self::slot(tile)] = CacheEntry { tile, number };
        (number, number == next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_rounded_down_and_end_at_an_edge() {
        for (cells, cell) in
            [(0.0, 0), (0.99, 0), (1.0, 1), (-0.01, -1), (-1.0, -1), (-64.5, -65), (1e6 + 0.5, 1_000_000)]
        {
            assert_eq!(floor_cell(cells), cell, "{cells}");
        }
        for cells in [1.1e9, 1e20, f64::INFINITY] {
            assert_eq!((floor_cell(cells), floor_cell(-cells)), (1 << 30, -(1 << 30)), "{cells}");
        }
    }
}
