//! What moves is not drawn: who walks beside the sensor would stand in every room, and cars in every street.
//!
//! A cloud is laid into what was seen a second before: what stands where the sensor saw through then was not there ([`RangeImage`]). Asked are
//! places, not single points.

use mapwright_geom::{Pose3, Stamp, Stored, is_in_place};
use mapwright_voxel::RangeImage;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// Clouds are compared with the oldest one that is no older than this, seconds: in less time few have left where they stood,
const MOST_AGE_S: f64 = 1.5;
/// and at least so much older,
const LEAST_AGE_S: f64 = 0.45;
/// and remembered so far apart, seconds.
const EVERY_S: f64 = 0.4;
/// A place is a cube with a side of so many voxels; it moves if so many of its points say so, and such a share of them.
const PLACE_VOXELS: f64 = 3.0;
const LEAST_POINTS: u32 = 3;
const MOVING_SHARE: f64 = 0.3;
/// Where a larger share of all points would be gone, it is the robot that is elsewhere than thought.
const MOST_SHARE: f64 = 0.4;

/// What one cloud saw.
#[derive(Debug, Clone)]
struct View {
    stamp: Stamp,
    /// The sensor in the front end's frame.
    local_from_sensor: Pose3,
    image: RangeImage,
}

/// Clouds of the last second.
#[derive(Debug, Clone, Default)]
pub(super) struct DynamicObjects {
    seen: VecDeque<View>,
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
        let is_old = |oldest: &View| stamp.secs_since(oldest.stamp) > MOST_AGE_S;
        let mut image = RangeImage::default();
        while self.seen.front().is_some_and(is_old) {
            image = self.seen.pop_front().map_or(image, |oldest| oldest.image);
        }
        image.see(
            points_m.iter().map(|point| (Vector3::from(point.map(f64::from)) - sensor_m).map(|m| m as f32).into()),
        );
        let local_from_sensor = local_from_robot * Pose3 { translation: sensor_m, ..Pose3::identity() };
        self.seen.push_back(View { stamp, local_from_sensor, image });
    }

    /// Finds what moves among the points of a cloud; how many points that are. `voxel_m` is the side of the smallest voxels.
    pub(super) fn find(&mut self, stamp: Stamp, local_from_robot: Pose3, points_m: &[[f32; 3]], voxel_m: f64) -> usize {
        self.moving.clear();
        let fits = |seen: &&View| (LEAST_AGE_S..=MOST_AGE_S).contains(&stamp.secs_since(seen.stamp));
        let Some(before) = self.seen.iter().find(fits) else { return 0 };
        let before_from_now = before.local_from_sensor.between(local_from_robot);
        self.places.clear();
        self.places.extend(points_m.iter().map(|point| {
            let then = before_from_now.transform(Vector3::from(point.map(f64::from)));
            let was_free = before.image.has_seen_through(then.map(|m| m as f32).into(), voxel_m) == Some(true);
            (place_of(point, voxel_m), was_free)
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

    /// Of the points of a cloud that lie in directions in which something was seen of late those that were seen through.
    pub(super) fn share_seen_through(&self, local_from_robot: Pose3, points_m: &[[f32; 3]], voxel_m: f64) -> f64 {
        let views: Vec<(Pose3, &RangeImage)> =
            self.seen.iter().map(|view| (view.local_from_sensor.between(local_from_robot), &view.image)).collect();
        let (mut seen, mut through) = (0_usize, 0_usize);
        for point in points_m {
            let point = Vector3::from(point.map(f64::from));
            let said = views.iter().filter_map(|(before_from_now, image)| {
                image.has_seen_through(before_from_now.transform(point).map(|m| m as f32).into(), voxel_m)
            });
            let said = said.reduce(|a, b| a || b);
            seen += usize::from(said.is_some());
            through += usize::from(said == Some(true));
        }
        through as f64 / seen.max(1) as f64
    }

    /// Whether a point of the last cloud lies on what moves.
    pub(super) fn moves(&self, point: &[f32; 3], voxel_m: f64) -> bool {
        self.moving.binary_search(&place_of(point, voxel_m)).is_ok()
    }

    /// Goes on as it was.
    pub(super) fn restore(from: &mut &[u8]) -> Option<Self> {
        let seen = (0..u8::take(from)?).map(|_| View::restore(from)).collect::<Option<_>>()?;
        Some(Self { seen, ..Self::default() })
    }

    pub(super) fn put(&self, out: &mut Vec<u8>) {
        (self.seen.len() as u8).put(out);
        self.seen.iter().for_each(|view| view.put(out));
    }

    /// It is no longer known where the robot is.
    pub(super) fn forget(&mut self) {
        self.seen.clear();
    }
}

impl View {
    fn restore(from: &mut &[u8]) -> Option<Self> {
        let (stamp, local_from_sensor) = Stored::take(from)?;
        let image = RangeImage::restore(from)?;
        is_in_place(local_from_sensor).then_some(Self { stamp, local_from_sensor, image })
    }

    fn put(&self, out: &mut Vec<u8>) {
        (self.stamp, self.local_from_sensor).put(out);
        self.image.put(out);
    }
}

fn place_of(point: &[f32; 3], voxel_m: f64) -> [i32; 3] {
    let side_m = PLACE_VOXELS * voxel_m;
    point.map(|metres| (f64::from(metres) / side_m).floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_that_stands_where_the_sensor_saw_through_was_seen_through() {
        let wall = |x: f32, half: i16| -> Vec<[f32; 3]> {
            let across = move |y: i16| (-20..=20_i16).map(move |z| [x, 0.05 * f32::from(y), 0.05 * f32::from(z)]);
            (-half..=half).flat_map(across).collect()
        };
        let mut objects = DynamicObjects::default();
        let at = |x: f64| Pose3 { translation: Vector3::new(x, 0.0, 0.0), ..Pose3::identity() };
        let share = |objects: &DynamicObjects, x: f64, seen: &[[f32; 3]]| objects.share_seen_through(at(x), seen, 0.1);
        assert_eq!(share(&objects, 0.0, &wall(5.0, 60)), 0.0, "nothing was seen yet");
        objects.remember(Stamp(0), at(0.0), &wall(5.0, 60), Vector3::zeros());
        assert_eq!(share(&objects, 0.0, &wall(5.0, 60)), 0.0, "the same");
        assert_eq!(share(&objects, 1.0, &wall(4.0, 60)), 0.0, "the same, seen from nearer");
        let nearer = share(&objects, 0.0, &wall(3.0, 30));
        assert!(nearer > 0.9, "{nearer}");
        let both = [wall(5.0, 60), wall(3.0, 10)].concat();
        let part = share(&objects, 0.0, &both);
        assert!(part > 0.05 && part < 0.3, "{part}");
        let elsewhere: Vec<[f32; 3]> = wall(3.0, 30).iter().map(|[x, y, z]| [-x, *y, *z]).collect();
        assert_eq!(share(&objects, 0.0, &elsewhere), 0.0, "nobody looked there");
    }
}
