//! Step 1: returns and free space as points, without what is no return and what moves; the motion during the sweep undone.

use super::dynamic::DynamicObjects;
use super::on_robot::{Motion, OnRobot, Present};
use super::predict::Step;
use super::seen::Place;
use super::sweep_motion::SweepMotion;
use super::sweep_twist::{Glance, SweepTwist};
use crate::sensors::{PerSensor, SensorId, Sensors};
use crate::settings::ScanSettings;
use mapwright_geom::{Pose2, Stamp, stored};
use mapwright_sensor::{BeamCounts, BeamTable, LaserModel, LaserScan, Odometry, Sweep, SweepPoints, TurnRate};
use std::sync::Arc;

/// Beams a match uses at most.
const MATCH_BEAMS: usize = 4096;
/// Scans over which the share of isolated hits is averaged.
const SCATTER_SCANS: f64 = 200.0;
/// Four buildings with sound lasers have 0.6 to 4.8 %; 10 % of random readings make 13 %.
const SCATTER_SHARE: f64 = 0.08;

/// The present scan, prepared, and what preparing the next one needs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Preparation {
    motion: SweepMotion,
    lasers: Sensors<LaserModel>,
    /// That of the present scan,
    laser: SensorId,
    /// and what is known of each.
    known: PerSensor<Known>,
    /// What the last sweeps have told of the motion during them, where the scan before was the same laser's.
    sweep_twist: SweepTwist,
    sweep: Option<Sweep>,
    points: SweepPoints,
    /// End points for matching where there are more than [`MATCH_BEAMS`], else empty.
    thinned: Vec<[f64; 2]>,
}

stored!(Preparation { motion, lasers, laser, known, sweep_twist; sweep, points, thinned });

/// What scans of one laser have shown.
#[derive(Debug, Clone, Default)]
struct Known {
    dynamic: DynamicObjects,
    on_robot: OnRobot,
    scatter: Scatter,
    table: BeamTable,
}

stored!(Known { dynamic, on_robot, scatter; table });

impl Preparation {
    pub(super) fn add_odometry(&mut self, odometry: Odometry) {
        self.motion.add_odometry(odometry);
    }

    pub(super) fn add_turn_rate(&mut self, rate: &TurnRate) -> bool {
        self.motion.add_turn_rate(rate)
    }

    /// Odometry's pose at a scan: its own, or what readings say of that time.
    pub(super) fn odometry_of(&self, scan: &LaserScan) -> Option<Pose2> {
        let own = scan.odom_from_robot.filter(|pose| pose.is_finite());
        own.or_else(|| self.motion.odometry_at(scan.stamp))
    }

    /// What was seen, as a keyframe keeps it; none before the first scan.
    pub(crate) fn sweep(&self) -> Option<&Sweep> {
        self.sweep.as_ref()
    }

    pub(crate) fn points(&self) -> &SweepPoints {
        &self.points
    }

    /// The end points a match uses: all, or evenly chosen ones where they are very many.
    pub(crate) fn match_points(&self) -> &[[f64; 2]] {
        if self.thinned.is_empty() { &self.points.hits } else { &self.thinned }
    }

    /// Which laser a scan is of: the present one from now on.
    pub(super) fn turn_to(&mut self, laser: &Arc<LaserModel>) -> SensorId {
        let of = self.lasers.of(laser);
        if of != std::mem::replace(&mut self.laser, of) {
            self.sweep_twist.forget();
        }
        of
    }

    /// The laser of the present scan.
    pub(super) fn laser(&self) -> SensorId {
        self.laser
    }

    /// A scan that is refused as a whole.
    pub(super) fn refuse(&mut self, scan: &LaserScan) -> BeamCounts {
        self.points.clear();
        BeamCounts { refused: u32::try_from(scan.ranges_m.len()).unwrap_or(u32::MAX), ..BeamCounts::default() }
    }

    /// Prepares a scan. Odometry's step, and the twist that it would be carried on with, tell the motion during the sweep, as far as a
    /// robot can have made it (`believes`, of seconds and a motion); what moves is dropped where the robot's `place` is given.
    pub(super) fn prepare(
        &mut self,
        settings: &ScanSettings,
        scan: &LaserScan,
        step: Step,
        twist: [f64; 3],
        place: Option<Place>,
        believes: impl Fn(f64, Pose2) -> bool,
    ) -> BeamCounts {
        let twist = self.motion.twist(scan, step, twist, believes);
        let limits = (settings.min_range_m, settings.max_range_m);
        let sweep = self.sweep.get_or_insert_with(|| Sweep::empty(&scan.laser));
        let mut beams = sweep.fill(scan, twist, limits);
        let Known { dynamic, on_robot, scatter, table } = self.known.of(self.laser);
        scatter.observe(sweep.isolated_share());
        if scatter.is_noisy() {
            beams.isolated = sweep.drop_isolated();
            beams.returns -= beams.isolated;
        }
        self.points.fill(sweep, table, settings.free_range_m);
        if settings.drop_moving {
            let directions = table.directions(&sweep.laser, sweep.codes.len());
            beams.on_robot = on_robot.drop_from(sweep, &self.points, directions, place.is_some());
            if beams.on_robot > 0 {
                beams.returns -= beams.on_robot;
                self.points.fill(sweep, table, settings.free_range_m);
            }
        }
        if let Some(place) = place {
            beams.moving = dynamic.drop_from(sweep, &self.points, scan.stamp, place);
            if beams.moving > 0 {
                beams.returns -= beams.moving;
                self.points.fill(sweep, table, settings.free_range_m);
            }
        }
        self.thin();
        beams
    }

    /// Whether a first match can tell the motion during the present sweep.
    pub(super) fn can_be_told(&self) -> bool {
        self.sweep_twist.is_known() && !self.points.hits.is_empty() && self.middle().is_some()
    }

    /// Undoes the motion during the sweep anew, as a first match tells it: the motion from the last scan, and what the wheels say of it.
    pub(super) fn undo_motion(
        &mut self,
        settings: &ScanSettings,
        stamp: Stamp,
        elapsed_s: f64,
        last_from_now: Pose2,
        by_wheels: Option<Pose2>,
    ) {
        let (Some(middle), Some(sweep)) = (self.middle(), &mut self.sweep) else { return };
        let seen = Glance { last_from_now, by_wheels, middle, twist: sweep.twist_per_s, elapsed_s };
        let Some(twist) = self.sweep_twist.of(&seen) else { return };
        let sweep_s = sweep.laser.beam_period_s * sweep.codes.len() as f64;
        sweep.twist_per_s = self.motion.turned(stamp, sweep_s, twist);
        self.points.fill(sweep, &mut self.known.of(self.laser).table, settings.free_range_m);
        self.thin();
    }

    fn thin(&mut self) {
        self.thinned.clear();
        let every = self.points.hits.len().div_ceil(MATCH_BEAMS);
        if every > 1 {
            self.thinned.extend(self.points.hits.iter().step_by(every));
        }
    }

    /// The middle of the present sweep in the frame of its scan; none of beams that are taken at once.
    fn middle(&self) -> Option<Pose2> {
        let sweep = self.sweep.as_ref()?;
        let half_s = 0.5 * sweep.laser.beam_period_s * sweep.codes.len() as f64;
        (half_s > 0.0).then(|| Pose2::exp(sweep.twist_per_s.map(|rate| rate * half_s)))
    }

    /// Where the scan was taken, now that it is known, and what says so: the next ones are compared with it.
    pub(super) fn remember(&mut self, stamp: Stamp, place: Place, motion: Motion, drops_moving: bool) {
        let middle = self.middle();
        self.sweep_twist.remember(middle);
        let Some(sweep) = &self.sweep else { return };
        let Known { dynamic, on_robot, table, .. } = self.known.of(self.laser);
        dynamic.remember(&sweep.laser, stamp, place);
        if drops_moving && !self.points.hits.is_empty() {
            let directions = table.directions(&sweep.laser, sweep.codes.len());
            let points = &self.points;
            on_robot.remember(&Present { sweep, points, directions, stamp, place, known: motion });
        }
    }

    /// The robot is elsewhere than thought: the next scans are not compared with those before.
    pub(super) fn forget_scans(&mut self) {
        self.sweep_twist.forget();
        self.known.iter_mut().for_each(|known| {
            known.dynamic.forget();
            known.on_robot.forget_scans();
        });
    }
}

/// Running mean of the share of isolated hits: a laser that scatters is told from a room with thin things in it.
#[derive(Debug, Clone, Default)]
struct Scatter {
    mean: f64,
    scans: f64,
}

stored!(Scatter { mean, scans });

impl Scatter {
    fn observe(&mut self, share: f64) {
        self.scans = (self.scans + 1.0).min(SCATTER_SCANS);
        self.mean += (share - self.mean) / self.scans;
    }

    fn is_noisy(&self) -> bool {
        self.mean > SCATTER_SHARE
    }
}
