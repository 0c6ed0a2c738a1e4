//! A building without end.

use super::without_repeats;
use crate::band::{Band, RoomKind, WALL_M, build_band};
use crate::build::{Builder, Frame};
use crate::furnish::corridor_piece;
use crate::math::{Point, distance};
use crate::rng::Rng;
use crate::route::{Route, Site};

const ROW_M: f64 = 60.0;
const CORRIDOR_M: f64 = 2.2;
const ROOMS_M: f64 = 5.5;
/// From one row to the next: corridor, rooms, and space for what lies behind the next corridor's doors.
const PITCH_M: f64 = CORRIDOR_M + ROOMS_M + 2.7;

/// A building that grows in a serpentine, row after row of corridor and rooms, so that a drive of `path_length_m`
/// never sees an old place again (within a room's visit it does). About 13 MB for 6 km.
#[must_use]
pub fn growing_building(seed: u64, path_length_m: f64) -> Site {
    let mut builder = Builder::new();
    let mut waypoints = vec![Row::new(0).frame.at(1.0, 0.5 * CORRIDOR_M)];
    let mut driven_m = 0.0;
    let mut number = 0;
    while driven_m < path_length_m {
        let before = waypoints.len() - 1;
        // A stream for each row: a longer building begins with the same rows.
        let mut rng = Rng::keyed(seed, 0x6772_6f77_0000 + number as u64);
        waypoints.extend(Row::new(number).build(&mut builder, &mut rng));
        driven_m += waypoints[before..].windows(2).map(|leg| distance(leg[0], leg[1])).sum::<f64>();
        number += 1;
    }
    Row::new(number).cap(&mut builder);
    Site { world: builder.build(), route: Route::new(without_repeats(waypoints)) }
}

/// One row: corridor below, rooms above, a passage up at its end. `u` runs the way it is driven.
struct Row {
    number: usize,
    frame: Frame,
}

impl Row {
    fn new(number: usize) -> Self {
        let y_m = number as f64 * PITCH_M;
        let forth = number.is_multiple_of(2);
        let (x_m, along) = if forth { (0.0, 1.0) } else { (ROW_M, -1.0) };
        Self { number, frame: Frame { origin: [x_m, y_m], u: [along, 0.0], v: [0.0, 1.0] } }
    }

    /// Builds the row and returns its waypoints.
    fn build(&self, builder: &mut Builder, rng: &mut Rng) -> Vec<Point> {
        let f = &self.frame;
        let rooms_end_m = ROW_M - CORRIDOR_M;
        let band = Band {
            frame: f.moved(0.0, CORRIDOR_M),
            length_m: rooms_end_m,
            depth_m: ROOMS_M,
            doors_between: [0.0, rooms_end_m],
            end_walls: [true, true],
            back_wall: true,
        };
        let rooms = build_band(builder, &band, rng);
        self.outer_walls(builder, rng);
        let mut way = vec![];
        let mut since_visit_m = 0.0;
        for (k, room) in rooms.iter().enumerate() {
            since_visit_m += 5.0;
            if room.kind != RoomKind::Private && rng.chance(since_visit_m / 20.0) {
                since_visit_m = 0.0;
                let through = rooms.get(k + 1).and_then(|next| room.visit_through(next, 0.5 * CORRIDOR_M));
                way.extend(through.unwrap_or_else(|| room.visit(0.5 * CORRIDOR_M)));
            }
        }
        let middle_m = ROW_M - 0.5 * CORRIDOR_M;
        way.extend([f.at(middle_m, 0.5 * CORRIDOR_M), f.at(middle_m, PITCH_M + 0.5 * CORRIDOR_M)]);
        self.reserve(builder, &way);
        rooms.iter().for_each(|room| room.furnish(builder, rng));
        self.corridor_furniture(builder, rng);
        way
    }

    fn reserve(&self, builder: &mut Builder, way: &[Point]) {
        let start = self.frame.at(0.5 * CORRIDOR_M, 0.5 * CORRIDOR_M);
        builder.reserve(&[start, way.first().copied().unwrap_or(start)]);
        builder.reserve(way);
    }

    fn outer_walls(&self, builder: &mut Builder, rng: &mut Rng) {
        let f = &self.frame;
        let entry_m = if self.number == 0 { 0.0 } else { CORRIDOR_M };
        builder.feature_wall(f.at(entry_m, 0.0), f.at(ROW_M, 0.0), [0.0, -1.0], 5.0, rng);
        builder.segment(f.at(0.0, 0.0), f.at(0.0, CORRIDOR_M));
        builder.feature_wall(f.at(ROW_M, 0.0), f.at(ROW_M, PITCH_M), f.u, 3.0, rng);
        builder.segment(f.at(ROW_M - CORRIDOR_M, CORRIDOR_M), f.at(ROW_M - CORRIDOR_M, PITCH_M));
    }

    fn corridor_furniture(&self, builder: &mut Builder, rng: &mut Rng) {
        let wall = self.frame.moved(0.0, WALL_M + 0.1);
        for _ in 0..5 {
            let at_m = rng.uniform(CORRIDOR_M + 1.0, ROW_M - 2.0);
            corridor_piece(builder, &wall, at_m, rng);
        }
    }

    /// Walls up the corridor that the last row leads into.
    fn cap(&self, builder: &mut Builder) {
        let at = |u_m: f64, v_m: f64| self.frame.at(u_m, v_m);
        builder.polyline(&[at(0.0, 0.0), at(0.0, CORRIDOR_M), at(3.0, CORRIDOR_M), at(3.0, 0.0), at(CORRIDOR_M, 0.0)]);
    }
}
