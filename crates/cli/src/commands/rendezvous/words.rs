//! What is said of encounters.

use super::Outcomes;
use super::data::DataSet;
use super::score::{Score, Scores};
use crate::args::RendezvousArgs;
use crate::report::remarks;
use crate::terminal::count;
use mapwright_rendezvous::{Kind, PairResult, RefusalReason, RobotId, WaitReason};
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub(super) fn to_words(args: &RendezvousArgs, set: &DataSet, outcomes: &Outcomes, scores: &Scores) -> String {
    let mut text = format!("{}: {}\n", args.data.display(), count(set.robots.len() as u64, "robot"));
    text += "pair    sightings  mutual  gathered  joins  refused  waiting\n";
    for ([a, b], r) in &outcomes.meetings.pairs {
        let of = |kind: Kind| r.encounters.iter().filter(|encounter| encounter.kind == kind).count();
        let joins = r.encounters.iter().filter(|encounter| encounter.is_join).count();
        text += &format!(
            "{:<8}{:>9}{:>8}{:>10}{:>7}{:>9}{:>9}{}\n",
            format!("{a} and {b}"),
            r.sightings,
            of(Kind::Mutual),
            of(Kind::Gathered),
            joins,
            r.refused.len(),
            r.waiting.len(),
            reasons(r),
        );
    }
    text + &score_table(scores) + &remarks(&set.losses, &oddities(outcomes))
}

fn score_table(scores: &Scores) -> String {
    if scores.0.is_empty() {
        return String::new();
    }
    let mut text =
        "beside the truth  scored  translation: median, 95 %   rotation: median, 95 %   NEES  within 95 %\n".to_owned();
    for score in scores.0.iter() {
        text += &match &score.errors {
            Some(e) => format!(
                "{:<16}{:>8}{:>16.3} m {:>7.3} m{:>13.2} deg {:>5.2} deg{:>7.2}{:>11.1} %\n",
                score.name,
                score.scored,
                e.translation_m[0],
                e.translation_m[1],
                e.rotation_deg[0],
                e.rotation_deg[1],
                e.nees,
                100.0 * e.within_95
            ),
            None => format!("{:<16}{:>8}\n", score.name, 0),
        };
    }
    text
}

fn oddities(outcomes: &Outcomes) -> Vec<String> {
    let mut odd = Vec::new();
    if outcomes.unknown_barcodes > 0 {
        let sightings = count(outcomes.unknown_barcodes as u64, "sighting");
        odd.push(format!("{sightings} of barcodes that nobody has, left out"));
    }
    if !outcomes.meetings.refused.is_empty() {
        let sightings = count(outcomes.meetings.refused.len() as u64, "sighting");
        odd.push(format!("{sightings} of a robot by itself, left out"));
    }
    odd
}

/// Why sightings were refused or wait, each reason with its number.
fn counted(result: &PairResult) -> BTreeMap<&'static str, usize> {
    let mut counts = BTreeMap::new();
    let refused = result.refused.iter().map(|(_, reason)| refusal_word(*reason));
    let waiting = result.waiting.iter().map(|(_, reason)| wait_word(*reason));
    refused.chain(waiting).for_each(|word| *counts.entry(word).or_insert(0) += 1);
    counts
}

fn reasons(result: &PairResult) -> String {
    let words: Vec<String> = counted(result).into_iter().map(|(word, number)| format!("{number} {word}")).collect();
    if words.is_empty() { String::new() } else { format!("  {}", words.join(", ")) }
}

fn refusal_word(reason: RefusalReason) -> &'static str {
    match reason {
        RefusalReason::Unsound => "not finite",
        RefusalReason::NoOdometry => "without odometry at their stamp",
        RefusalReason::Contradicted => "contradicted by others",
        _ => "refused",
    }
}

fn wait_word(reason: WaitReason) -> &'static str {
    match reason {
        WaitReason::Unidentified => "wait: of whom is not known",
        WaitReason::LittleMotion { .. } => "wait for motion",
        WaitReason::Vague { .. } => "wait: heading still vague",
        WaitReason::Inconsistent => "wait: odometry and sightings contradict each other",
        WaitReason::Ambiguous { .. } => "wait: several headings fit",
        _ => "wait: heading open",
    }
}

pub(super) fn to_json(args: &RendezvousArgs, set: &DataSet, outcomes: &Outcomes, scores: &Scores) -> Value {
    let pairs: Vec<Value> = outcomes.meetings.pairs.iter().map(|(robots, result)| pair_json(*robots, result)).collect();
    json!({
        "data": args.data.display().to_string(),
        "robots": set.robots.len(),
        "pairs": pairs,
        "scores": scores.0.iter().map(score_json).collect::<Vec<_>>(),
        "unknown_barcodes": outcomes.unknown_barcodes,
        "of_itself": outcomes.meetings.refused.len(),
        "losses": set.losses,
    })
}

fn pair_json(robots: [RobotId; 2], result: &PairResult) -> Value {
    let of = |kind: Kind| result.encounters.iter().filter(|encounter| encounter.kind == kind).count();
    json!({
        "robots": robots,
        "sightings": result.sightings,
        "mutual": of(Kind::Mutual),
        "gathered": of(Kind::Gathered),
        "joins": result.encounters.iter().filter(|encounter| encounter.is_join).count(),
        "refused": result.refused.len(),
        "waiting": result.waiting.len(),
        "reasons": counted(result),
    })
}

fn score_json(score: &Score) -> Value {
    let errors = score.errors.as_ref();
    json!({
        "of": score.name,
        "encounters": score.encounters,
        "scored": score.scored,
        "translation_m": errors.map(|e| json!({ "median": e.translation_m[0], "p95": e.translation_m[1] })),
        "rotation_deg": errors.map(|e| json!({ "median": e.rotation_deg[0], "p95": e.rotation_deg[1] })),
        "nees": errors.map(|e| e.nees),
        "within_95": errors.map(|e| e.within_95),
    })
}
