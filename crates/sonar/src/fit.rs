//! A line and the arcs that agree on it.

use crate::arc::Arc2;

/// A wall has answered so many times at least, from as many places: two arcs always have a common tangent.
pub(crate) const LEAST_ECHOES: usize = 3;
/// Arcs belong to a wall within so many standard deviations.
pub(crate) const GATE_SIGMAS: f64 = 2.5;

/// A line: direction of its normal in radians and depth in metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub(crate) normal_rad: f64,
    pub(crate) depth_m: f64,
}

/// A line and the free arcs that are tangent to it.
pub(crate) struct Fit {
    pub(crate) line: Line,
    /// Standard deviation of its direction, radians.
    pub(crate) direction_sigma_rad: f64,
    /// The arcs, and the place of each along the line, metres; in order of places.
    pub(crate) echoes: Vec<(usize, f64)>,
}

/// From how many places a wall answered.
pub(crate) fn places(arcs: &[Arc2], run: &[(usize, f64)]) -> usize {
    let mut places: Vec<u32> = run.iter().map(|&(k, _)| arcs[k].place).collect();
    places.sort_unstable();
    places.dedup();
    places.len()
}
