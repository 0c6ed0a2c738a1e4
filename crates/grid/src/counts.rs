//! Occupancy as integer counts of hits and passes, so that adding and removing a keyframe is exact and commutative.

use crate::tiles::{NO_TILE, TILE_BITS, TILE_CELLS, TILE_SIDE, TileIndex, cell_in_tile, floor_cell, tile_of};

use mapwright_geom::{Pose2, sin_cos};
use mapwright_sensor::SweepPoints;

/// Steps of the fixed-point end points within a cell.
pub(crate) const FRACTION_STEPS: f64 = 1024.0;
/// Set in a cell's passes while the cell has hits, so that a ray sees it without a second look-up.
const HAS_HITS: u32 = 1 << 30;
/// Set in a cell's passes while the cell is an obstacle of a local map: the sign, which costs a ray no comparison.
const OBSTACLE: u32 = 1 << 31;
const FLAGS: u32 = HAS_HITS | OBSTACLE;
/// Set in an entry of the touched cells where a beam ended.
pub(crate) const BEAM_END: u32 = 1 << 31;
/// No slot: the cell has no hits.
pub(crate) const NO_SLOT: u32 = u32::MAX;

/// A cell in which beams ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HitCell {
    /// Column.
    pub x: i32,
    /// Row.
    pub y: i32,
    /// Beams that ended here.
    pub hits: u32,
    /// Sum of the end points' offsets from the cell's lower corner along x, in 1/1024 of a cell, modulo 2^32.
    pub sum_x: u32,
    /// The same along y.
    pub sum_y: u32,
    /// Hits whose scan shows something small, a corner or an edge.
    pub points: u32,
    /// Hits whose scan knew the direction of the surface.
    pub normals: u32,
    /// Sum of `n_x n_x` of those hits' normals, in 1/1024, modulo 2^32.
    pub sum_nxx: u32,
    /// Sum of `n_x n_y`, likewise.
    pub sum_nxy: u32,
    /// Sum of `n_x` of those normals, which point to where the surface was seen from, likewise.
    pub sum_nx: u32,
    /// Sum of `n_y`, likewise.
    pub sum_ny: u32,
}

impl HitCell {
    const fn empty(x: i32, y: i32) -> Self {
        Self { x, y, hits: 0, sum_x: 0, sum_y: 0, points: 0, normals: 0, sum_nxx: 0, sum_nxy: 0, sum_nx: 0, sum_ny: 0 }
    }

    /// Whether the cell is an obstacle to a map in which so many beams passed through it, and a hit outweighs
    /// `passes_per_hit` of them.
    #[must_use]
    pub fn is_obstacle(&self, passes: u32, passes_per_hit: u32) -> bool {
        self.hits > 0 && self.hits.saturating_mul(passes_per_hit) >= passes
    }

    fn add(&mut self, other: &Self) {
        let pairs = [
            (&mut self.hits, other.hits),
            (&mut self.sum_x, other.sum_x),
            (&mut self.sum_y, other.sum_y),
            (&mut self.points, other.points),
            (&mut self.normals, other.normals),
            (&mut self.sum_nxx, other.sum_nxx),
            (&mut self.sum_nxy, other.sum_nxy),
            (&mut self.sum_nx, other.sum_nx),
            (&mut self.sum_ny, other.sum_ny),
        ];
        for (sum, term) in pairs {
            *sum = sum.wrapping_add(term);
        }
    }
}

/// The nearest whole number, modulo 2^32.
#[inline]
fn rounded(value: f64) -> u32 {
    // In 1.5 * 2^52 + value the mantissa's lowest bits are the whole number.
    const BIAS: f64 = 6_755_399_441_055_744.0;
    (value + BIAS).to_bits() as u32
}

/// What one beam's end adds to a cell.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// End point in cells.
    pub end_cells: [f64; 2],
    /// Unit normal of the surface in the map's frame, on the sensor's side, where the scan knows it.
    pub normal: Option<[f64; 2]>,
    /// Whether the scan shows something small there.
    pub point: bool,
}

#[derive(Debug, Clone)]
struct CountTile {
    key: (i32, i32),
    passes: Box<[u32; TILE_CELLS]>,
    slots: Box<[u32; TILE_CELLS]>,
}

/// Hit and pass counts on sparse tiles, unbounded in extent; memory is in proportion to the area seen.
#[derive(Debug, Clone)]
pub struct CountGrid {
    resolution_m: f64,
    index: TileIndex,
    tiles: Vec<CountTile>,
    cells: Vec<HitCell>,
    free_slots: Vec<u32>,
}

/// Adding a keyframe's beams or taking them out again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Count up.
    Add,
    /// Count down.
    Remove,
}

/// Counts to be added to a grid's: a share of the work, done beside the grid. May be negative where beams are taken out.
#[derive(Debug, Clone)]
pub struct Changes {
    grid: CountGrid,
    removed: bool,
}

impl Changes {
    /// None, for a grid of `resolution_m`.
    #[must_use]
    pub fn new(resolution_m: f64) -> Self {
        Self { grid: CountGrid::new(resolution_m), removed: false }
    }

    /// Counts a sweep's beams in or out.
    pub fn draw(&mut self, points: &SweepPoints, world_from_robot: Pose2, change: Change) {
        self.removed |= change == Change::Remove;
        self.grid.count::<false>(points, world_from_robot, change, &mut Vec::new());
    }
}

/// Bits of a coordinate within a tile, in 1/2^32 of a cell.
const BAND: u32 = 32 + TILE_BITS;
/// The highest bits of a [`Cursor`] are the index of a cell, or its row.
const CELL_SHIFT: u32 = 64 - 2 * TILE_BITS;
const ROW_MASK: usize = TILE_CELLS - TILE_SIDE as usize;

/// A beam's way over the cells: one a step along its major axis, the other coordinate in fixed point.
struct Ray {
    major: i32,
    /// In 1/2^32 of a cell.
    minor: i64,
    step: i32,
    minor_step: i64,
    /// Steps to go.
    left: u32,
}

impl Ray {
    /// From the start up to but not including the cell of the end; major coordinate first. None where that is nothing.
    fn new(start: [f64; 2], end: [f64; 2]) -> Option<Self> {
        const ONE: f64 = 4_294_967_296.0;
        let (first, last) = (floor_cell(start[0]), floor_cell(end[0]));
        if first == last {
            return None;
        }
        let slope = (end[1] - start[1]) / (end[0] - start[0]);
        let step = if last > first { 1 } else { -1 };
        let minor_at_first = (start[1] + slope * (f64::from(first) + 0.5 - start[0])) * ONE;
        // Rounded down; `floor` is a call where the processor may be any x86-64.
        let towards_zero = minor_at_first as i64;
        let minor = towards_zero.saturating_sub(i64::from(towards_zero as f64 > minor_at_first));
        let minor_step = (slope * f64::from(step) * ONE) as i64;
        Some(Self { major: first, minor, step, minor_step, left: first.abs_diff(last) })
    }

    #[inline]
    fn step_by(&mut self, steps: u32) {
        self.major = self.major.wrapping_add(self.step.wrapping_mul(steps as i32));
        self.minor = self.minor.wrapping_add(self.minor_step.wrapping_mul(i64::from(steps)));
    }

    /// The present cell within its tile, to go on from.
    #[inline]
    fn cursor<const STEEP: bool>(&self) -> Cursor<STEEP> {
        let place = |major: i64, minor: i64| {
            let flat = ((minor as u64) << (64 - BAND)).wrapping_add(major as u64);
            let steep = ((major as u64) << BAND).wrapping_add(minor as u64) << (64 - BAND - TILE_BITS);
            if STEEP { steep } else { flat }
        };
        let (major, minor) = (self.major & (TILE_SIDE - 1), self.minor & ((1 << BAND) - 1));
        Cursor { at: place(i64::from(major), minor), step: place(i64::from(self.step), self.minor_step) }
    }

    /// How many of the next steps begin in the tile of the present cell; they count as gone.
    #[inline]
    fn steps_in_tile(&mut self) -> u32 {
        let in_tile = self.major & (TILE_SIDE - 1);
        let to_edge = if self.step > 0 { TILE_SIDE - in_tile } else { in_tile + 1 };
        let most = self.left.min(to_edge as u32);
        // The slope is 1 at most: 63 steps do not leave a tile and come back.
        let minor_there = self.minor.wrapping_add(self.minor_step.wrapping_mul(i64::from(most) - 1));
        let steps = if minor_there >> BAND == self.minor >> BAND {
            most
        } else {
            let in_band = self.minor & ((1 << BAND) - 1);
            let to_go = if self.minor_step > 0 { (1 << BAND) - 1 - in_band } else { in_band };
            most.min((to_go as u64 / self.minor_step.unsigned_abs().max(1)) as u32 + 1)
        };
        self.left -= steps;
        steps
    }
}

/// A ray within one tile, in one number, so that a step is one addition: a look at a cell is most of what drawing does.
struct Cursor<const STEEP: bool> {
    /// From the highest bit on: of a steep ray the row and the column with its fraction, of a flat one the row with its fraction
    /// and, in the lowest bits, the column.
    at: u64,
    step: u64,
}

impl<const STEEP: bool> Cursor<STEEP> {
    /// Index of the cell within the tile.
    #[inline]
    fn cell(&self) -> usize {
        let highest = (self.at >> CELL_SHIFT) as usize;
        if STEEP { highest } else { highest & ROW_MASK | self.at as usize & (TILE_SIDE as usize - 1) }
    }

    #[inline]
    fn step(&mut self) {
        self.at = self.at.wrapping_add(self.step);
    }
}

impl CountGrid {
    /// An empty grid of square cells with sides of `resolution_m` metres.
    #[must_use]
    pub fn new(resolution_m: f64) -> Self {
        Self { resolution_m, index: TileIndex::new(), tiles: Vec::new(), cells: Vec::new(), free_slots: Vec::new() }
    }

    /// Side of a cell in metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Slots of cells with hits, for arrays that run beside them.
    #[must_use]
    pub fn slot_count(&self) -> usize {
        self.cells.len()
    }

    /// The cell in a slot. A slot whose cell has no hits is free.
    #[must_use]
    pub fn cell(&self, slot: u32) -> &HitCell {
        &self.cells[slot as usize]
    }

    /// Slot of a cell with hits.
    #[inline]
    #[must_use]
    pub fn slot(&self, cell_x: i32, cell_y: i32) -> Option<u32> {
        match self.index.find(tile_of(cell_x, cell_y)) {
            NO_TILE => None,
            tile => {
                let slot = self.tiles[tile as usize].slots[cell_in_tile(cell_x, cell_y)];
                (slot != NO_SLOT).then_some(slot)
            }
        }
    }

    /// Slots of a cell and its eight neighbours, row by row; [`NO_SLOT`] for cells without hits.
    pub(crate) fn neighbours(&self, cell_x: i32, cell_y: i32) -> [u32; 9] {
        let mut slots = [NO_SLOT; 9];
        let (in_x, in_y) = (cell_x & (TILE_SIDE - 1), cell_y & (TILE_SIDE - 1));
        let inside = 1..TILE_SIDE - 1;
        if inside.contains(&in_x) && inside.contains(&in_y) {
            let tile = self.index.find(tile_of(cell_x, cell_y));
            if tile != NO_TILE {
                let first = cell_in_tile(cell_x - 1, cell_y - 1);
                let all = &self.tiles[tile as usize].slots;
                for row in 0..3 {
                    let from = first + row * TILE_SIDE as usize;
                    slots[3 * row..3 * row + 3].copy_from_slice(&all[from..from + 3]);
                }
            }
            return slots;
        }
        // Down each column in turn: there the tile changes once at most.
        for column in 0..3 {
            let mut known = tile_of(cell_x + column - 1, cell_y - 1);
            let mut tile = self.index.find(known);
            for row in 0..3 {
                let (x, y) = (cell_x + column - 1, cell_y + row - 1);
                if tile_of(x, y) != known {
                    known = tile_of(x, y);
                    tile = self.index.find(known);
                }
                if tile != NO_TILE {
                    slots[(3 * row + column) as usize] = self.tiles[tile as usize].slots[cell_in_tile(x, y)];
                }
            }
        }
        slots
    }

    /// Beams that passed through a cell.
    #[must_use]
    pub fn passes(&self, cell_x: i32, cell_y: i32) -> u32 {
        match self.index.find(tile_of(cell_x, cell_y)) {
            NO_TILE => 0,
            tile => self.tiles[tile as usize].passes[cell_in_tile(cell_x, cell_y)] & !FLAGS,
        }
    }

    #[inline]
    fn tile_number(&mut self, tile: (i32, i32)) -> usize {
        let (number, new) = self.index.find_or_insert(tile, self.tiles.len() as u32);
        if new {
            self.push_tile(tile);
        }
        number as usize
    }

    #[cold]
    fn push_tile(&mut self, key: (i32, i32)) {
        let (passes, slots) = (Box::new([0; TILE_CELLS]), Box::new([NO_SLOT; TILE_CELLS]));
        self.tiles.push(CountTile { key, passes, slots });
    }

    /// Counts a sweep's beams in or out; slots of the cells that changed and have or had hits go to `touched`, with the
    /// highest bit set where a beam ended.
    pub fn draw(&mut self, points: &SweepPoints, world_from_robot: Pose2, change: Change, touched: &mut Vec<u32>) {
        self.count::<true>(points, world_from_robot, change, touched);
    }

    /// As [`CountGrid::draw`]; `touched` hears nothing unless it is to `LISTEN`.
    fn count<const LISTEN: bool>(
        &mut self,
        points: &SweepPoints,
        world_from_robot: Pose2,
        change: Change,
        touched: &mut Vec<u32>,
    ) {
        let cells_per_m = 1.0 / self.resolution_m;
        let (s, c) = sin_cos(world_from_robot.theta);
        let to_cells = |p: [f64; 2]| {
            [
                (world_from_robot.x + (c * p[0] - s * p[1])) * cells_per_m,
                (world_from_robot.y + (s * p[0] + c * p[1])) * cells_per_m,
            ]
        };
        let start = to_cells(points.origin);
        for (&hit, &[nx, ny]) in points.hits.iter().zip(&points.normals) {
            let end_cells = to_cells(hit);
            let point = nx.is_nan();
            let normal = (!point && (nx != 0.0 || ny != 0.0)).then_some([c * nx - s * ny, s * nx + c * ny]);
            let slot = self.hit(Hit { end_cells, normal, point }, change);
            if LISTEN {
                touched.push(slot | BEAM_END);
            }
            self.pass_by::<LISTEN>(start, end_cells, change, touched);
        }
        for &free in &points.free_ends {
            self.pass_by::<LISTEN>(start, to_cells(free), change, touched);
        }
    }

    /// Counts a beam's end point, given in cells; returns the cell's slot.
    pub fn hit(&mut self, hit: Hit, change: Change) -> u32 {
        let end_cells = hit.end_cells;
        let (x, y) = (floor_cell(end_cells[0]), floor_cell(end_cells[1]));
        let sum_x = ((end_cells[0] - f64::from(x)) * FRACTION_STEPS) as u32;
        let sum_y = ((end_cells[1] - f64::from(y)) * FRACTION_STEPS) as u32;
        let tile = self.tile_number(tile_of(x, y));
        let in_tile = cell_in_tile(x, y);
        let slot = match self.tiles[tile].slots[in_tile] {
            NO_SLOT => self.take_slot(tile, in_tile, x, y),
            slot => slot,
        };
        let cell = &mut self.cells[slot as usize];
        let sign = if change == Change::Add { 1 } else { u32::MAX };
        let add = |sum: &mut u32, term: u32| *sum = sum.wrapping_add(term.wrapping_mul(sign));
        add(&mut cell.hits, 1);
        add(&mut cell.sum_x, sum_x);
        add(&mut cell.sum_y, sum_y);
        add(&mut cell.points, u32::from(hit.point));
        if let Some([nx, ny]) = hit.normal {
            add(&mut cell.normals, 1);
            add(&mut cell.sum_nxx, rounded(nx * nx * FRACTION_STEPS));
            add(&mut cell.sum_nxy, rounded(nx * ny * FRACTION_STEPS));
            add(&mut cell.sum_nx, rounded(nx * FRACTION_STEPS));
            add(&mut cell.sum_ny, rounded(ny * FRACTION_STEPS));
        }
        slot
    }

    fn take_slot(&mut self, tile: usize, in_tile: usize, x: i32, y: i32) -> u32 {
        let fresh = HitCell::empty(x, y);
        let slot = if let Some(slot) = self.free_slots.pop() {
            self.cells[slot as usize] = fresh;
            slot
        } else {
            self.cells.push(fresh);
            self.cells.len() as u32 - 1
        };
        self.tiles[tile].slots[in_tile] = slot;
        // Changes may have a negative count here: added, the flag can be taken off again.
        let passes = &mut self.tiles[tile].passes[in_tile];
        *passes = passes.wrapping_add(HAS_HITS);
        slot
    }

    /// Remembers whether a slot's cell is an obstacle, so that rays need not ask.
    pub(crate) fn mark_obstacle(&mut self, slot: u32, obstacle: bool) {
        let HitCell { x, y, .. } = self.cells[slot as usize];
        let tile = self.tile_number(tile_of(x, y));
        let passes = &mut self.tiles[tile].passes[cell_in_tile(x, y)];
        *passes = if obstacle { *passes | OBSTACLE } else { *passes & !OBSTACLE };
    }

    /// Gives back the slot of a cell whose last hit was taken out.
    pub fn release_if_empty(&mut self, slot: u32) {
        let HitCell { x, y, hits, .. } = self.cells[slot as usize];
        if hits != 0 {
            return;
        }
        let tile = self.tile_number(tile_of(x, y));
        let in_tile = cell_in_tile(x, y);
        if self.tiles[tile].slots[in_tile] == slot {
            self.tiles[tile].slots[in_tile] = NO_SLOT;
            self.tiles[tile].passes[in_tile] &= !FLAGS;
            self.free_slots.push(slot);
        }
    }

    /// Counts the cells a beam passed, from its start up to but not including the cell of its end; both in cells.
    ///
    /// One cell per step of the longer axis, at the middle of that step. Slots of passed cells that hold hits go to
    /// `touched`.
    pub fn pass(&mut self, start_cells: [f64; 2], end_cells: [f64; 2], change: Change, touched: &mut Vec<u32>) {
        self.pass_by::<true>(start_cells, end_cells, change, touched);
    }

    fn pass_by<const LISTEN: bool>(&mut self, start: [f64; 2], end: [f64; 2], change: Change, touched: &mut Vec<u32>) {
        let steep = (end[1] - start[1]).abs() > (end[0] - start[0]).abs();
        let [start, end] = if steep { [[start[1], start[0]], [end[1], end[0]]] } else { [start, end] };
        match (steep, change) {
            (true, Change::Add) => self.walk::<true, true, LISTEN>(start, end, touched),
            (true, Change::Remove) => self.walk::<true, false, LISTEN>(start, end, touched),
            (false, Change::Add) => self.walk::<false, true, LISTEN>(start, end, touched),
            (false, Change::Remove) => self.walk::<false, false, LISTEN>(start, end, touched),
        }
    }

    /// Tile by tile, so that within one a step is a look at a cell and nothing else.
    fn walk<const STEEP: bool, const ADD: bool, const LISTEN: bool>(
        &mut self,
        start: [f64; 2],
        end: [f64; 2],
        touched: &mut Vec<u32>,
    ) {
        let Some(mut ray) = Ray::new(start, end) else { return };
        while ray.left > 0 {
            let minor = (ray.minor >> 32) as i32;
            let tile = self.tile_number(if STEEP { tile_of(minor, ray.major) } else { tile_of(ray.major, minor) });
            let CountTile { passes, slots, .. } = &mut self.tiles[tile];
            let steps = ray.steps_in_tile();
            let mut cursor = ray.cursor::<STEEP>();
            let mut look = || {
                let in_tile = cursor.cell();
                let count = passes[in_tile].wrapping_add(if ADD { 1 } else { u32::MAX });
                passes[in_tile] = count;
                // A pass can end an obstacle, and one pass less can make one of a cell with hits.
                let may_flip = if ADD { (count as i32) < 0 } else { count as i32 >= HAS_HITS as i32 };
                if LISTEN && may_flip {
                    touched.push(slots[in_tile]);
                }
                cursor.step();
            };
            // Two at a time: counting the steps would be a fifth of the work.
            for _ in 0..steps / 2 {
                look();
                look();
            }
            if steps % 2 == 1 {
                look();
            }
            ray.step_by(steps);
        }
    }

    /// Tiles row by row.
    fn tiles_in_order(&self) -> Vec<&CountTile> {
        let mut tiles: Vec<&CountTile> = self.tiles.iter().collect();
        tiles.sort_unstable_by_key(|tile| (tile.key.1, tile.key.0));
        tiles
    }

    /// Takes in what was counted elsewhere, in any order; cells that are left without hits give back their slots.
    pub fn take_in(&mut self, mut shares: Vec<Changes>) {
        if self.tiles.is_empty() && shares.first().is_some_and(|first| !first.removed) {
            *self = Self { resolution_m: self.resolution_m, ..shares.swap_remove(0).grid };
        }
        for Changes { grid, .. } in &shares {
            for tile in &grid.tiles {
                self.take_in_tile(tile, &grid.cells);
            }
        }
        // Only now: what one share takes out, another may have counted in.
        for cell in shares.iter().flat_map(|share| &share.grid.cells) {
            if let Some(slot) = self.slot(cell.x, cell.y) {
                self.release_if_empty(slot);
            }
        }
    }

    fn take_in_tile(&mut self, tile: &CountTile, cells: &[HitCell]) {
        let mine = self.tile_number(tile.key);
        for (sum, &term) in self.tiles[mine].passes.iter_mut().zip(tile.passes.iter()) {
            *sum = sum.wrapping_add(term);
        }
        for (in_tile, &slot) in tile.slots.iter().enumerate().filter(|(_, slot)| **slot != NO_SLOT) {
            let cell = &cells[slot as usize];
            // The other's flag came along with its passes.
            let passes = &mut self.tiles[mine].passes[in_tile];
            *passes = passes.wrapping_sub(HAS_HITS);
            let slot = match self.tiles[mine].slots[in_tile] {
                NO_SLOT => self.take_slot(mine, in_tile, cell.x, cell.y),
                slot => slot,
            };
            self.cells[slot as usize].add(cell);
        }
    }

    /// Tiles and slots in the order they would have if the cells had been counted row by row, empty tiles gone: what was
    /// done in between leaves no trace.
    pub fn compact(&mut self) {
        let (mut index, mut cells) = (TileIndex::new(), Vec::with_capacity(self.cells.len() - self.free_slots.len()));
        self.tiles.retain(|tile| tile.passes.iter().any(|&passes| passes != 0));
        self.tiles.sort_unstable_by_key(|tile| (tile.key.1, tile.key.0));
        for (number, tile) in self.tiles.iter_mut().enumerate() {
            index.find_or_insert(tile.key, number as u32);
            for slot in tile.slots.iter_mut().filter(|slot| **slot != NO_SLOT) {
                cells.push(self.cells[*slot as usize]);
                *slot = cells.len() as u32 - 1;
            }
        }
        (self.index, self.cells, self.free_slots) = (index, cells, Vec::new());
    }

    /// Everything that was counted, in one canonical order: equal maps give equal bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for tile in self.tiles_in_order() {
            for in_tile in 0..TILE_CELLS {
                let passes = tile.passes[in_tile] & !FLAGS;
                let slot = tile.slots[in_tile];
                if passes == 0 && slot == NO_SLOT {
                    continue;
                }
                let x = (tile.key.0 << TILE_BITS) + (in_tile as i32 & (TILE_SIDE - 1));
                let y = (tile.key.1 << TILE_BITS) + (in_tile as i32 >> TILE_BITS);
                let empty = HitCell::empty(x, y);
                let cell = if slot == NO_SLOT { &empty } else { &self.cells[slot as usize] };
                for word in [
                    x as u32,
                    y as u32,
                    passes,
                    cell.hits,
                    cell.sum_x,
                    cell.sum_y,
                    cell.points,
                    cell.normals,
                    cell.sum_nxx,
                    cell.sum_nxy,
                    cell.sum_nx,
                    cell.sum_ny,
                ] {
                    bytes.extend_from_slice(&word.to_le_bytes());
                }
            }
        }
        bytes
    }

    /// Every cell that was measured: column, row, hits, passes; tile by tile, these row by row.
    pub fn known_cells(&self) -> impl Iterator<Item = (i32, i32, u32, u32)> + '_ {
        self.tiles_in_order().into_iter().flat_map(move |tile| {
            (0..TILE_CELLS).filter_map(move |in_tile| {
                let passes = tile.passes[in_tile] & !FLAGS;
                let slot = tile.slots[in_tile];
                let hits = if slot == NO_SLOT { 0 } else { self.cells[slot as usize].hits };
                let x = (tile.key.0 << TILE_BITS) + (in_tile as i32 & (TILE_SIDE - 1));
                let y = (tile.key.1 << TILE_BITS) + (in_tile as i32 >> TILE_BITS);
                (passes + hits > 0).then_some((x, y, hits, passes))
            })
        })
    }

    /// Tiles in memory.
    #[must_use]
    pub fn tile_count(&self) -> usize {
        self.tiles.len()
    }
}
