//! What sensors deliver, and what is done with it before any map is involved.
//!
//! - [`LaserModel`], [`LaserScan`], [`Odometry`], [`TurnRate`]: readings of the plane as they arrive.
//! - [`SonarRing`], [`SonarReading`]: wide cones, and what each echo says.
//! - [`Pace`]: how fast the robot drives, by its odometry, and which of its steps no robot can have made.
//! - [`FarOrigin`]: what places that lie too far out are relative to.
//! - [`SpaceSensor`], [`Cloud`], [`PinholeCamera`], [`DepthImage`], [`ImuReading`]: readings of space.

mod cloud;
mod corrected_odometry;
mod far_origin;
mod head;
mod imu;
mod motion;
mod no_return_codes;
mod odometry_track;
mod pace;
mod prepared;
mod scan;
mod sonar;
mod space_sweep;
mod sweep_times;
mod turning;

pub use cloud::{Cloud, DepthImage, PinholeCamera, SpaceSensor};
pub use corrected_odometry::{CorrectedOdometry, OdometryCalibration, OdometryStep};
pub use far_origin::FarOrigin;
pub use head::{Bearings, OddHead, RANGE_MAX_UNSAID_M, SWEEP_MOST_S, SaidBearings, settle_ranges, settle_times};
pub use imu::{
    Down, DownEstimate, ImuPiece, ImuReading, ImuReadings, ImuTaken, Pushed, STANDARD_GRAVITY_M_PER_S2,
    TURN_NOISE_RAD2_PER_S, Turned, in_metres,
};
pub use motion::{Decomposed, MotionModel};
pub use no_return_codes::{FoundCodes, NoReturnCodes};
pub use odometry_track::{ODOMETRY_APART_MOST_S, OdometryReading, OdometryTrack};
pub use pace::Pace;
pub use prepared::{BEAM_DROPPED, BEAM_NO_RETURN, BeamCounts, BeamTable, Sweep, SweepPoints};
pub use scan::{LaserModel, LaserScan, Odometry};
pub use sonar::{Echo, SONAR_REACH_MOST_M, Sonar, SonarReading, SonarRing};
pub use space_sweep::SpaceSweep;
pub use sweep_times::SweepTimes;
pub use turning::{TurnRate, TurnRates};
