//! Several robots in one world that drive where they are told, see each other and get in each other's way.

use crate::laser::{LaserSettings, Scanner};
use crate::math::{Point, advance, distance};
use crate::odometry::{OdometryNoise, Wheels};
use crate::rng::Rng;
use crate::robot::{Arc2, RobotSettings};
use crate::shape::{Circle, Segment};
use crate::world::World;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::LaserScan;

/// Edge of the bins in which walls are looked up, metres.
const BIN_M: f64 = 0.5;

/// What a robot is told to do: drive and turn, within what it can.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Twist {
    /// Speed, m/s.
    pub speed_m_per_s: f64,
    /// Turn rate, rad/s, counter-clockwise.
    pub turn_rate_rad_per_s: f64,
}

/// Robots in a world. They stop at walls and at each other; one that is switched off stays where it is, in the way of others.
///
/// ```
/// use mapwright_sim::{LaserSettings, OdometryNoise, RobotSettings, Rovers, Twist, worlds};
/// let site = worlds::large_office(3);
/// let starts = [site.start(0.0), site.start(1.0)];
/// let laser = LaserSettings::with_field_of_view(std::f64::consts::TAU, 90);
/// let mut rovers = Rovers::new(site.world, &starts, 0.22, RobotSettings::default(), laser, OdometryNoise::default(), 3);
/// let ahead = Twist { speed_m_per_s: 0.5, turn_rate_rad_per_s: 0.0 };
/// (0..10).for_each(|_| rovers.step(&[ahead, Twist::default()], 0.1));
/// assert!(rovers.world_from_robot(0).distance(starts[0]) > 0.1);
/// assert_eq!(rovers.world_from_robot(1), starts[1]);
/// ```
#[derive(Debug, Clone)]
pub struct Rovers {
    world: World,
    walls: Walls,
    settings: RobotSettings,
    radius_m: f64,
    scanner: Scanner,
    rovers: Vec<Rover>,
    seed: u64,
    time_s: f64,
}

#[derive(Debug, Clone)]
struct Rover {
    world_from_robot: Pose2,
    twist: Twist,
    wheels: Wheels,
    scans: u64,
    driven_m: f64,
    bumps: u32,
}

impl Rovers {
    /// Robots of one kind that stand there. Their wheels and lasers err differently.
    #[must_use]
    pub fn new(
        world: World,
        starts: &[Pose2],
        radius_m: f64,
        settings: RobotSettings,
        laser: LaserSettings,
        odometry: OdometryNoise,
        seed: u64,
    ) -> Self {
        let rover = |(number, &world_from_robot): (usize, &Pose2)| Rover {
            world_from_robot,
            twist: Twist::default(),
            wheels: Wheels::new(odometry.clone(), stream(seed, number)),
            scans: 0,
            driven_m: 0.0,
            bumps: 0,
        };
        let rovers = starts.iter().enumerate().map(rover).collect();
        let walls = Walls::of(&world);
        Self { world, walls, settings, radius_m, scanner: Scanner::new(laser), rovers, seed, time_s: 0.0 }
    }

    /// Drives on for a while; each robot within its accelerations and speeds, and no farther than the next wall or robot.
    pub fn step(&mut self, told: &[Twist], seconds: f64) {
        for number in 0..self.rovers.len() {
            let told = told.get(number).copied().unwrap_or_default();
            let twist = limited(&self.settings, self.rovers[number].twist, told, seconds);
            let here = self.rovers[number].world_from_robot;
            let arc = Arc2 { distance_m: twist.speed_m_per_s * seconds, turn_rad: twist.turn_rate_rad_per_s * seconds };
            let there = advance(here, arc.distance_m, arc.turn_rad);
            let blocked = self.is_blocked(number, [here.x, here.y], [there.x, there.y]);
            let rover = &mut self.rovers[number];
            // Who meets something can still turn.
            let driven = if blocked { Arc2 { distance_m: 0.0, ..arc } } else { arc };
            rover.bumps += u32::from(blocked && arc.distance_m != 0.0);
            rover.twist = if blocked { Twist { speed_m_per_s: 0.0, ..twist } } else { twist };
            rover.world_from_robot = if blocked { advance(here, 0.0, arc.turn_rad) } else { there };
            rover.driven_m += driven.distance_m.abs();
            rover.wheels.count(driven);
        }
        self.time_s += seconds;
    }

    /// Whether the way leads nearer to something that is too near at its end.
    fn is_blocked(&self, number: usize, here: Point, there: Point) -> bool {
        let at_wall = |point| self.walls.distance_m(point, self.radius_m);
        let wall_m = at_wall(there);
        if wall_m < self.radius_m && wall_m < at_wall(here) {
            return true;
        }
        self.others(number).any(|other| {
            let away_m = distance(there, other.center);
            away_m < 2.0 * self.radius_m && away_m < distance(here, other.center)
        })
    }

    fn others(&self, number: usize) -> impl Iterator<Item = Circle> + '_ {
        let others = self.rovers.iter().enumerate().filter(move |&(other, _)| other != number);
        others.map(|(_, rover)| Circle {
            center: [rover.world_from_robot.x, rover.world_from_robot.y],
            radius_m: self.radius_m,
        })
    }

    /// What a robot's laser sees now, other robots included, with what its wheels say.
    pub fn scan(&mut self, number: usize) -> Option<LaserScan> {
        let world_from_robot = self.rovers.get(number)?.world_from_robot;
        let at = self.scanner.world_from_laser(world_from_robot);
        let moment = self.world.at(self.time_s, [at.x, at.y], self.scanner.model().range_max_m);
        let moment = moment.with_others(self.others(number));
        let stamp = self.stamp();
        let rover = &mut self.rovers[number];
        let mut rng = Rng::keyed(stream(self.seed, number) ^ 0x006c_6173_6572, rover.scans);
        rover.scans += 1;
        let ranges_m = self.scanner.sweep(&moment, |_| world_from_robot, &mut rng);
        Some(LaserScan {
            stamp,
            laser: self.scanner.model().clone(),
            ranges_m,
            odom_from_robot: Some(rover.wheels.odom_from_robot()),
        })
    }

    /// The time, from zero on.
    #[must_use]
    pub fn stamp(&self) -> Stamp {
        Stamp((self.time_s * 1e9).round() as i64)
    }

    /// Where a robot truly is.
    #[must_use]
    pub fn world_from_robot(&self, number: usize) -> Pose2 {
        self.rovers.get(number).map_or(Pose2::IDENTITY, |rover| rover.world_from_robot)
    }

    /// Where a robot is by its wheels.
    #[must_use]
    pub fn odom_from_robot(&self, number: usize) -> Pose2 {
        self.rovers.get(number).map_or(Pose2::IDENTITY, |rover| rover.wheels.odom_from_robot())
    }

    /// True length of a robot's way so far, metres.
    #[must_use]
    pub fn driven_m(&self, number: usize) -> f64 {
        self.rovers.get(number).map_or(0.0, |rover| rover.driven_m)
    }

    /// How often all robots together were held by a wall or by each other, steps.
    #[must_use]
    pub fn bumps(&self) -> u32 {
        self.rovers.iter().map(|rover| rover.bumps).sum()
    }

    /// How many things that stand still lie between two robots.
    #[must_use]
    pub fn between(&self, a: usize, b: usize) -> usize {
        let [from, to] = [a, b].map(|number| self.world_from_robot(number)).map(|pose| [pose.x, pose.y]);
        let line = Segment { a: from, b: to };
        let blocks = |(wall, radius_m): &(&Segment, &f64)| wall.distance_to_segment(&line) <= **radius_m;
        self.walls.segments.iter().zip(&self.walls.radii_m).filter(blocks).count()
    }

    /// How a robot moves.
    #[must_use]
    pub fn twist(&self, number: usize) -> Twist {
        self.rovers.get(number).map_or(Twist::default(), |rover| rover.twist)
    }

    /// Distance from a point to the nearest thing that stands still, metres; at least `within_m` where there is none nearer than that.
    #[must_use]
    pub fn clearance_m(&self, point: Point, within_m: f64) -> f64 {
        self.walls.distance_m(point, within_m)
    }

    /// What can be seen.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }
}

/// A robot's own stream of a seed; the first robot's is the seed's.
fn stream(seed: u64, number: usize) -> u64 {
    seed ^ (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

/// What a robot can do of what it is told.
fn limited(settings: &RobotSettings, before: Twist, told: Twist, seconds: f64) -> Twist {
    let towards = |before: f64, told: f64, most: f64, change: f64, brake: f64| {
        let wanted = told.clamp(-most, most);
        let slower = wanted.abs() < before.abs();
        let change = seconds * if slower { brake } else { change };
        before + (wanted - before).clamp(-change, change)
    };
    // Brakes are twice as strong, as in a drive along a route.
    let s = settings;
    let (speed, turn) = (before.speed_m_per_s, before.turn_rate_rad_per_s);
    let acceleration = s.acceleration_m_per_s2;
    let turn_acceleration = s.turn_acceleration_rad_per_s2;
    Twist {
        speed_m_per_s: towards(speed, told.speed_m_per_s, s.speed_m_per_s, acceleration, 2.0 * acceleration),
        turn_rate_rad_per_s: towards(
            turn,
            told.turn_rate_rad_per_s,
            s.turn_rate_rad_per_s,
            turn_acceleration,
            2.0 * turn_acceleration,
        ),
    }
}

/// Everything that stands still, by its place.
#[derive(Debug, Clone)]
struct Walls {
    low: Point,
    columns: usize,
    rows: usize,
    bins: Vec<Vec<u32>>,
    segments: Vec<Segment>,
    /// As those of no length, with their radii.
    radii_m: Vec<f64>,
}

impl Walls {
    fn of(world: &World) -> Self {
        let leaves =
            world.doors().iter().filter_map(|door| if door.shut_when.holds(0.0) { Some(door.shut) } else { door.open });
        let mut segments: Vec<Segment> = world.segments().iter().copied().chain(leaves).collect();
        let mut radii_m = vec![0.0; segments.len()];
        for circle in world.circles() {
            segments.push(Segment { a: circle.center, b: circle.center });
            radii_m.push(circle.radius_m);
        }
        let ends = || segments.iter().flat_map(|segment| [segment.a, segment.b]);
        let extreme = |axis: usize, least: bool| {
            let values = ends().map(|end| end[axis]);
            if least { values.fold(f64::INFINITY, f64::min) } else { values.fold(f64::NEG_INFINITY, f64::max) }
        };
        let low = [extreme(0, true), extreme(1, true)].map(|m| if m.is_finite() { m - 2.0 * BIN_M } else { 0.0 });
        let side = |axis: usize| {
            let high_m = extreme(axis, false);
            if high_m.is_finite() { ((high_m - low[axis]) / BIN_M) as usize + 4 } else { 1 }
        };
        let (columns, rows) = (side(0), side(1));
        let mut walls = Self { low, columns, rows, bins: vec![Vec::new(); columns * rows], segments, radii_m };
        walls.sort_in();
        walls
    }

    fn bin(&self, point: Point) -> [usize; 2] {
        let bin = |axis: usize, most: usize| (((point[axis] - self.low[axis]) / BIN_M).max(0.0) as usize).min(most - 1);
        [bin(0, self.columns), bin(1, self.rows)]
    }

    /// Into every bin from which it is nearer than a bin's edge.
    fn sort_in(&mut self) {
        for (number, segment) in self.segments.iter().enumerate() {
            let margin_m = self.radii_m[number] + BIN_M;
            let low = [segment.a[0].min(segment.b[0]) - margin_m, segment.a[1].min(segment.b[1]) - margin_m];
            let high = [segment.a[0].max(segment.b[0]) + margin_m, segment.a[1].max(segment.b[1]) + margin_m];
            let ([left, bottom], [right, top]) = (self.bin(low), self.bin(high));
            for row in bottom..=top {
                for column in left..=right {
                    let center = [column, row].map(|k| (k as f64 + 0.5) * BIN_M);
                    let center = [self.low[0] + center[0], self.low[1] + center[1]];
                    // Half a bin's diagonal on top of what is looked up.
                    if segment.distance_to_point(center) < margin_m + 0.75 * BIN_M {
                        self.bins[row * self.columns + column].push(number as u32);
                    }
                }
            }
        }
    }

    /// Distance to the nearest of them, at most `within_m`, which is at most a bin's edge.
    fn distance_m(&self, point: Point, within_m: f64) -> f64 {
        let [column, row] = self.bin(point);
        let near = self.bins[row * self.columns + column].iter().map(|&number| number as usize);
        let away = near.map(|number| self.segments[number].distance_to_point(point) - self.radii_m[number]);
        away.fold(within_m.min(BIN_M), f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::worlds;

    fn rovers(starts: &[Pose2]) -> Rovers {
        let wall = Segment { a: [3.0, -5.0], b: [3.0, 5.0] };
        let laser = LaserSettings { range_sigma_m: 0.0, ..LaserSettings::with_field_of_view(1.0, 3) };
        let world = World::new(vec![wall], vec![]);
        Rovers::new(world, starts, 0.2, RobotSettings::default(), laser, OdometryNoise::NONE, 1)
    }

    const AHEAD: Twist = Twist { speed_m_per_s: 9.0, turn_rate_rad_per_s: 0.0 };

    #[test]
    fn robots_stop_at_walls_and_at_each_other() {
        let mut rovers = rovers(&[Pose2::IDENTITY, Pose2::new(-1.0, 0.0, 0.0)]);
        (0..200).for_each(|_| rovers.step(&[AHEAD, AHEAD], 0.1));
        let [first, second] = [0, 1].map(|number| rovers.world_from_robot(number));
        assert!((2.7..=2.8).contains(&first.x), "{first:?}");
        assert!((0.4..0.5).contains(&(first.x - second.x)), "{second:?}");
        assert!(rovers.bumps() > 0 && rovers.driven_m(0) < 2.9);
    }

    #[test]
    fn a_robot_sees_the_others_and_what_its_wheels_say() {
        let mut rovers = rovers(&[Pose2::IDENTITY, Pose2::new(1.5, 0.0, 0.0)]);
        assert!((rovers.scan(0).unwrap().ranges_m[1] - 1.3).abs() < 1e-6);
        rovers.step(&[Twist::default(), AHEAD], 1.0);
        assert_eq!(rovers.scan(0).unwrap().odom_from_robot, Some(Pose2::IDENTITY));
        assert!(rovers.scan(1).unwrap().odom_from_robot.unwrap().x > 0.3);
        assert!(rovers.scan(2).is_none());
    }

    #[test]
    fn a_large_office_is_as_large_as_said_and_its_start_is_clear() {
        for seed in 0..20 {
            let site = worlds::large_office(seed);
            let walls = Walls::of(&site.world);
            let sides = [0, 1].map(|axis| {
                let ends = || site.world.segments().iter().flat_map(|s| [s.a[axis], s.b[axis]]);
                ends().fold(f64::NEG_INFINITY, f64::max) - ends().fold(f64::INFINITY, f64::min)
            });
            assert!((2780.0..2840.0).contains(&(sides[0] * sides[1])), "{sides:?}");
            for along_m in [-2.0, 0.0, 2.0] {
                let start = site.start(along_m);
                assert!(walls.distance_m([start.x, start.y], 0.5) >= 0.4, "seed {seed}, {along_m}");
            }
        }
    }
}
