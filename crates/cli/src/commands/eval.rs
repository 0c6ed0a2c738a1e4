//! `mapwright eval`

mod revisits;
mod space;

use crate::args::{AlignTo, EvalArgs};
use crate::failure::{Failure, Outcome};
use crate::foreign::kind_at;
use crate::report::remarks;
use crate::terminal::{count, grouped, say, say_json};
use mapwright_eval::{
    Alignment, Ate, ErrorStats, MAX_STAMP_DIFFERENCE_S, PoseErrors, Relation, RelationReport, Rpe, RpeSettings,
    StampedPose, ate, clock_offset_s, offset_words, relation_errors, rpe,
};
use mapwright_formats::{FormatError, LogStream, open_log, read_relations, read_trajectory};
use mapwright_geom::Stamp;
use serde_json::{Value, json};
use std::fmt::Write;
use std::fs::File;
use std::path::Path;

/// What is read of a folder of results.
const TRAJECTORY: &str = "trajectory.tum";
/// Where a smaller share of the poses has a partner, clocks that differ by a constant are looked for.
const MATCHED_SHARE: f64 = 0.9;

pub(super) fn run(args: &EvalArgs) -> Result<Outcome, Failure> {
    if args.revisits {
        return revisits::run(args);
    }
    match (&args.relations, &args.reference) {
        (Some(relations), _) => by_relations(args, &read_relation_file(relations)?),
        (None, Some(reference)) => match space::trajectories(args, reference)? {
            Some(trajectories) => space::compare(args, &trajectories),
            None => by_reference(args, &read_poses(reference)?),
        },
        (None, None) => Ok(Outcome::Done), // the command line demands one of them
    }
}

fn by_relations(args: &EvalArgs, relations: &[Relation]) -> Result<Outcome, Failure> {
    let (mut reports, mut losses) = (Vec::new(), Vec::new());
    for path in &args.trajectories {
        let report = relation_errors(&read_poses(path)?, relations);
        losses.extend(few_relations(path, &report));
        if !args.json {
            say(&relation_words(&path.display().to_string(), &report))?;
        }
        reports.push(report);
    }
    if args.json {
        let values = args.trajectories.iter().zip(&reports).map(|(path, report)| relation_json(path, report));
        say_json(&Value::Array(values.collect()))?;
    } else if reports.len() > 1 {
        say(&over_all(&reports))?;
    }
    warn(args, &losses)
}

/// What speaks against a score, as lines; beside JSON the exit code alone says so.
pub(super) fn warn(args: &EvalArgs, losses: &[String]) -> Result<Outcome, Failure> {
    if !args.json {
        say(&remarks(losses, &[]))?;
    }
    Ok(Outcome::of_losses(losses))
}

/// Less than half of the relations can be measured.
fn few_relations(path: &Path, report: &RelationReport) -> Option<String> {
    let all = report.used + report.missing + report.not_finite;
    let found = format!("{} of {} can be measured", report.used, count(all as u64, "relation"));
    (2 * report.used < all).then(|| format!("{}: only {found}: are both of the same drive?", path.display()))
}

/// How many poses were compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matches {
    pub(super) pairs: usize,
    pub(super) reference: usize,
    pub(super) estimate: usize,
}

impl Matches {
    /// Pairs are sought for each pose of the shorter trajectory.
    fn of(&self) -> usize {
        self.reference.min(self.estimate)
    }

    pub(super) fn words(&self) -> String {
        let whose = if self.estimate <= self.reference {
            "poses have a reference"
        } else {
            "poses of the reference have one of the trajectory"
        };
        format!(
            "{} of {} {whose} within {MAX_STAMP_DIFFERENCE_S} s",
            grouped(self.pairs as u64),
            grouped(self.of() as u64)
        )
    }

    /// Less than half of them, or less than there are once the clocks agree.
    pub(super) fn few(&self, path: &Path, reference: &[Stamp], estimate: &[Stamp]) -> Option<String> {
        if (self.pairs as f64) < MATCHED_SHARE * self.of() as f64
            && let Some(offset_s) = clock_offset_s(reference, estimate, MAX_STAMP_DIFFERENCE_S)
        {
            return Some(format!("{}: only {}: {}", path.display(), self.words(), offset_words(offset_s)));
        }
        let are_few = 2 * self.pairs < self.of();
        are_few.then(|| {
            format!("{}: only {}: are the clocks of both the same, and the drives?", path.display(), self.words())
        })
    }

    pub(super) fn to_json(self) -> Value {
        json!({ "pairs": self.pairs, "of": self.of(), "within_s": MAX_STAMP_DIFFERENCE_S })
    }
}

/// Mean and worst over several trajectories.
fn over_all(reports: &[RelationReport]) -> String {
    let errors: Vec<_> = reports.iter().filter_map(|report| report.all).collect();
    let stats = |pick: fn(&PoseErrors) -> f64| ErrorStats::of(&errors.iter().map(pick).collect::<Vec<_>>());
    match (stats(|e| e.translation_m.mean), stats(|e| e.rotation_deg.mean)) {
        (Some(metres), Some(degrees)) => format!(
            "over all {}: mean {:.4} m {:.3} deg, worst {:.4} m {:.3} deg, best {:.4} m {:.3} deg\n",
            errors.len(),
            metres.mean,
            degrees.mean,
            metres.max,
            degrees.max,
            metres.min,
            degrees.min
        ),
        _ => String::new(),
    }
}

/// Errors against relations as a table.
pub(super) fn relation_words(name: &str, report: &RelationReport) -> String {
    let mut text = format!("{name}: {} used, {} missing", count(report.used as u64, "relation"), report.missing);
    if report.not_finite > 0 {
        let _ = write!(text, ", {} not finite", report.not_finite);
    }
    text.push('\n');
    let rows = [("all", report.all), ("< 10 s apart", report.within_10_s), ("> 60 s apart", report.beyond_60_s)];
    for (what, errors) in rows {
        if let Some(PoseErrors { translation_m, rotation_deg }) = errors {
            let (metres, degrees) = (stats_words(&translation_m, "m"), stats_words(&rotation_deg, "deg"));
            let _ = writeln!(text, "  {what:<13} {:>6}  {metres}  |  {degrees}", translation_m.count);
        }
    }
    for missing in &report.first_missing {
        let (from, to) = (missing.relation.from.as_secs_f64(), missing.relation.to.as_secs_f64());
        let side = format!("{:?}", missing.side).to_lowercase();
        let _ =
            writeln!(text, "  missing       relation {}: {from:.6} to {to:.6}, no pose at {side}", missing.index + 1);
    }
    text
}

fn stats_words(stats: &ErrorStats, unit: &str) -> String {
    format!("{:.4} +- {:.4} {unit}, squared {:.6}, max {:.4}", stats.mean, stats.std, stats.mean_squared(), stats.max)
}

fn relation_json(path: &Path, report: &RelationReport) -> Value {
    let errors = |errors: &Option<PoseErrors>| errors.as_ref().map(errors_json);
    json!({
        "trajectory": path.display().to_string(),
        "used": report.used,
        "missing": report.missing,
        "not_finite": report.not_finite,
        "all": errors(&report.all),
        "within_10_s": errors(&report.within_10_s),
        "beyond_60_s": errors(&report.beyond_60_s),
    })
}

fn errors_json(errors: &PoseErrors) -> Value {
    json!({ "translation_m": stats_json(&errors.translation_m), "rotation_deg": stats_json(&errors.rotation_deg) })
}

pub(super) fn stats_json(stats: &ErrorStats) -> Value {
    json!({
        "count": stats.count, "mean": stats.mean, "std": stats.std, "rmse": stats.rmse, "median": stats.median,
        "min": stats.min, "max": stats.max, "squared_mean": stats.mean_squared(), "sse": stats.sse,
    })
}

fn by_reference(args: &EvalArgs, reference: &[StampedPose]) -> Result<Outcome, Failure> {
    let (mut values, mut losses) = (Vec::new(), Vec::new());
    for path in &args.trajectories {
        let score = |cause| Failure::Score { path: path.clone(), cause };
        let estimate = read_poses(path)?;
        let absolute = ate(reference, &estimate, alignment(args.alignment)).map_err(score)?;
        let settings = RpeSettings { delta: args.delta, all_pairs: args.all_pairs, ..RpeSettings::default() };
        let relative = rpe(reference, &estimate, &settings).map_err(score)?;
        let pairs = absolute.translation_m.count + absolute.not_finite;
        let matches = Matches { pairs, reference: reference.len(), estimate: estimate.len() };
        let stamps = |poses: &[StampedPose]| poses.iter().map(|pose| pose.stamp).collect::<Vec<_>>();
        losses.extend(matches.few(path, &stamps(reference), &stamps(&estimate)));
        if !args.json {
            say(&reference_words(path, &matches, &absolute, &relative))?;
        }
        let mut value = reference_json(path, &absolute, &relative);
        value["matched"] = matches.to_json();
        values.push(value);
    }
    if args.json {
        say_json(&Value::Array(values))?;
    }
    warn(args, &losses)
}

fn alignment(to: AlignTo) -> Alignment {
    match to {
        AlignTo::None => Alignment::None,
        AlignTo::Rigid => Alignment::Rigid,
        AlignTo::Similarity => Alignment::Similarity,
    }
}

fn reference_words(path: &Path, matches: &Matches, absolute: &Ate, relative: &Rpe) -> String {
    let row = |name: &str, metres: &ErrorStats, degrees: &ErrorStats| {
        format!(
            "  {name} {:>6}  rmse {:.4} m, mean {:.4}, median {:.4}, max {:.4}  |  rmse {:.3} deg, max {:.3}\n",
            metres.count, metres.rmse, metres.mean, metres.median, metres.max, degrees.rmse, degrees.max
        )
    };
    let scale = absolute.alignment.scale;
    let scaled = if scale == 1.0 { String::new() } else { format!("  scale {scale:.6}\n") };
    format!(
        "{}: {}\n{}{}{scaled}",
        path.display(),
        matches.words(),
        row("ATE", &absolute.translation_m, &absolute.rotation_deg),
        row("RPE", &relative.translation_m, &relative.rotation_deg)
    )
}

fn reference_json(path: &Path, absolute: &Ate, relative: &Rpe) -> Value {
    let both = |metres: &ErrorStats, degrees: &ErrorStats| json!({ "translation_m": stats_json(metres), "rotation_deg": stats_json(degrees) });
    json!({
        "trajectory": path.display().to_string(),
        "scale": absolute.alignment.scale,
        "not_finite": absolute.not_finite,
        "ate": both(&absolute.translation_m, &absolute.rotation_deg),
        "rpe": both(&relative.translation_m, &relative.rotation_deg),
    })
}

pub(super) fn read_relation_file(path: &Path) -> Result<Vec<Relation>, Failure> {
    let relations = open(path, read_relations)?;
    let planar =
        |r: &mapwright_formats::Relation| Relation { from: r.stamp_a, to: r.stamp_b, from_from_to: r.a_from_b() };
    Ok(relations.iter().map(planar).collect())
}

fn read_poses(path: &Path) -> Result<Vec<StampedPose>, Failure> {
    let poses = open(path, read_trajectory)?;
    Ok(poses.iter().map(|p| StampedPose { stamp: p.stamp, world_from_robot: p.world_from_robot }).collect())
}

fn open<T>(path: &Path, read: impl FnOnce(LogStream<File>) -> Result<T, FormatError>) -> Result<T, Failure> {
    let in_folder = path.join(TRAJECTORY);
    let path = if path.is_dir() { &in_folder } else { path };
    let file = File::open(path).map_err(|error| Failure::open(path, error))?;
    open_log(file).and_then(read).map_err(|cause| match kind_at(path).filter(|kind| !kind.is_trajectory()) {
        Some(kind) => Failure::Log(kind.instead(&path.display().to_string(), "rows of a trajectory or of relations")),
        None => Failure::read(path, cause),
    })
}
