//! An occupancy map as exploration needs it: unknown, free, occupied.

mod shared;

use mapwright_grid::CountGrid;
pub use shared::SharedMap;

/// Cells of unknown space around what is known, so that every known cell has eight neighbours.
const BORDER: usize = 2;
/// Cells a map may have; a stray reading far out must not fill the memory.
const MAX_CELLS: usize = 50_000_000;

/// What is known of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Cell {
    /// Never seen.
    #[default]
    Unknown,
    /// Seen, and nothing is there.
    Free,
    /// Something is there.
    Occupied,
}

/// A point in a cell, in fifteenths of it along x and y, plus one; zero where there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Stood(u8);

impl Stood {
    const STEPS: f64 = 15.0;

    /// Of a point from the cell's lower left corner, in cells.
    fn at(share: [f64; 2]) -> Self {
        let [x, y] = share.map(|share| (share * Self::STEPS).clamp(0.0, Self::STEPS - 1.0) as u8);
        Self(1 + y * Self::STEPS as u8 + x)
    }

    fn beside_center(self) -> [f64; 2] {
        let (number, steps) = (self.0.saturating_sub(1), Self::STEPS as u8);
        [number % steps, number / steps].map(|step| (f64::from(step) + 0.5) / Self::STEPS - 0.5)
    }
}

/// A rectangle of cells, row by row, that of the smallest y first.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyMap {
    origin_m: [f64; 2],
    resolution_m: f64,
    width: usize,
    height: usize,
    cells: Vec<Cell>,
    /// Where in each cell a robot has stood last, if one has: see [`Stood`]. Empty where nobody said so.
    stood: Vec<Stood>,
    /// Obstacles that are forgotten after a while: what they bar may be reached then.
    passing: usize,
}

impl OccupancyMap {
    /// A map whose lower left corner lies at `origin_m`; none where the cells are not as many as the sides say, where a side is zero or the
    /// resolution no length. What lies at its very edge counts as unknown.
    #[must_use]
    pub fn new(origin_m: [f64; 2], resolution_m: f64, width: usize, mut cells: Vec<Cell>) -> Option<Self> {
        let height = cells.len().checked_div(width)?;
        let is_sound = width * height == cells.len() && resolution_m.is_finite() && resolution_m > 0.0;
        if !is_sound || width < 3 || height < 3 || !origin_m.iter().all(|m| m.is_finite()) {
            return None;
        }
        cells[..width].fill(Cell::Unknown);
        cells[(height - 1) * width..].fill(Cell::Unknown);
        for row in cells.chunks_exact_mut(width) {
            (row[0], row[width - 1]) = (Cell::Unknown, Cell::Unknown);
        }
        Some(Self { origin_m, resolution_m, width, height, cells, stood: Vec::new(), passing: 0 })
    }

    /// What several maps in one frame say together: a cell is occupied where hits times `passes_per_hit` reach the passes, as a mapper
    /// sees an obstacle. None where nothing is known, where resolutions differ, or where the known cells lie too far apart.
    #[must_use]
    pub fn of_counts(maps: &[&CountGrid], passes_per_hit: u32) -> Option<Self> {
        let resolution_m = maps.first()?.resolution_m();
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        let mut known = Vec::new();
        maps.iter().for_each(|map| known.extend(map.known_cells()));
        for &(x, y, ..) in &known {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        let side = |k: usize| usize::try_from(i64::from(high[k]) - i64::from(low[k]) + 1).ok();
        let (width, height) = (side(0)? + 2 * BORDER, side(1)? + 2 * BORDER);
        if maps.iter().any(|map| map.resolution_m() != resolution_m) || width.checked_mul(height)? > MAX_CELLS {
            return None;
        }
        let mut counts = vec![(0_u32, 0_u32); width * height];
        for (x, y, hits, passes) in known {
            let (column, row) = ((x - low[0]) as usize + BORDER, (y - low[1]) as usize + BORDER);
            let sum = &mut counts[row * width + column];
            *sum = (sum.0.saturating_add(hits), sum.1.saturating_add(passes));
        }
        let cell = |&(hits, passes): &(u32, u32)| match (hits, passes) {
            (0, 0) => Cell::Unknown,
            _ if hits > 0 && hits.saturating_mul(passes_per_hit) >= passes => Cell::Occupied,
            _ => Cell::Free,
        };
        let origin_m = low.map(|cell| (f64::from(cell) - BORDER as f64) * resolution_m);
        let mut map = Self::new(origin_m, resolution_m, width, counts.iter().map(cell).collect())?;
        map.fill_between_beams();
        Some(map)
    }

    /// Unknown cells that three of four neighbours show to be free are free: beams far out leave gaps between each other.
    fn fill_between_beams(&mut self) {
        let between = |&index: &usize| {
            if self.cells[index] != Cell::Unknown {
                return false;
            }
            let near = self.sides(index).map(|side| self.cells[side]);
            !near.contains(&Cell::Occupied) && near.iter().filter(|cell| **cell == Cell::Free).count() >= 3
        };
        let gaps: Vec<usize> = self.inner().filter(between).collect();
        gaps.into_iter().for_each(|index| self.cells[index] = Cell::Free);
    }

    /// Side of a cell, metres.
    #[inline]
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Cells along x and along y.
    #[inline]
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Whether the cells of another map lie where those of this one do.
    pub(crate) fn is_laid_out_as(&self, origin_m: [f64; 2], size: [usize; 2]) -> bool {
        self.origin_m == origin_m && self.size() == size
    }

    pub(crate) fn origin_m(&self) -> [f64; 2] {
        self.origin_m
    }

    /// All cells, row by row.
    #[inline]
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The cell that holds a point, if there is one.
    #[inline]
    #[must_use]
    pub fn index_of(&self, point_m: [f64; 2]) -> Option<usize> {
        let place = |k: usize, most: usize| {
            let at = ((point_m[k] - self.origin_m[k]) / self.resolution_m).floor();
            (at >= 1.0 && at < most as f64 - 1.0).then_some(at as usize)
        };
        Some(place(1, self.height)? * self.width + place(0, self.width)?)
    }

    /// Middle of a cell, metres.
    #[inline]
    #[must_use]
    pub fn center_m(&self, index: usize) -> [f64; 2] {
        let middle = |k: usize, at: usize| self.origin_m[k] + (at as f64 + 0.5) * self.resolution_m;
        [middle(0, index % self.width), middle(1, index / self.width)]
    }

    /// Whether something is taken to be there for a while only.
    pub(crate) fn has_passing(&self) -> bool {
        self.passing > 0
    }

    /// What is known of the cell that holds a point.
    #[must_use]
    pub fn at(&self, point_m: [f64; 2]) -> Cell {
        self.index_of(point_m).map_or(Cell::Unknown, |index| self.cells[index])
    }

    /// Whether the middle of a robot was in a cell, and nothing has shown since that something is there.
    #[inline]
    pub(crate) fn has_stood(&self, index: usize) -> bool {
        self.stood_m(index).is_some()
    }

    /// Where exactly that was.
    #[inline]
    pub(crate) fn stood_m(&self, index: usize) -> Option<[f64; 2]> {
        let stood = self.stood.get(index).filter(|stood| stood.0 > 0 && self.cells[index] == Cell::Free)?;
        let [x, y] = self.center_m(index);
        let [dx, dy] = stood.beside_center().map(|share| share * self.resolution_m);
        Some([x + dx, y + dy])
    }

    /// Every cell that has eight neighbours; those at the left and right edges, which are unknown, have the ones across.
    pub(crate) fn inner(&self) -> std::ops::Range<usize> {
        self.width + 1..self.cells.len() - self.width - 1
    }

    /// The four neighbours of a cell that is not at the edge.
    #[inline]
    pub(crate) fn sides(&self, index: usize) -> [usize; 4] {
        [index - 1, index + 1, index - self.width, index + self.width]
    }

    /// The eight neighbours of a cell that is not at the edge, those at its sides first.
    #[inline]
    pub(crate) fn around(&self, index: usize) -> [usize; 8] {
        let w = self.width;
        [index - 1, index + 1, index - w, index + w, index - w - 1, index - w + 1, index + w - 1, index + w + 1]
    }

    /// Whether a cell is at the edge.
    #[inline]
    pub(crate) fn is_edge(&self, index: usize) -> bool {
        let (x, y) = (index % self.width, index / self.width);
        x == 0 || y == 0 || x + 1 == self.width || y + 1 == self.height
    }

    /// Distance of the middles of two cells, metres.
    #[inline]
    pub(crate) fn between_m(&self, a: usize, b: usize) -> f64 {
        let part = |a: usize, b: usize| a as f64 - b as f64;
        let (dx, dy) = (part(a % self.width, b % self.width), part(a / self.width, b / self.width));
        dx.hypot(dy) * self.resolution_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map drawn in letters, the first line on top: `#` occupied, `.` free, anything else unknown.
    pub(crate) fn drawn(lines: &[&str]) -> OccupancyMap {
        let width = lines[0].len();
        let cell = |letter: u8| match letter {
            b'#' => Cell::Occupied,
            b'.' => Cell::Free,
            _ => Cell::Unknown,
        };
        let cells = lines.iter().rev().flat_map(|line| line.bytes().map(cell)).collect();
        OccupancyMap::new([0.0; 2], 0.1, width, cells).unwrap()
    }

    #[test]
    fn points_and_cells_agree_and_the_edge_is_unknown() {
        let map = drawn(&["....", ".#..", "....", "...."]);
        assert_eq!(map.at([0.15, 0.25]), Cell::Occupied);
        assert_eq!(map.index_of(map.center_m(9)), Some(9));
        for outside in [[-1.0, 0.1], [0.05, 0.15], [0.15, 0.39], [f64::NAN, 0.15], [1e300, 0.1]] {
            assert_eq!(map.at(outside), Cell::Unknown, "{outside:?}");
        }
        assert!(OccupancyMap::new([0.0; 2], 0.1, 3, vec![Cell::Free; 10]).is_none());
        assert!(OccupancyMap::new([0.0; 2], 0.0, 3, vec![Cell::Free; 9]).is_none());
        assert!(OccupancyMap::new([0.0; 2], 0.1, 0, vec![]).is_none());
    }

    #[test]
    fn counts_of_several_maps_are_added() {
        use mapwright_grid::Change;
        let mut maps = [CountGrid::new(0.1), CountGrid::new(0.1)];
        for (map, x) in maps.iter_mut().zip([0.05, 0.55]) {
            map.pass([x / 0.1, 0.5], [x / 0.1 + 4.0, 0.5], Change::Add, &mut Vec::new());
        }
        let map = OccupancyMap::of_counts(&[&maps[0], &maps[1]], 5).unwrap();
        let free = map.cells().iter().filter(|cell| **cell == Cell::Free).count();
        assert_eq!((free, map.at([0.75, 0.05])), (8, Cell::Free));
        assert!(OccupancyMap::of_counts(&[], 5).is_none());
        assert!(OccupancyMap::of_counts(&[&CountGrid::new(0.1)], 5).is_none());
        assert!(OccupancyMap::of_counts(&[&maps[0], &CountGrid::new(0.2)], 5).is_none());
    }
}
