//! Where odometry has the robot, as readings: of transforms or messages, with what is known to be wrong taken out.

use crate::gate::Reading;
use mapwright::SpaceReading;
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::planar;
use mapwright_sensor::{
    CorrectedOdometry, FarOrigin, Odometry, OdometryCalibration, OdometryReading, OdometryTrack, Pace,
};

/// Readings of the last seconds, in the plane or in space; the same as of a recording, so that a scan has the same pose.
#[derive(Debug)]
pub(super) enum Track {
    InPlane { readings: OdometryTrack<Pose2>, origin: FarOrigin, pace: Pace, corrected: Option<CorrectedOdometry> },
    InSpace { readings: OdometryTrack<Pose3>, corrected: Option<CorrectedOdometry<Pose3>> },
}

/// Where odometry has the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Place {
    InPlane(Pose2),
    InSpace(Pose3),
}

impl Track {
    pub(super) fn new(is_in_space: bool, calibration: Option<OdometryCalibration>) -> Self {
        if is_in_space {
            let corrected = calibration.map(CorrectedOdometry::new);
            return Self::InSpace { readings: OdometryTrack::default(), corrected };
        }
        let (readings, origin, pace) = (OdometryTrack::default(), FarOrigin::at_first_reading(), Pace::default());
        Self::InPlane { readings, origin, pace, corrected: calibration.map(CorrectedOdometry::new) }
    }

    /// Takes in where odometry has the robot, and says what that is to the mapper; none where it lies too far out.
    pub(super) fn add(&mut self, stamp: Stamp, odom_from_robot: Pose3) -> Option<Reading> {
        match self {
            Self::InPlane { readings, origin, pace, corrected } => {
                let said = origin.near(planar(&odom_from_robot))?;
                let (stamp, pose) = match corrected {
                    Some(corrected) => (corrected.stamp(stamp), corrected.pose(said)),
                    None => (stamp, said),
                };
                let is_anew = readings
                    .newest()
                    .is_some_and(|last| !pace.add(stamp.secs_since(last.stamp), last.odom_from_robot.between(pose)));
                readings.add(OdometryReading { stamp, odom_from_robot: pose, is_anew });
                Some(Reading::Odometry(Odometry { stamp, odom_from_robot: pose }))
            }
            Self::InSpace { readings, corrected } => {
                let (stamp, pose) = match corrected {
                    Some(corrected) => (corrected.stamp(stamp), corrected.pose(odom_from_robot)),
                    None => (stamp, odom_from_robot),
                };
                readings.add(OdometryReading { stamp, odom_from_robot: pose, is_anew: false });
                Some(Reading::InSpace(SpaceReading::Odometry(stamp)))
            }
        }
    }

    /// Stamps of the first and the last reading.
    pub(super) fn span(&self) -> Option<[Stamp; 2]> {
        match self {
            Self::InPlane { readings, .. } => Some([readings.oldest()?.stamp, readings.newest()?.stamp]),
            Self::InSpace { readings, .. } => Some([readings.oldest()?.stamp, readings.newest()?.stamp]),
        }
    }

    /// Where the robot was: between two readings, or a little after the last one.
    pub(super) fn at(&self, stamp: Stamp) -> Option<Place> {
        match self {
            Self::InPlane { readings, .. } => readings.at(stamp).map(Place::InPlane),
            Self::InSpace { readings, .. } => readings.at(stamp).map(Place::InSpace),
        }
    }

    pub(super) fn clear(&mut self) {
        match self {
            Self::InPlane { readings, .. } => readings.clear(),
            Self::InSpace { readings, .. } => readings.clear(),
        }
    }
}
