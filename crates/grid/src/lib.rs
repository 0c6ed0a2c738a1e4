//! Two-dimensional maps, the matching of scans against them, and of finished maps against each other.

mod align;
mod beams;
mod correlative;
mod counts;
mod field;
mod local_map;
mod matcher;
mod survivors;
mod tiles;

pub use align::{
    Alignment, Evidence, JoinError, MapError, Occupancy, OccupancyMap, Refusal, Source, WallAgreement, align, join,
};
pub use beams::BeamAgreement;
pub use correlative::{
    CorrelativeSearch, MAX_SEARCH_BLOCKS, MAX_SEARCH_CELLS, Peak, SearchResult, SearchSettings, SearchWindow,
    Separation,
};
pub use counts::{Change, Changes, CountGrid, HitCell};
pub use field::DistanceField;
pub use local_map::{Agreement, LocalMap, LocalMapSettings, Surfel};
pub use matcher::{Evaluation, MatchResult, Matcher, MatcherSettings, Prior};
pub use tiles::floor_cell;
