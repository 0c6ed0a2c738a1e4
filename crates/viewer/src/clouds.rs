//! Maps of space as points: some of each keyframe's, thinned evenly, and fewer of each the more keyframes there are.

use mapwright_sensor::SpaceSweep;
use std::collections::BTreeMap;

/// Points of a keyframe at most.
const MOST_OF_ONE: usize = 1500;
/// Points of all together at most: 6 bytes each to a page, 8 in its graphics memory.
const MOST_OF_ALL: usize = 600_000;
/// The first voxels that points are thinned by, as a share of how far the cloud reaches; then larger ones.
const FIRST_SHARE: f64 = 0.005;
const GROWTH: f64 = 1.4;

/// Points of a keyframe in the robot's frame, in an order of which every beginning covers all of it.
#[derive(Debug)]
struct Thinned {
    step_m: f64,
    points: Vec<[i16; 3]>,
}

/// Points of keyframes, thinned.
#[derive(Debug, Default)]
pub(crate) struct Clouds {
    of: Vec<Option<Thinned>>,
    taken: usize,
    /// How often all were halved.
    halved: u32,
}

impl Clouds {
    pub(crate) fn has(&self, keyframe: usize) -> bool {
        self.of.get(keyframe).is_some_and(Option::is_some)
    }

    /// Takes a keyframe's cloud. Says whether those taken before now have fewer points.
    pub(crate) fn take(&mut self, keyframe: usize, sweep: &SpaceSweep) -> bool {
        if self.of.len() <= keyframe {
            self.of.resize_with(keyframe + 1, || None);
        }
        let mut points = thin(sweep, MOST_OF_ONE);
        points.truncate(self.most_of_one());
        self.taken += usize::from(self.of[keyframe].is_none());
        self.of[keyframe] = Some(Thinned { step_m: sweep.step_m, points });
        let before = self.halved;
        while self.taken * self.most_of_one() > MOST_OF_ALL && self.most_of_one() > 1 {
            self.halved += 1;
        }
        let most = self.most_of_one();
        if self.halved > before {
            self.of.iter_mut().flatten().for_each(|thinned| thinned.points.truncate(most));
        }
        self.halved > before
    }

    fn most_of_one(&self) -> usize {
        (MOST_OF_ONE >> self.halved).max(1)
    }

    /// Metres per step and points of a keyframe in steps.
    pub(crate) fn of(&self, keyframe: usize) -> Option<(f64, &[[i16; 3]])> {
        self.of.get(keyframe)?.as_ref().map(|thinned| (thinned.step_m, &thinned.points[..]))
    }

    pub(crate) fn len(&self) -> usize {
        self.of.len()
    }
}

/// Centroids of a cloud's points in voxels as small as gives no more than `most`, in mixed order.
fn thin(sweep: &SpaceSweep, most: usize) -> Vec<[i16; 3]> {
    let reach = sweep.points.iter().flatten().fold(1.0_f64, |reach, &value| reach.max(f64::from(value).abs()));
    let mut side = (FIRST_SHARE * reach).max(1.0);
    let mut points = centroids(&sweep.points, side);
    while points.len() > most {
        side *= GROWTH;
        points = centroids(&sweep.points, side);
    }
    let mut mixed: Vec<(u32, [i16; 3])> = points
        .into_iter()
        .enumerate()
        .map(|(place, point)| ((place as u32).wrapping_mul(0x9e37_79b1), point))
        .collect();
    mixed.sort_unstable();
    mixed.into_iter().map(|(_, point)| point).collect()
}

fn centroids(points: &[[i16; 3]], side: f64) -> Vec<[i16; 3]> {
    let mut voxels: BTreeMap<[i32; 3], ([i64; 3], i64)> = BTreeMap::new();
    for point in points {
        let voxel = voxels.entry(point.map(|value| (f64::from(value) / side).floor() as i32)).or_default();
        (0..3).for_each(|axis| voxel.0[axis] += i64::from(point[axis]));
        voxel.1 += 1;
    }
    voxels.into_values().map(|(sum, count)| sum.map(|value| (value / count) as i16)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_sensor::SpaceSensor;
    use std::sync::Arc;

    fn sweep(points: usize) -> SpaceSweep {
        let sensor = Arc::new(SpaceSensor {
            name: "lidar".to_owned(),
            range_min_m: 0.1,
            range_max_m: 50.0,
            robot_from_sensor: mapwright_geom::Pose3::identity(),
            range_sigma_m: 0.02,
            range_sigma_per_m: 0.0,
        });
        let at = |k: usize| [(k as f32 * 0.37).sin() * 20.0, (k as f32 * 0.11).cos() * 20.0, (k % 50) as f32 * 0.1];
        let points: Vec<[f32; 3]> = (0..points).map(at).collect();
        SpaceSweep::new(&sensor, &points, Vec::new())
    }

    #[test]
    fn a_cloud_is_thinned_to_a_bound_and_covers_what_it_covered() {
        let sweep = sweep(20_000);
        let thinned = thin(&sweep, MOST_OF_ONE);
        assert!(thinned.len() <= MOST_OF_ONE && thinned.len() > MOST_OF_ONE / 4, "{}", thinned.len());
        let beginning = &thinned[..thinned.len() / 8];
        for side in [-1, 1] {
            assert!(beginning.iter().any(|p| i32::from(p[0]) * side > 10_000), "one half of it lacks one side");
        }
        assert_eq!(thin(&SpaceSweep { points: Vec::new(), ..sweep }, 10), [[0; 3]; 0]);
    }

    #[test]
    fn many_keyframes_have_few_points_each() {
        let (mut clouds, sweep) = (Clouds::default(), sweep(3000));
        let halved = (0..1000).filter(|&keyframe| clouds.take(keyframe, &sweep)).count();
        assert_eq!(halved, 2, "1500 points of 400 keyframes, 750 of 800");
        let all: usize = (0..1000).filter_map(|keyframe| clouds.of(keyframe)).map(|(_, points)| points.len()).sum();
        assert!(all <= MOST_OF_ALL, "{all}");
    }
}
