//! Recognising places seen before, and refusing what only looks like them.
//!
//! Which old places to look for, what was found there and whether to believe it ([`Closing`], [`Verification`], [`Solving`]) is
//! written once for the plane and for space, over [`Pose`](mapwright_geom::Pose) and the trait [`Submaps`].

mod cascade;
mod claims;
mod closing;
mod places;
mod plane;
mod plane_ends;
mod plane_submap;
mod plane_verify;
mod solving;
mod space;
mod submaps;
mod verification;
mod views;

pub use cascade::{Finding, VerifySettings};
pub use claims::{SaidAndSeen, fit_where_said, is_found_where_said};
pub use closing::{
    APART_M, Closing, ClosingSettings, Decision, KnownPlace, LEFT_M, Ledger, RUN_WAY_M, WINDOW_M, WINDOW_RAD, is_old,
    run_of,
};
pub use places::{PlaceHit, PlaceIndex};
pub use plane::PlaneSubmaps;
pub use plane_submap::{PlaneSubmap, PlaneSubmapSettings};
pub use plane_verify::PlaneVerifier;
pub use solving::{Solved, Solving};
pub use space::{SpaceSubmap, SpaceSubmaps};
pub use submaps::{Closes, ClosingPolicy, PoseOf, SUBMAP_M, Submaps, Window};
pub use verification::{Judged, Target, Verification, Verified};
pub use views::{View, views, views_along};
