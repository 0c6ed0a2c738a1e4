//! What is drawn of a session, of the plane or of space.

use super::figure::Figure;
use super::submaps::Overlays;
use crate::closures::{CandidateRecord, Recorded, records};
use crate::picture::{Meeting, RunNames, RunShown, meetings, of_several, runs};
use mapwright::{Pose3, SeparateMap, Session, SpaceSweep, Stamp, Status};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use serde_json::Value;

/// Of so many maps there are pictures; what holds nothing together may be in hundreds of pieces.
pub(super) const MAPS_SHOWN: usize = 6;

/// What is drawn of a session. All poses are those of space; in the plane z is 0.
pub(super) struct Drawn {
    pub(super) is_space: bool,
    /// The robot at every scan, in arrival order.
    pub(super) way: Vec<WayPose>,
    pub(super) keyframes: Vec<KeyframePlace>,
    pub(super) candidates: Vec<CandidateRecord>,
    /// Where something begins after a break, and how, in words.
    pub(super) breaks: Vec<(usize, &'static str)>,
    /// Where to drive next, the best first, by the numbers in `map.png`.
    pub(super) next: Vec<NextPlace>,
    pub(super) slips: usize,
    pub(super) maps: usize,
    pub(super) figures: Vec<Figure>,
    pub(super) overlays: Overlays,
    /// Runs where there are several, and where two of them met.
    pub(super) runs: Vec<DrawnRun>,
    pub(super) meetings: Vec<Meeting>,
}

/// A run of several.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DrawnRun {
    pub(super) number: usize,
    pub(super) name: String,
    pub(super) keyframes: usize,
    pub(super) length_m: f64,
}

/// A place whose visit would make a map more certain.
#[derive(Debug, Clone)]
pub(super) struct NextPlace {
    pub(super) map: usize,
    pub(super) place: [f64; 3],
    /// Where it is, and what would be gained.
    pub(super) words: String,
}

/// Where the robot was at a scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct WayPose {
    pub(super) stamp: Stamp,
    /// The scan's number in arrival order.
    pub(super) scan: u64,
    pub(super) map_from_robot: Pose3,
    pub(super) map: usize,
    /// Of which run it is, and how many breaks of that run lie before it.
    pub(super) part: [usize; 2],
    pub(super) status: Status,
}

/// Where a keyframe is.
#[derive(Debug, Clone, Copy)]
pub(super) struct KeyframePlace {
    pub(super) place: [f64; 3],
    pub(super) map: usize,
    /// Of which run it is, and how many breaks of that run lie before it.
    pub(super) part: [usize; 2],
    /// Standard deviation of its position relative to where its map begins, in space to where the way ends, metres; none where it is not known.
    pub(super) sigma_m: Option<f64>,
}

/// What both kinds have in common, without pictures. Of each keyframe `points` gives those that are laid over others, metres, in its own frame.
pub(super) fn drawn<M: Measurement<Pose: Recorded>>(
    session: &Session<M>,
    report: &Value,
    maps: &[SeparateMap],
    figures: Vec<Figure>,
    up: [f64; 3],
    points: impl FnMut(&M) -> Vec<[f64; 3]>,
) -> Drawn {
    let map_of = |place: usize| maps.iter().position(|map| map.has(place)).unwrap_or(0);
    let breaks = session.fragments().iter().filter(|fragment| session.is_break(fragment));
    let breaks = breaks.filter_map(|fragment| Some((session.place(fragment.first)?, fragment.start.name())));
    let breaks: Vec<(usize, &'static str)> = breaks.collect();
    let numbers = runs(session);
    let part = |at: usize| {
        let own = breaks.iter().filter(|(first, _)| *first <= at && numbers[*first] == numbers[at]);
        [numbers[at], own.count()]
    };
    let poses: Vec<Pose3> = session.map_from_keyframe().iter().map(|pose| pose.in_space()).collect();
    let keyframe = |(at, pose): (usize, &Pose3)| KeyframePlace {
        place: pose.translation.into(),
        map: map_of(at),
        part: part(at),
        sigma_m: None,
    };
    let keyframes: Vec<KeyframePlace> = poses.iter().enumerate().map(keyframe).collect();
    let candidates = records(session);
    let horizontals = figures.first().map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], Figure::horizontals);
    let overlays = Overlays::of(session, &candidates, (&poses, horizontals, up), points);
    let several = of_several(session, &RunNames::of_report(report));
    Drawn {
        is_space: M::CODE == SpaceSweep::CODE,
        way: way(session, report, &keyframes),
        breaks,
        keyframes,
        candidates,
        next: Vec::new(),
        slips: session.slips().len(),
        maps: maps.len(),
        figures,
        overlays,
        runs: several.into_iter().flatten().map(drawn_run).collect(),
        meetings: meetings(session),
    }
}

fn drawn_run<P: Pose>(run: RunShown<P>) -> DrawnRun {
    DrawnRun { length_m: run.length_m(), number: run.number, name: run.name, keyframes: run.keyframes }
}

fn way<M: Measurement>(session: &Session<M>, report: &Value, keyframes: &[KeyframePlace]) -> Vec<WayPose> {
    let mut way = Vec::with_capacity(session.scans().len());
    let mut scan = 0;
    for (at, (known, pose)) in session.scans().iter().zip(session.trajectory()).enumerate() {
        // Numbers have gaps where a damaged log has lost scans.
        while session.scan_place(scan).is_none_or(|place| place < at) && scan < session.next_scan() {
            scan += 1;
        }
        let place = known.keyframe.and_then(|id| session.place(id));
        let (map, part) =
            place.and_then(|place| keyframes.get(place)).map_or((0, [0, 0]), |known| (known.map, known.part));
        let map_from_robot = pose.map_from_robot.in_space();
        way.push(WayPose { stamp: pose.stamp, scan, map_from_robot, map, part, status: Status::Tracking });
    }
    if way.is_empty() {
        way = way_of_keyframes(session, keyframes);
    }
    for (status, scans) in doubtful(report) {
        let from = way.partition_point(|pose| pose.scan < scans.start);
        let to = way.partition_point(|pose| pose.scan < scans.end);
        way[from..to.max(from)].iter_mut().for_each(|pose| pose.status = status);
    }
    way
}

/// Of a session without scans, such as one of robots that tell each other their keyframes alone, by their stamps.
fn way_of_keyframes<M: Measurement>(session: &Session<M>, keyframes: &[KeyframePlace]) -> Vec<WayPose> {
    let pose = |(at, known): (usize, &KeyframePlace)| WayPose {
        stamp: session.keyframes()[at].stamp,
        scan: at as u64,
        map_from_robot: session.map_from_keyframe()[at].in_space(),
        map: known.map,
        part: known.part,
        status: Status::Tracking,
    };
    let mut way: Vec<WayPose> = keyframes.iter().enumerate().map(pose).collect();
    way.sort_by_key(|pose| pose.stamp);
    way
}

/// Scans that were not tracked, as far as the report lists them.
fn doubtful(report: &Value) -> Vec<(Status, std::ops::Range<u64>)> {
    let runs = report["status"]["runs"].as_array().map_or(&[][..], Vec::as_slice);
    let run = |run: &Value| {
        let (first, scans) = (run["first_scan"].as_u64()?, run["scans"].as_u64()?);
        let status = match run["status"].as_str()? {
            "degraded" => Status::Degraded,
            "lost" => Status::Lost,
            _ => return None,
        };
        Some((status, first..first.saturating_add(scans)))
    };
    runs.iter().filter_map(run).collect()
}
