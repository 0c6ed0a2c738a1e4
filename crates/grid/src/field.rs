//! A truncated Euclidean distance transform that follows its obstacles.
//!
//! Every cell within [`DistanceField::radius_cells`] of an obstacle knows its nearest one; ties go to the smallest
//! `(y, x)`, so that the field is a function of the set of obstacles and has no history. An obstacle that appears is
//! compared with what the cells around it know. When some disappear, the cells that pointed at them look at all that is
//! left around, from bit rows of obstacles. Both are exact, unlike propagation among neighbours (brushfire: Kalra,
//! Ferguson, Stentz 2006; Lau, Sprunk, Burgard 2013), whose truncation error this avoids.

use crate::survivors::Survivors;
use crate::tiles::{NO_TILE, TILE_BITS, TILE_CELLS, TILE_SIDE, TileIndex, cell_in_tile, tile_of};

/// No obstacle within the radius.
pub(crate) const NO_OBSTACLE: u32 = u32::MAX;
/// Rank of an obstacle beyond the radius, to a cell that knows none,
const FAR: i16 = i16::MAX - 1;
/// and to a cell that is none of its disc's.
const OUTSIDE: i16 = i16::MAX;
const MAX_RADIUS_CELLS: i32 = 15;

#[derive(Debug, Clone)]
pub(crate) struct FieldTile {
    key: (i32, i32),
    /// Obstacle handle per cell.
    pub(crate) nearest: Box<[u32; TILE_CELLS]>,
    /// The obstacle's rank among those that may be nearest to the cell.
    rank: Box<[i16; TILE_CELLS]>,
    occupied: [u64; TILE_SIDE as usize],
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct DistanceField {
    radius: i32,
    index: TileIndex,
    pub(crate) tiles: Vec<FieldTile>,
    /// The disc of cells within the radius, row by row.
    disc: Vec<DiscRow>,
    /// Cell of each obstacle handle.
    cells: Vec<(i32, i32)>,
    orphans: Vec<(i32, i32)>,
    gone: Vec<(i32, i32)>,
    survivors: Survivors,
    /// Corner of the survivors' box.
    corner: (i32, i32),
}

/// Look-ups that stay in a tile for a while, as those of neighbouring beams do.
pub(crate) struct LookUps<'a> {
    field: &'a DistanceField,
    tile: (i32, i32),
    number: u32,
}

/// Cells that are looked at together: a disc's row fits in.
const WINDOW: usize = 32;
/// So many entries before and after a disc's middle column are enough for a window anywhere in a tile.
const DISC_SIDE: usize = WINDOW + MAX_RADIUS_CELLS as usize + 1;

/// Obstacles so many columns and rows from a cell in the order in which they are nearest to it: by distance, then by row, then by
/// column. No two have the same rank.
fn rank(dx: i32, dy: i32) -> i16 {
    // Below 2^14: the squared distance is at most 15^2.
    ((dx * dx + dy * dy) << 6 | (dy + MAX_RADIUS_CELLS) << 1 | i32::from(dx > 0)) as i16
}

/// Ranks of a disc's middle for the cells along one of its rows: in the middle that for its own column.
#[derive(Debug, Clone)]
struct DiscRow([i16; 2 * DISC_SIDE]);

impl DiscRow {
    fn new(dy: i32, radius: i32) -> Self {
        Self(std::array::from_fn(|k| {
            let dx = k as i32 - DISC_SIDE as i32;
            if dx * dx + dy * dy <= radius * radius { rank(-dx, -dy) } else { OUTSIDE }
        }))
    }

    /// From a column of a tile's row on: the ranks of a middle that is in column `x`.
    #[inline]
    fn window(&self, start: usize, x: i32) -> &[i16; WINDOW] {
        let from = (start as i32 - x + DISC_SIDE as i32) as usize;
        self.0.get(from..).and_then(|ranks| ranks.first_chunk()).unwrap_or(&[OUTSIDE; WINDOW])
    }
}

/// First column of the window over a tile's row in which is all of a disc whose middle is in column `x`.
fn window_start(x: i32) -> usize {
    (x - MAX_RADIUS_CELLS).clamp(0, TILE_SIDE - WINDOW as i32) as usize
}

/// What is nearer than what was known takes its place, in the widest registers there are. No branches: where a disc wins is hard to
/// foresee.
struct Claim<'a> {
    known: &'a mut [i16; WINDOW],
    nearest: &'a mut [u32; WINDOW],
    ranks: &'a [i16; WINDOW],
    handle: u32,
}

impl pulp::WithSimd for Claim<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { ranks, handle, .. } = self;
        // Copies, for the compiler has to know that the arrays are apart.
        let (mut known, mut nearest) = (*self.known, *self.nearest);
        for k in 0..WINDOW {
            nearest[k] = if ranks[k] < known[k] { handle } else { nearest[k] };
            known[k] = known[k].min(ranks[k]);
        }
        (*self.known, *self.nearest) = (known, nearest);
    }
}

fn any_same(a: &[i16; WINDOW], b: &[i16; WINDOW]) -> bool {
    a.iter().zip(b).fold(false, |any, (a, b)| any | (a == b))
}

/// The rows that a disc around a cell has in a tile, with the row's number and the cell's column within the tile.
#[inline]
fn for_each_row_in_tile(
    disc: &[DiscRow],
    tile: (i32, i32),
    cell: (i32, i32),
    mut call: impl FnMut(&DiscRow, i32, i32),
) {
    let (x, y) = (cell.0 - (tile.0 << TILE_BITS), cell.1 - (tile.1 << TILE_BITS));
    let first = y - disc.len() as i32 / 2;
    for (row, y) in disc.iter().zip(first..).filter(|(_, y)| (0..TILE_SIDE).contains(y)) {
        call(row, y, x);
    }
}

impl LookUps<'_> {
    /// As [`DistanceField::nearest`].
    #[inline(always)]
    pub(crate) fn nearest(&mut self, cell_x: i32, cell_y: i32) -> u32 {
        let tile = tile_of(cell_x, cell_y);
        if tile != self.tile {
            (self.tile, self.number) = (tile, self.field.index.find(tile));
        }
        match self.number {
            NO_TILE => NO_OBSTACLE,
            number => self.field.tiles[number as usize].nearest[cell_in_tile(cell_x, cell_y)],
        }
    }
}

impl DistanceField {
    /// An empty field that knows obstacles up to `radius_cells` away (1 to 15).
    #[must_use]
    pub fn new(radius_cells: u32) -> Self {
        let radius = (radius_cells as i32).clamp(1, MAX_RADIUS_CELLS);
        Self {
            radius,
            index: TileIndex::new(),
            tiles: Vec::new(),
            disc: (-radius..=radius).map(|dy| DiscRow::new(dy, radius)).collect(),
            cells: Vec::new(),
            orphans: Vec::new(),
            gone: Vec::new(),
            survivors: Survivors::default(),
            corner: (0, 0),
        }
    }

    /// The truncation radius in cells.
    #[must_use]
    pub fn radius_cells(&self) -> u32 {
        self.radius as u32
    }

    /// Handle of the obstacle nearest to a cell, or `u32::MAX` where none is within the radius.
    #[inline]
    #[must_use]
    pub fn nearest(&self, cell_x: i32, cell_y: i32) -> u32 {
        match self.index.find(tile_of(cell_x, cell_y)) {
            NO_TILE => NO_OBSTACLE,
            tile => self.tiles[tile as usize].nearest[cell_in_tile(cell_x, cell_y)],
        }
    }

    /// Number of the tile.
    #[inline]
    pub(crate) fn tile_number(&self, tile: (i32, i32)) -> u32 {
        self.index.find(tile)
    }

    /// For look-ups of many cells in a row.
    pub(crate) fn look_ups(&self) -> LookUps<'_> {
        LookUps { field: self, tile: (i32::MIN, i32::MIN), number: NO_TILE }
    }

    /// Squared distance in cells to the nearest obstacle and that obstacle's cell.
    #[must_use]
    pub fn nearest_cell(&self, cell_x: i32, cell_y: i32) -> Option<(u32, (i32, i32))> {
        let handle = self.nearest(cell_x, cell_y);
        if handle == NO_OBSTACLE {
            return None;
        }
        let (ox, oy) = self.cells[handle as usize];
        Some((((ox - cell_x).pow(2) + (oy - cell_y).pow(2)) as u32, (ox, oy)))
    }

    /// Whether a cell holds an obstacle.
    #[must_use]
    pub fn is_occupied(&self, cell_x: i32, cell_y: i32) -> bool {
        match self.index.find(tile_of(cell_x, cell_y)) {
            NO_TILE => false,
            tile => {
                let row = self.tiles[tile as usize].occupied[(cell_y & (TILE_SIDE - 1)) as usize];
                row >> (cell_x & (TILE_SIDE - 1)) & 1 == 1
            }
        }
    }

    fn tile_mut(&mut self, tile: (i32, i32)) -> &mut FieldTile {
        let (number, new) = self.index.find_or_insert(tile, self.tiles.len() as u32);
        if new {
            self.tiles.push(FieldTile {
                key: tile,
                nearest: Box::new([NO_OBSTACLE; TILE_CELLS]),
                rank: Box::new([FAR; TILE_CELLS]),
                occupied: [0; TILE_SIDE as usize],
            });
        }
        &mut self.tiles[number as usize]
    }

    /// An obstacle appears in a cell that had none. `handle` is the caller's name for it; handles should be dense.
    pub fn insert(&mut self, cell_x: i32, cell_y: i32, handle: u32) {
        if handle == NO_OBSTACLE || self.is_occupied(cell_x, cell_y) {
            return;
        }
        if self.cells.len() <= handle as usize {
            self.cells.resize(handle as usize + 1, (0, 0));
        }
        self.cells[handle as usize] = (cell_x, cell_y);
        let row = (cell_y & (TILE_SIDE - 1)) as usize;
        self.tile_mut(tile_of(cell_x, cell_y)).occupied[row] |= 1 << (cell_x & (TILE_SIDE - 1));
        let r = self.radius;
        for tile_y in (cell_y - r) >> TILE_BITS..=(cell_y + r) >> TILE_BITS {
            for tile_x in (cell_x - r) >> TILE_BITS..=(cell_x + r) >> TILE_BITS {
                self.claim_in_tile((tile_x, tile_y), (cell_x, cell_y), handle);
            }
        }
    }

    /// Cells of one tile that are nearer to the new obstacle than to what they knew now point at it.
    fn claim_in_tile(&mut self, tile: (i32, i32), cell: (i32, i32), handle: u32) {
        let (disc, arch) = (std::mem::take(&mut self.disc), pulp::Arch::new());
        let FieldTile { nearest, rank, .. } = self.tile_mut(tile);
        for_each_row_in_tile(&disc, tile, cell, |row, y, x| {
            let start = window_start(x);
            let from = cell_in_tile(start as i32, y);
            if let (Some(known), Some(nearest)) = (rank[from..].first_chunk_mut(), nearest[from..].first_chunk_mut()) {
                arch.dispatch(Claim { known, nearest, ranks: row.window(start, x), handle });
            }
        });
        self.disc = disc;
    }

    /// The obstacle of a cell disappears. Does nothing where there is none.
    pub fn remove(&mut self, cell_x: i32, cell_y: i32) {
        self.remove_all(&[(cell_x, cell_y)]);
    }

    /// The obstacles of cells disappear, all at once: no cell is given to one that goes as well.
    pub fn remove_all(&mut self, cells: &[(i32, i32)]) {
        let mut gone = std::mem::take(&mut self.gone);
        for &(x, y) in cells {
            if self.is_occupied(x, y) {
                gone.push((x, y));
                self.tile_mut(tile_of(x, y)).occupied[(y & (TILE_SIDE - 1)) as usize] &= !(1 << (x & (TILE_SIDE - 1)));
            }
        }
        let mut orphans = std::mem::take(&mut self.orphans);
        for cell in gone.drain(..) {
            self.collect_orphans(cell, &mut orphans);
            self.collect_survivors(&orphans);
            for (x, y) in orphans.drain(..) {
                let found = self.nearest_survivor((x, y));
                let tile = self.tile_mut(tile_of(x, y));
                let in_tile = cell_in_tile(x, y);
                (tile.rank[in_tile], tile.nearest[in_tile]) = found;
            }
        }
        (self.gone, self.orphans) = (gone, orphans);
    }

    /// Cells that point at an obstacle: no other has its rank there.
    fn collect_orphans(&self, (cell_x, cell_y): (i32, i32), orphans: &mut Vec<(i32, i32)>) {
        let r = self.radius;
        for tile_y in (cell_y - r) >> TILE_BITS..=(cell_y + r) >> TILE_BITS {
            for tile_x in (cell_x - r) >> TILE_BITS..=(cell_x + r) >> TILE_BITS {
                let Some(tile) = self.tiles.get(self.index.find((tile_x, tile_y)) as usize) else { continue };
                let base = (tile_x << TILE_BITS, tile_y << TILE_BITS);
                for_each_row_in_tile(&self.disc, (tile_x, tile_y), (cell_x, cell_y), |row, y, x| {
                    let start = window_start(x);
                    let (known, ranks) = (&tile.rank[cell_in_tile(start as i32, y)..], row.window(start, x));
                    if known.first_chunk().is_some_and(|known| any_same(known, ranks)) {
                        let own =
                            (start as i32..).zip(known.iter().zip(ranks)).filter(|(_, (known, rank))| known == rank);
                        orphans.extend(own.map(|(x, _)| (base.0 + x, base.1 + y)));
                    }
                });
            }
        }
    }

    /// All obstacles within the radius of the box around the orphans, in the order in which ties go.
    fn collect_survivors(&mut self, orphans: &[(i32, i32)]) {
        let mut survivors = std::mem::take(&mut self.survivors);
        survivors.clear();
        let range = |coordinate: fn(&(i32, i32)) -> i32| {
            let (low, high) = (orphans.iter().map(coordinate).min()?, orphans.iter().map(coordinate).max()?);
            Some((low - self.radius, high + self.radius))
        };
        if let (Some((left, right)), Some((low, high))) = (range(|cell| cell.0), range(|cell| cell.1)) {
            // At most 4 * 15 + 1 columns: a disc's, and the radius on both sides.
            let columns = u64::MAX >> (63 - (right - left));
            self.corner = (left, low);
            for y in low..=high {
                let mut bits = self.row_bits(left, y) & columns;
                while bits != 0 {
                    survivors.push(bits.trailing_zeros() as i16, (y - low) as i16);
                    bits &= bits - 1;
                }
            }
        }
        self.survivors = survivors;
    }

    fn nearest_survivor(&self, (cell_x, cell_y): (i32, i32)) -> (i16, u32) {
        let (left, low) = self.corner;
        let (d2, (x, y)) = self.survivors.nearest((cell_x - left) as i16, (cell_y - low) as i16);
        if i32::from(d2) > self.radius * self.radius {
            return (FAR, NO_OBSTACLE);
        }
        // An occupied cell is its own nearest obstacle.
        let (x, y) = (left + i32::from(x), low + i32::from(y));
        (rank(x - cell_x, y - cell_y), self.nearest(x, y))
    }

    /// Occupancy of 64 cells of a row from `first_x` on, lowest bit first.
    fn row_bits(&self, first_x: i32, y: i32) -> u64 {
        let row = (y & (TILE_SIDE - 1)) as usize;
        let shift = (first_x & (TILE_SIDE - 1)) as u32;
        let (tile_x, tile_y) = tile_of(first_x, y);
        let bits_of = |tile| match self.index.find(tile) {
            NO_TILE => 0,
            number => self.tiles[number as usize].occupied[row],
        };
        let low = bits_of((tile_x, tile_y)) >> shift;
        if shift == 0 { low } else { low | bits_of((tile_x + 1, tile_y)) << (64 - shift) }
    }

    /// All obstacles, tile by tile in the order the tiles were made.
    pub fn obstacles(&self) -> impl Iterator<Item = (i32, i32)> + '_ {
        self.tiles.iter().flat_map(|tile| {
            let (base_x, base_y) = (tile.key.0 << TILE_BITS, tile.key.1 << TILE_BITS);
            (0..TILE_SIDE).flat_map(move |row| {
                let bits = tile.occupied[row as usize];
                (0..TILE_SIDE).filter(move |col| bits >> col & 1 == 1).map(move |col| (base_x + col, base_y + row))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// Squared distance and cell of the nearest obstacle by looking at all of them.
    fn brute(obstacles: &BTreeMap<(i32, i32), u32>, radius: i32, x: i32, y: i32) -> Option<(u32, (i32, i32))> {
        obstacles
            .keys()
            .map(|&(oy, ox)| (((ox - x).pow(2) + (oy - y).pow(2)) as u32, oy, ox))
            .min()
            .filter(|&(d2, _, _)| d2 <= (radius * radius) as u32)
            .map(|(d2, oy, ox)| (d2, (ox, oy)))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4_000))]
        #[test]
        fn the_field_equals_the_batch_transform_after_any_sequence(
            radius in 1u32..=15,
            origin in (-70i32..70, -70i32..70),
            steps in prop::collection::vec((any::<bool>(), 0i32..24, 0i32..24), 1..60),
            at_once in 0usize..20,
        ) {
            let mut field = DistanceField::new(radius);
            let mut obstacles = BTreeMap::new();
            for (handle, (add, dx, dy)) in steps.into_iter().enumerate() {
                let (x, y) = (origin.0 + dx, origin.1 + dy);
                if add {
                    if let std::collections::btree_map::Entry::Vacant(free) = obstacles.entry((y, x)) {
                        free.insert(handle as u32);
                        field.insert(x, y, handle as u32);
                    }
                } else {
                    obstacles.remove(&(y, x));
                    field.remove(x, y);
                }
            }
            let gone: Vec<_> = obstacles.keys().map(|&(y, x)| (x, y)).take(at_once).collect();
            field.remove_all(&gone);
            obstacles.retain(|&(y, x), _| !gone.contains(&(x, y)));
            let reach = radius as i32 + 2;
            for y in origin.1 - reach..origin.1 + 24 + reach {
                for x in origin.0 - reach..origin.0 + 24 + reach {
                    prop_assert_eq!(field.nearest_cell(x, y), brute(&obstacles, radius as i32, x, y), "cell {} {}", x, y);
                }
            }
        }
    }
}
