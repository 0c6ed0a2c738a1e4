//! What was seen around the two keyframes of a candidate, to be laid over each other.

use super::figure::dot;
use super::html::base64;
use crate::closures::{CandidateRecord, VerdictName};
use mapwright::{Pose3, Session, SpaceSweep};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use nalgebra::Vector3;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// A submap is what was seen from a keyframe, so many before and after it,
const NEIGHBOURS: usize = 6;
/// and no farther from it than this, metres.
const AROUND_M: f64 = 3.0;
/// Points farther away than this are left out, metres: in the middle the fit shows.
const REACH_M: f64 = 15.0;
/// Points are told in whole centimetres, and thinned to one in a square of such a side, centimetres, or of a larger one.
const CELL_CM: i32 = 5;
/// Candidates at most that have submaps: closures first.
const CANDIDATES: usize = 400;
/// All points of a page take so many characters,
const BUDGET: usize = 480_000;
/// a point this many: two numbers of 16 bits as base64.
const CHARACTERS_A_POINT: f64 = 5.4;
/// Points of a submap, at least and at most.
const POINTS: [usize; 2] = [80, 700];

/// Of clouds that are laid over each other the points between these heights above the sensor are shown, metres: walls rather than
/// floors and ceilings.
const BAND_M: [f64; 2] = [-0.4, 0.8];

/// Submaps by keyframe, and how they lie.
#[derive(Debug, Clone, Default)]
pub(super) struct Overlays {
    submaps: BTreeMap<u32, Vec<[i16; 2]>>,
    placings: BTreeMap<usize, Placing>,
}

/// Where the keyframe `to` lies relative to `from`, along the horizontal axes of the picture, metres.
#[derive(Debug, Clone, Copy)]
struct Placing {
    /// As the map has it.
    mapped: [f64; 2],
    /// As the match has it, and how much it turns relative to the map, radians; none where nothing was found.
    found: Option<[f64; 3]>,
}

impl Overlays {
    /// Of a session's candidates; poses, and the horizontal axes and up, are of and in the map. `points` are those that a keyframe saw, in
    /// its own frame, metres.
    pub(super) fn of<M: Measurement>(
        session: &Session<M>,
        records: &[CandidateRecord],
        (poses, horizontals, up): (&[Pose3], [[f64; 3]; 2], [f64; 3]),
        mut points: impl FnMut(&M) -> Vec<[f64; 3]>,
    ) -> Self {
        let chosen = chosen(records, poses.len());
        let wanted: BTreeSet<u32> = chosen.iter().flat_map(|&at| [records[at].from, records[at].to]).collect();
        let share = BUDGET as f64 / CHARACTERS_A_POINT / wanted.len().max(1) as f64;
        let most = (share as usize).clamp(POINTS[0], POINTS[1]);
        let mut submap = |keyframe: u32| {
            let all = around(session, poses, keyframe as usize, up, &mut points);
            let flat = all.into_iter().map(|point| horizontals.map(|axis| dot(axis, point)));
            (keyframe, thinned(flat.collect(), most))
        };
        let submaps = wanted.into_iter().map(&mut submap).collect();
        let placing = |&at: &usize| {
            let found = session.candidates().get(at).and_then(|candidate| candidate.from_from_to);
            let [from, to] = [records[at].from, records[at].to].map(|k| poses[k as usize]);
            (at, placing(from, to, found.map(Pose::in_space), horizontals, up))
        };
        Self { submaps, placings: chosen.iter().map(placing).collect() }
    }

    /// Of a candidate: `mapped`, and `found` where there is one.
    pub(super) fn placing(&self, candidate: usize) -> Value {
        let rounded = |v: f64| (v * 1e4).round() / 1e4 + 0.0; // no negative zero
        self.placings.get(&candidate).map_or(Value::Null, |placing| {
            json!({ "mapped": placing.mapped.map(rounded), "found": placing.found.map(|found| found.map(rounded)) })
        })
    }

    /// Points of each keyframe's submap: pairs of 16 bits, the lower byte first, as base64; centimetres.
    pub(super) fn to_json(&self) -> Value {
        let bytes =
            |points: &[[i16; 2]]| points.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
        let submaps =
            self.submaps.iter().map(|(keyframe, points)| (keyframe.to_string(), json!(base64(&bytes(points)))));
        Value::Object(submaps.collect::<Map<String, Value>>())
    }
}

/// Candidates that have submaps, closures first; both keyframes are there.
fn chosen(records: &[CandidateRecord], keyframes: usize) -> Vec<usize> {
    let there = |record: &CandidateRecord| (record.from.max(record.to) as usize) < keyframes;
    let mut chosen: Vec<usize> = (0..records.len()).filter(|&at| there(&records[at])).collect();
    chosen.sort_by_key(|&at| match records[at].verdict {
        VerdictName::Accepted => 0,
        VerdictName::Withdrawn => 1,
        VerdictName::Waiting | VerdictName::Refused => 2,
    });
    chosen.truncate(CANDIDATES);
    chosen
}

/// What was seen around a keyframe, relative to its position along the map's axes, metres.
fn around<M: Measurement>(
    session: &Session<M>,
    poses: &[Pose3],
    keyframe: usize,
    up: [f64; 3],
    points: &mut impl FnMut(&M) -> Vec<[f64; 3]>,
) -> Vec<[f64; 3]> {
    let centre = poses[keyframe].translation;
    let near = keyframe.saturating_sub(NEIGHBOURS)..(keyframe + NEIGHBOURS + 1).min(poses.len());
    let fits = |&k: &usize| {
        let is_linked = session.joined_fragments([k, keyframe]).is_none();
        (poses[k].translation - centre).norm() <= AROUND_M && is_linked
    };
    let mut all = Vec::new();
    for k in near.filter(fits) {
        let Some(sweep) = session.drawn().get(k).and_then(Option::as_ref) else { continue };
        let own_up = poses[k].rotation.inverse() * Vector3::from(up);
        let mut seen = points(sweep);
        if M::CODE == SpaceSweep::CODE {
            seen = at_eye_level(seen, own_up.into());
        }
        let moved = |point: [f64; 3]| -> [f64; 3] { (poses[k].transform(Vector3::from(point)) - centre).into() };
        all.extend(seen.into_iter().map(moved));
    }
    all
}

/// Points of a cloud at about the sensor's height, or all where there are few of these; `up` is in the cloud's frame.
fn at_eye_level(points: Vec<[f64; 3]>, up: [f64; 3]) -> Vec<[f64; 3]> {
    let is_level = |point: &[f64; 3]| (BAND_M[0]..=BAND_M[1]).contains(&dot(*point, up));
    let level: Vec<[f64; 3]> = points.iter().copied().filter(is_level).collect();
    if level.len() * 20 < points.len() { points } else { level }
}

/// At most so many points in whole centimetres, spread evenly, in a fixed order.
fn thinned(points: Vec<[f64; 2]>, most: usize) -> Vec<[i16; 2]> {
    let near = points.into_iter().filter(|[x, y]| x.hypot(*y) <= REACH_M);
    let whole: Vec<[i32; 2]> = near.map(|point| point.map(|v| (v * 100.0).round() as i32)).collect();
    let mut cell_cm = CELL_CM;
    loop {
        let mut cells: BTreeMap<[i32; 2], [i32; 2]> = BTreeMap::new();
        for point in &whole {
            cells.entry(point.map(|v| v.div_euclid(cell_cm))).or_insert(*point);
        }
        if cells.len() <= most {
            return cells.into_values().map(|point| point.map(|v| v as i16)).collect();
        }
        cell_cm += (cell_cm + 3) / 4;
    }
}

fn placing(
    map_from_from: Pose3,
    map_from_to: Pose3,
    from_from_to: Option<Pose3>,
    horizontals: [[f64; 3]; 2],
    up: [f64; 3],
) -> Placing {
    let flat = |to: Pose3| {
        let offset: [f64; 3] = (to.translation - map_from_from.translation).into();
        horizontals.map(|axis| dot(axis, offset))
    };
    let found = from_from_to.map(|from_from_to| {
        let found = map_from_from * from_from_to;
        let turn = (found.rotation * map_from_to.rotation.inverse()).scaled_axis();
        let [x, y] = flat(found);
        [x, y, dot(turn.into(), up)]
    });
    Placing { mapped: flat(map_from_to), found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright::Pose2;

    #[test]
    fn thinned_points_are_few_near_and_spread() {
        let points: Vec<[f64; 2]> =
            (0..20_000).map(|k| [f64::from(k % 200) * 0.05, f64::from(k / 200) * 0.05]).collect();
        let kept = thinned(points.clone(), 500);
        assert!((300..=500).contains(&kept.len()), "{}", kept.len());
        assert!(kept.iter().any(|[x, y]| *x > 900 && *y > 400));
        assert_eq!(thinned(points[..3].to_vec(), 500), [[0, 0], [5, 0], [10, 0]]);
        assert!(thinned(vec![[f64::NAN, 0.0], [20.0, 0.0], [1e300, 1.0]], 500).is_empty());
    }

    #[test]
    fn a_found_pose_is_told_relative_to_the_map() {
        let from = Pose2::new(3.0, 1.0, 1.0);
        let to = from * Pose2::new(0.5, 0.2, 0.3);
        let found = from.between(Pose2::new(to.x + 0.1, to.y - 0.2, to.theta + 0.05));
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let placing = placing(from.in_space(), to.in_space(), Some(found.in_space()), axes, [0.0, 0.0, 1.0]);
        let [x, y, turn] = placing.found.unwrap_or_default();
        assert!((x - placing.mapped[0] - 0.1).abs() < 1e-9 && (y - placing.mapped[1] + 0.2).abs() < 1e-9);
        assert!((turn - 0.05).abs() < 1e-9 && (placing.mapped[0] - (to.x - 3.0)).abs() < 1e-9);
    }
}
