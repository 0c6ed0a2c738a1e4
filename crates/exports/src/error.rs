//! Why something cannot be written.

use mapwright_bags::BagError;
use mapwright_formats::FormatError;
use mapwright_ros::RosError;

/// Why a log or results cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The container cannot carry it, or the stream below failed.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The text format cannot carry it, or the stream below failed.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The map's points are no message.
    #[error("{0}")]
    Points(String),
    /// A message cannot be written.
    #[error(transparent)]
    Ros(#[from] RosError),
}
