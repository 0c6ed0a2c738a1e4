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
#[inline]
pub(crate) fn floor_cell(cells: f64) -> i32 {
    const BIAS: f64 = 1_073_741_824.0;
    // Positive after the bias, so that truncation rounds down; the cast saturates.
    ((cells + BIAS) as i64 - BIAS as i64) as i32
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
