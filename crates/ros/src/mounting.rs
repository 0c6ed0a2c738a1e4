//! How a planar laser sits on a robot.

use crate::error::RosError;
use mapwright_geom::{Pose2, Pose3};
use nalgebra::Vector3;

/// A laser's place on the robot, seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    /// Pose of the laser in the plane.
    pub robot_from_laser: Pose2,
    /// Whether it hangs upside down, so that bearings turn the other way.
    pub inverted: bool,
    /// Height above the robot's origin, metres.
    pub height_m: f64,
    /// Angle of its scan plane against the robot's, degrees.
    pub tilt_deg: f64,
}

impl Mounting {
    /// The mounting that is in the robot's origin.
    pub const IDENTITY: Self =
        Self { robot_from_laser: Pose2::IDENTITY, inverted: false, height_m: 0.0, tilt_deg: 0.0 };

    /// The projection of a mounting onto the plane.
    ///
    /// # Errors
    /// [`RosError::Tilted`] where the scan plane is tilted by more than `limit_deg`, or the pose is not finite.
    pub fn project(robot_from_laser: Pose3, limit_deg: f64) -> Result<Self, RosError> {
        let up = robot_from_laser.rotation * Vector3::z();
        let tilt_deg = up.x.hypot(up.y).atan2(up.z.abs()).to_degrees();
        let place = robot_from_laser.translation;
        // a NaN fails the comparison
        if !(tilt_deg <= limit_deg && robot_from_laser.is_finite()) {
            return Err(RosError::Tilted { tilt_deg, limit_deg });
        }
        let (inverted, height_m) = (up.z < 0.0, place.z);
        Ok(Self { robot_from_laser: planar(&robot_from_laser), inverted, height_m, tilt_deg })
    }
}

/// A pose seen from above: height, roll and pitch are left out, the heading is that of the x axis.
#[must_use]
pub fn planar(pose: &Pose3) -> Pose2 {
    let forward = pose.rotation * Vector3::x();
    Pose2::new(pose.translation.x, pose.translation.y, forward.y.atan2(forward.x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use std::f64::consts::PI;

    fn mounted(roll: f64, pitch: f64, yaw: f64) -> Pose3 {
        Pose3 {
            translation: Vector3::new(0.2, 0.1, 0.5),
            rotation: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        }
    }

    #[test]
    fn an_upright_laser_keeps_its_heading() {
        let mounting = Mounting::project(mounted(0.01, 0.0, 1.2), 5.0).unwrap();
        assert!(!mounting.inverted && (mounting.robot_from_laser.theta - 1.2).abs() < 1e-3);
        assert!((mounting.tilt_deg - 0.573).abs() < 1e-3 && mounting.height_m == 0.5);
    }

    #[test]
    fn beams_of_a_laser_upside_down_point_where_they_do_in_space() {
        let robot_from_laser = mounted(PI, 0.0, 0.7);
        let mounting = Mounting::project(robot_from_laser, 5.0).unwrap();
        let scan = crate::messages::LaserScan { angle_min: -0.4, angle_increment: 0.1, ..Default::default() };
        let (laser, _) = scan.laser(&mounting).unwrap();
        assert!(laser.inverted);
        for beam in 0..9 {
            let bearing = -0.4 + 0.1 * f64::from(beam);
            let direction = robot_from_laser.rotation * Vector3::new(bearing.cos(), bearing.sin(), 0.0);
            let seen = laser.bearing_in_robot(beam as usize);
            assert!((direction.x - seen.cos()).abs() < 1e-6 && (direction.y - seen.sin()).abs() < 1e-6);
        }
    }

    #[test]
    fn a_tilted_scan_plane_is_refused_in_degrees() {
        let error = Mounting::project(mounted(0.0, 0.5, 0.0), 5.0).unwrap_err();
        assert_eq!(error.to_string(), "the scan plane is tilted by 28.6 deg, expected at most 5.0 deg");
        assert!(Mounting::project(mounted(0.0, f64::NAN, 0.0), 5.0).is_err());
    }
}
