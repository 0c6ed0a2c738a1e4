//! Buildings to be located in, half of them with places that cannot be told apart until the robot has left them.

use super::look_alike::{Shapes, corridor_module, room_module, turned, way_back};
use super::{office_floor, rooms};
use crate::band::WALL_M;
use crate::build::{Builder, Frame};
use crate::drive::{Drive, DriveSettings};
use crate::furnish::{Inside, furnish};
use crate::math::{Point, add, distance};
use crate::rng::Rng;
use crate::route::{Route, Site};
use crate::world::World;
use std::sync::Arc;

/// What there is twice in a building.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TwiceTheSame {
    /// Nothing: an office floor or a suite of rooms.
    Nothing,
    /// The ends of a long room, which half a turn maps to itself; its two doors lead to different rooms.
    EndsOfRoom,
    /// Rooms along a corridor, three to five times.
    Rooms,
    /// Two wings, corridors with a dead end to either side of a hall.
    Wings,
}

/// A building, a drive that maps it, and a later one that begins somewhere in it.
#[derive(Debug, Clone)]
pub struct Relocalisation {
    /// What there is twice; the later drive begins there, and leads on to where it can be told apart.
    pub twice: TwiceTheSame,
    /// World and way of the first drive.
    pub mapped: Arc<Site>,
    /// The first drive.
    pub mapping: DriveSettings,
    /// World and way of the later one: the same, with two people who walk about.
    pub later_site: Arc<Site>,
    /// The later drive.
    pub later: DriveSettings,
}

impl Relocalisation {
    /// The first drive, with its truth.
    #[must_use]
    pub fn mapping_drive(&self) -> Drive {
        Drive::new(Arc::clone(&self.mapped), self.mapping.clone())
    }

    /// The later one.
    #[must_use]
    pub fn later_drive(&self) -> Drive {
        Drive::new(Arc::clone(&self.later_site), self.later.clone())
    }
}

/// The building of a seed: ordinary for odd seeds, for even ones the long room, the rooms in a row and the wings take turns.
#[must_use]
pub fn relocalisation(seed: u64) -> Relocalisation {
    let mut rng = Rng::keyed(seed, 0x0074_7769_6365);
    if seed.is_multiple_of(2) {
        let (twice, plan) = match seed / 2 % 3 {
            0 => (TwiceTheSame::EndsOfRoom, ends_of_room(&mut rng)),
            1 => (TwiceTheSame::Rooms, rooms_in_a_row(&mut rng)),
            _ => (TwiceTheSame::Wings, wings(&mut rng)),
        };
        let world = World::new(plan.shapes.segments, plan.shapes.circles);
        drives(twice, Site { world, route: Route::new(plan.mapping) }, Route::new(plan.later), &mut rng)
    } else {
        let mut site = if seed % 4 == 1 { office_floor(rng.next_u64()) } else { rooms(rng.next_u64()) };
        shorten(&mut site.route.waypoints, MAPPED_M);
        let mut later = site.route.waypoints.clone();
        if rng.chance(0.5) {
            later.reverse();
        }
        let begin = rng.below((2 * later.len() / 3).max(1));
        drives(TwiceTheSame::Nothing, site, Route::new(later[begin..].to_vec()), &mut rng)
    }
}

/// So much of an ordinary building is mapped, metres of way.
const MAPPED_M: f64 = 150.0;

/// Without the waypoints beyond so much way.
fn shorten(way: &mut Vec<Point>, length_m: f64) {
    let mut along_m = 0.0;
    let legs = way.windows(2).take_while(|leg| {
        along_m += distance(leg[0], leg[1]);
        along_m <= length_m
    });
    let kept = 1 + legs.count();
    way.truncate(kept);
}

fn drives(twice: TwiceTheSame, site: Site, later: Route, rng: &mut Rng) -> Relocalisation {
    let later_site = Site { world: site.world.clone(), route: later }.with_people(2, rng.next_u64());
    let mapping = DriveSettings { seed: rng.next_u64(), ..DriveSettings::long_drive(0) };
    let later = DriveSettings { seed: rng.next_u64(), duration_s: 120.0, ..DriveSettings::long_drive(0) };
    Relocalisation { twice, mapped: site.into(), mapping, later_site: later_site.into(), later }
}

struct Plan {
    shapes: Shapes,
    mapping: Vec<Point>,
    later: Vec<Point>,
}

/// Half a turn about the origin.
fn opposite(p: Point) -> Point {
    turned(p, 2)
}

fn ends_of_room(rng: &mut Rng) -> Plan {
    let (long_m, wide_m) = (rng.uniform(6.0, 11.0), rng.uniform(2.6, 4.2));
    let door_m = rng.uniform(0.35, 0.7) * long_m;
    let end = [0.75 * long_m, rng.uniform(-0.3, 0.3) * wide_m];
    let door = [[door_m, wide_m - 1.0], [door_m, wide_m + 1.0], [door_m, wide_m + 2.8]];
    let visit = |side: fn(Point) -> Point| {
        let way = door.map(side);
        [way[0], way[1], way[2], way[1], way[0]]
    };
    let mut mapping = vec![opposite(end), [0.0, 0.0], end];
    mapping.extend(visit(|p| p));
    mapping.push([0.0, 0.0]);
    mapping.extend(visit(opposite));
    mapping.extend([opposite(end), [0.0, 0.0], end, [0.0, 0.0], opposite(end)]);
    let mut later =
        vec![opposite(end), [0.0, 0.0], end, [0.0, 0.0], opposite(end), [0.0, 0.0], door[0], door[1], door[2]];
    if rng.chance(0.5) {
        later.iter_mut().for_each(|p| *p = opposite(*p));
    }
    let mut half = Builder::new();
    for way in [&mapping, &later] {
        half.reserve(way);
        half.reserve(&way.iter().map(|&p| opposite(p)).collect::<Vec<_>>());
    }
    half.wall([long_m, -wide_m], [long_m, wide_m], WALL_M, &[]);
    half.wall([-long_m, wide_m], [long_m, wide_m], WALL_M, &[[long_m + door_m - 0.5, long_m + door_m + 0.5]]);
    let frame = Frame { origin: [0.6, -wide_m + 0.1], u: [1.0, 0.0], v: [0.0, 1.0] };
    furnish(&mut half, &Inside { frame, width_m: long_m - 0.7, depth_m: 2.0 * wide_m - 0.2 }, rng);
    let half = Shapes::of(half);
    let mut shapes = Shapes::default();
    shapes.put_up(&half, 0, [0.0, 0.0]);
    shapes.put_up(&half, 2, [0.0, 0.0]);
    for quarters in [0, 2] {
        shapes.put_up(&side_room(&door, wide_m, rng), quarters, [0.0, 0.0]);
    }
    Plan { shapes, mapping, later }
}

/// A room behind the upper wall of a long one, of any size.
fn side_room(door: &[Point; 3], wide_m: f64, rng: &mut Rng) -> Shapes {
    let (left_m, right_m) = (door[0][0] - rng.uniform(1.5, 3.5), door[0][0] + rng.uniform(1.5, 3.5));
    let top_m = wide_m + rng.uniform(4.0, 6.5);
    let mut builder = Builder::new();
    builder.reserve(door);
    builder.wall([left_m, wide_m], [left_m, top_m], WALL_M, &[]);
    builder.wall([left_m, top_m], [right_m, top_m], WALL_M, &[]);
    builder.wall([right_m, top_m], [right_m, wide_m], WALL_M, &[]);
    let frame = Frame { origin: [left_m + 0.1, wide_m + 0.1], u: [1.0, 0.0], v: [0.0, 1.0] };
    furnish(&mut builder, &Inside { frame, width_m: right_m - left_m - 0.2, depth_m: top_m - wide_m - 0.2 }, rng);
    Shapes::of(builder)
}

fn rooms_in_a_row(rng: &mut Rng) -> Plan {
    let half_m = rng.uniform(0.95, 1.3);
    let (width_m, depth_m, count) = (rng.uniform(4.6, 6.6), rng.uniform(4.5, 6.5), 3 + rng.below(3));
    let door_m = rng.uniform(1.0, width_m - 1.0);
    let goal = [rng.uniform(1.4, width_m - 1.4), half_m + depth_m * rng.uniform(0.6, 0.75)];
    let room = [[door_m, 0.0], [door_m, half_m + 1.4], goal];
    let mut shapes = Shapes::default();
    let module = room_module(&room, width_m, depth_m, half_m, rng);
    let at = |k: usize| k as f64 * width_m;
    (0..count).for_each(|k| shapes.put_up(&module, 0, [at(k), 0.0]));
    let end_m = at(count);
    shapes.polyline(&[[end_m, half_m + depth_m], [end_m, half_m]]);
    let (left_m, right_m, low_m) = (-1.5, end_m + 1.5, -rng.uniform(14.0, 22.0));
    shapes.put_up(&way_back(end_m, [left_m, right_m], low_m, half_m, rng), 0, [0.0, 0.0]);
    let way = |k: usize| room.map(|p| add(p, [at(k), 0.0]));
    let mut mapping = vec![[left_m, 0.0]];
    for k in 0..count {
        let [door, inside, goal] = way(k);
        mapping.extend([door, inside, goal, inside, door]);
    }
    let around = [[right_m, 0.0], [right_m, low_m], [left_m, low_m], [left_m, 0.0], [right_m, 0.0]];
    mapping.extend(around);
    let [door, inside, goal] = way(rng.below(count));
    let mut later = vec![goal, inside, door];
    later.extend(around);
    Plan { shapes, mapping, later }
}

fn wings(rng: &mut Rng) -> Plan {
    let half_m = rng.uniform(0.95, 1.3);
    let (hall_m, wide_m, long_m) = (rng.uniform(2.5, 4.0), rng.uniform(2.5, 4.0), rng.uniform(10.0, 18.0));
    let end_m = hall_m + long_m;
    let mut wing = Builder::new();
    corridor_module(&mut wing, [hall_m, end_m], 0.0, half_m, rng);
    wing.polyline(&[[end_m, -half_m], [end_m, half_m]]);
    let wing = Shapes::of(wing);
    let mut hall = Builder::new();
    let (begin, end) = ([-end_m + 0.8, 0.0], [end_m - 0.8, 0.0]);
    hall.reserve(&[begin, end]);
    for x_m in [-hall_m, hall_m] {
        hall.polyline(&[[x_m, -wide_m], [x_m, -half_m]]);
        hall.polyline(&[[x_m, half_m], [x_m, wide_m]]);
    }
    hall.polyline(&[[-hall_m, wide_m], [hall_m, wide_m]]);
    hall.polyline(&[[-hall_m, -wide_m], [hall_m, -wide_m]]);
    let frame = Frame { origin: [-hall_m, -wide_m], u: [1.0, 0.0], v: [0.0, 1.0] };
    furnish(&mut hall, &Inside { frame, width_m: 2.0 * hall_m, depth_m: 2.0 * wide_m }, rng);
    let mut shapes = Shapes::of(hall);
    shapes.put_up(&wing, 0, [0.0, 0.0]);
    shapes.put_up(&wing, 2, [0.0, 0.0]);
    let in_wing = [hall_m + 0.6 * long_m, 0.0];
    let mut later = vec![in_wing, end, in_wing, [0.0, 0.0], begin];
    if rng.chance(0.5) {
        later.iter_mut().for_each(|p| *p = opposite(*p));
    }
    Plan { shapes, mapping: vec![begin, end, begin, end], later }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_later_way_is_free_and_the_same_seed_gives_the_same() {
        for seed in 0..12 {
            let (case, again) = (relocalisation(seed), relocalisation(seed));
            assert_eq!(case.twice == TwiceTheSame::Nothing, seed % 2 == 1);
            assert!(case.later_site.clearance_m() > 0.2, "seed {seed}: {} m", case.later_site.clearance_m());
            assert!(case.mapped.clearance_m() > 0.2, "seed {seed}: {} m", case.mapped.clearance_m());
            let first = |case: &Relocalisation| case.later_drive().scans().next().map(|scan| scan.scan.ranges_m);
            assert_eq!(first(&case), first(&again));
        }
    }
}
