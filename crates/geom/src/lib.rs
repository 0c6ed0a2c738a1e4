//! Rigid motions of the plane and of space, their covariances, and stamps.
//!
//! Units are metres and radians, axes are right-handed with x forward. A pose named `a_from_b` takes coordinates in
//! frame `b` to coordinates in frame `a`, so that names cancel: `a_from_b * b_from_c = a_from_c`. Tangent vectors are
//! right perturbations, translation first: `pose * exp([dx, dy, dtheta])`. What is the same in the plane and in space is
//! written over [`Pose`].
//!
//! ```
//! use mapwright_geom::Pose2;
//! let world_from_robot = Pose2::new(1.0, 2.0, std::f64::consts::FRAC_PI_2);
//! let robot_from_laser = Pose2::new(0.1, 0.0, 0.0);
//! let world_from_laser = world_from_robot * robot_from_laser;
//! assert!((world_from_laser.y - 2.1).abs() < 1e-12);
//! ```

mod angle;
mod covariance;
mod point;
mod pose;
mod pose2;
mod pose3;
mod sealed;
mod sound;
mod stamp;
mod stored;
mod tangent;
mod wahba;

pub use angle::{sin_cos, wrap_angle};
pub use covariance::{compose_covariance, inverse_covariance};
pub use point::Point;
pub use pose::{Apart, FARTHEST_M, Pose};
pub use pose2::Pose2;
pub use pose3::{Pose3, skew};
pub use sound::{is_covariance, is_in_place};
pub use stamp::Stamp;
pub use stored::Stored;
pub use tangent::{Cov3, Cov6, Tangent, TangentMatrix};
pub use wahba::BestRotation;
