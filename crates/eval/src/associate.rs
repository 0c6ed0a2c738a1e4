//! Which poses of two trajectories belong together.

use crate::error::EvalError;
use mapwright_geom::{Pose2, Stamp};

/// How far apart the stamps of one pair may be, seconds: evo's default.
pub const MAX_STAMP_DIFFERENCE_S: f64 = 0.01;

/// A pose of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// When.
    pub stamp: Stamp,
    /// Where the robot was, in the frame of its trajectory.
    pub world_from_robot: Pose2,
}

/// What two trajectories say of the same moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePair {
    /// Stamp of the reference's pose.
    pub stamp: Stamp,
    /// The reference's pose, in the reference's frame.
    pub world_from_robot: Pose2,
    /// The estimate's pose, in the estimate's frame.
    pub map_from_robot: Pose2,
}

/// Pairs each pose of the shorter trajectory (the estimate, where both are equally long) with the one of the longer
/// that is nearest in time, if it lies within `max_difference_s`.
///
/// This is evo's rule with stamps compared in whole nanoseconds. Pairs come in the order of the shorter trajectory; a
/// pose of the longer may serve twice. Between two equally near poses the earlier in time wins; where stamps repeat,
/// the last of them; and where the longer trajectory's stamps step backwards, the first in order among the nearest.
///
/// # Errors
/// [`EvalError::NoMatchingStamps`] when there is no pair.
pub fn associate(
    reference: &[StampedPose],
    estimate: &[StampedPose],
    max_difference_s: f64,
) -> Result<Vec<PosePair>, EvalError> {
    let stamps = |poses: &[StampedPose]| poses.iter().map(|pose| pose.stamp).collect::<Vec<_>>();
    let paired = paired_stamps(&stamps(reference), &stamps(estimate), max_difference_s)?;
    let pair = |[of_reference, of_estimate]: [usize; 2]| PosePair {
        stamp: reference[of_reference].stamp,
        world_from_robot: reference[of_reference].world_from_robot,
        map_from_robot: estimate[of_estimate].world_from_robot,
    };
    Ok(paired.into_iter().map(pair).collect())
}

/// [`associate`] of stamps alone: the places in the reference and in the estimate that belong together.
pub(crate) fn paired_stamps(
    reference: &[Stamp],
    estimate: &[Stamp],
    max_difference_s: f64,
) -> Result<Vec<[usize; 2]>, EvalError> {
    let pairs = nearest_pairs(reference, estimate, max_difference_s);
    if pairs.is_empty() {
        return Err(EvalError::NoMatchingStamps {
            reference: reference.len(),
            estimate: estimate.len(),
            max_difference_s,
            offset_s: clock_offset_s(reference, estimate, max_difference_s),
        });
    }
    Ok(pairs)
}

fn nearest_pairs(reference: &[Stamp], estimate: &[Stamp], max_difference_s: f64) -> Vec<[usize; 2]> {
    let reference_is_shorter = estimate.len() > reference.len();
    let (shorter, longer) = if reference_is_shorter { (reference, estimate) } else { (estimate, reference) };
    let nearest = NearestStamp::new(longer);
    let max_difference_ns = (max_difference_s * 1e9).round() as u64;
    let pair = |(index, stamp): (usize, &Stamp)| {
        let other = nearest.index(*stamp)?;
        let near = stamp.0.abs_diff(longer[other].0) <= max_difference_ns;
        near.then_some(if reference_is_shorter { [index, other] } else { [other, index] })
    };
    shorter.iter().enumerate().filter_map(pair).collect()
}

/// So large a share of the shorter trajectory's stamps has partners once a constant offset is taken off.
const OFFSET_SHARE: f64 = 0.9;
/// Of fewer poses any offset explains all.
const OFFSET_POSES: usize = 10;
/// Leap seconds between atomic time or GPS and UTC, and hours between time zones, seconds.
const KNOWN_OFFSETS_S: [i64; 2] = [37, 18];
const ZONES_H: i64 = 14;

/// By how much the clock of the estimate is ahead of the reference's, seconds, where one offset explains nearly all stamps: that of the
/// first stamps or of the last, or one that clocks are known to differ by.
#[must_use]
pub fn clock_offset_s(reference: &[Stamp], estimate: &[Stamp], max_difference_s: f64) -> Option<f64> {
    let ends = |stamps: &[Stamp]| Some([stamps.iter().min()?.0, stamps.iter().max()?.0]);
    let (of_reference, of_estimate) = (ends(reference)?, ends(estimate)?);
    let by_ends = (0..2).map(|end| of_estimate[end].saturating_sub(of_reference[end]));
    let zones = (1..=ZONES_H).map(|hours| 3600 * hours);
    let known = KNOWN_OFFSETS_S.into_iter().chain(zones).flat_map(|s| [s, -s]).map(|s| s * 1_000_000_000);
    let shorter = reference.len().min(estimate.len());
    if shorter < OFFSET_POSES {
        return None;
    }
    let least = OFFSET_SHARE * shorter as f64;
    let explains = |offset_ns: &i64| {
        let shifted: Vec<Stamp> = estimate.iter().map(|stamp| Stamp(stamp.0.saturating_sub(*offset_ns))).collect();
        nearest_pairs(reference, &shifted, max_difference_s).len() as f64 >= least
    };
    // a known one is exact
    let offset_ns = known.chain(by_ends).filter(|offset_ns| *offset_ns != 0).find(explains)?;
    Some(offset_ns as f64 * 1e-9)
}

/// The same in words.
#[must_use]
pub fn offset_words(seconds: f64) -> String {
    let which = if seconds > 0.0 { "later" } else { "earlier" };
    format!("all its stamps are {:.3} s {which} than the reference's, so that the clocks differ by that", seconds.abs())
}

/// The pairs without NaN or infinity, and how many had to go.
pub(crate) fn finite_pairs(pairs: &[PosePair]) -> Result<(Vec<PosePair>, usize), EvalError> {
    let finite: Vec<_> =
        pairs.iter().copied().filter(|p| p.world_from_robot.is_finite() && p.map_from_robot.is_finite()).collect();
    if finite.is_empty() {
        return Err(EvalError::NothingFinite { pairs: pairs.len() });
    }
    let dropped = pairs.len() - finite.len();
    Ok((finite, dropped))
}

/// Stamps in ascending order with their places in the trajectory.
struct NearestStamp {
    sorted: Vec<(Stamp, usize)>,
    was_sorted: bool,
}

impl NearestStamp {
    fn new(stamps: &[Stamp]) -> Self {
        let mut sorted: Vec<_> = stamps.iter().enumerate().map(|(index, stamp)| (*stamp, index)).collect();
        let was_sorted = sorted.is_sorted();
        sorted.sort_unstable();
        Self { sorted, was_sorted }
    }

    fn index(&self, stamp: Stamp) -> Option<usize> {
        if self.was_sorted { self.index_of_sorted(stamp) } else { self.first_index(stamp) }
    }

    /// evo's binary search: the pose after the stamp, unless the one before is as near.
    fn index_of_sorted(&self, stamp: Stamp) -> Option<usize> {
        let last = self.sorted.len().checked_sub(1)?;
        let after = self.sorted.partition_point(|(other, _)| *other <= stamp).min(last);
        let before = after.saturating_sub(1);
        let to_after = i128::from(self.sorted[after].0.0) - i128::from(stamp.0);
        let to_before = i128::from(stamp.0) - i128::from(self.sorted[before].0.0);
        Some(if after > 0 && to_before <= to_after { before } else { after })
    }

    /// evo's linear search: the first in order among the nearest.
    fn first_index(&self, stamp: Stamp) -> Option<usize> {
        let at = self.sorted.partition_point(|(other, _)| *other < stamp);
        let after = self.sorted.get(at);
        let before = at.checked_sub(1).map(|place| self.first_of_equal(place));
        before
            .into_iter()
            .chain(after)
            .min_by_key(|(other, index)| (other.0.abs_diff(stamp.0), *index))
            .map(|(_, index)| *index)
    }

    fn first_of_equal(&self, place: usize) -> &(Stamp, usize) {
        let stamp = self.sorted[place].0;
        &self.sorted[self.sorted.partition_point(|(other, _)| *other < stamp)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(stamps_ns: &[i64]) -> Vec<StampedPose> {
        let pose = |k: usize| Pose2::new(k as f64, 0.0, 0.0);
        stamps_ns.iter().enumerate().map(|(k, s)| StampedPose { stamp: Stamp(*s), world_from_robot: pose(k) }).collect()
    }

    /// Places `(reference, estimate)` that were paired.
    fn paired(reference_ns: &[i64], estimate_ns: &[i64]) -> Vec<(usize, usize)> {
        associate(&at(reference_ns), &at(estimate_ns), 10e-9)
            .unwrap_or_default()
            .iter()
            .map(|p| (p.world_from_robot.x as usize, p.map_from_robot.x as usize))
            .collect()
    }

    #[test]
    fn the_nearest_stamp_within_the_bound_is_taken() {
        assert_eq!(paired(&[0, 100, 200], &[11, 95, 210]), [(1, 1), (2, 2)]);
        assert_eq!(paired(&[100], &[95, 102, 300]), [(0, 1)]);
        assert_eq!(paired(&[0, 10], &[5]), [(0, 0)]);
    }

    #[test]
    fn repeated_and_backward_stamps_follow_the_rule() {
        assert_eq!(paired(&[0, 50, 50, 90], &[50]), [(2, 0)]);
        assert_eq!(paired(&[50, 60, 0, 50], &[50]), [(0, 0)]);
        assert_eq!(paired(&[60, 50, 0, 50], &[55]), [(0, 0)]);
    }

    #[test]
    fn clocks_that_differ_by_a_constant_are_named() {
        let every = |first_ms: i64, count: i64| (0..count).map(|k| Stamp((first_ms + 100 * k) * 1_000_000)).collect();
        let reference: Vec<Stamp> = every(1_000_000, 200);
        let offset_s = |first_ms: i64, count: i64| clock_offset_s(&reference, &every(first_ms, count), 0.01);
        assert_eq!(offset_s(1_037_000, 200), Some(37.0));
        assert_eq!(offset_s(1_003_000 - 7_200_000, 150), Some(-7200.0), "a time zone, begun 3 s later");
        assert_eq!(offset_s(1_000_000 + 86_400_000, 150), Some(86_400.0), "both begin at once");
        assert_eq!(offset_s(1_000_050, 3), None, "too few to tell");
        let slower: Vec<Stamp> = (0..200).map(|k| Stamp(1_100_000_000_000 + 137_000_000 * k)).collect();
        assert_eq!(clock_offset_s(&reference, &slower, 0.01), None, "of another rate");
        let words = paired_stamps(&reference, &every(1_037_000, 200), 0.01).unwrap_err().to_string();
        assert!(words.contains("found none: all its stamps are 37.000 s later than the reference's"), "{words}");
    }

    #[test]
    fn strangers_and_extreme_stamps_are_refused_in_words() {
        let error = associate(&at(&[i64::MIN]), &at(&[i64::MAX]), 0.01).unwrap_err();
        assert!(error.to_string().contains("within 0.01 s"), "{error}");
        assert!(associate(&[], &[], 0.01).is_err());
    }
}
