//! A map of space judged by its own clouds, where it came to a place twice.

use super::{errors_json, open};
use crate::args::EvalArgs;
use crate::failure::{Failure, Outcome};
use crate::session::{AnySession, read_any_session};
use crate::space::Revisits;
use crate::terminal::{count, say, say_json};
use mapwright::{Pose3, Stamp};
use mapwright_eval::RevisitReport;
use mapwright_formats::read_space_trajectory;
use serde_json::{Value, json};
use std::path::Path;

/// Judges each session, or each trajectory on the clouds of each session.
pub(super) fn run(args: &EvalArgs) -> Result<Outcome, Failure> {
    let (mut values, mut losses) = (Vec::new(), Vec::new());
    for results in &args.trajectories {
        let (clouds, lost) = read(results, args)?;
        losses.extend(lost);
        if args.trajectory.is_empty() {
            let report = judge(&clouds, results, None)?;
            told(args, &mut values, (results, &clouds), results, &report)?;
        }
        for path in &args.trajectory {
            let report = judge(&clouds, path, Some(&poses(path)?))?;
            told(args, &mut values, (results, &clouds), path, &report)?;
        }
    }
    if args.json {
        say_json(&Value::Array(values))?;
    } else if !losses.is_empty() {
        say(&losses.iter().map(|loss| format!("lost  {loss}\n")).collect::<String>())?;
    }
    Ok(Outcome::of_losses(&losses))
}

/// The clouds of a folder of results, and what was lost of it.
fn read(results: &Path, args: &EvalArgs) -> Result<(Revisits, Vec<String>), Failure> {
    let refused = |cause: &str| Failure::Session { path: results.to_owned(), cause: cause.to_owned() };
    let (AnySession::Space(session), losses) = read_any_session(results)? else {
        return Err(refused("--revisits needs a session of space, found one of the plane"));
    };
    let revisits = Revisits::of(&session).map(|revisits| revisits.within(args.within));
    let mut revisits = revisits.ok_or_else(|| refused("expected keyframes with points, found none"))?;
    revisits.settings.apart = args.apart.unwrap_or(revisits.settings.apart);
    Ok((revisits, losses))
}

fn judge(clouds: &Revisits, path: &Path, judged: Option<&[(Stamp, Pose3)]>) -> Result<RevisitReport, Failure> {
    clouds.judge(judged).map_err(|cause| Failure::Score { path: path.to_owned(), cause })
}

fn told(
    args: &EvalArgs,
    values: &mut Vec<Value>,
    (results, clouds): (&Path, &Revisits),
    path: &Path,
    report: &RevisitReport,
) -> Result<(), Failure> {
    if args.json {
        let mut value = to_json(path, results, report);
        value["scans_apart"] = json!(clouds.settings.apart);
        values.push(value);
        return Ok(());
    }
    say(&words(path, clouds.settings.apart, report))
}

fn poses(path: &Path) -> Result<Vec<(Stamp, Pose3)>, Failure> {
    let read = open(path, read_space_trajectory)?;
    if read.is_numbered {
        let cause = "expected stamps, by which poses are paired with clouds, found KITTI's rows without";
        return Err(Failure::Log(format!("{}: {cause}", path.display())));
    }
    Ok(read.poses)
}

fn words(path: &Path, apart: u64, report: &RevisitReport) -> String {
    let (pairs, apart) = (count(report.pairs as u64, "pair"), count(apart, "scan"));
    let mut text = format!("{}: {pairs} of different visits ({apart} and more apart) registered", path.display());
    text += &format!(
        ", {} left out as too little fits, {} as a direction is left open\n",
        report.not_fitting, report.loose
    );
    if report.without_pose > 0 {
        text += &format!("  {} without a pose of that stamp\n", count(report.without_pose as u64, "cloud"));
    }
    if let Some((errors, (metres, degrees))) = report.corrections.as_ref().zip(report.percentile_90) {
        let (moved, turned) = (errors.translation_m, errors.rotation_deg);
        text += &format!(
            "  correction  median {:.4} m, 90 % within {metres:.4} m, max {:.4}  |  median {:.3} deg, 90 % within {degrees:.3} deg, max {:.3}\n",
            moved.median, moved.max, turned.median, turned.max
        );
    }
    text
}

fn to_json(path: &Path, results: &Path, report: &RevisitReport) -> Value {
    json!({
        "trajectory": path.display().to_string(),
        "clouds_of": results.display().to_string(),
        "clouds": report.scans,
        "without_pose": report.without_pose,
        "pairs": report.pairs,
        "not_fitting": report.not_fitting,
        "loose": report.loose,
        "corrections": report.corrections.as_ref().map(errors_json),
        "percentile_90_m": report.percentile_90.map(|(metres, _)| metres),
        "percentile_90_deg": report.percentile_90.map(|(_, degrees)| degrees),
    })
}
