//! Worlds, sensors and drives in space, all functions of a seed.
//!
//! The world's frame has z up; the robot's has x ahead, y to the left and z up, its origin on the floor below it. Metres,
//! radians and seconds throughout. As in the plane, same seed means same bytes: only plain IEEE operations are used, and every
//! cloud is a function of the drive and its own number, whoever asks for it and in whatever order.
//!
//! ```
//! use mapwright_sim::space::{SpaceDrive, SpaceDriveSettings, worlds};
//! let site = worlds::two_storey(7);
//! let drive = SpaceDrive::new(site.into(), SpaceDriveSettings { seed: 7, ..SpaceDriveSettings::default() });
//! for taken in drive.clouds().take(2) {
//!     assert_eq!(taken.cloud.points_m.len(), taken.cloud.times_s.len());
//!     assert!(taken.world_from_robot.is_finite());
//! }
//! ```
//!
//! - [`worlds`]: buildings with storeys joined by ramps and stairs, nested loops, storeys that look alike, streets around a courtyard.
//! - [`SpaceWorld`], [`Solid`], [`SpaceSite`]: build your own.
//! - [`Revisits::in_space`](crate::Revisits::in_space): which times of a drive see the same place.
//! - [`SpaceDrive`]: the robot's way, its wheels, [`ImuSettings`], [`LidarSettings`], [`DepthSettings`] and [`StereoSettings`], and the truth at any time.

mod build;
mod depth;
mod drive;
mod furnish;
mod imu;
mod lidar;
mod path;
mod plan;
mod settings;
mod site;
mod solid;
mod stereo;
mod texture;
mod tree;
mod turn;
mod views;
mod wheels;
mod wobble;
mod world;
pub mod worlds;

pub use depth::DepthSettings;
pub use drive::{SpaceDrive, TrueCloud, TrueDepthImage, TrueStereoPair};
pub use imu::ImuSettings;
pub use lidar::LidarSettings;
pub use settings::SpaceDriveSettings;
pub use site::SpaceSite;
pub use solid::Solid;
pub use stereo::StereoSettings;
pub use wheels::SpaceOdometryNoise;
pub use wobble::Wobble;
pub use world::{SpaceHit, SpaceWorld};
