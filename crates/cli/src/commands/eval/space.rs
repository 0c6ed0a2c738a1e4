//! Trajectories in space against a reference.

use super::{Matches, alignment, errors_json, open, warn};
use crate::args::EvalArgs;
use crate::failure::{Failure, Outcome};
use crate::terminal::{count, say, say_json};
use mapwright_eval::{PoseErrors, RpeSettings, SegmentError, SpaceErrors, space_errors};
use mapwright_formats::{SpaceTrajectory, read_space_trajectory, read_stamps};
use mapwright_geom::{Pose3, Stamp};
use nalgebra::{Quaternion, UnitQuaternion};
use serde_json::{Value, json};
use std::path::Path;

/// The reference and what is compared with it.
pub(super) struct Trajectories {
    reference: SpaceTrajectory,
    /// Each with whether its rows or those of the reference were paired by their numbers, for only one of both has stamps.
    estimates: Vec<(SpaceTrajectory, bool)>,
}

/// Reads all; none where everything lies in the plane, and is compared there.
pub(super) fn trajectories(args: &EvalArgs, reference: &Path) -> Result<Option<Trajectories>, Failure> {
    let times = args.times.as_ref().map(|path| open(path, read_stamps).map(|stamps| (path, stamps))).transpose()?;
    let read = |path: &Path| {
        let mut read = open(path, read_space_trajectory)?;
        if let Some((file, stamps)) = times.as_ref().filter(|_| read.is_numbered) {
            stamp(&mut read, stamps).map_err(|cause| refused(path, &format!("{cause} in {}", file.display())))?;
        }
        Ok(read)
    };
    let (mut reference, name) = (read(reference)?, reference);
    let mut estimates = args.trajectories.iter().map(|path| read(path)).collect::<Result<Vec<_>, Failure>>()?;
    let is_planar = |read: &SpaceTrajectory| !read.is_numbered && times.is_none() && read.is_planar();
    if is_planar(&reference) && estimates.iter().all(is_planar) {
        return Ok(None);
    }
    let of_reference = reference.is_numbered;
    if let Some(stamped) = estimates.iter().find(|estimate| of_reference && !estimate.is_numbered) {
        let stamps: Vec<_> = stamped.poses.iter().map(|pose| pose.0).collect();
        stamp(&mut reference, &stamps).map_err(|cause| refused(name, &without_stamps(&cause)))?;
    }
    let stamps: Vec<_> = reference.poses.iter().map(|pose| pose.0).collect();
    let mut paired = Vec::new();
    for (path, mut estimate) in args.trajectories.iter().zip(estimates.drain(..)) {
        let by_number = estimate.is_numbered != of_reference;
        if estimate.is_numbered != reference.is_numbered {
            stamp(&mut estimate, &stamps).map_err(|cause| refused(path, &without_stamps(&cause)))?;
        }
        paired.push((estimate, by_number));
    }
    Ok(Some(Trajectories { reference, estimates: paired }))
}

/// Why rows without stamps cannot be paired.
fn without_stamps(cause: &str) -> String {
    format!(
        "found KITTI's rows, which have no stamps, and they cannot be paired by their numbers: {cause} in the other trajectory; \
         give their stamps by --times FILE"
    )
}

fn refused(path: &Path, cause: &str) -> Failure {
    Failure::Log(format!("{}: {cause}", path.display()))
}

fn stamp(read: &mut SpaceTrajectory, stamps: &[Stamp]) -> Result<(), String> {
    if read.poses.len() != stamps.len() {
        return Err(format!(
            "expected {} for its poses, found {}",
            count(read.poses.len() as u64, "stamp"),
            stamps.len()
        ));
    }
    read.poses.iter_mut().zip(stamps).for_each(|(pose, stamp)| pose.0 = *stamp);
    read.is_numbered = false;
    Ok(())
}

pub(super) fn compare(args: &EvalArgs, trajectories: &Trajectories) -> Result<Outcome, Failure> {
    let settings = RpeSettings { delta: args.delta, all_pairs: args.all_pairs, ..RpeSettings::default() };
    let (mut values, mut losses) = (Vec::new(), Vec::new());
    for (path, (estimate, by_number)) in args.trajectories.iter().zip(&trajectories.estimates) {
        let reference = &trajectories.reference.poses;
        let errors = space_errors(reference, &estimate.poses, alignment(args.alignment), &settings)
            .map_err(|cause| Failure::Score { path: path.clone(), cause })?;
        let pairs = errors.pairs + errors.not_finite;
        let matches = Matches { pairs, reference: reference.len(), estimate: estimate.poses.len() };
        let stamps = |poses: &[(Stamp, Pose3)]| poses.iter().map(|pose| pose.0).collect::<Vec<_>>();
        losses.extend(matches.few(path, &stamps(reference), &stamps(&estimate.poses)));
        let reread = space_errors(reference, &w_first(&estimate.poses), alignment(args.alignment), &settings);
        losses.extend(reread.ok().and_then(|reread| order_of_quaternions(path, &errors, &reread)));
        if !args.json {
            say(&words(path, &matches, *by_number, &errors))?;
        }
        let mut value = to_json(path, &errors);
        value["matched"] = matches.to_json();
        value["paired_by_number"] = json!(by_number);
        values.push(value);
    }
    if args.json {
        say_json(&Value::Array(values))?;
    }
    warn(args, &losses)
}

/// The poses, had their quaternions been written with w first.
fn w_first(poses: &[(Stamp, Pose3)]) -> Vec<(Stamp, Pose3)> {
    let reread = |pose: &Pose3| {
        let [w, x, y, z]: [f64; 4] = pose.rotation.coords.into();
        Pose3 { rotation: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)), ..*pose }
    };
    poses.iter().map(|(stamp, pose)| (*stamp, reread(pose))).collect()
}

/// Rotations that are wrong by so many times less with w first were written so.
const W_FIRST_BETTER: f64 = 4.0;

fn order_of_quaternions(path: &Path, read: &SpaceErrors, reread: &SpaceErrors) -> Option<String> {
    let [as_read, w_first] = [read, reread].map(|errors| errors.absolute.rotation_deg.rmse);
    (W_FIRST_BETTER * w_first < as_read).then(|| {
        format!(
            "{}: its quaternions have w first, expected x y z w: read so, its rotations are off by {w_first:.1} deg, not by {as_read:.1} deg",
            path.display()
        )
    })
}

fn words(path: &Path, matches: &Matches, by_number: bool, errors: &SpaceErrors) -> String {
    let row = |name: &str, PoseErrors { translation_m, rotation_deg }: &PoseErrors| {
        format!(
            "  {name} {:>6}  rmse {:.4} m, mean {:.4}, median {:.4}, max {:.4}  |  rmse {:.3} deg, max {:.3}\n",
            translation_m.count,
            translation_m.rmse,
            translation_m.mean,
            translation_m.median,
            translation_m.max,
            rotation_deg.rmse,
            rotation_deg.max
        )
    };
    let how =
        if by_number { "paired by their numbers, for one of both has no stamps".to_owned() } else { matches.words() };
    let mut text = format!("{}: in space; {how}\n", path.display());
    text += &row("ATE", &errors.absolute);
    text += &row("RPE", &errors.relative);
    if let Some(segments) = &errors.segments {
        text += &segment_words("KITTI", &segments.all);
        segments.by_length.iter().for_each(|error| text += &segment_words(&format!("{:>4} m", error.length_m), error));
    }
    if errors.scale != 1.0 {
        text += &format!("  scale {:.6}\n", errors.scale);
    }
    text
}

fn segment_words(name: &str, error: &SegmentError) -> String {
    format!(
        "  {name} {:>4}  {:.4} %  |  {:.4} deg in 100 m\n",
        error.count, error.translation_percent, error.rotation_deg_per_100_m
    )
}

fn to_json(path: &Path, errors: &SpaceErrors) -> Value {
    let segment = |error: &SegmentError| {
        json!({
            "length_m": error.length_m,
            "count": error.count,
            "translation_percent": error.translation_percent,
            "rotation_deg_per_100_m": error.rotation_deg_per_100_m,
        })
    };
    json!({
        "trajectory": path.display().to_string(),
        "space": true,
        "scale": errors.scale,
        "not_finite": errors.not_finite,
        "ate": errors_json(&errors.absolute),
        "rpe": errors_json(&errors.relative),
        "kitti": errors.segments.as_ref().map(|segments| json!({
            "all": segment(&segments.all),
            "by_length": segments.by_length.iter().map(segment).collect::<Vec<_>>(),
        })),
    })
}
