//! How well what was seen of a place on different visits agrees, in a finished map of space.

use mapwright::{Pose3, Session, SpaceSweep, Stamp, TrajectoryPose};
use mapwright_eval::{
    EvalError, RevisitFit, RevisitReport, RevisitScan, RevisitSettings, revisit_errors, revisit_fits,
};
use std::sync::Arc;

/// The keyframes of a session that are drawn.
pub(crate) struct Revisits {
    scans: Vec<RevisitScan>,
    /// The places of their keyframes in the session, rising.
    places: Vec<usize>,
    sweeps: Vec<Arc<SpaceSweep>>,
    pub(crate) settings: RevisitSettings,
    /// How far the robot drives from scan to scan, metres.
    step_m: f64,
}

impl Revisits {
    /// Those of a session; none where there are no points.
    pub(crate) fn of(session: &Session<SpaceSweep>) -> Option<Self> {
        let trajectory: Vec<_> = session.trajectory().collect();
        let (mut scans, mut places, mut sweeps) = (Vec::new(), Vec::new(), Vec::new());
        for (place, keyframe) in session.keyframes().iter().enumerate() {
            let at = session.scan_place(keyframe.scan).and_then(|scan| trajectory.get(scan));
            let (Some(at), Some(sweep)) = (at, &session.drawn()[place]) else { continue };
            scans.push(RevisitScan {
                stamp: at.stamp,
                number: keyframe.scan,
                map_from_robot: at.map_from_robot,
                robot_from_cloud: at.map_from_robot.between(session.map_from_keyframe()[place]),
                sensor_m: sweep.origin_m(),
            });
            places.push(place);
            sweeps.push(Arc::clone(sweep));
        }
        let sweep = sweeps.iter().find(|sweep| !sweep.points.is_empty())?;
        let range_m = rms_range_m(sweep);
        let settings = RevisitSettings::for_range(range_m, sweep.sensor.sigma_m(range_m));
        Some(Self { scans, places, sweeps, settings, step_m: mean_step_m(&trajectory) })
    }

    /// The same with visits that lie within so many metres of each other.
    pub(crate) fn within(self, within_m: f64) -> Self {
        let apart = RevisitSettings::apart_for(self.step_m, within_m);
        Self { settings: RevisitSettings { apart, within_m, ..self.settings }, ..self }
    }

    /// What registration says of pairs of keyframes, by their places in the session, in the map.
    pub(super) fn fits(&self, pairs: &[[usize; 2]]) -> Vec<RevisitFit> {
        let scan = |place: usize| self.places.binary_search(&place).ok();
        let pairs: Vec<[usize; 2]> = pairs.iter().filter_map(|&[a, b]| Some([scan(a)?, scan(b)?])).collect();
        revisit_fits(&self.scans, &pairs, self.points_m(), &self.settings)
    }

    /// What registration asks of the map's poses, or of others.
    pub(crate) fn judge(&self, judged: Option<&[(Stamp, Pose3)]>) -> Result<RevisitReport, EvalError> {
        revisit_errors(&self.scans, judged, self.points_m(), &self.settings)
    }

    fn points_m(&self) -> impl Fn(usize) -> Vec<[f32; 3]> + '_ {
        |scan| self.sweeps[scan].points_m().collect()
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
