//! How well what was seen of a place on different visits agrees, in a finished map of space.

use mapwright::{Pose3, Session, SpaceSweep, Stamp, TrajectoryPose};
use mapwright_eval::{EvalError, RevisitReport, RevisitScan, RevisitSettings, revisit_errors};
use std::sync::Arc;

/// The keyframes of a session that are drawn.
pub(crate) struct Revisits {
    scans: Vec<RevisitScan>,
    sweeps: Vec<Arc<SpaceSweep>>,
    pub(crate) settings: RevisitSettings,
}

impl Revisits {
    /// Those at places that count; visits lie within so many metres of each other. None where there are no points.
    pub(crate) fn of(session: &Session<SpaceSweep>, within_m: f64, counts: impl Fn(usize) -> bool) -> Option<Self> {
        let trajectory: Vec<_> = session.trajectory().collect();
        let (mut scans, mut sweeps) = (Vec::new(), Vec::new());
        for (place, keyframe) in session.keyframes().iter().enumerate().filter(|(place, _)| counts(*place)) {
            let at = session.scan_place(keyframe.scan).and_then(|scan| trajectory.get(scan));
            let (Some(at), Some(sweep)) = (at, &session.drawn()[place]) else { continue };
            scans.push(RevisitScan {
                stamp: at.stamp,
                number: keyframe.scan,
                map_from_robot: at.map_from_robot,
                robot_from_cloud: at.map_from_robot.between(session.map_from_keyframe()[place]),
            });
            sweeps.push(Arc::clone(sweep));
        }
        let sweep = sweeps.iter().find(|sweep| !sweep.points.is_empty())?;
        let range_m = rms_range_m(sweep);
        let settings = RevisitSettings {
            apart: RevisitSettings::apart_for(mean_step_m(&trajectory), within_m),
            within_m,
            ..RevisitSettings::for_range(range_m, sweep.sensor.sigma_m(range_m))
        };
        Some(Self { scans, sweeps, settings })
    }

    /// What registration asks of the map's poses, or of others.
    pub(crate) fn judge(&self, judged: Option<&[(Stamp, Pose3)]>) -> Result<RevisitReport, EvalError> {
        let points_m = |scan: usize| -> Vec<[f32; 3]> { self.sweeps[scan].points_m().collect() };
        revisit_errors(&self.scans, judged, points_m, &self.settings)
    }
}

/// How far the robot drives from scan to scan, metres.
fn mean_step_m(trajectory: &[TrajectoryPose<Pose3>]) -> f64 {
    let steps_m = trajectory.windows(2).map(|pair| pair[0].map_from_robot.distance(pair[1].map_from_robot));
    steps_m.sum::<f64>() / trajectory.len().saturating_sub(1).max(1) as f64
}

fn rms_range_m(sweep: &SpaceSweep) -> f64 {
    let square = |point: [f32; 3]| point.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>();
    (sweep.points_m().map(square).sum::<f64>() / sweep.points.len().max(1) as f64).sqrt()
}
