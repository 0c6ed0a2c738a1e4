//! How a robot drives in space and what it carries.

use super::depth::DepthSettings;
use super::imu::ImuSettings;
use super::lidar::LidarSettings;
use super::stereo::StereoSettings;
use super::wheels::SpaceOdometryNoise;
use super::wobble::Wobble;
use crate::robot::RobotSettings;

/// Everything about a drive in space except where it leads.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceDriveSettings {
    /// How the robot moves, seen from above.
    pub robot: RobotSettings,
    /// How the floor tilts and lifts it.
    pub wobble: Wobble,
    /// What its odometry gets wrong.
    pub odometry: SpaceOdometryNoise,
    /// Its lidar.
    pub lidar: LidarSettings,
    /// Its depth camera.
    pub depth: DepthSettings,
    /// Its stereo camera.
    pub stereo: StereoSettings,
    /// Its inertial sensor.
    pub imu: ImuSettings,
    /// The drive ends then, seconds, or with its way.
    pub duration_s: f64,
    /// Seed of wobble and noise.
    pub seed: u64,
}

impl Default for SpaceDriveSettings {
    /// 1 m/s, 32 beams.
    fn default() -> Self {
        let robot = RobotSettings {
            speed_m_per_s: 1.0,
            turn_rate_rad_per_s: 1.2,
            acceleration_m_per_s2: 0.7,
            ..RobotSettings::default()
        };
        Self {
            robot,
            wobble: Wobble::default(),
            odometry: SpaceOdometryNoise::default(),
            lidar: LidarSettings::default(),
            depth: DepthSettings::default(),
            stereo: StereoSettings::default(),
            imu: ImuSettings::default(),
            duration_s: f64::INFINITY,
            seed: 0,
        }
    }
}
