//! A straight corridor, and one that comes back to its start.

use crate::band::WALL_M;
use crate::build::{Builder, Frame};
use crate::furnish::corridor_piece;
use crate::math::{Point, add, distance, lerp, scale, sub, unit};
use crate::rng::Rng;
use crate::route::{Route, Site};

/// What the walls of a corridor offer to a laser.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CorridorWalls {
    /// Niches, recessed doors, doors ajar and pilasters at irregular intervals.
    Features,
    /// Nothing: two parallel lines between two ends.
    Featureless,
}

/// A straight corridor 60 to 90 m long, driven there and back.
#[must_use]
pub fn corridor(seed: u64, walls: CorridorWalls) -> Site {
    let mut rng = Rng::keyed(seed, 0x636f_7272);
    let mut builder = Builder::new();
    let (length_m, width_m) = (rng.uniform(60.0, 90.0), rng.uniform(1.9, 2.6));
    let half_m = 0.5 * width_m;
    let route = vec![[1.5, 0.0], [length_m - 1.5, 0.0], [1.5, 0.0]];
    builder.reserve(&route);
    for side in [-1.0, 1.0] {
        let (a, b) = ([0.0, side * half_m], [length_m, side * half_m]);
        match walls {
            CorridorWalls::Features => builder.feature_wall(a, b, [0.0, side], 5.0, &mut rng),
            CorridorWalls::Featureless => builder.segment(a, b),
        }
    }
    builder.segment([0.0, -half_m], [0.0, half_m]);
    builder.segment([length_m, -half_m], [length_m, half_m]);
    Site { world: builder.build(), route: Route::new(route) }
}

/// A single rectangular loop of corridor, `length_m` around (kept within 50 to 2000 m), driven once and a little on.
#[must_use]
pub fn grand_loop(seed: u64, length_m: f64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6c6f_6f70);
    let length_m = length_m.clamp(50.0, 2000.0);
    let mut builder = Builder::new();
    let share = rng.uniform(0.5, 0.66);
    let (a_m, b_m) = (0.5 * length_m * share, 0.5 * length_m * (1.0 - share));
    let corners = [[0.0, 0.0], [a_m, 0.0], [a_m, b_m], [0.0, b_m]];
    let half_m = 0.5 * rng.uniform(2.0, 2.8);
    let way = lap_and_a_bit(&corners, length_m);
    builder.reserve(&way);
    for side in 0..4 {
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        loop_side(&mut builder, from, to, half_m, &mut rng);
    }
    Site { world: builder.build(), route: Route::new(way) }
}

/// Both walls of one side of the loop, and what stands along them.
fn loop_side(builder: &mut Builder, from: Point, to: Point, half_m: f64, rng: &mut Rng) {
    let along = unit(sub(to, from));
    let outward = [along[1], -along[0]];
    for (side, ends_m) in [(1.0, half_m), (-1.0, -half_m)] {
        let away = scale(outward, side * half_m);
        let a = add(sub(from, scale(along, ends_m)), away);
        let b = add(add(to, scale(along, ends_m)), away);
        builder.feature_wall(a, b, scale(outward, side), 4.5, rng);
        let wall = Frame { origin: a, u: along, v: scale(outward, -side) };
        let pieces = (distance(a, b) / 12.0) as usize;
        for _ in 0..pieces {
            let at_m = rng.uniform(2.0, distance(a, b) - 2.0);
            corridor_piece(builder, &wall.moved(0.0, WALL_M), at_m, rng);
        }
    }
}

/// Once around from the middle of the first side, and on for a fifth of the way, at most 25 m.
fn lap_and_a_bit(corners: &[Point; 4], length_m: f64) -> Vec<Point> {
    let [a, b, c, d] = *corners;
    let start = lerp(a, b, 0.5);
    let left_m = distance(start, b);
    let on = lerp(start, b, ((0.2 * length_m).min(25.0) / left_m).min(0.9));
    vec![start, b, c, d, a, start, on]
}
