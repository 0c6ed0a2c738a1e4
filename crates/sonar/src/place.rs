//! From where on a robot is at another place.

use mapwright_geom::{Pose2, wrap_angle};

/// A robot that has moved less stands, metres and radians: a tenth of a map's cell, and what that is at 1 m.
const STANDS_M: f64 = 0.01;
const STANDS_RAD: f64 = 0.01;

pub(crate) fn stands(a: Pose2, b: Pose2) -> bool {
    let step = a.between(b);
    step.x.hypot(step.y) < STANDS_M && wrap_angle(step.theta).abs() < STANDS_RAD
}
