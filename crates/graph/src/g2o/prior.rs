//! Gravity as g2o's prior of a pose, and back.

use crate::gravity::{Gravity, WORLD_DOWN};
use mapwright_geom::Pose3;
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3};

/// Information that should be zero, or another's, may be so far from it, as a share of the most: files of few digits.
const ROUNDING: f64 = 1e-4;

/// A pose that is level as gravity says, as near as can be to where the vertex is, and the information of its right perturbation over
/// angles: none of where it is and of where it heads.
pub(super) fn of_gravity(gravity: &Gravity, world_from_vertex: Pose3) -> (Pose3, Matrix6<f64>) {
    let leaning = world_from_vertex.rotation * gravity.down_in_vertex;
    let level = UnitQuaternion::rotation_between(&leaning, &WORLD_DOWN)
        .unwrap_or_else(|| UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI));
    let mut information = Matrix6::zeros();
    let weight = 1.0 / (gravity.sigma_rad * gravity.sigma_rad);
    information.fixed_view_mut::<3, 3>(3, 3).copy_from(&(across(&gravity.down_in_vertex) * weight));
    (Pose3 { rotation: level * world_from_vertex.rotation, ..world_from_vertex }, information)
}

/// The gravity that such a prior of a sensor's pose says; none where it says something else, or more.
pub(super) fn gravity_of(
    vertex: usize,
    vertex_from_sensor: Pose3,
    world_from_sensor: Pose3,
    information: &Matrix6<f64>,
) -> Option<Gravity> {
    let turns: Matrix3<f64> = information.fixed_view::<3, 3>(3, 3).into_owned();
    let weight = 0.5 * turns.trace();
    let rounding = ROUNDING * weight;
    let down_in_sensor = world_from_sensor.rotation.inverse() * WORLD_DOWN;
    let of_position = information.fixed_view::<3, 6>(0, 0).amax();
    let is_gravity = (turns - across(&down_in_sensor) * weight).amax() <= rounding && of_position <= rounding;
    let down_in_vertex = vertex_from_sensor.rotation * down_in_sensor;
    let gravity = Gravity { vertex, down_in_vertex, sigma_rad: 1.0 / weight.sqrt() };
    Some(gravity).filter(|gravity| is_gravity && weight > 0.0 && gravity.is_sound())
}

/// Both turns across a direction, and none about it.
fn across(direction: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() - direction * direction.transpose()
}
