//! A hall whose ends a short-sighted laser does not see from its middle, though it sees always some of what stands along its walls.

use crate::band::WALL_M;
use crate::build::{Builder, Frame};
use crate::furnish::box_in;
use crate::math::Point;
use crate::rng::Rng;
use crate::route::{Route, Site};

/// A hall of 22 to 30 by 5 to 7 m with pillars and cabinets along its walls, and a way in slight bends along it and back.
#[must_use]
pub fn hall(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6861_6c6c);
    let (length_m, width_m) = (rng.uniform(22.0, 30.0), rng.uniform(5.0, 7.0));
    let mut builder = Builder::new();
    let corners = [[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m], [0.0, 0.0]];
    corners.windows(2).for_each(|pair| builder.wall(pair[0], pair[1], WALL_M, &[]));
    let waypoints = way(length_m, width_m, &mut rng);
    builder.reserve(&waypoints);
    let walls = [
        Frame { origin: [0.0, 0.0], u: [1.0, 0.0], v: [0.0, 1.0] },
        Frame { origin: [0.0, width_m], u: [1.0, 0.0], v: [0.0, -1.0] },
    ];
    for wall in walls {
        let mut at_m = rng.uniform(1.0, 3.0);
        while at_m < length_m - 1.0 {
            let (along_m, depth_m) = if rng.chance(0.5) {
                (rng.uniform(0.25, 0.45), rng.uniform(0.25, 0.45))
            } else {
                (rng.uniform(0.6, 1.6), rng.uniform(0.35, 0.6))
            };
            builder.solid(box_in(&wall, at_m, 0.5 * (depth_m + WALL_M), along_m, depth_m));
            at_m += rng.uniform(1.5, 3.0);
        }
    }
    Site { world: builder.build(), route: Route::new(waypoints) }
}

fn way(length_m: f64, width_m: f64, rng: &mut Rng) -> Vec<Point> {
    let bends = 5;
    let mut bend = |k: usize| {
        let x_m = 2.5 + (length_m - 5.0) * k as f64 / bends as f64;
        [x_m, 0.5 * width_m + rng.uniform(-0.15, 0.15) * width_m]
    };
    let mut way: Vec<Point> = (0..=bends).map(&mut bend).collect();
    way.extend((0..bends).rev().map(bend));
    way
}
