#![allow(clippy::unwrap_used)]
use super::*;
use proptest::prelude::*;

const SIDE_M: f64 = 0.5;

fn empty() -> Occupancy {
    Occupancy::new(OccupancySettings { resolution_m: SIDE_M, max_range_m: 20.0 })
}

fn drawn(clouds: &[(Vec<[f32; 3]>, Pose3)]) -> Occupancy {
    let mut occupancy = empty();
    clouds.iter().for_each(|cloud| draw(&mut occupancy, cloud, Change::Add));
    occupancy
}

fn draw(occupancy: &mut Occupancy, (points_m, pose): &(Vec<[f32; 3]>, Pose3), change: Change) {
    occupancy.draw(points_m.iter().copied(), [0.0; 3], *pose, change);
}

fn all(occupancy: &Occupancy) -> Vec<VoxelCounts> {
    occupancy.voxels().collect()
}

#[test]
fn a_ray_passes_what_is_before_its_point_and_no_more() {
    let occupancy =
        drawn(&[(vec![[2.2, 0.0, 0.0]], Pose3::from_quaternion([0.1, 0.1, 0.1], [0.0, 0.0, 0.0, 1.0]).unwrap())]);
    let known: Vec<_> = all(&occupancy).iter().map(|v| (v.index, v.hits, v.passes)).collect();
    let expected: Vec<_> = (0..5).map(|x| ([x, 0, 0], u32::from(x == 4), u32::from(x < 4))).collect();
    assert_eq!(known, expected);
    assert_eq!(occupancy.counts_at([2.3, 0.4, 0.01]).map(|v| v.hits), Some(1));
    assert_eq!(occupancy.counts_at([2.6, 0.4, 0.01]), None);
}

#[test]
fn a_cloud_counts_once_and_what_it_hits_it_does_not_pass() {
    // Ten points in one voxel, and one behind it that is seen through it.
    let points = (0..10).map(|k| [2.1 + 0.01 * k as f32, 0.1, 0.1]).chain([[4.1, 0.2, 0.2]]).collect();
    let occupancy = drawn(&[(points, Pose3::from_quaternion([0.1; 3], [0.0, 0.0, 0.0, 1.0]).unwrap())]);
    let there = occupancy.counts_at([2.2, 0.2, 0.2]).unwrap();
    assert_eq!((there.hits, there.passes), (1, 0));
    let before = occupancy.counts_at([1.2, 0.2, 0.2]).unwrap();
    assert_eq!((before.hits, before.passes), (0, 1));
}

#[test]
fn beyond_the_greatest_range_the_way_counts_but_not_the_point() {
    let occupancy =
        drawn(&[(vec![[100.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0], [f32::INFINITY, 1.0, 0.0]], Pose3::identity())]);
    assert_eq!(all(&occupancy).len(), 40);
    assert!(all(&occupancy).iter().all(|v| v.hits == 0 && v.passes == 1));
}

#[test]
fn counts_go_on_beyond_a_byte_and_back() {
    let cloud = (vec![[2.2, 0.0, 0.0]], Pose3::identity());
    let mut occupancy = empty();
    (0..700).for_each(|_| draw(&mut occupancy, &cloud, Change::Add));
    let [near, end] = [[0.2, 0.1, 0.1], [2.2, 0.1, 0.1]];
    assert_eq!(occupancy.counts_at(near).map(|v| v.passes), Some(700));
    assert_eq!(occupancy.counts_at(end).map(|v| v.hits), Some(700));
    (0..699).for_each(|_| draw(&mut occupancy, &cloud, Change::Remove));
    assert_eq!(all(&occupancy), all(&drawn(std::slice::from_ref(&cloud))));
    draw(&mut occupancy, &cloud, Change::Remove);
    assert!(all(&occupancy).is_empty());
}

#[test]
fn odds_are_read_as_octomap_does() {
    assert!((f64::from(log_odds(1, 0)) - (0.7_f64 / 0.3).ln()).abs() < 1e-6);
    assert!((f64::from(log_odds(0, 1)) - (0.4_f64 / 0.6).ln()).abs() < 1e-6);
    assert!(log_odds(1, 2) > 0.0 && log_odds(1, 3) < 0.0);
    assert!((f64::from(log_odds(u32::MAX, 0)) - (0.971_f64 / 0.029).ln()).abs() < 1e-6);
    assert!((f64::from(log_odds(0, u32::MAX)) - (0.1192_f64 / 0.8808).ln()).abs() < 1e-6);
}

fn any_cloud() -> impl Strategy<Value = (Vec<[f32; 3]>, Pose3)> {
    let point = [-25.0_f32..25.0, -25.0..25.0, -5.0..5.0];
    let place = [-9.0..9.0, -9.0..9.0, -2.0..2.0];
    let turn = [-1.0..1.0, -1.0..1.0, -1.0..1.0, 0.1..1.0];
    (prop::collection::vec(point, 0..40), place, turn)
        .prop_map(|(points, place, turn)| (points, Pose3::from_quaternion(place, turn).unwrap()))
}

/// The voxels of one cloud by a walk in small steps along each ray: those that it must have passed, being in them for longer than a
/// step.
fn walked(points_m: &[[f32; 3]], pose: Pose3) -> Vec<([i32; 3], [i32; 3])> {
    let origin = pose.translation / SIDE_M;
    let mut out = Vec::new();
    for point in points_m {
        let end = pose.transform(nalgebra::Vector3::from(point.map(f64::from))) / SIDE_M;
        if (end - origin).norm() > 20.0 / SIDE_M {
            continue;
        }
        let index = end.map(|v| v.floor() as i32);
        let middle = end.map(|v| v.floor() + 0.5);
        for k in 0..2000 {
            let at = origin + (middle - origin) * (f64::from(k) + 0.5) / 2000.0;
            out.push((at.map(|v| v.floor() as i32).into(), index.into()));
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn rays_pass_every_voxel_on_their_way((points, pose) in any_cloud()) {
        let occupancy = drawn(&[(points.clone(), pose)]);
        for (index, end) in walked(&points, pose) {
            let middle_m = |index: [i32; 3]| index.map(|v| (f64::from(v) + 0.5) * SIDE_M);
            prop_assert!(occupancy.counts_at(middle_m(index)).is_some(), "{index:?} on the way to {end:?}");
            prop_assert_eq!(occupancy.counts_at(middle_m(end)).map(|v| (v.hits, v.passes)), Some((1, 0)));
        }
    }

    #[test]
    fn order_does_not_matter_and_what_is_taken_out_was_never_there(
        clouds in prop::collection::vec(any_cloud(), 1..6),
        others in prop::collection::vec(any_cloud(), 0..3),
    ) {
        let expected = all(&drawn(&clouds));
        let mut occupancy = empty();
        // Even what is taken out before it comes in.
        others.iter().for_each(|cloud| draw(&mut occupancy, cloud, Change::Remove));
        clouds.iter().rev().for_each(|cloud| draw(&mut occupancy, cloud, Change::Add));
        others.iter().rev().for_each(|cloud| draw(&mut occupancy, cloud, Change::Add));
        prop_assert_eq!(all(&occupancy), expected);
        clouds.iter().for_each(|cloud| draw(&mut occupancy, cloud, Change::Remove));
        prop_assert!(all(&occupancy).is_empty());
    }

    #[test]
    fn the_order_of_points_does_not_matter((mut points, pose) in any_cloud()) {
        let expected = all(&drawn(&[(points.clone(), pose)]));
        points.reverse();
        prop_assert_eq!(all(&drawn(&[(points, pose)])), expected);
    }
}
