//! What a run in space has made, for `report.json` and for people.

use super::inertial::Felt;
use super::simulated::AgainstTruth;
use super::source::Read;
use super::tally::Tally;
use crate::pieces::Pieces;
use crate::report::{in_detail, remarks};
use crate::terminal::{count, duration, grouped};
use crate::verdict::Usable;
use mapwright::{BeamCounts, EdgeKind, Pose3, Session, SpaceSweep, Stamp, Status, Verdict};
use mapwright_clouds::{Notes, ReferenceFrame};
use mapwright_eval::{Alignment, RpeSettings, SegmentError, SpaceErrors, space_errors};
use serde_json::{Map, Value, json};

/// What was made.
#[derive(Debug, Clone)]
pub(super) struct Results {
    pub(super) log_s: f64,
    path_m: f64,
    pieces: Pieces,
    climbed_m: f64,
    keyframes: usize,
    closures: usize,
    candidates: usize,
    withdrawn: usize,
    corrections: u32,
    resolution_m: f64,
    map_points: usize,
    beside: Beside,
    /// Of a simulated drive.
    truth: Option<AgainstTruth>,
    felt: Option<Felt>,
}

/// What a run says beside the poses that came with its recording.
#[derive(Debug, Clone, Default)]
pub(super) struct Beside {
    /// The file that it was compared with, and the errors.
    pub(super) errors: Option<(String, SpaceErrors)>,
    /// Why others were not compared.
    pub(super) refused: Vec<String>,
}

impl Beside {
    /// Compares with the first of the references that it can be compared with.
    pub(super) fn of(read: &Read, way: &[(Stamp, Pose3)]) -> Self {
        let robot_from_sensor = read.robot_from_sensor();
        let sensor: Vec<_> = way.iter().map(|&(stamp, pose)| (stamp, pose * robot_from_sensor)).collect();
        let mut beside = Self::default();
        for reference in &read.references {
            if reference.frame == ReferenceFrame::Camera {
                let reason = format!("{} not compared: its poses are those of {}", reference.file, reference.frame);
                beside.refused.push(reason);
                continue;
            }
            match space_errors(&reference.poses, &sensor, Alignment::Rigid, &RpeSettings::default()) {
                Ok(errors) => {
                    beside.errors = Some((reference.file.clone(), errors));
                    break;
                }
                Err(cause) => beside.refused.push(format!("{} not compared: {cause}", reference.file)),
            }
        }
        beside
    }
}

impl Results {
    pub(super) fn of(
        session: &Session<SpaceSweep>,
        (way, path_m): (&[(Stamp, Pose3)], f64),
        resolution_m: f64,
        map_points: usize,
        beside: Beside,
        truth: Option<AgainstTruth>,
    ) -> Self {
        let heights = || way.iter().map(|(_, pose)| pose.translation.z);
        let climbed_m = heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min);
        let stamps = || way.iter().map(|(stamp, _)| *stamp);
        let log_s = stamps().max().zip(stamps().min()).map_or(0.0, |(last, first)| last.secs_since(first));
        let withdrawn = session.candidates().iter().filter(|c| matches!(c.verdict, Verdict::Withdrawn(_))).count();
        Self {
            log_s,
            path_m,
            pieces: Pieces::of(session),
            climbed_m: climbed_m.max(0.0),
            keyframes: session.keyframes().len(),
            closures: session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count(),
            candidates: session.candidates().len(),
            withdrawn,
            corrections: session.corrections(),
            resolution_m,
            map_points,
            beside,
            truth,
            felt: None,
        }
    }

    /// The same with what a run says of inertial readings.
    pub(super) fn feeling(self, felt: Option<Felt>) -> Self {
        Self { felt, ..self }
    }

    /// What is apart, in words.
    pub(super) fn losses(&self) -> Vec<String> {
        self.pieces.losses().into_iter().chain(self.felt.as_ref().and_then(Felt::loss)).collect()
    }

    /// What is odd about it, in words.
    pub(super) fn odd(&self) -> Vec<String> {
        self.felt.as_ref().map_or_else(Vec::new, Felt::odd)
    }
}

/// What was noted, in words: what was lost, and what is only odd.
pub(crate) fn notes_in_words(notes: &Notes) -> (Vec<String>, Vec<String>) {
    let words = notes.kinds.iter().map(|(kind, noted)| {
        let first = noted.first.first().map_or_else(String::new, |first| format!(", first {first}"));
        (kind.loses_data(), format!("{kind}: {}{first}", grouped(noted.count)))
    });
    let (losses, odd): (Vec<_>, Vec<_>) = words.partition(|(is_loss, _)| *is_loss);
    let plain = |words: Vec<(bool, String)>| words.into_iter().map(|(_, words)| words).collect();
    (plain(losses), plain(odd))
}

/// The same with all places that are known.
pub(crate) fn notes_json(notes: &Notes) -> Value {
    let noted = notes.kinds.iter().map(|(kind, noted)| {
        let first: Vec<String> = noted.first.iter().map(ToString::to_string).collect();
        (kind.to_string(), json!({ "count": noted.count, "first": first }))
    });
    Value::Object(noted.collect::<Map<String, Value>>())
}

pub(super) fn to_json(
    name: &str,
    read: &Read,
    tally: &Tally,
    results: &Results,
    (usable, losses): (&Usable, &[String]),
) -> Value {
    let (run_count, runs) = tally.runs.report();
    let BeamCounts { returns, no_return, too_near, not_a_number, refused, moving, .. } = tally.points;
    let mut report = json!({
        "verdict": usable.to_json(),
        "log": name,
        "recording": {
            "kind": read.kind,
            "frames": read.frames,
            "sensor": read.sensor.as_ref().map(|sensor| &sensor.name),
            "decisions": read.decisions,
            "read": read.json,
            "notes": notes_json(&read.notes),
        },
        "clouds": tally.clouds,
        "log_s": results.log_s,
        "points": {
            "returns": returns, "no_return": no_return, "too_near": too_near, "not_a_number": not_a_number, "refused": refused,
            "moving": moving,
        },
        "status": {
            "tracking": tally.status(Status::Tracking),
            "degraded": tally.status(Status::Degraded),
            "lost": tally.status(Status::Lost),
            "run_count": run_count,
            "runs": runs,
        },
        "matches": {
            "median_inlier_share": tally.median_inlier_share(),
            "restarted": tally.restarted,
            "evaluations": tally.evaluations,
        },
        "refused": tally.refused,
        "path_m": results.path_m,
        "climbed_m": results.climbed_m,
        "keyframes": results.keyframes,
        "loops": {
            "candidates": results.candidates,
            "closures": results.closures,
            "withdrawn": results.withdrawn,
            "corrections": results.corrections,
        },
        "pieces": results.pieces.to_json(),
        "resolution_m": results.resolution_m,
        "map_points": results.map_points,
        "reference": results.beside.errors.as_ref().map(|(file, errors)| json!({
            "file": file,
            "pairs": errors.pairs,
            "ate_rmse_m": errors.absolute.translation_m.rmse,
            "ate_max_m": errors.absolute.translation_m.max,
            "rpe_median_m": errors.relative.translation_m.median,
            "rpe_rmse_m": errors.relative.translation_m.rmse,
            "rpe_median_deg": errors.relative.rotation_deg.median,
            "rpe_rmse_deg": errors.relative.rotation_deg.rmse,
            "kitti_percent": errors.segments.as_ref().map(|segments| segments.all.translation_percent),
            "kitti_deg_per_100_m": errors.segments.as_ref().map(|segments| segments.all.rotation_deg_per_100_m),
        })),
        "imu": results.felt.as_ref().map(Felt::to_json),
        "not_compared": results.beside.refused,
        "losses": losses,
    });
    if tally.points.uncertain > 0 {
        report["points"]["uncertain"] = json!(tally.points.uncertain);
    }
    if let Some(truth) = &results.truth {
        report["against_truth"] = truth.to_json();
    }
    report
}

/// What a run says at its end, in the order in which one wants to know it: whether the map can be used; what was made and how good it is, what was
/// lost, where it is, and then details.
pub(super) fn to_words(
    (read, tally, results): (&Read, &Tally, &Results),
    (name, timing, usable): (&str, &Value, &Usable),
    (losses, odd): (&[String], &[String]),
    written: &str,
) -> String {
    let said = [&read.said, odd].concat();
    let refused = results.beside.refused.iter().map(|refused| format!("beside   {refused}\n"));
    let details = read.lines.clone() + &refused.collect::<String>() + &remarks(&[], &said);
    format!(
        "{}{name}: {}{}{written}{}",
        usable.words(),
        numbers(read, tally, results, timing),
        remarks(losses, &[]),
        in_detail(&details)
    )
}

fn numbers(read: &Read, tally: &Tally, results: &Results, timing: &Value) -> String {
    let ms = timing["total_s"].as_f64().unwrap_or(0.0) * 1e3 / tally.clouds.max(1) as f64;
    let ms = if tally.clouds > 0 { format!("; {ms:.1} ms a cloud") } else { String::new() };
    let mut words = format!(
        "{}, {} over {}; {:.1} m of way, {:.1} m of height\n",
        read.kind,
        count(tally.clouds, "cloud"),
        duration(results.log_s),
        results.path_m,
        results.climbed_m
    );
    // the first cloud meets nothing that is known
    let fit = tally.median_inlier_share().filter(|_| tally.clouds > 1);
    let fit =
        fit.map_or_else(String::new, |share| format!("; {:.0} % of the known points fit (median)", 100.0 * share));
    let tracked = format!(
        "tracked  {} of {}, {} doubtful, {} lost{fit}\n",
        grouped(tally.status(Status::Tracking)),
        grouped(tally.clouds),
        grouped(tally.status(Status::Degraded)),
        grouped(tally.status(Status::Lost)),
    );
    if tally.clouds > 0 {
        words += &tracked;
    }
    let BeamCounts { returns, uncertain, .. } = tally.points;
    if uncertain > 0 {
        let share = 100.0 * f64::from(uncertain) / (f64::from(uncertain) + f64::from(returns)).max(1.0);
        words += &format!(
            "points   {} of them ({share:.0} %) are not used: their depth is uncertain by more than a third of a voxel\n",
            grouped(u64::from(uncertain))
        );
    }
    let loops = match results.candidates {
        0 => "no candidate for a closure".to_owned(),
        candidates => {
            format!("{} of {}", count(results.closures as u64, "closure"), count(candidates as u64, "candidate"))
        }
    };
    words += &format!(
        "map      {} in voxels from {:.2} m, {}, {loops}{ms}\n",
        count(results.map_points as u64, "point"),
        results.resolution_m,
        count(results.keyframes as u64, "keyframe"),
    );
    words += &results.pieces.words();
    words += &results.felt.as_ref().map_or_else(String::new, Felt::to_words);
    if let Some((file, errors)) = &results.beside.errors {
        words += &format!(
            "beside   {file}: {} poses, ATE {:.4} m (worst {:.3}), from cloud to cloud {:.4} m, {:.3} deg (median)\n",
            errors.pairs,
            errors.absolute.translation_m.rmse,
            errors.absolute.translation_m.max,
            errors.relative.translation_m.median,
            errors.relative.rotation_deg.median
        );
        if let Some(segments) = &errors.segments {
            let SegmentError { translation_percent, rotation_deg_per_100_m, .. } = segments.all;
            words += &format!(
                "         over 100 to 800 m {translation_percent:.3} %, {rotation_deg_per_100_m:.4} deg in 100 m\n"
            );
        }
    }
    words + &results.truth.as_ref().map_or_else(String::new, AgainstTruth::to_words)
}
