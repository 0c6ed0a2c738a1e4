//! Where a search for the relative pose begins, and whether it has one answer.

use crate::sighting::Sighting;
use crate::solve::{Mode, Outliers, climb};
use crate::window::{Entry, Noise, Window};
use mapwright_geom::Pose2;
use std::f64::consts::{PI, TAU};

/// The best mode is the answer where all others together have less than this share of the probability.
const MOST_OF_RIVALS: f64 = 0.01;
/// A mode is as good as normal while its directions are known to so much, radians; a sine differs from its angle by 4 % at twice that.
const WIDEST_RAD: f64 = 0.25;
/// Directions tried where none is measured.
const DIRECTIONS: usize = 10;
/// Sightings of each observer from which searches begin, the nearest: one may be wrong.
const FIRST: usize = 3;
/// Modes nearer than this are one, in standard deviations squared.
const SAME_MODE: f64 = 4.0;
/// Starts nearer than this are one, metres and radians.
const SAME_START: [f64; 2] = [0.5, 0.2];
/// Ranges tried where none is measured, metres.
const RANGES_M: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

/// Why sightings do not yet make an encounter.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum WaitReason {
    /// The sensor did not say who was seen.
    Unidentified,
    /// One robot alone was seen, and it has hardly moved since: its heading is open.
    LittleMotion {
        /// How far it drove between the first and the last of them, metres.
        moved_m: f64,
    },
    /// One answer, but too vague.
    Vague {
        /// Standard deviation of the heading, radians.
        heading_rad: f64,
    },
    /// Several relative poses explain the sightings.
    Ambiguous {
        /// How many.
        modes: usize,
    },
    /// Nothing fits: odometry of one of the robots failed between the sightings, or several of them are wrong.
    Inconsistent,
    /// No relative pose follows: the sightings leave a direction open.
    Open,
}

/// The one answer of a window, or why there is none.
pub(crate) fn one_answer(window: &Window, noise: &Noise, outliers: &Outliers) -> Result<Mode, WaitReason> {
    let mut modes: Vec<Mode> = Vec::new();
    for start in starts(window) {
        let Some(mode) = climb(window, start, noise, outliers) else { continue };
        match modes.iter_mut().find(|known| is_same(known, &mode)) {
            Some(known) if known.evidence < mode.evidence => *known = mode,
            Some(_) => {}
            None => modes.push(mode),
        }
    }
    modes.sort_by(|one, two| two.evidence.total_cmp(&one.evidence));
    let best = modes.first().ok_or(WaitReason::Open)?;
    let against = |mode: &Mode| (mode.evidence - best.evidence).exp();
    let rivals: f64 = modes[1..].iter().map(against).sum();
    if rivals / (1.0 + rivals) > MOST_OF_RIVALS {
        let alive = modes.iter().filter(|mode| against(mode) > MOST_OF_RIVALS / modes.len() as f64).count();
        return Err(WaitReason::Ambiguous { modes: alive });
    }
    if best.is_inconsistent() {
        return Err(WaitReason::Inconsistent);
    }
    let heading_rad = best.covariance[(2, 2)].sqrt();
    let across_rad = mapwright_geom::TangentMatrix::position_variance_m2(&best.covariance).sqrt()
        / best.a_from_b.x.hypot(best.a_from_b.y).max(1.0);
    if heading_rad.max(across_rad) > WIDEST_RAD {
        return Err(WaitReason::Vague { heading_rad });
    }
    modes.into_iter().next().ok_or(WaitReason::Open)
}

fn is_same(known: &Mode, mode: &Mode) -> bool {
    let apart = known.a_from_b.between(mode.a_from_b).log();
    let apart = nalgebra::Vector3::from(apart);
    known.covariance.try_inverse().is_some_and(|information| apart.dot(&(information * apart)) < SAME_MODE)
}

/// Relative poses by single sightings, those nearest to the moment, with every direction where none was measured.
fn starts(window: &Window) -> Vec<Pose2> {
    let (by_a, by_b) = (nearest(window, true), nearest(window, false));
    let mut starts = Vec::new();
    match (by_a.is_empty(), by_b.is_empty()) {
        (false, false) => {
            for one in &by_a {
                by_b.iter().for_each(|two| push_starts(window, Some(one), Some(two), &mut starts));
            }
        }
        (false, true) => by_a.iter().take(1).for_each(|one| push_starts(window, Some(one), None, &mut starts)),
        (true, _) => by_b.iter().take(1).for_each(|two| push_starts(window, None, Some(two), &mut starts)),
    }
    starts
}

/// From both the same hill is climbed.
fn is_near(one: Pose2, two: Pose2) -> bool {
    let apart = one.between(two);
    apart.x.hypot(apart.y) < SAME_START[0] && apart.theta.abs() < SAME_START[1]
}

fn nearest(window: &Window, is_by_a: bool) -> Vec<Entry> {
    let mut entries: Vec<Entry> = window.entries.iter().filter(|entry| entry.is_by_a == is_by_a).copied().collect();
    entries.sort_by(|one, two| one.after_s.abs().total_cmp(&two.after_s.abs()));
    entries.truncate(FIRST);
    entries
}

fn push_starts(window: &Window, by_a: Option<&Entry>, by_b: Option<&Entry>, starts: &mut Vec<Pose2>) {
    let (Some(of_a), Some(of_b)) = (by_a.or(by_b), by_b.or(by_a)) else { return };
    let all = || (0..DIRECTIONS).map(|k| TAU * k as f64 / DIRECTIONS as f64 - PI).collect::<Vec<_>>();
    let bearings = |entry: Option<&Entry>| entry.and_then(|e| e.sighting.bearing_rad).map_or_else(all, |rad| vec![rad]);
    let range = |entry: Option<&Entry>| entry.and_then(|entry| range_of(&entry.sighting));
    let ranges_m = range(by_a).or(range(by_b)).map_or_else(|| RANGES_M.to_vec(), |m| vec![m]);
    for &range_m in &ranges_m {
        for by_a_rad in bearings(by_a) {
            for by_b_rad in bearings(by_b) {
                let (s, c) = by_a_rad.sin_cos();
                let a_from_b = Pose2::new(range_m * c, range_m * s, by_a_rad + PI - by_b_rad);
                let start = window.carried_to_now(a_from_b, of_a, of_b);
                if !starts.iter().any(|known| is_near(*known, start)) {
                    starts.push(start);
                }
            }
        }
    }
}

fn range_of(sighting: &Sighting) -> Option<f64> {
    sighting.range_m
}
