//! What stands in rooms, as a laser 30 to 40 cm above the floor sees it.

use crate::build::{Builder, Footprint, Frame};
use crate::math::{Point, add, dot, rotate, scale, sub};
use crate::rng::Rng;
use std::f64::consts::TAU;

/// Attempts to find a place for one piece.
const TRIES: usize = 8;

/// A room's inside: `frame` at one corner, `u` to `width_m`, `v` to `depth_m`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inside {
    pub(crate) frame: Frame,
    pub(crate) width_m: f64,
    pub(crate) depth_m: f64,
}

impl Inside {
    /// The four walls as frames: `u` along the wall, `v` into the room; with their lengths.
    fn walls(&self) -> [(Frame, f64); 4] {
        let Frame { u, v, .. } = self.frame;
        let (minus_u, minus_v) = (scale(u, -1.0), scale(v, -1.0));
        [
            (self.frame, self.width_m),
            (Frame { origin: self.frame.at(0.0, self.depth_m), u, v: minus_v }, self.width_m),
            (Frame { origin: self.frame.origin, u: v, v: u }, self.depth_m),
            (Frame { origin: self.frame.at(self.width_m, 0.0), u: v, v: minus_u }, self.depth_m),
        ]
    }

    fn any_point(&self, margin_m: f64, rng: &mut Rng) -> Point {
        let along = |length_m: f64, rng: &mut Rng| {
            rng.uniform(margin_m.min(0.5 * length_m), (length_m - margin_m).max(0.5 * length_m))
        };
        let (u_m, v_m) = (along(self.width_m, rng), along(self.depth_m, rng));
        self.frame.at(u_m, v_m)
    }

    fn contains(&self, point: Point, margin_m: f64) -> bool {
        let local = sub(point, self.frame.origin);
        let (u_m, v_m) = (dot(local, self.frame.u), dot(local, self.frame.v));
        let within = |value_m: f64, length_m: f64| (margin_m..length_m - margin_m).contains(&value_m);
        within(u_m, self.width_m) && within(v_m, self.depth_m)
    }

    fn area_m2(&self) -> f64 {
        self.width_m * self.depth_m
    }
}

/// Fills a room as its size suggests.
pub(crate) fn furnish(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let area_m2 = room.area_m2();
    match rng.below(10) {
        0 => storage(builder, room, rng),
        1 | 2 if area_m2 > 22.0 => meeting(builder, room, rng),
        3 | 4 if area_m2 > 24.0 => laboratory(builder, room, rng),
        _ => office(builder, room, rng),
    }
    let bits = 1 + (area_m2 / 14.0) as usize + rng.below(3);
    (0..bits).for_each(|_| clutter(builder, room, rng));
}

/// Fills a room of a home as its size suggests: bath, kitchen, bedroom or living room.
pub(crate) fn furnish_home(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let area_m2 = room.area_m2();
    match rng.below(3) {
        _ if area_m2 < 9.0 => bath(builder, room, rng),
        0 if area_m2 < 16.0 => kitchen(builder, room, rng),
        0 | 1 => living_room(builder, room, rng),
        _ => bedroom(builder, room, rng),
    }
    (0..1 + rng.below(4)).for_each(|_| clutter(builder, room, rng));
}

/// Pieces with their backs to the walls: length and depth of each, metres.
fn along_walls(builder: &mut Builder, room: &Inside, pieces: &[[f64; 2]], rng: &mut Rng) {
    pieces.iter().for_each(|&[length_m, depth_m]| against_wall(builder, room, length_m, depth_m, rng));
}

fn bath(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    along_walls(builder, room, &[[1.7, 0.75], [0.6, 0.6], [rng.uniform(0.5, 0.9), 0.45]], rng);
    builder.round(room.any_point(0.4, rng), 0.2);
}

fn kitchen(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let counter_m = rng.uniform(0.5, 0.8) * room.width_m.max(room.depth_m);
    along_walls(builder, room, &[[counter_m, 0.6], [rng.uniform(1.0, 2.0), 0.6], [0.6, 0.65]], rng);
    meeting(builder, room, rng);
}

fn living_room(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let sofa = [rng.uniform(1.6, 2.4), rng.uniform(0.8, 1.0)];
    let shelves = [[rng.uniform(0.8, 2.2), 0.35], [rng.uniform(0.6, 1.5), 0.4]];
    along_walls(builder, room, &[sofa, shelves[0], shelves[1], [0.8, 0.8]], rng);
    meeting(builder, room, rng);
}

fn bedroom(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let bed = [rng.uniform(0.9, 1.8), 2.0];
    along_walls(builder, room, &[bed, [rng.uniform(1.0, 2.2), 0.6], [0.45, 0.4], [0.8, 0.45]], rng);
    desk(builder, room, DeskStyle::draw(rng), rng);
}

/// Desks at the walls or in pairs, chairs, shelves.
fn office(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let style = DeskStyle::draw(rng);
    let desks = 1 + (room.area_m2() / 9.0) as usize + rng.below(2);
    for _ in 0..desks {
        desk(builder, room, style, rng);
    }
    for _ in 0..1 + (room.area_m2() / 14.0) as usize + rng.below(3) {
        let (length_m, depth_m) = (rng.uniform(0.8, 2.0), rng.uniform(0.3, 0.45));
        against_wall(builder, room, length_m, depth_m, rng);
    }
}

fn storage(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    for _ in 0..4 + rng.below(5) {
        let (length_m, depth_m) = (rng.uniform(0.6, 2.2), rng.uniform(0.35, 0.7));
        against_wall(builder, room, length_m, depth_m, rng);
    }
    (0..3 + rng.below(4)).for_each(|_| clutter(builder, room, rng));
}

/// A long table on legs with chairs around, somewhere near the middle.
fn meeting(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let wide = room.width_m > room.depth_m;
    let length_m = rng.uniform(1.8, (0.6 * room.width_m.max(room.depth_m)).clamp(1.9, 4.5));
    let depth_m = rng.uniform(0.9, 1.3);
    for _ in 0..4 * TRIES {
        let along = if wide { room.frame.u } else { room.frame.v };
        let center = room.any_point(1.2, rng);
        let place = Footprint { center, along, length_m: length_m + 0.9, depth_m: depth_m + 1.1 };
        if builder.claim(place) {
            return meeting_table(builder, Footprint { length_m, depth_m, ..place }, rng);
        }
    }
    against_wall(builder, room, 1.6, 0.5, rng);
}

fn meeting_table(builder: &mut Builder, table: Footprint, rng: &mut Rng) {
    let inset = Footprint { length_m: table.length_m - 0.2, depth_m: table.depth_m - 0.2, ..table };
    inset.corners().into_iter().for_each(|corner| builder.leg(corner, 0.035));
    let across = [-table.along[1], table.along[0]];
    let seats = (table.length_m / 0.75) as usize;
    for seat in 0..seats {
        for side in [-1.0, 1.0] {
            let along_m = (seat as f64 + 0.5) / seats as f64 * table.length_m - 0.5 * table.length_m;
            let away_m = side * (0.5 * table.depth_m + rng.uniform(0.05, 0.35));
            let at = add(table.center, add(scale(table.along, along_m), scale(across, away_m)));
            if rng.chance(0.85) {
                chair(builder, at, rng);
            }
        }
    }
}

/// Rows of benches.
fn laboratory(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let wide = rng.chance(0.5);
    let (length_m, rows_m) = if wide { (room.width_m, room.depth_m) } else { (room.depth_m, room.width_m) };
    let along = if wide { room.frame.u } else { room.frame.v };
    let spacing_m = rng.uniform(1.9, 2.5);
    let mut row_m = rng.uniform(1.3, 1.8);
    while row_m < rows_m - 1.0 {
        let bench_m = rng.uniform(0.45, 0.75) * length_m;
        let middle_m = rng.uniform(0.5 * bench_m, length_m - 0.5 * bench_m);
        let center = if wide { room.frame.at(middle_m, row_m) } else { room.frame.at(row_m, middle_m) };
        let bench = Footprint { center, along, length_m: bench_m, depth_m: rng.uniform(0.7, 0.9) };
        // A bench in the way is sawn off.
        let mut lengths = [1.0, 0.6, 0.35].into_iter();
        lengths.any(|share| builder.solid(Footprint { length_m: bench_m * share, ..bench }));
        row_m += spacing_m;
    }
    (0..3).for_each(|_| against_wall(builder, room, 1.2, 0.5, rng));
    (0..2 + rng.below(3)).for_each(|_| stool(builder, room, rng));
}

/// How a desk looks below its top; one style a room.
#[derive(Debug, Clone, Copy)]
enum DeskStyle {
    Solid,
    Panels,
    Legs,
}

impl DeskStyle {
    fn draw(rng: &mut Rng) -> Self {
        [Self::Solid, Self::Panels, Self::Legs][rng.below(3)]
    }
}

/// A desk at a wall, its chair in front.
fn desk(builder: &mut Builder, room: &Inside, style: DeskStyle, rng: &mut Rng) {
    let (length_m, depth_m) = (rng.uniform(1.2, 1.8), rng.uniform(0.7, 0.8));
    for _ in 0..TRIES {
        let (wall, wall_m) = room.walls()[rng.below(4)];
        // Some desks stand with their short side to the wall.
        let (u_m, v_m) = if rng.chance(0.7) { (length_m, depth_m) } else { (depth_m, length_m) };
        if wall_m < u_m + 0.4 {
            continue;
        }
        let at_m = snapped(rng.uniform(0.5 * u_m + 0.03, wall_m - 0.5 * u_m - 0.03), 0.5 * u_m + 0.03, wall_m, rng);
        let front_m = v_m + 0.03;
        let place = box_in(&wall, at_m, 0.5 * front_m + 0.02, u_m, front_m);
        if builder.claim(place) {
            desk_body(builder, &box_in(&wall, at_m, 0.5 * v_m + 0.04, u_m, v_m), style);
            let seat = if u_m > v_m {
                wall.at(at_m + rng.uniform(-0.3, 0.3), v_m + rng.uniform(0.25, 0.6))
            } else {
                wall.at(at_m + 0.5 * u_m + rng.uniform(0.25, 0.5), 0.5 * v_m + rng.uniform(-0.3, 0.3))
            };
            office_chair(builder, room, seat, rng);
            return;
        }
    }
}

fn desk_body(builder: &mut Builder, desk: &Footprint, style: DeskStyle) {
    let [a, b, c, d] = desk.corners();
    match style {
        DeskStyle::Solid => builder.polyline(&[a, b, c, d, a]),
        DeskStyle::Panels => {
            builder.polyline(&[a, d]);
            builder.polyline(&[b, c]);
            let drawers = add(desk.center, scale(desk.along, 0.5 * desk.length_m - 0.25));
            let drawers =
                Footprint { center: drawers, length_m: 0.43, depth_m: (desk.depth_m - 0.15).min(0.6), ..*desk };
            let [a, b, c, d] = drawers.corners();
            builder.polyline(&[a, b, c, d, a]);
        }
        DeskStyle::Legs => [a, b, c, d].into_iter().for_each(|corner| builder.leg(corner, 0.03)),
    }
}

/// A swivel chair: its column, or with the seat pulled low.
fn office_chair(builder: &mut Builder, room: &Inside, at: Point, rng: &mut Rng) {
    let radius_m = rng.uniform(0.04, 0.22);
    if room.contains(at, radius_m) {
        builder.round(at, radius_m);
    }
}

/// A chair on four legs, its place already claimed.
fn chair(builder: &mut Builder, at: Point, rng: &mut Rng) {
    let turn_rad = rng.uniform(-0.3, 0.3);
    for corner in [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]] {
        builder.leg(add(at, rotate(corner, turn_rad)), 0.015);
    }
}

fn stool(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    let at = room.any_point(0.5, rng);
    builder.round(at, 0.15);
}

/// Bins, plants, cartons.
fn clutter(builder: &mut Builder, room: &Inside, rng: &mut Rng) {
    if rng.chance(0.5) {
        let at = room.any_point(0.3, rng);
        builder.round(at, rng.uniform(0.1, 0.22));
    } else {
        let along = rotate([1.0, 0.0], rng.uniform(0.0, TAU));
        let (length_m, depth_m) = (rng.uniform(0.25, 0.6), rng.uniform(0.2, 0.45));
        builder.solid(Footprint { center: room.any_point(0.4, rng), along, length_m, depth_m });
    }
}

/// A solid piece with its back to one of the walls.
fn against_wall(builder: &mut Builder, room: &Inside, length_m: f64, depth_m: f64, rng: &mut Rng) {
    for _ in 0..TRIES {
        let (wall, wall_m) = room.walls()[rng.below(4)];
        if wall_m < length_m + 0.2 {
            continue;
        }
        let low_m = 0.5 * length_m + 0.03;
        let at_m = snapped(rng.uniform(low_m, wall_m - low_m), low_m, wall_m, rng);
        if builder.solid(box_in(&wall, at_m, 0.5 * depth_m + 0.02, length_m, depth_m)) {
            return;
        }
    }
}

/// Pushed into the nearer corner, as furniture often is.
fn snapped(at_m: f64, low_m: f64, wall_m: f64, rng: &mut Rng) -> f64 {
    match (rng.chance(0.5), at_m < 0.5 * wall_m) {
        (false, _) => at_m,
        (true, true) => low_m,
        (true, false) => wall_m - low_m,
    }
}

/// A box with its length along a wall's `u`.
pub(crate) fn box_in(wall: &Frame, u_m: f64, v_m: f64, length_m: f64, depth_m: f64) -> Footprint {
    Footprint { center: wall.at(u_m, v_m), along: wall.u, length_m, depth_m }
}

/// Things along a corridor's wall: benches, cabinets, copiers, plants. `wall` has `v` into the corridor.
pub(crate) fn corridor_piece(builder: &mut Builder, wall: &Frame, at_m: f64, rng: &mut Rng) {
    match rng.below(5) {
        0 => {
            let radius_m = rng.uniform(0.14, 0.2);
            builder.round(wall.at(at_m, radius_m + 0.05), radius_m);
        }
        1 => {
            builder.solid(box_in(wall, at_m, 0.3, 0.7, 0.55));
        }
        2 => {
            builder.solid(box_in(wall, at_m, 0.12, 0.5, 0.2));
        }
        _ => {
            builder.solid(box_in(wall, at_m, 0.22, rng.uniform(0.6, 1.8), 0.4));
        }
    }
}
