//! The plane that a robot drives in, cut out of space.

use crate::key::unpack;
use crate::occupancy::{BLOCK_BITS, BLOCK_SIDE, Block, Occupancy};
use std::ops::Range;

/// Below a band a floor is looked for so far down, metres: as high as a sensor's band may stand above it; the floor of the storey
/// below lies deeper.
const FLOOR_BELOW_M: f64 = 2.0;

/// A cell of a floor plan of which something is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FloorCell {
    /// Column: the cell reaches from `x * resolution_m` to `(x + 1) * resolution_m` in the map's frame.
    pub x: i32,
    /// Row, likewise.
    pub y: i32,
    /// Whether something stands in the band there. Otherwise it is free.
    pub is_occupied: bool,
}

/// Cells of a plan for a robot that drives, from what lies in a band of heights above its way (metres, lowest and highest): occupied
/// where a voxel of the band is, otherwise free where one of the band is free or a floor was seen up to 2 m below it. A band lies above
/// the place of the way, in the map's frame in metres, that is nearest in the plane; where a way crosses over itself there is one plan of
/// two storeys. In a fixed order; without a way there is nothing.
#[must_use]
pub fn floor_cells(occupancy: &Occupancy, way_m: &[[f64; 3]], band_m: [f64; 2]) -> Vec<FloorCell> {
    let blocks = occupancy.sorted_blocks();
    let columns = blocks.chunk_by(|(a, _), (b, _)| unpack(*a)[..2] == unpack(*b)[..2]);
    let resolution_m = occupancy.resolution_m();
    let mut cells = Vec::new();
    for column in columns {
        let [x, y, _] = unpack(column[0].0).map(|v| v << BLOCK_BITS);
        let middle_m = [x, y].map(|v| f64::from(v + BLOCK_SIDE / 2) * resolution_m);
        let Some(height_m) = height_of_way(way_m, middle_m) else { continue };
        // A voxel belongs to where its middle is.
        let layer = |z_m: f64| ((height_m + z_m) / resolution_m - 0.5).ceil() as i32;
        let layers = Layers {
            floor: layer(band_m[0] - FLOOR_BELOW_M)..layer(band_m[0]),
            band: layer(band_m[0])..layer(band_m[1]),
        };
        cells_of(column.iter().map(|(_, block)| *block), [x, y], &layers, &mut cells);
    }
    cells
}

/// Layers of voxels, by z.
struct Layers {
    floor: Range<i32>,
    band: Range<i32>,
}

fn height_of_way(way_m: &[[f64; 3]], [x, y]: [f64; 2]) -> Option<f64> {
    let square = |at: &[f64; 3]| (at[0] - x).powi(2) + (at[1] - y).powi(2);
    way_m.iter().min_by(|a, b| square(a).total_cmp(&square(b))).map(|at| at[2])
}

/// The cells above which blocks lie, one over the other.
fn cells_of<'a>(
    blocks: impl Iterator<Item = &'a Block>,
    corner: [i32; 2],
    layers: &Layers,
    cells: &mut Vec<FloorCell>,
) {
    const SIDE: usize = BLOCK_SIDE as usize;
    let mut found: [Option<bool>; SIDE * SIDE] = [None; SIDE * SIDE];
    for voxel in blocks.flat_map(Block::voxels) {
        let [x, y] = [0, 1].map(|k| (voxel.index[k] - corner[k]) as usize);
        let cell = &mut found[x + SIDE * y];
        let is_occupied = voxel.log_odds() > 0.0;
        if layers.band.contains(&voxel.index[2]) {
            *cell = Some(is_occupied || *cell == Some(true));
        } else if is_occupied && layers.floor.contains(&voxel.index[2]) {
            cell.get_or_insert(false);
        }
    }
    let place = |at: usize| [corner[0] + (at % SIDE) as i32, corner[1] + (at / SIDE) as i32];
    cells.extend(found.iter().enumerate().filter_map(|(at, found)| {
        let [x, y] = place(at);
        found.map(|is_occupied| FloorCell { x, y, is_occupied })
    }));
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::{Change, OccupancySettings};
    use mapwright_geom::Pose3;

    /// A sensor 1 m above a floor, a box 0.5 m high 4 m before it and a beam of the ceiling 2 m above it, in voxels of 0.2 m.
    fn hall(height_m: f32) -> (Occupancy, [f64; 3]) {
        let mut occupancy = Occupancy::new(OccupancySettings { resolution_m: 0.2, max_range_m: 30.0 });
        let floor = (0..60).flat_map(|x| (-30..30).map(move |y| [0.2 * x as f32 - 4.0, 0.2 * y as f32, -0.99]));
        let block = (-5..5).flat_map(|y| (0..3).map(move |z| [4.2, 0.2 * y as f32, 0.2 * z as f32 - 0.9]));
        let beam = (-30..30).map(|y| [2.2, 0.2 * y as f32, 2.1]);
        let points: Vec<_> = block.chain(beam).chain(floor.filter(|p| p[0] < 4.0)).collect();
        let place_m = [0.1, 0.1, f64::from(height_m)];
        let pose = Pose3::from_quaternion(place_m, [0.0, 0.0, 0.0, 1.0]).unwrap();
        occupancy.draw(points, [0.0; 3], pose, Change::Add);
        (occupancy, place_m)
    }

    fn at(cells: &[FloorCell], x_m: f64, y_m: f64) -> Option<bool> {
        let [x, y] = [x_m, y_m].map(|v| (v / 0.2).floor() as i32);
        cells.iter().find(|cell| (cell.x, cell.y) == (x, y)).map(|cell| cell.is_occupied)
    }

    #[test]
    fn what_stands_in_the_way_is_occupied_and_floor_and_ceiling_are_free() {
        for height_m in [1.0, 41.0] {
            let (occupancy, place_m) = hall(height_m);
            let cells = floor_cells(&occupancy, &[[500.0, 0.0, 7.0], place_m], [-0.8, 0.3]);
            assert_eq!(at(&cells, 4.3, 0.1), Some(true), "the box");
            assert_eq!(at(&cells, 2.3, 0.1), Some(false), "below the beam");
            assert_eq!(at(&cells, -3.0, 3.0), Some(false), "the floor");
            assert_eq!(at(&cells, 6.0, 0.1), None, "behind the box");
        }
    }

    #[test]
    fn a_floor_is_free_though_no_ray_went_through_the_band_and_there_is_no_plan_without_a_way() {
        let (occupancy, place_m) = hall(1.0);
        let low = floor_cells(&occupancy, &[place_m], [3.0, 4.0]);
        assert_eq!(at(&low, 2.3, 0.1), Some(false), "the beam, 1 m below the band");
        assert_eq!(at(&low, -3.0, 3.0), None, "a floor far below is another storey's");
        assert!(floor_cells(&occupancy, &[], [-0.8, 0.3]).is_empty());
    }
}
