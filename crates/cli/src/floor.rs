//! A floor plan of a map of space: what stands in the way of a robot that drives.

use mapwright::{Pose2, Session, SpaceSweep};
use mapwright_formats::{GridImage, UNKNOWN};
use mapwright_logs::SliceBounds;
use mapwright_voxel::{FloorCell, Occupancy, floor_cells};
use std::ops::Range;

/// Side of voxels unless said, metres: OctoMap's own.
pub(crate) const RESOLUTION_M: f64 = 0.1;
/// Cells that an image may have.
const CELLS_AT_MOST: u64 = 100_000_000;

/// Obstacles are what stands between these heights above the robot's way; why there is no floor plan, in words, where there is none.
pub(crate) fn floor_image(
    occupancy: &Occupancy,
    session: &Session<SpaceSweep>,
    band: SliceBounds,
) -> Result<GridImage, String> {
    if !is_upright(session) {
        return Err("a floor plan needs a map whose z axis points upwards, found one that points where a camera looks"
            .to_owned());
    }
    let way_m: Vec<[f64; 3]> = session.map_from_keyframe().iter().map(|pose| pose.translation.into()).collect();
    let cells = floor_cells(occupancy, &way_m, [band.z_min_m, band.z_max_m]);
    image_of(&cells, occupancy.resolution_m())
        .map_err(|cells| format!("expected {CELLS_AT_MOST} cells of a map's file at most, found {cells}"))
}

/// Whether the map's z axis may point upwards. Of a camera whose mounting is not known it is the optical axis: all that it sees
/// first lies on that side, and farther along it than across.
fn is_upright(session: &Session<SpaceSweep>) -> bool {
    let first = session.drawn().iter().flatten().find(|sweep| !sweep.points.is_empty());
    first.is_none_or(|sweep| {
        let farther_across = |point: &[i16; 3]| {
            point[2] <= 0 || point[0].unsigned_abs().max(point[1].unsigned_abs()) > point[2].unsigned_abs()
        };
        sweep.points.iter().any(farther_across)
    })
}

/// The known cells as an image; how many it would have where those are too many.
fn image_of(cells: &[FloorCell], resolution_m: f64) -> Result<GridImage, u64> {
    let [columns, rows] = [range(cells.iter().map(|cell| cell.x)), range(cells.iter().map(|cell| cell.y))];
    let size = columns.len() as u64 * rows.len() as u64;
    if size > CELLS_AT_MOST {
        return Err(size);
    }
    let (width, height) = (columns.len(), rows.len());
    let mut image = vec![UNKNOWN; width * height];
    for cell in cells {
        let at = (cell.y - rows.start) as usize * width + (cell.x - columns.start) as usize;
        image[at] = if cell.is_occupied { 100 } else { 0 };
    }
    let corner_m = [columns.start, rows.start].map(|v| f64::from(v) * resolution_m);
    let world_from_map = Pose2::new(corner_m[0], corner_m[1], 0.0);
    Ok(GridImage { width, height, resolution_m, world_from_map, cells: image })
}

/// From the least to the greatest; one cell where there is none, for no image is empty.
fn range(values: impl Iterator<Item = i32> + Clone) -> Range<i32> {
    let ends = values.clone().min().zip(values.max());
    ends.map_or(0..1, |(least, most)| least..most + 1)
}
