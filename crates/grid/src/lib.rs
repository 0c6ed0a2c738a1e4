//! Two-dimensional maps and the matching of scans against them.

mod counts;
mod field;
mod live;
mod matcher;
mod tiles;

pub use counts::{Change, CountGrid, HitCell, Occupancy};
pub use field::DistanceField;
pub use live::{Agreement, LiveMap, LiveMapSettings, Surfel};
pub use matcher::{Evaluation, MatchResult, Matcher, MatcherSettings, Prior};
