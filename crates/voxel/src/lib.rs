//! Maps of space on hashed voxels, and scans matched against them in six degrees of freedom.

mod eigen;
mod key;
mod matcher;
mod surfel;
mod surfel_map;
mod thin;

pub use matcher::{Fit, Matcher, MatcherSettings, Prior};
pub use surfel::Surfel;
pub use surfel_map::{Change, SurfelMap, SurfelMapSettings};
pub use thin::Thinner;
