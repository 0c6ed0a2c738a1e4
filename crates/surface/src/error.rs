//! What can go wrong.

/// Why a surface could not be drawn or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A setting that cannot be.
    #[error("{name}: expected {expected}, found {found}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// What it may be.
        expected: &'static str,
        /// What it is.
        found: f64,
    },
    /// A view with one column longer than another.
    #[error("{found} {what} for {points} points: expected {expected}")]
    Columns {
        /// Which column.
        what: &'static str,
        /// How long it is.
        found: usize,
        /// How many points there are.
        points: usize,
        /// How long it may be.
        expected: &'static str,
    },
    /// A pose with a component that is not finite.
    #[error("a pose with a component that is not finite")]
    Pose,
    /// The memory allowed is used up. Nothing of the cloud was drawn.
    #[error(
        "voxels of {voxel_m} m need at least {needed_mb} MB for what is drawn so far, {limit_mb} MB are allowed (memory_mb): \
         voxels of {fits_m:.3} m would fit"
    )]
    Memory {
        /// What the surface would take with this cloud, megabytes.
        needed_mb: u64,
        /// What it may take, megabytes.
        limit_mb: u64,
        /// Side of its voxels, metres.
        voxel_m: f64,
        /// With voxels of this side, metres, what was drawn so far would take half of what is allowed.
        fits_m: f64,
    },
    /// So many clouds in one surface that its sums might overflow. Nothing of the last was drawn.
    #[error("more than {limit} clouds in one surface")]
    TooManyClouds {
        /// How many there may be.
        limit: u32,
    },
    /// A patch that was prepared for a surface with other voxels.
    #[error("a patch prepared for voxels of {found_m} m in a surface with voxels of {expected_m} m")]
    OtherVoxels {
        /// Those of the patch, metres.
        found_m: f64,
        /// Those of the surface, metres.
        expected_m: f64,
    },
    /// A keyframe that is already there.
    #[error("keyframe {id} is already in the surface")]
    Twice {
        /// Its number.
        id: u64,
    },
    /// A keyframe that is not there.
    #[error("keyframe {id} is not in the surface")]
    Unknown {
        /// Its number.
        id: u64,
    },
    /// A mesh of which the columns disagree, or whose triangles name vertices that are not there.
    #[error("a mesh that is none: {what}")]
    Mesh {
        /// What is wrong with it.
        what: &'static str,
    },
    /// A mesh that the format cannot hold.
    #[error("{bytes} bytes are more than a .glb can hold, which is 4 GiB")]
    TooLarge {
        /// How long it would be.
        bytes: u64,
    },
    /// What the stream says.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}
