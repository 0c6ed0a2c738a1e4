//! Errors beside a reference, over time.

use super::html::escaped;
use super::plot::{Line, Plot, significant};
use super::run::Run;
use crate::failure::Failure;
use mapwright::{Pose3, Stamp};
use mapwright_eval::{
    Alignment, Delta, ErrorAt, ErrorSeries, ErrorStats, EvalError, RpeSettings, StampedPose, error_series,
    space_error_series,
};
use mapwright_formats::{open_log, read_space_trajectory};
use mapwright_geom::Pose2;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Steps that relative errors are of, metres of way.
const STEP_M: f64 = 1.0;
/// What a simulated run writes beside its results.
const TRUTH: &str = "truth.tum";

/// A trajectory that others are compared with.
pub(super) struct Reference {
    pub(super) name: String,
    poses: Vec<(Stamp, Pose3)>,
    /// KITTI's rows have no stamps.
    is_numbered: bool,
}

/// The errors of a run beside it.
pub(super) struct Errors {
    pub(super) series: ErrorSeries,
    /// Poses of the run, some of which have no counterpart.
    poses: usize,
}

impl Reference {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let file = File::open(path).map_err(|error| Failure::open(path, error))?;
        let read = open_log(file).and_then(read_space_trajectory).map_err(|cause| Failure::read(path, cause))?;
        Ok(Self { name: path.display().to_string(), poses: read.poses, is_numbered: read.is_numbered })
    }

    /// The one that is given, or the truth that a simulated run has left in its folder.
    pub(super) fn of(given: Option<&PathBuf>, run: &Run) -> Result<Option<Self>, Failure> {
        let path = given.cloned().or_else(|| run.results.beside(TRUTH));
        path.map(|path| Self::read(&path)).transpose()
    }

    /// A run's own trajectory, for another one.
    pub(super) fn of_run(run: &Run) -> Self {
        Self { name: run.name.clone(), poses: run.trajectory(), is_numbered: false }
    }

    /// A run's errors beside it.
    pub(super) fn errors(&self, run: &Run) -> Result<Errors, Failure> {
        let failed = |cause: EvalError| Failure::Score { path: PathBuf::from(&self.name), cause };
        let trajectory = run.trajectory();
        let stamped = self.stamped(&trajectory)?;
        let steps = RpeSettings { delta: Delta::Metres(STEP_M), ..RpeSettings::default() };
        let series = if run.drawn.is_space {
            space_error_series(&stamped, &trajectory, Alignment::Rigid, &steps)
        } else {
            error_series(&in_plane(&stamped), &in_plane(&trajectory), Alignment::Rigid, &steps)
        };
        Ok(Errors { series: series.map_err(failed)?, poses: trajectory.len() })
    }

    /// With stamps: rows without any belong to the run's scans in order, where they are as many.
    fn stamped(&self, trajectory: &[(Stamp, Pose3)]) -> Result<Vec<(Stamp, Pose3)>, Failure> {
        if !self.is_numbered {
            return Ok(self.poses.clone());
        }
        if self.poses.len() != trajectory.len() {
            return Err(Failure::Log(format!(
                "{}: expected stamps, or a row for each of the {} scans, found {} of KITTI's rows without stamps",
                self.name,
                trajectory.len(),
                self.poses.len()
            )));
        }
        Ok(trajectory.iter().zip(&self.poses).map(|((stamp, _), (_, pose))| (*stamp, *pose)).collect())
    }
}

fn in_plane(poses: &[(Stamp, Pose3)]) -> Vec<StampedPose> {
    let planar = |&(stamp, pose): &(Stamp, Pose3)| {
        let yaw = pose.rotation.euler_angles().2;
        StampedPose { stamp, world_from_robot: Pose2::new(pose.translation.x, pose.translation.y, yaw) }
    };
    poses.iter().map(planar).collect()
}

impl Errors {
    pub(super) fn ate_m(&self) -> Option<f64> {
        self.absolute_m().map(|stats| stats.rmse)
    }

    pub(super) fn rpe_m(&self) -> Option<f64> {
        self.relative(|error| error.translation_m).map(|stats| stats.rmse)
    }

    fn absolute_m(&self) -> Option<ErrorStats> {
        stats(&self.series.absolute, |error| error.translation_m)
    }

    fn relative(&self, pick: fn(&ErrorAt) -> f64) -> Option<ErrorStats> {
        stats(&self.series.relative, pick)
    }

    /// A sentence.
    pub(super) fn words(&self) -> String {
        let Some(absolute) = self.absolute_m() else { return String::new() };
        let mut text = format!(
            "ATE {} m rms, at most {} m, over {} of {} poses",
            significant(absolute.rmse),
            significant(absolute.max),
            absolute.count,
            self.poses
        );
        if let (Some(m), Some(deg)) =
            (self.relative(|error| error.translation_m), self.relative(|error| error.rotation_deg))
        {
            text += &format!(
                "; RPE over {STEP_M:.0} m of way {} m and {}° rms",
                significant(m.rmse),
                significant(deg.rmse)
            );
        }
        text + "."
    }
}

fn stats(errors: &[ErrorAt], pick: fn(&ErrorAt) -> f64) -> Option<ErrorStats> {
    ErrorStats::of(&errors.iter().map(pick).collect::<Vec<_>>())
}

/// Errors of one or of two runs beside a reference, over time.
pub(super) fn plots(reference: &str, runs: &[(&str, &Run, &Errors)]) -> String {
    let length_s = runs.iter().map(|(_, run, _)| run.length_s()).fold(0.0, f64::max);
    let plot = |title: &str, unit: &str, pick: fn(&Errors) -> &[ErrorAt], value: fn(&ErrorAt) -> f64| {
        let lines = runs.iter().map(|(name, run, errors)| Line {
            name,
            values: pick(errors).iter().map(|error| (run.seconds(error.stamp), value(error))).collect(),
            pauses: run.clock.pauses(),
        });
        Plot { title, unit, length_s, lines: lines.collect() }.to_html()
    };
    let mut text = format!("<p>Beside {}, aligned rigidly. ", escaped(reference));
    for (name, _, errors) in runs {
        let name = if runs.len() > 1 { format!("{name}: ") } else { String::new() };
        text += &escaped(&format!("{name}{} ", errors.words()));
    }
    text += "</p>\n<div class=\"plots\">";
    text += &plot("Absolute error (ATE)", "m", |errors| &errors.series.absolute, |error| error.translation_m);
    text += &plot("Heading error", "°", |errors| &errors.series.absolute, |error| error.rotation_deg);
    text += &plot(
        "Relative error over 1 m of way (RPE)",
        "m",
        |errors| &errors.series.relative,
        |error| error.translation_m,
    );
    text += &plot(
        "Relative heading error over 1 m of way",
        "°",
        |errors| &errors.series.relative,
        |error| error.rotation_deg,
    );
    text + "</div>\n"
}
