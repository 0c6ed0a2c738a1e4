//! Robots of a team drive through a small building while they talk, and where they truly were.

use crate::robots::{Robot, Simulated};
use mapwright::{KeyframeId, Pose2, Session, Stamp};
use mapwright_eval::{Alignment, ErrorStats, PosePair, ate_of_pairs};
use mapwright_record::SessionEdge;
use mapwright_sim::{Drive, DriveSettings, LaserSettings, TrueScan, worlds};
use serde::Serialize;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Each robot drives so long, seconds.
pub(super) const DRIVE_S: f64 = 20.0;
const SCANS_HZ: f64 = 5.0;
const BEAMS: usize = 120;
/// Robots hear and work so often, seconds.
const STEP_S: f64 = 0.1;
/// Who do not agree after so long never will, seconds.
const AGREE_S: f64 = 300.0;
/// So long after the end nothing more is looked for, seconds.
const SETTLED_S: f64 = 15.0;
/// A closure between two robots is wrong if it is farther from the truth, metres and radians.
const WRONG_M: f64 = 0.3;
const WRONG_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;

/// What each robot's laser sees.
fn laser() -> LaserSettings {
    let mut laser = LaserSettings::with_field_of_view(TAU, BEAMS);
    Arc::make_mut(&mut laser.model).range_max_m = 12.0;
    laser
}

/// How well one sweep tells a coordinate of where it was taken in a map without errors, metres: half of its beams see surfaces across.
pub(super) fn sigma_of_sweep_m() -> f64 {
    let laser = laser();
    laser.range_sigma_m / (0.5 * laser.beams as f64).sqrt()
}

/// What robots record in three rooms, each from a place of its own.
pub(super) struct Drives(Vec<Vec<TrueScan>>);

impl Drives {
    pub(super) fn new(seed: u64, robots: usize) -> Self {
        let site = Arc::new(worlds::three_rooms(seed));
        let drive = |robot: usize| {
            let settings = DriveSettings {
                laser: laser(),
                scan_rate_hz: SCANS_HZ,
                start_waypoint: 2 * robot,
                duration_s: DRIVE_S,
                seed: seed.wrapping_mul(64) + robot as u64,
                ..DriveSettings::default()
            };
            Drive::new(Arc::clone(&site), settings).scans().collect()
        };
        Self((0..robots).map(drive).collect())
    }

    /// All drive and talk until `end_s` or later, and until all agree; calls each time before they hear each other.
    pub(super) fn run(&self, team: &mut Simulated, end_s: f64, mut call: impl FnMut(&mut Simulated, f64)) -> Agreed {
        let (mut next, mut agreed) = (vec![0; self.0.len()], Agreed::default());
        for step in 0_u64.. {
            let seconds = step as f64 * STEP_S;
            let now = Stamp((seconds * 1e9) as i64);
            call(team, seconds);
            for (robot, drive) in self.0.iter().enumerate() {
                while let Some(taken) = drive.get(next[robot])
                    && taken.scan.stamp.as_secs_f64() <= seconds
                {
                    team.map(robot, now, |mapper| Some(mapper.add_scan(&taken.scan)));
                    next[robot] += 1;
                    if next[robot] == drive.len() {
                        team.map(robot, now, |mapper| Some(mapper.look_again()));
                        team.robots[robot].team.finish();
                    }
                }
            }
            let has_worked = team.step(now, seconds);
            let since_end_s = seconds - end_s;
            if since_end_s < 0.0 || !step.is_multiple_of(5) {
                continue;
            }
            agreed.note(team, since_end_s);
            let is_over = team.is_agreed() && since_end_s >= SETTLED_S && !has_worked;
            if is_over || since_end_s > AGREE_S {
                break;
            }
        }
        agreed
    }

    /// Where a keyframe truly was taken.
    fn world_from(&self, team: &Simulated, id: KeyframeId) -> Option<Pose2> {
        let own = |robot: &Robot| robot.mapper.session().place(id);
        let (number, place) = team.robots.iter().enumerate().find_map(|(at, robot)| Some((at, own(robot)?)))?;
        let scan = team.robots[number].mapper.keyframes()[place].scan;
        Some(self.0[number].get(scan as usize)?.world_from_robot)
    }
}

/// Seconds after the end until robots who live and do not lie first
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct Agreed {
    /// held all records of what was mapped,
    pub(super) held_s: Option<f64>,
    /// had the same map with all that they have mapped,
    pub(super) agreed_s: Option<f64>,
    /// and had all looked at it again.
    pub(super) audited_s: Option<f64>,
}

impl Agreed {
    fn note(&mut self, team: &Simulated, since_end_s: f64) {
        let note = |first_s: &mut Option<f64>, is_so: fn(&Simulated) -> bool| {
            if first_s.is_none() && is_so(team) {
                *first_s = Some(since_end_s);
            }
        };
        note(&mut self.held_s, Simulated::holds_all);
        note(&mut self.agreed_s, Simulated::has_one_map);
        note(&mut self.audited_s, Simulated::is_agreed);
    }
}

/// A map beside the truth.
pub(super) struct Truth<'a> {
    map: &'a Session,
    world_from_keyframe: Vec<Option<Pose2>>,
}

impl<'a> Truth<'a> {
    pub(super) fn new(drives: &Drives, team: &Simulated, map: &'a Session) -> Self {
        let world_from_keyframe = map.keyframes().iter().map(|keyframe| drives.world_from(team, keyframe.id)).collect();
        Self { map, world_from_keyframe }
    }

    /// Whether an edge says what is not so.
    pub(super) fn is_wrong(&self, known: &SessionEdge<Pose2>) -> bool {
        let [from, to] = known.ends.map(|end| self.world_from_keyframe[end as usize]);
        let (Some(from), Some(to)) = (from, to) else { return true };
        let by = known.recorded.edge.from_from_to.between(from.between(to));
        by.x.hypot(by.y) > WRONG_M || by.theta.abs() > WRONG_RAD
    }

    /// How far keyframes lie from where they were taken, aligned rigidly, metres.
    pub(super) fn error_m(&self, places: impl Iterator<Item = usize>) -> Option<ErrorStats> {
        let pairs = places.filter_map(|place| {
            let (stamp, map_from_robot) = (self.map.keyframes()[place].stamp, self.map.map_from_keyframe()[place]);
            Some(PosePair { stamp, world_from_robot: self.world_from_keyframe[place]?, map_from_robot })
        });
        ate_of_pairs(&pairs.collect::<Vec<_>>(), Alignment::Rigid).ok().map(|ate| ate.translation_m)
    }
}
