//! Errors beside surveyed relations (Kümmerle et al. 2009), as `mapwright eval --relations` has them.

use super::html::escaped;
use super::run::Run;
use crate::failure::Failure;
use crate::terminal::count;
use mapwright_eval::{PoseErrors, Relation, RelationReport, StampedPose, relation_errors};
use mapwright_formats::{Relation as Row, open_log, read_relations};
use mapwright_geom::Pose2;
use std::fmt::Write;
use std::fs::File;
use std::path::{Path, PathBuf};

/// So many rows tell what a file of eight numbers a row is.
const LOOKED_AT: usize = 100;
/// Of a quaternion the length is one; so much may be lost where it is written with few digits.
const NEARLY_ONE: f64 = 0.05;

/// Surveyed relations, and the name of their file.
pub(super) struct Relations {
    pub(super) name: String,
    relations: Vec<Relation>,
}

impl Relations {
    fn read(path: &Path) -> Result<Self, Failure> {
        let rows = read_rows(path)?.map_err(|cause| Failure::read(path, cause))?;
        let relation = |row: &Row| Relation { from: row.stamp_a, to: row.stamp_b, from_from_to: row.a_from_b() };
        Ok(Self { name: path.display().to_string(), relations: rows.iter().map(relation).collect() })
    }

    /// What a run's errors are; of maps of space there are none.
    pub(super) fn errors(&self, run: &Run) -> Result<RelationReport, Failure> {
        if run.drawn.is_space {
            let why = "relations are scored in the plane, and this is a map of space";
            return Err(Failure::Usage(format!("{}: {why}", self.name)));
        }
        let planar =
            |pose: mapwright::Pose3| Pose2::new(pose.translation.x, pose.translation.y, pose.rotation.euler_angles().2);
        let trajectory = run.trajectory();
        let poses = trajectory.iter().map(|&(stamp, pose)| StampedPose { stamp, world_from_robot: planar(pose) });
        Ok(relation_errors(&poses.collect::<Vec<_>>(), &self.relations))
    }
}

/// What was asked for, told apart: a trajectory to compare with, and relations, which may have been given as the reference.
pub(super) fn told_apart<'a>(
    reference: Option<&'a PathBuf>,
    relations: Option<&PathBuf>,
) -> Result<(Option<&'a PathBuf>, Option<Relations>), Failure> {
    if let Some(path) = relations {
        return Ok((reference, Some(Relations::read(path)?)));
    }
    match reference {
        Some(path) if are_relations(path)? => Ok((None, Some(Relations::read(path)?))),
        reference => Ok((reference, None)),
    }
}

/// Whether rows of eight numbers are relations: those of a trajectory end with a quaternion.
fn are_relations(path: &Path) -> Result<bool, Failure> {
    let Ok(rows) = read_rows(path)? else { return Ok(false) };
    let has_quaternion = |row: &Row| {
        let [roll, pitch, yaw] = row.roll_pitch_yaw_rad;
        let square: f64 = [row.position_m[2], roll, pitch, yaw].iter().map(|v| v * v).sum();
        (square.sqrt() - 1.0).abs() < NEARLY_ONE
    };
    Ok(!rows.iter().take(LOOKED_AT).all(has_quaternion))
}

fn read_rows(path: &Path) -> Result<Result<Vec<Row>, mapwright_formats::FormatError>, Failure> {
    let file = File::open(path).map_err(|error| Failure::open(path, error))?;
    Ok(open_log(file).and_then(read_relations))
}

/// A table of the errors.
pub(super) fn table(report: &RelationReport) -> String {
    let mut text = format!("<p>{} used, {} missing", count(report.used as u64, "relation"), report.missing);
    if report.not_finite > 0 {
        let _ = write!(text, ", {} not finite", report.not_finite);
    }
    text += ".</p>\n<table><thead><tr><th scope=\"col\">relations</th><th scope=\"col\">number</th><th scope=\"col\">mean ± \
             deviation</th><th scope=\"col\">at most</th><th scope=\"col\">heading, mean ± deviation</th><th \
             scope=\"col\">at most</th></tr></thead><tbody>";
    let rows = [
        ("all", &report.all),
        ("less than 10 s apart", &report.within_10_s),
        ("more than 60 s apart", &report.beyond_60_s),
    ];
    for (what, errors) in rows {
        if let Some(PoseErrors { translation_m: m, rotation_deg: deg }) = errors {
            let _ = write!(
                text,
                "<tr><th scope=\"row\">{}</th><td>{}</td><td>{:.4} ± {:.4} m</td><td>{:.3} m</td><td>{:.3} ± {:.3}°</td>\
                 <td>{:.2}°</td></tr>",
                escaped(what),
                m.count,
                m.mean,
                m.std,
                m.max,
                deg.mean,
                deg.std,
                deg.max
            );
        }
    }
    text + "</tbody></table>\n"
}

/// What they are beside.
pub(super) fn heading(relations: &Relations) -> String {
    format!("<p>Beside {}, as <code>mapwright eval --relations</code> has them.</p>\n", escaped(&relations.name))
}
