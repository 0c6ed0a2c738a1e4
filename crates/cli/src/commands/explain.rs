//! `mapwright explain`

use crate::args::ExplainArgs;
use crate::closures::{CandidateRecord, ClosureFile, FragmentRecord, SlipRecord, VerdictName};
use crate::failure::{Failure, Outcome};
use crate::terminal::{count, say, say_json};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write;

pub(super) fn run(args: &ExplainArgs) -> Result<Outcome, Failure> {
    let file = ClosureFile::read(&args.results)?;
    let shown: Vec<_> = file.candidates.iter().filter(|candidate| is_wanted(args, candidate)).collect();
    if args.json {
        return to_json(args, &file, &shown);
    }
    say(&(summary(&file, shown.len()) + &groups(&shown) + &slips(args, &file)))?;
    Ok(Outcome::Done)
}

/// The candidates that are wanted as they stand in closures.json, and the slips.
fn to_json(args: &ExplainArgs, file: &ClosureFile, shown: &[&CandidateRecord]) -> Result<Outcome, Failure> {
    let slips = shown_slips(args, file);
    say_json(&json!({
        "keyframes": file.keyframes,
        "candidates_in_all": file.candidates.len(),
        "candidates": shown,
        "slips": slips,
    }))?;
    Ok(Outcome::Done)
}

fn is_wanted(args: &ExplainArgs, candidate: &CandidateRecord) -> bool {
    let refused = matches!(candidate.verdict, VerdictName::Refused | VerdictName::Withdrawn);
    let verdict = match (args.accepted, args.refused) {
        (true, _) => candidate.verdict == VerdictName::Accepted,
        (false, true) => refused,
        (false, false) => true,
    };
    verdict && args.keyframe.is_none_or(|keyframe| [candidate.from, candidate.to].contains(&keyframe))
}

fn summary(file: &ClosureFile, shown: usize) -> String {
    let mut verdicts: BTreeMap<VerdictName, u64> = BTreeMap::new();
    file.candidates.iter().for_each(|candidate| *verdicts.entry(candidate.verdict).or_default() += 1);
    let counted: Vec<_> = verdicts.iter().map(|(verdict, n)| format!("{n} {}", verdict.name())).collect();
    let (all, keyframes) = (file.candidates.len(), count(file.keyframes as u64, "keyframe"));
    let mut text = format!("{} among {keyframes}", count(all as u64, "candidate"));
    if all > 0 {
        let _ = write!(text, ": {}", counted.join(", "));
    } else {
        text += ": nowhere did the robot come near a place that it had left, or see one that looked like it";
    }
    let stands = |candidate: &&CandidateRecord| candidate.joins.is_some() && candidate.verdict == VerdictName::Accepted;
    if file.candidates.iter().any(|candidate| candidate.joins.is_some()) {
        let joins = file.candidates.iter().filter(stands).count();
        let _ = write!(
            text,
            "; {} fragments over a break",
            if joins == 1 { "1 joins".to_owned() } else { format!("{joins} join") }
        );
    }
    if shown < all {
        let _ = write!(text, "; shown: {shown}");
    }
    text + "\n"
}

/// By verdict and reason, in the order of the run within each.
fn groups(shown: &[&CandidateRecord]) -> String {
    let mut groups: BTreeMap<(VerdictName, &str), Vec<&CandidateRecord>> = BTreeMap::new();
    for candidate in shown {
        groups.entry((candidate.verdict, candidate.reason.as_deref().unwrap_or(""))).or_default().push(candidate);
    }
    let mut text = String::new();
    for ((verdict, reason), candidates) in groups {
        let reason = if reason.is_empty() { String::new() } else { format!(", {reason}") };
        let _ = writeln!(text, "\n{}{reason}: {}", verdict.name(), candidates.len());
        candidates.iter().for_each(|candidate| text += &in_words(candidate));
    }
    text
}

/// Not beside a choice of candidates by their verdict.
fn shown_slips<'a>(args: &ExplainArgs, file: &'a ClosureFile) -> Vec<&'a SlipRecord> {
    let begins_there = |slip: &&SlipRecord| args.keyframe.is_none_or(|keyframe| keyframe == slip.from);
    let is_chosen = args.accepted || args.refused;
    file.slips.iter().filter(begins_there).filter(|_| !is_chosen).collect()
}

/// One line each.
fn slips(args: &ExplainArgs, file: &ClosureFile) -> String {
    let slips = shown_slips(args, file);
    if slips.is_empty() {
        return String::new();
    }
    let mut text =
        format!("\n{} of the wheels, put right by what scans say together\n", count(slips.len() as u64, "slip"));
    for slip in slips {
        let _ = writeln!(
            text,
            "  {}{}: {:.3} m, settled by scan {}",
            slip.from,
            at(slip.from_stamp_s),
            slip.metres,
            slip.scan
        );
    }
    text
}

fn at(stamp_s: Option<f64>) -> String {
    stamp_s.map_or(String::new(), |stamp_s| format!(" ({stamp_s:.3} s)"))
}

/// What a candidate over a break joins, or would; empty where no break lies between.
fn joins(candidate: &CandidateRecord) -> String {
    let Some([from, to]) = &candidate.joins else { return String::new() };
    let how = match candidate.verdict {
        VerdictName::Accepted => "joins",
        VerdictName::Waiting => "would join",
        VerdictName::Refused => "would have joined",
        VerdictName::Withdrawn => "joined, until it was taken back,",
    };
    format!("      {how} the fragment that {} with the one that {}\n", beginning(to), beginning(from))
}

fn beginning(fragment: &FragmentRecord) -> String {
    let (start, at) =
        (fragment.start.as_str(), fragment.stamp_s.map_or(String::new(), |stamp| format!(" at {stamp:.3} s")));
    match start {
        "uncertain" | "blind" | "lost" => format!("began {start}{at}"),
        _ => format!("began{at} ({start})"),
    }
}

/// Two lines: what and where, and the numbers; between them what it joins over a break.
fn in_words(candidate: &CandidateRecord) -> String {
    let mut text = format!(
        "  {}{} -> {}{}, found by {}",
        candidate.from,
        at(candidate.from_stamp_s),
        candidate.to,
        at(candidate.to_stamp_s),
        candidate.detection
    );
    if let Some([x, y, theta]) = candidate.from_from_to {
        let _ = write!(text, ", at {x:.3} m {y:.3} m {:.2} deg", theta.to_degrees());
    }
    if let Some([x, y, theta]) = candidate.sigmas.filter(|_| candidate.from_from_to.is_some()) {
        let _ = write!(text, " +- {x:.3} m {y:.3} m {:.2} deg", theta.to_degrees());
    }
    format!("{text}\n{}      {}\n{}", joins(candidate), evidence(candidate), gave_way(candidate))
}

/// Which edge of the chain gave way to a closure that contradicted it; empty where none did.
fn gave_way(candidate: &CandidateRecord) -> String {
    let Some(edge) = &candidate.gave_way else { return String::new() };
    let what = if edge.kind == "odometry" { "odometry alone" } else { "a match" };
    format!(
        "      the chain gave way most at {} -> {}{}, {what}: by {:.3} m {:.2} deg, chi-square {:.1}\n",
        edge.from,
        edge.to,
        at(edge.to_stamp_s),
        edge.metres,
        edge.radians.to_degrees(),
        edge.chi2
    )
}

fn evidence(candidate: &CandidateRecord) -> String {
    let evidence = &candidate.evidence;
    let mut parts = vec![count(u64::from(evidence.points), "point")];
    let numbers = [
        ("score", evidence.score),
        ("share of it that the runner-up scores", evidence.ambiguity),
        ("overlap", evidence.overlap),
        ("inliers", evidence.inlier_share),
        ("contradiction", evidence.contradiction),
    ];
    parts.extend(numbers.iter().filter_map(|(what, value)| value.map(|value| format!("{what} {value:.2}"))));
    parts.extend(evidence.cycle_chi2.map(|chi2| format!("cycle chi-square {chi2:.1}")));
    parts.push(format!("{} agreeing", evidence.agreeing));
    parts.join(", ")
}
