//! How simulated robots follow their ways and let each other pass.

use mapwright::Pose2;
use mapwright_explore::{OccupancyMap, Terrain, aside_m, way_m};
use mapwright_geom::wrap_angle;
use mapwright_sim::Twist;

/// The point of the way that is steered for lies so far ahead, metres.
const LOOKAHEAD_M: f64 = 0.25;
/// Beyond this heading error a robot turns on the spot, radians.
const TURN_ON_SPOT_RAD: f64 = 0.7;
/// Turn rate per radian of heading error, 1/s.
const STEER_GAIN_PER_S: f64 = 2.5;
/// Robots nearer than this to each other take turns, metres.
const MEETING_M: f64 = 2.2;
/// So much of a way ahead of a robot is kept free for it, metres.
const AHEAD_M: f64 = 3.0;
/// Another robot goes first after so long, seconds: the time to get out of a room.
const TURN_S: f64 = 15.0;
/// Distance that robots keep from each other beyond their radii, metres: half a cell, and what a pose may be off.
const KEEP_M: f64 = 0.12;

/// A robot as its driver knows it.
#[derive(Debug, Clone, Default)]
pub(super) struct Driver {
    pub(super) map_from_robot: Pose2,
    pub(super) goal_m: Option<[f64; 2]>,
    /// The way ahead, from the robot on.
    pub(super) way_m: Vec<[f64; 2]>,
    pub(super) alive: bool,
    /// Where the robot was held by something that its map does not show, and until when it keeps off, seconds.
    pub(super) bumps_m: Vec<([f64; 2], f64)>,
    /// Steps that it did not move though it was to, and steps that it still backs off.
    pub(super) held: u32,
    pub(super) back: u32,
}

impl Driver {
    fn at_m(&self) -> [f64; 2] {
        [self.map_from_robot.x, self.map_from_robot.y]
    }

    /// The way ahead as points a few centimetres apart, up to a length.
    fn ahead_m(&self, length_m: f64) -> Vec<[f64; 2]> {
        const STEP_M: f64 = 0.1;
        let (mut points, mut from, mut left_m) = (vec![self.at_m()], self.at_m(), length_m);
        for &to in &self.way_m {
            let leg_m = apart_m(from, to);
            let steps = (leg_m.min(left_m) / STEP_M).ceil() as usize;
            points.extend((1..=steps).map(|k| {
                let share = (k as f64 * STEP_M / leg_m).min(1.0);
                [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])]
            }));
            left_m -= leg_m;
            from = to;
            if left_m <= 0.0 {
                break;
            }
        }
        points
    }
}

/// After so many steps without moving a robot was held by something, and backs off for so many.
const HELD_STEPS: u32 = 10;
const BACK_STEPS: u32 = 10;
const BACK_M_PER_S: f64 = -0.2;
/// It keeps off that place for so long, seconds: what held it may have been another robot, and a narrow room must not stay shut.
const KEEP_OFF_S: f64 = 20.0;

impl Driver {
    /// Notes how far the robot got in a step that it was told to drive in.
    pub(super) fn moved(&mut self, told: Twist, moved_m: f64, radius_m: f64, now_s: f64) {
        self.back = self.back.saturating_sub(1);
        let is_held = told.speed_m_per_s > 0.05 && moved_m < 1e-3;
        self.held = if is_held { self.held + 1 } else { 0 };
        if self.held > HELD_STEPS {
            (self.held, self.back) = (0, BACK_STEPS);
            self.bumps_m.push((self.map_from_robot.transform([radius_m, 0.0]), now_s + KEEP_OFF_S));
        }
    }
}

/// What each robot does now: along its way, but not into another robot.
pub(super) fn twist(drivers: &mut [Driver], number: usize, radius_m: f64, speed_m_per_s: f64) -> Twist {
    let here = drivers[number].map_from_robot;
    let at_m = [here.x, here.y];
    if drivers[number].alive && drivers[number].back > 0 {
        return Twist { speed_m_per_s: BACK_M_PER_S, turn_rate_rad_per_s: 0.0 };
    }
    while drivers[number].way_m.len() > 1 && apart_m(drivers[number].way_m[0], at_m) < LOOKAHEAD_M {
        drivers[number].way_m.remove(0);
    }
    let Some((&target, end)) = drivers[number].way_m.first().zip(drivers[number].way_m.last()) else {
        return Twist::default();
    };
    let end_m = apart_m(at_m, *end);
    if !drivers[number].alive || end_m < 0.06 {
        return Twist::default();
    }
    let error_rad = wrap_angle((target[1] - at_m[1]).atan2(target[0] - at_m[0]) - here.theta);
    let straight = (1.0 - error_rad.abs() / TURN_ON_SPOT_RAD).max(0.0);
    let speed = speed_m_per_s * straight * (end_m / 0.3).clamp(0.2, 1.0);
    let in_the_way = is_in_the_way(drivers, number, radius_m);
    Twist { speed_m_per_s: if in_the_way { 0.0 } else { speed }, turn_rate_rad_per_s: STEER_GAIN_PER_S * error_rad }
}

/// Whether another robot stands on the next half metre of the way.
fn is_in_the_way(drivers: &[Driver], number: usize, radius_m: f64) -> bool {
    let ahead = drivers[number].ahead_m(0.5);
    let here_m = drivers[number].at_m();
    drivers.iter().enumerate().filter(|&(other, _)| other != number).any(|(_, other)| {
        let other_m = other.at_m();
        let nearest_m = ahead.iter().map(|&point| apart_m(point, other_m)).fold(f64::INFINITY, f64::min);
        // Who is too near already may drive away.
        nearest_m < 2.0 * radius_m + 0.5 * KEEP_M && nearest_m < apart_m(here_m, other_m) - 0.01
    })
}

/// Finds every robot's way anew: to its goal around who stands near, or out of the way of those that go first.
///
/// Who has a goal goes before who has none, and among those each goes first in turn: what two cannot settle in one order they can in the
/// other. Who cannot get out of the way goes first after all.
pub(super) fn find_ways(map: &OccupancyMap, terrain: &Terrain, drivers: &mut [Driver], radius_m: f64, now_s: f64) {
    let keep_m = 2.0 * radius_m + KEEP_M;
    let alive = (0..drivers.len()).filter(|&number| drivers[number].alive);
    let mut order: Vec<usize> = alive.collect();
    let (robots, turn) = (drivers.len().max(1), (now_s / TURN_S) as usize);
    order.sort_by_key(|&number| (drivers[number].goal_m.is_none(), (number + turn) % robots));
    let mut before: Vec<usize> = Vec::new();
    for &number in &order {
        let at_m = drivers[number].at_m();
        drivers[number].bumps_m.retain(|&(_, until_s)| until_s > now_s);
        let bumps: Vec<([f64; 2], f64)> =
            drivers[number].bumps_m.iter().map(|&(bump, _)| (bump, terrain.radius_m())).collect();
        let bumped = if bumps.is_empty() { None } else { Some(terrain.clone().without(map, &bumps)) };
        let terrain = bumped.as_ref().unwrap_or(terrain);
        let near: Vec<([f64; 2], f64)> = (0..drivers.len())
            .filter(|&other| other != number && apart_m(drivers[other].at_m(), at_m) < MEETING_M)
            .map(|other| (drivers[other].at_m(), keep_m))
            .collect();
        let around = if near.is_empty() { terrain.clone() } else { terrain.clone().without(map, &near) };
        drivers[number].way_m = drivers[number].goal_m.map_or(Vec::new(), |goal_m| {
            let way = way_m(map, &around, at_m, goal_m);
            // Where there is no way around, others are asked to let it pass.
            if way.is_empty() && !near.is_empty() {
                return way_m(map, &terrain.clone().avoiding(map, &near), at_m, goal_m);
            }
            way
        });
        let first: Vec<usize> = before
            .iter()
            .copied()
            .filter(|&other| apart_m(drivers[other].at_m(), at_m) < MEETING_M && !drivers[other].way_m.is_empty())
            .collect();
        let kept_free: Vec<[f64; 2]> = first.iter().flat_map(|&other| drivers[other].ahead_m(AHEAD_M)).collect();
        let is_kept = |point: &[f64; 2], margin_m: f64| kept_free.iter().any(|&free| apart_m(free, *point) < margin_m);
        if is_kept(&at_m, keep_m) {
            let aside = aside_m(map, &around, at_m, &kept_free, keep_m);
            if aside.is_empty() {
                // It cannot: those that it is in the way of wait instead, or get out of its way.
                for &other in &first {
                    let own = drivers[number].ahead_m(AHEAD_M);
                    let other_m = drivers[other].at_m();
                    let without = terrain.clone().without(map, &[(at_m, keep_m)]);
                    drivers[other].way_m = aside_m(map, &without, other_m, &own, keep_m);
                }
            } else {
                drivers[number].way_m = aside;
            }
        } else if drivers[number].ahead_m(1.0).iter().any(|point| is_kept(point, keep_m)) {
            drivers[number].way_m = Vec::new();
        }
        before.push(number);
    }
}

pub(super) fn apart_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
