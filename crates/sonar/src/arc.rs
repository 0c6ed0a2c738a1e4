//! An echo as an arc in the frame of its stretch.

use mapwright_geom::{Pose2, wrap_angle};

/// Where something is, as one echo says: on the arc of this range within the cone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc2 {
    /// Pose of the sonar in the stretch's frame; the cone's axis is its x axis.
    pub stretch_from_sonar: Pose2,
    /// Half of the cone's opening, radians.
    pub half_rad: f64,
    /// Range of the echo, metres.
    pub range_m: f64,
    /// Number of the place where the robot was.
    pub place: u32,
}

/// Smooth walls answer so far beyond the cone's edge too, radians: sound has no sharp edge.
const BEYOND_EDGE_RAD: f64 = 0.1;

impl Arc2 {
    /// Place of the sonar along a direction, metres.
    #[must_use]
    pub fn along_m(&self, direction: [f64; 2]) -> f64 {
        self.stretch_from_sonar.x * direction[0] + self.stretch_from_sonar.y * direction[1]
    }

    /// How far along a unit normal the wall lies that has this normal and gave the echo, metres.
    #[must_use]
    pub fn depth_m(&self, normal: [f64; 2]) -> f64 {
        self.along_m(normal) + self.range_m
    }

    /// The same in the frame of a pose of its own frame.
    pub(crate) fn seen_from(&self, pose: Pose2) -> Self {
        Self { stretch_from_sonar: pose.between(self.stretch_from_sonar), ..*self }
    }

    /// Whether sound of the cone meets a wall whose normal, away from the robot, has this direction, straight on.
    #[must_use]
    pub fn faces(&self, normal_rad: f64) -> bool {
        wrap_angle(normal_rad - self.stretch_from_sonar.theta).abs() <= self.half_rad + BEYOND_EDGE_RAD
    }

    /// Standard deviation of the range, metres: sound's speed and the pulse's length, as data sheets of air sonars have them (1 %),
    /// and what odometry gets wrong between two readings.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        0.02 + 0.01 * self.range_m
    }
}
