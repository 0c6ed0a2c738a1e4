//! The walls of a map: surfaces with their direction, and what lies nearest to a place.

use super::{MapError, Occupancy, OccupancyMap};
use crate::field::{DistanceField, NO_OBSTACLE};
use crate::tiles::floor_cell;

/// Wall cells a map may have: what has more is no building but noise, or one picture of a country.
pub(super) const MAX_WALL_CELLS: usize = 2_000_000;
/// Nearest walls are known up to so many cells of a field away.
pub(super) const FIELD_RADIUS_CELLS: u32 = 14;
/// A wall's direction is that of the occupied cells within so many cells of it,
const NEIGHBOURHOOD_CELLS: i64 = 3;
/// of which there are at least so many,
const LEAST_NEIGHBOURS: f64 = 4.0;
/// spread across by at most this share of their spread along it (standard deviations; a wall two cells thick has 0.25).
const MOST_SPREAD_ACROSS: f64 = 0.4;
/// Walls that cross each other at 45 degrees or more are not the same.
const LEAST_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Which side of a wall is free is told by cells so many cells off.
const SIDE_CELLS: f64 = 2.5;

/// A cell's worth of wall.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    /// Where it is: the middle of the occupied cells around, on the line through this one; metres from the walls' middle.
    pub(super) at: [f64; 2],
    /// Across the wall, unit length, where the wall has a direction; to the free side, where only one is.
    pub(super) normal: Option<[f64; 2]>,
    /// Whether it is known to be seen from that side alone.
    pub(super) has_side: bool,
}

impl Surface {
    /// Whether this may be the same surface as another one nearby, whose normal as seen from here is given: about as directed, and
    /// not the other side of it.
    pub(super) fn may_be(&self, other: &Self, normal_of_other: Option<[f64; 2]>) -> bool {
        let (Some([ax, ay]), Some([bx, by])) = (self.normal, normal_of_other) else { return true };
        let cosine = ax * bx + ay * by;
        if self.has_side && other.has_side { cosine > LEAST_COSINE } else { cosine.abs() > LEAST_COSINE }
    }
}

/// Walls by cells of some size.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) cell_m: f64,
    field: DistanceField,
}

impl Level {
    fn of(surfaces: &[Surface], cell_m: f64) -> Self {
        let mut field = DistanceField::new(FIELD_RADIUS_CELLS);
        for (number, surface) in surfaces.iter().enumerate() {
            let [x, y] = surface.at.map(|m| floor_cell(m / cell_m));
            field.insert(x, y, number as u32);
        }
        Self { cell_m, field }
    }

    /// Number of the surface nearest to a place, where one is within the radius.
    pub(super) fn nearest(&self, place: [f64; 2]) -> Option<usize> {
        let [x, y] = place.map(|m| floor_cell(m / self.cell_m));
        let number = self.field.nearest(x, y);
        (number != NO_OBSTACLE).then_some(number as usize)
    }
}

/// One of two maps that are to be aligned. Places are in metres from the middle of its walls.
#[derive(Debug)]
pub(super) struct Walls<'a> {
    pub(super) map: &'a OccupancyMap,
    /// The middle of the walls in the map's frame, a corner of four cells.
    pub(super) middle: [f64; 2],
    /// Half the sides of the rectangle around the walls.
    pub(super) half_sides: [f64; 2],
    /// Root mean square distance of walls from the middle.
    pub(super) rms_radius_m: f64,
    pub(super) surfaces: Vec<Surface>,
    /// Finest first.
    pub(super) levels: Vec<Level>,
}

impl<'a> Walls<'a> {
    pub(super) fn of(map: &'a OccupancyMap) -> Result<Self, MapError> {
        let cells = wall_cells(map)?;
        let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
        for cell in &cells {
            low = [0, 1].map(|k: usize| low[k].min(cell[k]));
            high = [0, 1].map(|k: usize| high[k].max(cell[k] + 1));
        }
        let resolution_m = map.resolution_m;
        let middle = [0, 1].map(|k: usize| f64::from(low[k].midpoint(high[k])) * resolution_m);
        let half_sides = [0, 1].map(|k: usize| f64::from(high[k] - low[k]) / 2.0 * resolution_m);
        let surfaces: Vec<Surface> = cells.iter().map(|&cell| surface(map, cell, middle)).collect();
        let squared: f64 = surfaces.iter().map(|s| s.at[0] * s.at[0] + s.at[1] * s.at[1]).sum();
        let rms_radius_m = (squared / surfaces.len() as f64).sqrt().max(resolution_m);
        let levels = vec![Level::of(&surfaces, resolution_m)];
        Ok(Self { map, middle, half_sides, rms_radius_m, surfaces, levels })
    }

    /// Adds coarser levels until one knows walls `reach_m` away.
    pub(super) fn reach(&mut self, reach_m: f64) {
        let mut cell_m = self.map.resolution_m;
        while cell_m * f64::from(FIELD_RADIUS_CELLS) < reach_m {
            cell_m *= 2.0;
            self.levels.push(Level::of(&self.surfaces, cell_m));
        }
    }

    /// What the map says of a place.
    pub(super) fn occupancy(&self, place: [f64; 2]) -> Occupancy {
        self.map.at([0, 1].map(|k: usize| (place[k] + self.middle[k]) / self.map.resolution_m))
    }

    pub(super) fn radius_m(&self) -> f64 {
        self.half_sides[0].hypot(self.half_sides[1])
    }
}

/// Occupied cells with one beside them that is not.
fn wall_cells(map: &OccupancyMap) -> Result<Vec<[u32; 2]>, MapError> {
    let mut cells = Vec::new();
    let mut known = false;
    for (y, row) in map.cells.chunks_exact(map.width.max(1)).enumerate() {
        for (x, &cell) in row.iter().enumerate() {
            known |= cell != Occupancy::Unknown;
            let [u, v] = [x as i64, y as i64];
            if cell == Occupancy::Occupied
                && [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(dx, dy)| !map.is_occupied(u + dx, v + dy))
            {
                cells.push([x as u32, y as u32]);
            }
        }
        if cells.len() > MAX_WALL_CELLS {
            return Err(MapError::TooManyWalls);
        }
    }
    match (cells.is_empty(), known) {
        (false, _) => Ok(cells),
        (true, true) => Err(MapError::NoWalls),
        (true, false) => Err(MapError::AllUnknown),
    }
}

fn surface(map: &OccupancyMap, [x, y]: [u32; 2], middle: [f64; 2]) -> Surface {
    let (u, v) = (i64::from(x), i64::from(y));
    let (mut n, mut sum, mut squares) = (0.0, [0.0; 2], [0.0; 3]);
    for dy in -NEIGHBOURHOOD_CELLS..=NEIGHBOURHOOD_CELLS {
        for dx in -NEIGHBOURHOOD_CELLS..=NEIGHBOURHOOD_CELLS {
            if map.is_occupied(u + dx, v + dy) {
                let [p, q] = [dx as f64, dy as f64];
                n += 1.0;
                (sum[0], sum[1]) = (sum[0] + p, sum[1] + q);
                (squares[0], squares[1], squares[2]) = (squares[0] + p * p, squares[1] + p * q, squares[2] + q * q);
            }
        }
    }
    let [mx, my] = sum.map(|s| s / n);
    let (cxx, cxy, cyy) = (squares[0] / n - mx * mx, squares[1] / n - mx * my, squares[2] / n - my * my);
    let spread = ((cxx - cyy) / 2.0).hypot(cxy);
    let (across, along) = ((cxx + cyy) / 2.0 - spread, (cxx + cyy) / 2.0 + spread);
    let is_line = n >= LEAST_NEIGHBOURS && across < MOST_SPREAD_ACROSS * MOST_SPREAD_ACROSS * along;
    let normal = is_line.then(|| {
        // The eigenvector of the smaller eigenvalue, from whichever row of the matrix is longer.
        let (p, q) = if cxx > cyy { (cxy, across - cxx) } else { (across - cyy, cxy) };
        let length = p.hypot(q);
        [p / length, q / length]
    });
    // Along the line the cell's own place, across it that of all cells around.
    let offset = normal.map_or([0.0; 2], |[nx, ny]| {
        let d = mx * nx + my * ny;
        [d * nx, d * ny]
    });
    let centre = [f64::from(x) + 0.5 + offset[0], f64::from(y) + 0.5 + offset[1]];
    let is_free =
        |[nx, ny]: [f64; 2]| map.at([centre[0] + SIDE_CELLS * nx, centre[1] + SIDE_CELLS * ny]) == Occupancy::Free;
    let free = normal.map_or([false; 2], |normal| [is_free(normal), is_free(normal.map(|n| -n))]);
    Surface {
        at: [0, 1].map(|k: usize| centre[k] * map.resolution_m - middle[k]),
        normal: if free == [false, true] { normal.map(|normal| normal.map(|n| -n)) } else { normal },
        has_side: free[0] != free[1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;

    #[test]
    fn a_slanted_wall_has_its_direction_and_lies_between_the_cells() {
        let (width, height) = (60, 40);
        let mut cells = vec![Occupancy::Free; width * height];
        for x in 0..width {
            cells[(10.3 + 0.3 * x as f64) as usize * width + x] = Occupancy::Occupied;
        }
        let map = OccupancyMap { width, height, resolution_m: 0.05, world_from_map: Pose2::IDENTITY, cells };
        let walls = Walls::of(&map).unwrap();
        assert_eq!(walls.surfaces.len(), width);
        let length = 1_f64.hypot(0.3);
        for surface in &walls.surfaces[5..width - 5] {
            let [nx, ny] = surface.normal.unwrap();
            assert!((nx * 0.3 - ny).abs() / length > 0.97, "{nx} {ny}");
            let [x, y] = [0, 1].map(|k: usize| (surface.at[k] + walls.middle[k]) / 0.05);
            let off = (y - (10.3 + 0.3 * (x - 0.5))) / length;
            assert!(off.abs() < 0.35, "{off}");
        }
    }
}
