//! Places the robot may have come back to: the table, and what a click shows.

use super::html::escaped;
use super::run::Run;
use crate::closures::{CandidateRecord, VerdictName};
use crate::terminal::count;
use mapwright::Stamp;
use serde_json::{Value, json};
use std::fmt::Write;

/// Rows of the table at most; `mapwright explain` lists all.
const ROWS: usize = 800;
/// What evidence has for every ambiguity that is no larger.
const LEAST_AMBIGUITY: f64 = 0.75;

/// The table of all candidates, closures first; `id` is the run's on this page.
pub(super) fn table(run: &Run, id: &str) -> String {
    let candidates = &run.drawn.candidates;
    if candidates.is_empty() {
        return "<p>The robot came to no place that it might have seen before: no closures, none refused.</p>\n"
            .to_owned();
    }
    let mut rows: Vec<usize> = (0..candidates.len()).collect();
    rows.sort_by_key(|&number| (candidates[number].verdict, number));
    let mut text = format!(
        "<p>{}. Choose one here or on the map to lay its two submaps over each other.</p>\n<div class=\"scroll\" tabindex=\"0\" \
         role=\"region\" aria-label=\"Table of closures\"><table class=\"closures\"><thead><tr><th scope=\"col\">no.</th>\
         <th scope=\"col\">verdict</th><th scope=\"col\">keyframes</th><th scope=\"col\">times</th>\
         <th scope=\"col\">why</th></tr></thead><tbody>\n",
        summary(candidates)
    );
    for &number in rows.iter().take(ROWS) {
        text += &row(run, id, number);
    }
    text += "</tbody></table></div>\n";
    if rows.len() > ROWS {
        let _ = writeln!(
            text,
            "<p class=\"note\">{} further ones are not in this table; <code>mapwright explain</code> lists all.</p>",
            rows.len() - ROWS
        );
    }
    text
}

fn summary(candidates: &[CandidateRecord]) -> String {
    let of = |verdict: VerdictName| candidates.iter().filter(|c| c.verdict == verdict).count();
    let verdicts = [VerdictName::Accepted, VerdictName::Waiting, VerdictName::Withdrawn, VerdictName::Refused];
    let counted = verdicts.map(|verdict| (of(verdict), verdict.name()));
    let counted = counted.iter().filter(|(n, _)| *n > 0).map(|(n, name)| format!("{n} {name}"));
    format!("{}: {}", count(candidates.len() as u64, "candidate"), counted.collect::<Vec<_>>().join(", "))
}

fn row(run: &Run, id: &str, number: usize) -> String {
    let candidate = &run.drawn.candidates[number];
    let verdict = candidate.verdict.name();
    let times = [candidate.from_stamp_s, candidate.to_stamp_s].map(|stamp_s| time(run, stamp_s)).join(" → ");
    format!(
        "<tr data-row=\"{id}-{number}\"><td><button type=\"button\" class=\"choose\" data-run=\"{id}\" \
         data-closure=\"{number}\" aria-label=\"Show candidate {n}, {verdict}\">{n}</button></td>\
         <td><span class=\"key {verdict}\">{verdict}</span>{}</td><td>{} → {}</td><td>{times}</td><td class=\"why\">{}</td></tr>\n",
        if candidate.joins.is_some() { " (join)" } else { "" },
        candidate.from,
        candidate.to,
        escaped(&reason(candidate)),
        n = number + 1,
    )
}

/// Of driving since the begin.
fn time(run: &Run, stamp_s: Option<f64>) -> String {
    stamp_s.map_or("?".to_owned(), |stamp_s| format!("{:.1} s", run.seconds(Stamp::from_secs_f64(stamp_s)).max(0.0)))
}

/// What was decided and why, as a sentence.
pub(super) fn reason(candidate: &CandidateRecord) -> String {
    let evidence = &candidate.evidence;
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let mut said = match (&candidate.reason, candidate.verdict) {
        (Some(reason), VerdictName::Refused) => format!("Refused: {reason}"),
        (Some(reason), VerdictName::Waiting) => format!("Waits: {reason}"),
        (Some(reason), VerdictName::Withdrawn) => format!("Was a closure and was withdrawn: {reason}"),
        _ => "Accepted".to_owned(),
    };
    let mut parts = Vec::new();
    parts.extend(evidence.inlier_share.map(|share| format!("{} of what both see fits", percent(share))));
    parts.extend(evidence.contradiction.map(|share| format!("{} contradicts", percent(share))));
    parts.extend(evidence.ambiguity.map(runner_up));
    parts.extend(evidence.cycle_chi2.map(|chi2| format!("cycle chi-square {chi2:.1}")));
    if evidence.agreeing > 0 {
        let verb = if evidence.agreeing == 1 { "agrees" } else { "agree" };
        parts.push(format!("{} {verb} with it", count(u64::from(evidence.agreeing), "other")));
    }
    if !parts.is_empty() {
        let _ = write!(said, "; {}", parts.join(", "));
    }
    if let Some([from, to]) = &candidate.joins {
        let does = if candidate.verdict == VerdictName::Accepted { "joins" } else { "would join" };
        let _ = write!(said, ". It {does} two fragments over a break ({}; {})", from.start, to.start);
    }
    said + "."
}

/// What a click shows of each.
pub(super) fn to_json(run: &Run) -> Value {
    let candidate = |(number, candidate): (usize, &CandidateRecord)| {
        let times = [candidate.from_stamp_s, candidate.to_stamp_s].map(|stamp_s| time(run, stamp_s));
        json!({
            "verdict": candidate.verdict.name(),
            "reason": reason(candidate),
            "from": candidate.from,
            "to": candidate.to,
            "times": times,
            "numbers": numbers(candidate),
            "placing": run.drawn.overlays.placing(number),
        })
    };
    let shown = run.drawn.candidates.iter().enumerate();
    shown.map(candidate).collect()
}

/// Names and values for people.
fn numbers(candidate: &CandidateRecord) -> Vec<[String; 2]> {
    let evidence = &candidate.evidence;
    let mut numbers = vec![["found by".to_owned(), found_by(&candidate.detection).to_owned()]];
    if let Some([x, y, theta]) = candidate.from_from_to {
        let sigmas = candidate
            .sigmas
            .map_or(String::new(), |[sx, sy, st]| format!(" ± {sx:.3} m, {sy:.3} m, {:.2}°", st.to_degrees()));
        numbers.push(["pose".to_owned(), format!("{x:.3} m, {y:.3} m, {:.2}°{sigmas}", theta.to_degrees())]);
    }
    let shares = [
        ("score", evidence.score),
        ("runner-up, of the score", evidence.ambiguity),
        ("overlap", evidence.overlap),
        ("inliers", evidence.inlier_share),
        ("contradiction", evidence.contradiction),
    ];
    let share = |(name, value): (&str, Option<f64>)| Some([name.to_owned(), format!("{:.2}", value?)]);
    numbers.extend(shares.into_iter().filter_map(share));
    numbers.extend(evidence.cycle_chi2.map(|chi2| ["cycle chi-square".to_owned(), format!("{chi2:.2}")]));
    numbers.push(["points".to_owned(), evidence.points.to_string()]);
    numbers.push(["agreeing".to_owned(), evidence.agreeing.to_string()]);
    numbers
}

/// How well the best pose elsewhere fits; 0.75 stands for that or less.
fn runner_up(share: f64) -> String {
    if share <= LEAST_AMBIGUITY {
        return "no other pose fits nearly as well".to_owned();
    }
    format!("the best other pose fits {:.0} % as well", 100.0 * share)
}

fn found_by(detection: &str) -> &str {
    match detection {
        "pose" => "where the robot may be",
        "place" => "what the place looks like",
        "match" => "the match of a scan",
        "sighting" => "two robots that saw each other",
        other => other,
    }
}
