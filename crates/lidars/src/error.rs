//! What is wrong with what the caller says of a lidar.

/// A failure to say which lidar is meant. What a lidar sends is never an error: it is counted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LidarError {
    /// No lidar has this name.
    #[error(
        "expected ld06, ld19, rplidar, rplidar-standard, rplidar-express, velodyne, ouster or hesai, found {name:?}"
    )]
    Name {
        /// What was said.
        name: String,
    },
    /// The name does not say where the lidar is.
    #[error("expected where the lidar is behind its name, such as {example}, found {found:?}")]
    Place {
        /// What was said.
        found: String,
        /// What could have been said.
        example: &'static str,
    },
    /// A speed of a serial line that is none.
    #[error("expected a speed in baud behind the last @ of {found:?}, such as 115200")]
    Baud {
        /// What was said.
        found: String,
    },
    /// What an Ouster says of itself cannot be read.
    #[error("metadata of an Ouster: {reason}")]
    Metadata {
        /// Why, in words.
        reason: String,
    },
}
