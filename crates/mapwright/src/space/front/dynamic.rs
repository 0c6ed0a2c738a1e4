//! What moves is not drawn: who walks beside the sensor would stand in every room, and cars in every street.
//!
//! A cloud is laid into what was seen a second before, as ranges by direction: what stands where nothing had stood in the way then was not there.
//! Asked are places, not single points: of a place that moves most points say so.

use mapwright_geom::{Pose3, Stamp, Stored, is_in_place, stored};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::f64::consts::PI;

/// Clouds are compared with the oldest one that is no older than this, seconds: in less time few have left where they stood,
const MOST_AGE_S: f64 = 1.5;
/// and at least so much older,
const LEAST_AGE_S: f64 = 0.45;
/// and remembered so far apart, seconds.
const EVERY_S: f64 = 0.4;
/// Ranges are kept in steps of so much, metres.
const STEP_M: f64 = 0.01;
/// Directions are told apart by this much, radians: as sparse as the rings of lidars with 16 of them.
const DIRECTION_RAD: f64 = 2.0 * PI / COLUMNS as f64;
const COLUMNS: usize = 180;
const STEPS_AT_MOST: f64 = u16::MAX as f64;
const ROWS: usize = COLUMNS / 2;
/// A direction and those beside it are nine. Of so many something must have come back, all of it from farther away than a point
const SEEN_AT_LEAST: u32 = 5;
/// by such a share of its range, and so many voxels: a wall that is passed at a slant.
const FARTHER_SHARE: f64 = 0.1;
const FARTHER_VOXELS: f64 = 0.5;
/// A place is a cube with a side of so many voxels; it moves if so many of its points say so, and such a share of them.
const PLACE_VOXELS: f64 = 3.0;
const LEAST_POINTS: u32 = 3;
const MOVING_SHARE: f64 = 0.3;
/// Where a larger share of all points would be gone, it is the robot that is elsewhere than thought.
const MOST_SHARE: f64 = 0.4;

/// Ranges by direction, of one cloud.
#[derive(Debug, Clone)]
struct Ranges {
    stamp: Stamp,
    /// The sensor in the front end's frame.
    local_from_sensor: Pose3,
    /// Of the nearest return of each direction, in steps; zero where none came back.
    nearest: Vec<u16>,
}

stored!(Ranges { stamp, local_from_sensor, nearest });

/// Clouds of the last second.
#[derive(Debug, Clone, Default)]
pub(super) struct DynamicObjects {
    seen: VecDeque<Ranges>,
    places: Vec<([i32; 3], bool)>,
    moving: Vec<[i32; 3]>,
}

impl DynamicObjects {
    /// Remembers a cloud whose points were seen from `local_from_robot`, by a sensor at `sensor_m` in the robot's frame, metres.
    pub(super) fn remember(
        &mut self,
        stamp: Stamp,
        local_from_robot: Pose3,
        points_m: &[[f32; 3]],
        sensor_m: Vector3<f64>,
    ) {
        if self.seen.back().is_some_and(|last| stamp < last.stamp) {
            self.seen.clear();
        }
        if self.seen.back().is_some_and(|last| stamp.secs_since(last.stamp) < EVERY_S) {
            return;
        }
        let is_old = |oldest: &Ranges| stamp.secs_since(oldest.stamp) > MOST_AGE_S;
        let mut nearest = vec![];
        while self.seen.front().is_some_and(is_old) {
            nearest = self.seen.pop_front().map_or(nearest, |oldest| oldest.nearest);
        }
        nearest.clear();
        nearest.resize(COLUMNS * ROWS, 0);
        for point in points_m {
            let way = Vector3::from(point.map(f64::from)) - sensor_m;
            let (known, steps) = (&mut nearest[direction(way)], (way.norm() / STEP_M).clamp(1.0, STEPS_AT_MOST) as u16);
            if *known == 0 || steps < *known {
                *known = steps;
            }
        }
        let local_from_sensor = local_from_robot * Pose3 { translation: sensor_m, ..Pose3::identity() };
        self.seen.push_back(Ranges { stamp, local_from_sensor, nearest });
    }

    /// Finds what moves among the points of a cloud; how many points that are. `voxel_m` is the side of the smallest voxels.
    pub(super) fn find(&mut self, stamp: Stamp, local_from_robot: Pose3, points_m: &[[f32; 3]], voxel_m: f64) -> usize {
        self.moving.clear();
        let fits = |seen: &&Ranges| (LEAST_AGE_S..=MOST_AGE_S).contains(&stamp.secs_since(seen.stamp));
        let Some(before) = self.seen.iter().find(fits) else { return 0 };
        let before_from_now = before.local_from_sensor.between(local_from_robot);
        let farther_m = FARTHER_VOXELS * voxel_m;
        self.places.clear();
        self.places.extend(points_m.iter().map(|point| {
            let then = before_from_now.transform(Vector3::from(point.map(f64::from)));
            (place_of(point, voxel_m), before.was_free(then, farther_m))
        }));
        self.places.sort_unstable();
        for same in self.places.chunk_by(|a, b| a.0 == b.0) {
            let moving = same.iter().filter(|(_, was_free)| *was_free).count();
            if moving as u32 >= LEAST_POINTS && moving as f64 >= MOVING_SHARE * same.len() as f64 {
                self.moving.push(same[0].0);
            }
        }
        let count = points_m.iter().filter(|point| self.moves(point, voxel_m)).count();
        if count as f64 > MOST_SHARE * points_m.len() as f64 {
            self.moving.clear();
            return 0;
        }
        count
    }

    /// Whether a point of the last cloud lies on what moves.
    pub(super) fn moves(&self, point: &[f32; 3], voxel_m: f64) -> bool {
        self.moving.binary_search(&place_of(point, voxel_m)).is_ok()
    }

    /// Goes on as it was.
    pub(super) fn restore(from: &mut &[u8]) -> Option<Self> {
        let seen = VecDeque::<Ranges>::take(from)?;
        let is_sound =
            |ranges: &Ranges| ranges.nearest.len() == COLUMNS * ROWS && is_in_place(ranges.local_from_sensor);
        seen.iter().all(is_sound).then_some(Self { seen, ..Self::default() })
    }

    pub(super) fn put(&self, out: &mut Vec<u8>) {
        self.seen.put(out);
    }

    /// It is no longer known where the robot is.
    pub(super) fn forget(&mut self) {
        self.seen.clear();
    }
}

impl Ranges {
    /// Whether nothing stood at a point, nor in the way there.
    fn was_free(&self, point: Vector3<f64>, farther_m: f64) -> bool {
        let least = (((1.0 + FARTHER_SHARE) * point.norm() + farther_m) / STEP_M).min(STEPS_AT_MOST) as u16;
        let middle = direction(point);
        let (row, column) = (middle / COLUMNS, middle % COLUMNS);
        let mut seen = 0;
        for row in row.saturating_sub(1)..=(row + 1).min(ROWS - 1) {
            for aside in [COLUMNS - 1, 0, 1] {
                let nearest = self.nearest[row * COLUMNS + (column + aside) % COLUMNS];
                if nearest > 0 && nearest < least {
                    return false;
                }
                seen += u32::from(nearest > 0);
            }
        }
        seen >= SEEN_AT_LEAST
    }
}

/// The number of a direction.
fn direction(way: Vector3<f64>) -> usize {
    let (azimuth, elevation) = (way.y.atan2(way.x) + PI, way.z.atan2(way.x.hypot(way.y)) + 0.5 * PI);
    let within = |angle: f64, most: usize| ((angle / DIRECTION_RAD) as usize).min(most - 1);
    within(elevation, ROWS) * COLUMNS + within(azimuth, COLUMNS)
}

fn place_of(point: &[f32; 3], voxel_m: f64) -> [i32; 3] {
    let side_m = PLACE_VOXELS * voxel_m;
    point.map(|metres| (f64::from(metres) / side_m).floor() as i32)
}
