//! A band of rooms along one side of a corridor.

use crate::build::{Builder, Frame, Gap};
use crate::furnish::{Inside, furnish};
use crate::math::Point;
use crate::rng::Rng;
use crate::world::Schedule;

/// Thickness of a wall, metres.
pub(crate) const WALL_M: f64 = 0.14;
/// The robot drives straight on for so long behind a door, past its open leaf, metres.
const INSIDE_M: f64 = 1.4;

/// Where a band lies and what it must look like. `frame` has `u` along the corridor's wall and `v` into the rooms.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Band {
    pub(crate) frame: Frame,
    pub(crate) length_m: f64,
    pub(crate) depth_m: f64,
    /// Doors lead to the corridor between these two places along `u`.
    pub(crate) doors_between: [f64; 2],
    /// Whether the band's first and last wall across are to be built.
    pub(crate) end_walls: [bool; 2],
    pub(crate) back_wall: bool,
}

/// One room of a band.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    frame: Frame,
    from_m: f64,
    to_m: f64,
    depth_m: f64,
    door_m: f64,
    pub(crate) kind: RoomKind,
    /// Depth of the door to the next room, where there is one.
    next_door_m: Option<f64>,
    /// Where a visitor goes, in the frame of the band.
    goal: Point,
}

/// How a room meets its corridor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum RoomKind {
    /// Through a door that stands open.
    Open,
    /// Through a door that is shut now and then.
    Private,
    /// A lounge without a wall to the corridor.
    Lounge,
}

impl Room {
    /// From the corridor, `corridor_m` before the wall, through the door to the goal and back.
    pub(crate) fn visit(&self, corridor_m: f64) -> Vec<Point> {
        let mut way = self.way_in(corridor_m);
        let back: Vec<Point> = way.iter().rev().skip(1).copied().collect();
        way.extend(back);
        way
    }

    pub(crate) fn way_in(&self, corridor_m: f64) -> Vec<Point> {
        let inside_m = INSIDE_M.min(0.5 * self.depth_m);
        let inside = self.frame.at(self.door_m, inside_m);
        vec![self.doorstep(corridor_m), inside, self.frame.at(self.goal[0], self.goal[1])]
    }

    /// In through this room's door, through the door to `next`, and out through its door.
    pub(crate) fn visit_through(&self, next: &Self, corridor_m: f64) -> Option<Vec<Point>> {
        let depth_m = self.next_door_m?;
        let across = [self.frame.at(self.door_m, depth_m), next.frame.at(next.door_m, depth_m)];
        Some(vec![self.doorstep(corridor_m), across[0], across[1], next.doorstep(corridor_m)])
    }

    /// The place in the corridor before the door.
    pub(crate) fn doorstep(&self, corridor_m: f64) -> Point {
        self.frame.at(self.door_m, -corridor_m)
    }

    pub(crate) fn has_next_door(&self) -> bool {
        self.next_door_m.is_some()
    }

    pub(crate) fn furnish(&self, builder: &mut Builder, rng: &mut Rng) {
        builder.reserve(&[self.frame.at(self.door_m, -0.5), self.frame.at(self.door_m, 0.7)]);
        let frame = self.frame.moved(self.from_m + 0.5 * WALL_M, 0.5 * WALL_M);
        let (width_m, depth_m) = (self.to_m - self.from_m - WALL_M, self.depth_m - WALL_M);
        furnish(builder, &Inside { frame, width_m, depth_m }, rng);
    }
}

/// Builds the walls and doors of a band, rooms of every width.
pub(crate) fn build_band(builder: &mut Builder, band: &Band, rng: &mut Rng) -> Vec<Room> {
    let rooms = divide(band, rng);
    build_walls(builder, band, &rooms);
    rooms.iter().for_each(|room| hang_door(builder, room, rng));
    rooms
}

/// Rooms of random widths, each with room for a door.
fn divide(band: &Band, rng: &mut Rng) -> Vec<Room> {
    let mut rooms: Vec<Room> = Vec::new();
    let mut from_m = 0.0;
    while from_m < band.length_m - 1.0 {
        let wanted_m = match rng.below(5) {
            0 | 1 => rng.uniform(2.6, 3.4),
            2 | 3 => rng.uniform(3.6, 5.4),
            _ => rng.uniform(5.6, 8.0),
        };
        let first_m = band.doors_between[0] + 1.5;
        let mut to_m: f64 = (from_m + wanted_m).max(first_m);
        if band.length_m - to_m < (band.length_m - band.doors_between[1] + 1.6).max(2.6) {
            to_m = band.length_m;
        }
        rooms.push(room(band, from_m, to_m, rng));
        from_m = to_m;
    }
    connect(&mut rooms, rng);
    rooms
}

fn room(band: &Band, from_m: f64, to_m: f64, rng: &mut Rng) -> Room {
    let low_m = from_m.max(band.doors_between[0]) + 0.7;
    let high_m = to_m.min(band.doors_between[1]) - 0.7;
    // Most doors are near a corner.
    let door_m = match rng.below(3) {
        0 => low_m,
        1 => high_m,
        _ => rng.uniform(low_m, high_m),
    };
    let kind = match rng.below(10) {
        0 if from_m >= band.doors_between[0] && to_m <= band.doors_between[1] => RoomKind::Lounge,
        1 | 2 => RoomKind::Private,
        _ => RoomKind::Open,
    };
    let aside_m = rng.uniform(from_m + 0.9, to_m - 0.9);
    let goal = [aside_m, band.depth_m * rng.uniform(0.45, 0.72)];
    Room { frame: band.frame, from_m, to_m, depth_m: band.depth_m, door_m, kind, next_door_m: None, goal }
}

/// Some neighbours get a door between them.
fn connect(rooms: &mut [Room], rng: &mut Rng) {
    for k in 1..rooms.len() {
        let both_open = rooms[k - 1].kind == RoomKind::Open && rooms[k].kind == RoomKind::Open;
        let after_connection = k >= 2 && rooms[k - 2].next_door_m.is_some();
        if both_open && !after_connection && rng.chance(0.25) {
            rooms[k - 1].next_door_m = Some(rooms[k].depth_m * rng.uniform(0.4, 0.7));
        }
    }
}

fn build_walls(builder: &mut Builder, band: &Band, rooms: &[Room]) {
    let frame = &band.frame;
    let gaps: Vec<Gap> = rooms.iter().map(opening).collect();
    builder.wall(frame.at(0.0, 0.0), frame.at(band.length_m, 0.0), WALL_M, &gaps);
    for room in rooms {
        let last = room.to_m >= band.length_m;
        if !last || band.end_walls[1] {
            let gap: Vec<Gap> = room.next_door_m.map(|m| [m - 0.55, m + 0.55]).into_iter().collect();
            builder.wall(frame.at(room.to_m, 0.0), frame.at(room.to_m, band.depth_m), WALL_M, &gap);
        }
    }
    if band.end_walls[0] {
        builder.wall(frame.at(0.0, 0.0), frame.at(0.0, band.depth_m), WALL_M, &[]);
    }
    if band.back_wall {
        builder.wall(frame.at(0.0, band.depth_m), frame.at(band.length_m, band.depth_m), WALL_M, &[]);
    }
}

/// The opening in the corridor's wall.
fn opening(room: &Room) -> Gap {
    match room.kind {
        RoomKind::Lounge => [room.from_m + 0.5 * WALL_M, room.to_m - 0.5 * WALL_M],
        _ => [room.door_m - 0.5, room.door_m + 0.5],
    }
}

fn hang_door(builder: &mut Builder, room: &Room, rng: &mut Rng) {
    if room.kind == RoomKind::Lounge || (room.kind == RoomKind::Open && rng.chance(0.3)) {
        return;
    }
    let side = if room.door_m - room.from_m < room.to_m - room.door_m { -1.0 } else { 1.0 };
    let (hinge, shut_end) =
        (room.frame.at(room.door_m + 0.5 * side, 0.03), room.frame.at(room.door_m - 0.5 * side, 0.03));
    let handedness = (room.frame.u[0] * room.frame.v[1] - room.frame.u[1] * room.frame.v[0]).signum();
    let swing_rad = rng.uniform(85f64.to_radians(), 97f64.to_radians()) * -side * handedness;
    builder.door(hinge, shut_end, swing_rad, shut_when(room.kind, rng));
}

fn shut_when(kind: RoomKind, rng: &mut Rng) -> Schedule {
    match kind {
        RoomKind::Private if rng.chance(0.5) => Schedule::Always,
        RoomKind::Private => {
            let (present_s, absent_s) = (rng.uniform(60.0, 400.0), rng.uniform(60.0, 400.0));
            Schedule::Repeating { present_s, absent_s, phase_s: rng.uniform(0.0, 800.0) }
        }
        _ => Schedule::During(Vec::new()),
    }
}
