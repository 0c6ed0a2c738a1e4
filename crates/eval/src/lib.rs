//! How good a trajectory, a covariance or a map is.
//!
//! - [`relation_errors`]: the error of relative poses against surveyed ones (Kümmerle et al. 2009). It punishes what is
//!   wrong locally and never depends on where the map's origin lies.
//! - [`ate`] and [`rpe`]: absolute trajectory error after alignment and relative pose error, as evo defines them.
//! - [`error_series`]: the same pose by pose, to be drawn over time.
//! - [`space_errors`]: the same in space, and the errors of KITTI's benchmark.
//! - [`revisit_errors`]: without a reference, by how much clouds of different visits ask to be moved onto each other.
//! - [`Nees`]: whether covariances are honest.
//! - [`score_map`]: occupied cells found and invented.
//!
//! All functions take slices and return numbers; reading files is done elsewhere.
//!
//! ```
//! use mapwright_eval::{Alignment, StampedPose, ate};
//! use mapwright_geom::{Pose2, Stamp};
//!
//! let truth: Vec<_> = (0..100_i64)
//!     .map(|k| StampedPose {
//!         stamp: Stamp(k * 100_000_000),
//!         world_from_robot: Pose2::new(0.1 * k as f64, (0.1 * k as f64).sin(), 0.0),
//!     })
//!     .collect();
//! let map_from_world = Pose2::new(5.0, -2.0, 1.0);
//! let estimate: Vec<_> = truth
//!     .iter()
//!     .map(|p| StampedPose { world_from_robot: map_from_world * p.world_from_robot, ..*p })
//!     .collect();
//! let errors = ate(&truth, &estimate, Alignment::Rigid)?;
//! assert!(errors.translation_m.rmse < 1e-9);
//! # Ok::<(), mapwright_eval::EvalError>(())
//! ```

mod associate;
mod ate;
mod error;
mod map_score;
mod nees;
mod relations;
mod revisits;
mod rpe;
mod series;
mod space;
mod stats;

pub use associate::{MAX_STAMP_DIFFERENCE_S, PosePair, StampedPose, associate, clock_offset_s, offset_words};
pub use ate::{Alignment, Ate, Similarity2, align, ate, ate_of_pairs};
pub use error::EvalError;
pub use map_score::{CellImage, CellState, MapScore, score_map};
pub use nees::{Nees, chi_square_quantile};
pub use relations::{MissingRelation, MissingSide, Relation, RelationError, RelationReport, relation_errors};
pub use revisits::{RevisitFit, RevisitReport, RevisitScan, RevisitSettings, revisit_errors, revisit_fits};
pub use rpe::{Delta, Rpe, RpeSettings, rpe, rpe_of_pairs};
pub use series::{ErrorAt, ErrorSeries, error_series};
pub use space::{SegmentError, SegmentErrors, SpaceErrors, space_error_series, space_errors, space_nees};
pub use stats::{ErrorStats, PoseErrors};
