//! What was seen of a run and its map.

use crate::hanging::Hanging;
use crate::tally::Tally;
use crate::turns::Turns;
use crate::wheels::Wheels;
use mapwright::{Advice, EdgeKind, Objection, Pose2, SeparateMap, Session, Stamp, Status, Verdict as Judged, Visits};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use serde::Serialize;

/// Odometry has to predict so many of the scans before it says so.
const ODOMETRY_SHARE: f64 = 0.9;

/// What was seen of a run and its map.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Facts {
    pub(crate) scans: u64,
    pub(crate) keyframes: usize,
    /// Share of the scans in the log that could not be used.
    pub(crate) unused: f64,
    /// Shares of the scans.
    pub(crate) degraded: f64,
    pub(crate) lost: f64,
    pub(crate) median_inlier_share: f64,
    /// Share of the keyframes that are not in the first map.
    pub(crate) elsewhere: f64,
    /// Pieces of the first map that odometry over a break alone holds.
    pub(crate) on_odometry: usize,
    /// What a single step of odometry holds.
    pub(crate) hanging: Hanging,
    /// What a place where a lost robot was found holds.
    pub(crate) on_finding: Hanging,
    /// For how long neither laser nor wheels said how the robot moves, seconds.
    pub(crate) guessed_s: f64,
    /// Share of the scans whose matches contradict the motion before, where no wheels say how the robot moves, by how many deviations at
    /// most, and the share of the returns that met what travels with the robot.
    pub(crate) against_velocity: f64,
    pub(crate) against_sigmas: f64,
    pub(crate) on_robot: f64,
    /// The way from scan to scan, as a multiple of the way in the order of the stamps.
    pub(crate) way_by_stamps: f64,
    /// Loop closures of the first map, and motions of which wheels and scans both tell: what tests a map in which no two visits can be compared.
    pub(crate) closures: usize,
    pub(crate) wheel_motions: usize,
    pub(crate) compared: usize,
    pub(crate) misfits: usize,
    pub(crate) moved_mean_m: f64,
    pub(crate) moved_90_m: f64,
    /// Of the keyframes of the first map relative to its beginning.
    pub(crate) mean_sigma_m: f64,
    pub(crate) worst_sigma_m: f64,
    /// Places that were recognised where the map does not have them.
    pub(crate) unheeded: usize,
    /// What scans say of the motion, as a multiple of what the wheels say: of turns, of ways; and the direction of the way beside theirs,
    /// degrees.
    pub(crate) turns_of_odometry: f64,
    pub(crate) way_of_odometry: f64,
    pub(crate) aside_deg: f64,
    /// How far the point about which the wheels turn lies from where the map has the robot.
    pub(crate) lever_m: f64,
    /// What to say where scans turn the other way than the wheels.
    pub(crate) mirrored: Option<String>,
}

impl Facts {
    pub(crate) fn of(tally: &Tally, turns: &Turns, session: &Session, advice: &Advice, visits: Visits) -> Self {
        let (maps, pieces) = (session.maps(), session.pieces());
        let keyframes = session.keyframes().len();
        let first = maps.first().cloned().unwrap_or_default();
        let in_first = first.keyframes.iter().map(ExactSizeIterator::len).sum::<usize>();
        let wheels = Wheels::of(session);
        let hangs = |piece: &&usize| pieces.get(**piece).is_some_and(|piece| piece.link.is_some());
        Self {
            scans: tally.scans,
            unused: tally.share_unused(0),
            keyframes,
            degraded: tally.share(Status::Degraded),
            lost: tally.share(Status::Lost),
            median_inlier_share: tally.median_inlier_share().unwrap_or(0.0),
            elsewhere: keyframes.saturating_sub(in_first) as f64 / keyframes.max(1) as f64,
            hanging: Hanging::on_odometry(session),
            on_finding: Hanging::on_finding(session, tally.found()),
            guessed_s: tally.guessed_s(),
            against_velocity: tally.against_velocity().0,
            against_sigmas: tally.against_velocity().1,
            on_robot: tally.share_on_robot(),
            way_by_stamps: way_by_stamps(session),
            on_odometry: first.pieces.iter().filter(hangs).count(),
            closures: session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count(),
            // what was predicted without odometry says nothing of it
            wheel_motions: if tally.share_by_odometry() > ODOMETRY_SHARE { wheels.motions } else { 0 },
            compared: visits.compared,
            misfits: visits.misfits,
            moved_mean_m: visits.mean_m,
            moved_90_m: visits.percentile_90_m,
            mean_sigma_m: advice.mean_sigma_m,
            worst_sigma_m: advice.worst_sigma_m,
            unheeded: unheeded(session, &first),
            turns_of_odometry: wheels.turns,
            way_of_odometry: wheels.way,
            aside_deg: wheels.aside_rad.to_degrees(),
            lever_m: if tally.share_by_odometry() > ODOMETRY_SHARE { wheels.lever_m } else { 0.0 },
            mirrored: turns.words(),
        }
    }

    /// What scans say of the motion beside what the wheels say.
    pub(super) fn wheels(&self) -> Wheels {
        Wheels {
            motions: self.wheel_motions,
            turns: self.turns_of_odometry,
            way: self.way_of_odometry,
            aside_rad: self.aside_deg.to_radians(),
            lever_m: self.lever_m,
        }
    }
}

/// Scans that come in another order than they were taken in lead to and fro. Where stamps alone are wrong, as of a logger that has set them in
/// bursts, their order does.
fn way_by_stamps(session: &Session) -> f64 {
    let mut poses: Vec<(Stamp, Pose2)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
    let way_m = |poses: &[(Stamp, Pose2)]| poses.windows(2).map(|pair| pair[0].1.distance(pair[1].1)).sum::<f64>();
    let in_log_m = way_m(&poses);
    poses.sort_by_key(|(stamp, _)| *stamp);
    let by_stamps_m = way_m(&poses);
    if by_stamps_m > 0.0 { in_log_m / by_stamps_m } else { 1.0 }
}

/// A place that was recognised this far from where the map has it is not heeded, metres.
pub(super) const UNHEEDED_M: f64 = 1.0;

/// Findings that nothing spoke against but the chain of edges, or that no other agreed with, and that the map says otherwise.
pub(crate) fn unheeded<M: Measurement>(session: &Session<M>, map: &SeparateMap) -> usize {
    let poses = session.map_from_keyframe();
    let found = session.candidates().iter().filter(|candidate| {
        let (Judged::Waiting(why) | Judged::Refused(why)) = candidate.verdict else { return false };
        matches!(why, Objection::Alone | Objection::Improbable)
    });
    let is_elsewhere = |from: usize, to: usize, found: M::Pose| {
        map.has(from) && map.has(to) && poses[from].between(poses[to]).distance(found) > UNHEEDED_M
    };
    let says = |candidate: &mapwright::Candidate<M::Pose>| {
        let (from, to) = (session.place(candidate.from)?, session.place(candidate.to)?);
        Some(is_elsewhere(from, to, candidate.from_from_to?))
    };
    found.filter_map(says).filter(|&elsewhere| elsewhere).count()
}
