//! The scan that stands for a stretch: where rays from the robot meet its walls.

use crate::wall::Wall;
use mapwright_geom::sin_cos;
use std::f64::consts::{PI, TAU};

/// Range of the nearest wall for each of so many beams all around the origin from -pi on, metres; NaN where none is known.
pub(crate) fn ranges_m<'a>(walls: impl Iterator<Item = &'a Wall> + Clone, beams: usize) -> Vec<f32> {
    let range = |beam: usize| {
        let (sin, cos) = sin_cos(-PI + TAU * beam as f64 / beams as f64);
        let nearest_m = walls.clone().filter_map(|wall| wall.met_m([0.0; 2], [cos, sin])).fold(f64::INFINITY, f64::min);
        if nearest_m.is_finite() { nearest_m as f32 } else { f32::NAN }
    };
    (0..beams).map(range).collect()
}
