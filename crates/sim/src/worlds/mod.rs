//! Ready worlds, each a function of a seed and little else; no two seeds alike.

mod corridor;
mod corridor_grid;
mod growing;
mod hall;
mod look_alike;
mod loops;
mod office;
mod rooms;
mod twice_the_same;

pub use corridor::{CorridorWalls, corridor, grand_loop};
pub use corridor_grid::corridor_grid;
pub use growing::growing_building;
pub use hall::hall;
pub use look_alike::{Alias, LookAlike, LookAlikeKind, look_alike};
pub use loops::loop_of;
pub use office::{large_office, office_floor, office_to_explore, small_office};
pub use rooms::{home, rooms, three_rooms};
pub use twice_the_same::{Relocalisation, TwiceTheSame, relocalisation};

use crate::math::{Point, distance};

/// Without waypoints that repeat the one before.
fn without_repeats(waypoints: Vec<Point>) -> Vec<Point> {
    let mut kept: Vec<Point> = Vec::with_capacity(waypoints.len());
    for point in waypoints {
        if kept.last().is_none_or(|&last| distance(last, point) > 0.05) {
            kept.push(point);
        }
    }
    kept
}
