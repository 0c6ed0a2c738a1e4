use super::*;
use mapwright_sensor::SpaceSensor;
use nalgebra::Vector3;
use std::sync::Arc;

type Solid = [[f64; 3]; 2];

/// A room of 9 by 7 m, 3 m high, with a pillar, an alcove's corner and a table: no turn of it looks the same.
const ROOM: Solid = [[-4.0, -3.0, -1.0], [5.0, 4.0, 2.0]];
const FURNITURE: [Solid; 3] = [
    [[2.5, 2.0, -1.0], [3.0, 2.5, 2.0]],
    [[-4.0, 1.5, -1.0], [-2.0, 4.0, 2.0]],
    [[-1.0, -3.0, -1.0], [1.5, -2.2, 0.0]],
];
/// Who stands in it, at such a place along the room.
fn visitor(x: f64) -> Solid {
    [[x, 0.8, -1.0], [x + 0.6, 1.4, 0.8]]
}

/// How far a ray goes into a box, and out of it again.
fn hits(from: Vector3<f64>, along: Vector3<f64>, [low, high]: Solid) -> Option<[f64; 2]> {
    let mut way = [f64::NEG_INFINITY, f64::INFINITY];
    for axis in 0..3 {
        let [a, b] = [low, high].map(|side| (side[axis] - from[axis]) / along[axis]);
        way = [way[0].max(a.min(b)), way[1].min(a.max(b))];
    }
    (way[0] < way[1] && way[1] > 0.0).then_some(way)
}

/// What a lidar sees of the room and of what stands in it.
fn view(at: Pose3, stands: &[Solid]) -> View<SpaceSweep> {
    let mut points_m = Vec::new();
    for (turn, rise) in (0..360).flat_map(|turn| (-20..=20).map(move |rise| (turn, rise))) {
        let [turn, rise] = [f64::from(turn), 2.0 * f64::from(rise)].map(f64::to_radians);
        let ray = Vector3::new(turn.cos() * rise.cos(), turn.sin() * rise.cos(), rise.sin());
        let along = at.rotation * ray;
        let wall_m = hits(at.translation, along, ROOM).map_or(0.0, |way| way[1]);
        let solids = FURNITURE.iter().chain(stands);
        let nearest_m = solids.filter_map(|solid| Some(hits(at.translation, along, *solid)?[0])).fold(wall_m, f64::min);
        points_m.push((nearest_m * ray).map(|m| m as f32).into());
    }
    let sweep = SpaceSweep::new(&Arc::new(SpaceSensor::lidar("lidar")), &points_m, Vec::new());
    View { sweep: Arc::new(sweep), submap_from_keyframe: at }
}

fn at(x: f64, y: f64, turn: f64) -> Pose3 {
    Pose3::exp(Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, turn)).moved([x, y, 0.0])
}

/// What is found of a place in a submap of others, looked for from where it is.
fn found(query: View<SpaceSweep>, target: &[View<SpaceSweep>]) -> Finding<Pose3> {
    let map = SurfelMapSettings { resolution_m: 0.2, levels: 4, noise_m: 0.01 };
    let mut submaps = SpaceSubmaps::new(map, 4.0, VerifySettings::in_space());
    let target_from_query = query.submap_from_keyframe;
    let query = submaps.draw(&[View { submap_from_keyframe: Pose3::identity(), ..query }]);
    let target = submaps.draw(target);
    let window = Window { target_from_query, half_width_m: 1.0, half_height_m: 0.3, half_width_rad: 0.5 };
    let found = submaps.look_for(&query, &target, &window);
    let off_m = found.target_from_query.map(|pose| pose.distance(target_from_query));
    assert!(off_m.is_some_and(|off_m| off_m < 0.05), "{off_m:?} {found:?}");
    found
}

#[test]
fn what_was_seen_through_says_that_it_is_another_room() {
    let target = [at(0.0, 0.0, 0.0), at(1.0, 0.3, 0.5), at(2.0, 0.5, 1.0)].map(|pose| view(pose, &[]));
    let same = found(view(at(0.6, -0.4, 0.2), &[]), &target);
    assert_eq!(same.objection, None, "{same:?}");
    let other = found(view(at(0.6, -0.4, 0.2), &[visitor(-1.2)]), &target);
    assert_eq!(other.objection, Some(Objection::Contradiction));
    // By nothing else: little is seen through, and all else is alike.
    assert_eq!(VerifySettings::in_space().objection_to_fit(&other.evidence), None, "{other:?}");
}

#[test]
fn where_somebody_walks_about_more_may_be_seen_through() {
    let way = [(at(0.0, 0.0, 0.0), -1.6), (at(0.5, 0.0, 0.2), -0.2), (at(0.8, 0.1, 0.4), 1.0)];
    let target = way.map(|(pose, x)| view(pose, &[visitor(x)]));
    let later = found(view(at(0.6, -0.4, 0.2), &[visitor(-1.2)]), &target);
    assert_eq!(later.objection, None, "{later:?}");
    assert!(later.evidence.contradiction.is_some_and(|share| share > SEEN_THROUGH), "{later:?}");
}
