//! Two maps as one.

use super::{Occupancy, OccupancyMap};
use mapwright_geom::Pose2;

/// Cells that a joined map may have.
const MAX_CELLS: f64 = 1e8;
/// A wall of the second map within so many cells of one of the first is that wall, drawn a little beside it.
const SAME_WALL_CELLS: i64 = 3;

/// Which map a cell of a joined map is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Source {
    /// Neither: it is unknown.
    #[default]
    Neither,
    /// The first alone knows it.
    A,
    /// The second alone knows it.
    B,
    /// Both know it, and say the same.
    Both,
    /// Both know it, and one says there is a wall.
    Contradicted,
}

/// A joined map that is too large to be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("expected a joined map of at most {MAX_CELLS:.0} cells, found {width:.0} x {height:.0}")]
pub struct JoinError {
    width: f64,
    height: f64,
}

/// Two maps as one in the first one's cells, and which map each cell is from. What one of them knows is known; where both do, the
/// first one's walls and all free space stay, and a wall that the second alone has is drawn unless it is one of the first, a
/// little beside it.
///
/// # Errors
///
/// [`JoinError`].
pub fn join(a: &OccupancyMap, b: &OccupancyMap, a_from_b: Pose2) -> Result<(OccupancyMap, Vec<Source>), JoinError> {
    let cells_from_b = Cells::of(a, b, a_from_b);
    let (mut joined, offset) = canvas(a, &cells_from_b)?;
    let mut sources = vec![Source::Neither; joined.cells.len()];
    let maps = [a, b];
    for v in 0..joined.height {
        for u in 0..joined.width {
            let in_a = [u as i64 + offset[0], v as i64 + offset[1]];
            let in_b = cells_from_b.back(in_a.map(|cells| cells as f64 + 0.5)).map(|cells| cells.floor() as i64);
            let at = v * joined.width + u;
            (joined.cells[at], sources[at]) = combined(maps, [in_a, in_b], b.cell(in_b[0], in_b[1]));
        }
    }
    // Walls one cell thick have gaps where they are sampled aslant: each of their cells is drawn as well.
    for (at, _) in b.cells.iter().enumerate().filter(|(_, cell)| **cell == Occupancy::Occupied) {
        let in_b = [at % b.width, at / b.width];
        let in_a = cells_from_b.forward(in_b.map(|cells| cells as f64 + 0.5)).map(|cells| cells.floor() as i64);
        let [u, v] = [0, 1].map(|k: usize| (in_a[k] - offset[k]).max(0) as usize);
        let at = v * joined.width + u;
        if u < joined.width && v < joined.height && joined.cells[at] != Occupancy::Occupied {
            let cells = [in_a, in_b.map(|cells| cells as i64)];
            (joined.cells[at], sources[at]) = combined(maps, cells, Occupancy::Occupied);
        }
    }
    Ok((joined, sources))
}

/// What both say of a place, given by its cell in each.
fn combined([a, b]: [&OccupancyMap; 2], [in_a, in_b]: [[i64; 2]; 2], of_b: Occupancy) -> (Occupancy, Source) {
    use Occupancy::{Free, Occupied, Unknown};
    let of_a = a.cell(in_a[0], in_a[1]);
    match (of_a, of_b) {
        (Unknown, Unknown) => (Unknown, Source::Neither),
        (known, Unknown) => (known, Source::A),
        // Behind a wall of the first map, or in it.
        (Unknown, Occupied) if is_beside_wall(a, in_a) => (Unknown, Source::Neither),
        (Unknown, known) => (known, Source::B),
        (Free, Free) | (Occupied, Occupied) => (of_a, Source::Both),
        (Free, Occupied) if is_beside_wall(a, in_a) => (Free, Source::Both),
        (Occupied, Free) if is_beside_wall(b, in_b) => (Occupied, Source::Both),
        (Free, Occupied) | (Occupied, Free) => (Occupied, Source::Contradicted),
    }
}

fn is_beside_wall(map: &OccupancyMap, [u, v]: [i64; 2]) -> bool {
    let reach = -SAME_WALL_CELLS..=SAME_WALL_CELLS;
    let within = |dx: i64, dy: i64| dx * dx + dy * dy <= SAME_WALL_CELLS * SAME_WALL_CELLS;
    reach.clone().any(|dy| reach.clone().any(|dx| within(dx, dy) && map.is_occupied(u + dx, v + dy)))
}

/// From cells of the one map to cells of the other, both from their corners.
struct Cells {
    a_from_b: Pose2,
    b_from_a: Pose2,
    sides_m: [f64; 2],
    /// Least and greatest cells of the first map at which the second knows anything.
    corners: [[f64; 2]; 2],
}

impl Cells {
    fn of(a: &OccupancyMap, b: &OccupancyMap, a_from_b: Pose2) -> Self {
        let a_from_b = a.world_from_map.inverse() * a_from_b * b.world_from_map;
        let sides_m = [a.resolution_m, b.resolution_m];
        let mut cells = Self { a_from_b, b_from_a: a_from_b.inverse(), sides_m, corners: [[0.0; 2]; 2] };
        let corners: Vec<[f64; 2]> = known_ends(b).map(|corner| cells.forward(corner)).collect();
        let Some(&first) = corners.first() else { return cells };
        let bound = |pick: fn(f64, f64) -> f64| {
            [0, 1].map(|k: usize| corners.iter().map(|corner| corner[k]).fold(first[k], pick))
        };
        cells.corners = [bound(f64::min), bound(f64::max)];
        cells
    }

    fn forward(&self, cell_b: [f64; 2]) -> [f64; 2] {
        self.a_from_b.transform(cell_b.map(|cells| cells * self.sides_m[1])).map(|m| m / self.sides_m[0])
    }

    fn back(&self, cell_a: [f64; 2]) -> [f64; 2] {
        self.b_from_a.transform(cell_a.map(|cells| cells * self.sides_m[0])).map(|m| m / self.sides_m[1])
    }
}

/// The corners of what is known in each row.
fn known_ends(map: &OccupancyMap) -> impl Iterator<Item = [f64; 2]> {
    let known = |cell: &Occupancy| *cell != Occupancy::Unknown;
    let of_row = move |(y, row): (usize, &[Occupancy])| {
        let ends = row.iter().position(known).zip(row.iter().rposition(known));
        ends.map(|(first, last)| [[first, y], [last + 1, y], [first, y + 1], [last + 1, y + 1]])
    };
    let rows = map.cells.chunks_exact(map.width.max(1)).enumerate();
    rows.filter_map(of_row).flatten().map(|corner| corner.map(|cells| cells as f64))
}

/// A map for both, nothing in it, and where in the first one's cells it begins.
fn canvas(a: &OccupancyMap, b: &Cells) -> Result<(OccupancyMap, [i64; 2]), JoinError> {
    let sides = [a.width as f64, a.height as f64];
    let low = b.corners[0].map(|cells| cells.floor().min(0.0));
    let high = [0, 1].map(|k: usize| b.corners[1][k].ceil().max(sides[k]));
    let [width, height] = [0, 1].map(|k: usize| high[k] - low[k]);
    if width * height > MAX_CELLS {
        return Err(JoinError { width, height });
    }
    let corner = Pose2::new(low[0] * a.resolution_m, low[1] * a.resolution_m, 0.0);
    let (width, height) = (width as usize, height as usize);
    let map = OccupancyMap {
        width,
        height,
        resolution_m: a.resolution_m,
        world_from_map: a.world_from_map * corner,
        cells: vec![Occupancy::Unknown; width * height],
    };
    Ok((map, low.map(|cells| cells as i64)))
}
