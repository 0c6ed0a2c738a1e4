//! Why a score cannot be given.

/// Why a score cannot be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EvalError {
    /// No two stamps of the trajectories are near enough.
    #[error(
        "expected stamps of the estimate ({estimate} poses) within {max_difference_s} s of the reference's \
         ({reference} poses), found none{}",
        .offset_s.map_or_else(String::new, |seconds| format!(": {}", crate::offset_words(seconds)))
    )]
    NoMatchingStamps {
        /// Poses in the reference.
        reference: usize,
        /// Poses in the estimate.
        estimate: usize,
        /// How far apart stamps may be, seconds.
        max_difference_s: f64,
        /// By how much all stamps of the estimate are later, seconds, where the clocks differ by a constant.
        offset_s: Option<f64>,
    },
    /// All matched poses contain NaN or infinity.
    #[error("expected finite poses, found none among {pairs} matched pairs")]
    NothingFinite {
        /// Matched pairs.
        pairs: usize,
    },
    /// All positions of one trajectory coincide, so no rotation aligns it.
    #[error(
        "expected positions that differ to align by, found {pairs} pairs without motion in one of the trajectories"
    )]
    NotAlignable {
        /// Matched pairs.
        pairs: usize,
    },
    /// The distance between the poses of a pair is zero, negative or not finite.
    #[error("expected a positive step between the poses of a pair, found {delta}")]
    BadDelta {
        /// Frames or metres.
        delta: f64,
    },
    /// The trajectory is too short for a single pair.
    #[error("expected pairs of poses {delta} apart, found none among {poses} poses")]
    NoPairs {
        /// Frames or metres, in words.
        delta: String,
        /// Poses matched.
        poses: usize,
    },
    /// No two scans far apart in order were taken near each other.
    #[error(
        "expected clouds {apart} scans and more apart in order but less than {within_m} m in place, found none among {scans}{}",
        .nearest_m.map_or_else(String::new, |metres| format!(": the nearest are {metres:.1} m apart"))
    )]
    NoRevisits {
        /// Clouds with a pose.
        scans: usize,
        /// How far apart in order, scans.
        apart: u64,
        /// How near to each other, metres.
        within_m: f64,
        /// How near those come that are so far apart in order, metres; none where none are.
        nearest_m: Option<f64>,
    },
    /// An image's cells do not fill its width and height.
    #[error("expected {width} x {height} cells, found {cells}")]
    BadImage {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Cells in the slice.
        cells: usize,
    },
    /// Two images that should show the same area differ in size.
    #[error("expected images of one size, found {reference:?} for the reference and {estimate:?} for the estimate")]
    ImageSizes {
        /// Columns and rows.
        reference: (usize, usize),
        /// Columns and rows.
        estimate: (usize, usize),
    },
}
