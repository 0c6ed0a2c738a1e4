//! What reading logs has brought and lost, for report and people.

use crate::report::{
    far_origin, heads_json, jump_oddity, mount_oddity, order_json, range_losses, range_oddities, ranges_json,
    read_losses, read_oddities, read_report, time_oddities, topic_oddities, topic_report,
};
use crate::terminal::{count, grouped};
use mapwright_bags::{Damages, ReadReport as Container};
use mapwright_formats::{FormatError, Noted, ReadReport};
use mapwright_logs::{ClockStep, LogReport, Plan, RecordingReport, Refused, Survey, TopicSurvey};
use serde_json::{Value, json};
use std::fmt::Write;

/// The reports of all logs of a run, with their names.
#[derive(Default)]
pub(crate) struct Reading {
    pub(crate) logs: Vec<(String, LogReport)>,
    /// How odometry goes on from one log to the next.
    pub(crate) notes: Vec<String>,
}

impl Reading {
    /// The report of one log, or a list of several.
    pub(crate) fn to_json(&self) -> Value {
        if let [(_, report)] = &self.logs[..] {
            return report_json(report);
        }
        let logs = self.logs.iter().map(|(name, report)| json!({ "log": name, "read": report_json(report) }));
        json!({ "logs": logs.collect::<Vec<_>>(), "notes": self.notes })
    }

    /// What was lost, in words.
    pub(crate) fn losses(&self) -> Vec<String> {
        self.of_each(|report| match report {
            LogReport::Carmen(report) => read_losses(report),
            LogReport::Recording(report) => recording_losses(report),
            _ => Vec::new(),
        })
    }

    /// Scans that were left out because their ranges are in no metres.
    pub(crate) fn scans_left_out(&self) -> u64 {
        let of = |report: &LogReport| match report {
            LogReport::Carmen(report) => report.ranges.beyond_reach.count,
            LogReport::Recording(report) => report.stream.ranges.beyond_reach.count,
            _ => 0,
        };
        self.logs.iter().map(|(_, report)| of(report)).sum()
    }

    /// What is odd without being a loss, in words.
    pub(crate) fn oddities(&self) -> Vec<String> {
        self.of_each(|report| match report {
            LogReport::Carmen(report) => read_oddities(report),
            LogReport::Recording(report) => recording_oddities(report),
            _ => Vec::new(),
        })
    }

    /// What was used of recordings and why, as lines.
    pub(crate) fn used(&self) -> String {
        let mut text = String::new();
        for (name, report) in &self.logs {
            let used = match report {
                LogReport::Recording(report) => plan_words(&report.plan),
                LogReport::Carmen(report) => lasers_of_carmen(report),
                _ => String::new(),
            };
            if self.logs.len() > 1 && !used.is_empty() {
                let _ = writeln!(text, "log      {name}");
            }
            text += &used;
        }
        for note in &self.notes {
            let _ = writeln!(text, "joined   {note}");
        }
        text
    }

    /// Where reading stands, in words.
    pub(crate) fn place(&self) -> String {
        match self.logs.last() {
            Some((_, LogReport::Carmen(report))) => format!("line {} of the log", report.lines),
            Some((_, LogReport::Recording(report))) => format!("message {} of the recording", report.stream.messages),
            _ => "nothing".to_owned(),
        }
    }

    /// Words about each log, with its name where there are several.
    fn of_each(&self, words: impl Fn(&LogReport) -> Vec<String>) -> Vec<String> {
        let named = |name: &str, word: String| if self.logs.len() > 1 { format!("{name}: {word}") } else { word };
        self.logs
            .iter()
            .flat_map(|(name, report)| words(report).into_iter().map(move |word| named(name, word)))
            .collect()
    }
}

/// What was found where scans were expected.
pub(crate) fn found_instead(logs: &[(String, LogReport)]) -> String {
    let words = logs.iter().map(|(_, report)| match report {
        LogReport::Carmen(report) => found_in_carmen(report),
        LogReport::Recording(report) => {
            let mut found = vec![count(report.stream.messages, "message")];
            found.extend(recording_losses(report));
            found.join(", ")
        }
        _ => "nothing".to_owned(),
    });
    words.collect::<Vec<_>>().join("; ")
}

fn found_in_carmen(report: &ReadReport) -> String {
    if report.bytes == 0 && report.lines == 0 && report.tear.is_none() {
        return "an empty file".to_owned();
    }
    let mut found = vec![count(report.lines, "line")];
    if report.sonar_readings > 0 {
        found.push(format!("{} of sonars", count(report.sonar_readings, "reading")));
    }
    if report.odometry > 0 {
        found.push(count(report.odometry, "odometry reading"));
    }
    found.extend(report.tear.as_ref().map(FormatError::to_string));
    found.extend(range_losses(&report.ranges));
    if let Some(first) = report.drops.values().flat_map(|drops| &drops.first).min_by_key(|dropped| dropped.line) {
        found.push(format!("{} dropped, first {first}", report.dropped_lines()));
    }
    found.join(", ")
}

/// The lasers of a CARMEN log that has several.
fn lasers_of_carmen(report: &ReadReport) -> String {
    let scans: Vec<_> = report.topics.iter().filter(|topic| !matches!(&*topic.name, "ODOM" | "SONAR")).collect();
    if scans.len() < 2 {
        return String::new();
    }
    let each = scans.iter().map(|topic| format!("{} ({})", topic.name, count(topic.events, "scan")));
    format!("scans    {}: all mapped\n", each.collect::<Vec<_>>().join(", "))
}

/// A plan as lines.
pub(crate) fn plan_words(plan: &Plan) -> String {
    let used = plan.reasons.iter().map(|(what, why)| format!("{what:<9}{why}\n"));
    used.chain(plan.assumed.iter().map(|assumed| format!("assumed  {assumed}\n"))).collect()
}

pub(crate) fn plan_json(plan: &Plan) -> Value {
    let reasons: Vec<_> = plan.reasons.iter().map(|(what, why)| json!({ "what": what, "why": why })).collect();
    json!({
        "scans": plan.scans,
        "lasers": plan.lasers().collect::<Vec<_>>(),
        "robot_frame": plan.robot_frame,
        "sensor_frame": plan.sensor_frame,
        "reasons": reasons,
        "assumed": plan.assumed,
    })
}

fn report_json(report: &LogReport) -> Value {
    match report {
        LogReport::Carmen(report) => read_report(report),
        LogReport::Recording(report) => recording_json(report),
        _ => Value::Null,
    }
}

fn recording_json(report: &RecordingReport) -> Value {
    let stream = &report.stream;
    let mut value = survey_json(&report.survey);
    value["used"] = plan_json(&report.plan);
    value["scans"] = json!(stream.scans);
    value["odometry"] = json!(stream.odometry);
    value["turn_rates"] = json!(stream.turn_rates);
    value["undecodable"] = refused_json(&stream.undecodable);
    value["unusable"] = refused_json(&stream.unusable);
    value["refused_turn_rates"] = refused_json(&stream.refused_turn_rates);
    value["late"] = noted_json(&stream.late);
    value["unstamped"] = noted_json(&stream.unstamped);
    value["scans_without_odometry"] = noted_json(&stream.without_odometry);
    value["non_finite_ranges"] = json!(stream.non_finite_ranges);
    value["heads_that_contradict_themselves"] = heads_json(&stream.odd_heads);
    value["order"] = order_json(stream.order);
    value["ranges"] = ranges_json(&stream.ranges);
    value["points_used"] = json!(stream.points_used);
    value["points_outside"] = json!(stream.points_outside);
    value["held_bytes"] = json!(stream.held_bytes);
    value["odometry_origin_m"] = json!(stream.odometry_origin_m);
    value["clock_steps"] = json!(stream.clock_steps);
    value["first_clock_step"] = json!(stream.first_clock_step.as_ref().map(|step| {
        json!({ "topic": step.name, "message": step.place, "by_s": step.by_s, "from_the_beginning": step.is_first })
    }));
    value["topics_used"] = json!(stream.topics.iter().map(topic_report).collect::<Vec<_>>());
    value
}

fn refused_json(refused: &Refused) -> Value {
    json!({ "count": refused.count, "first": refused.first })
}

fn noted_json(noted: &Noted) -> Value {
    json!({ "count": noted.count, "first_messages": noted.first_places })
}

/// What a first pass has found.
pub(crate) fn survey_json(survey: &Survey) -> Value {
    let topics: Vec<_> = survey.topics.iter().map(topic_json).collect();
    let container = &survey.container;
    let damages: Vec<_> = container
        .damages
        .iter()
        .map(|(kind, damages)| {
            let first: Vec<_> = damages.first.iter().map(ToString::to_string).collect();
            json!({
                "kind": kind.to_string(),
                "loses_messages": kind.loses_messages(),
                "count": damages.count,
                "skipped_bytes": damages.skipped_bytes,
                "first": first,
            })
        })
        .collect();
    json!({
        "container": container.container.map(|container| container.to_string()),
        "files": container.parts,
        "bytes": container.file_bytes,
        "messages": container.messages,
        "indexed": container.indexed,
        "topics": topics,
        "damages": damages,
    })
}

fn topic_json(topic: &TopicSurvey) -> Value {
    json!({
        "name": topic.name,
        "type": topic.type_name,
        "messages": topic.messages,
        "bytes": topic.bytes,
        "rate_hz": topic.rate_hz(),
        "frames": topic.frames,
        "child_frames": topic.child_frames,
        "undecodable": topic.undecodable,
        "first_error": topic.first_error,
    })
}

/// Damage that may have cost messages, or that has not, in words.
pub(crate) fn damage_words(container: &Container, lossy: bool) -> impl Iterator<Item = String> + '_ {
    let of_kind = container.damages.iter().filter(move |(kind, _)| kind.loses_messages() == lossy);
    of_kind.map(|(kind, damages)| {
        let Damages { count: times, first, .. } = damages;
        let file =
            first.first().and_then(|damage| container.parts.get(damage.part)).filter(|_| container.parts.len() > 1);
        let file = file.map_or_else(String::new, |file| format!("{file}, "));
        let first = first.first().map_or_else(String::new, ToString::to_string);
        format!("{kind} ({}, first at {file}{first})", count(*times, "place"))
    })
}

fn recording_losses(report: &RecordingReport) -> Vec<String> {
    let mut losses: Vec<_> = damage_words(&report.survey.container, true).collect();
    for (refused, what) in [(&report.stream.undecodable, "not decoded"), (&report.stream.unusable, "not usable")] {
        if let Some(first) = &refused.first {
            losses.push(format!("{} {what}, first {first}", count(refused.count, "message")));
        }
    }
    losses.extend(range_losses(&report.stream.ranges));
    losses
}

/// A clock that was set, in words.
fn clock_words(step: &ClockStep, times: u64) -> String {
    let ClockStep { name, place, by_s, is_first } = step;
    let (seconds, which) = (by_s.abs(), if *by_s > 0.0 { "ahead" } else { "back" });
    let times = if times > 1 { format!(", the first of {} such steps", grouped(times)) } else { String::new() };
    if *is_first {
        let which = if *by_s > 0.0 { "ahead of" } else { "behind" };
        return format!(
            "the clock of {name} is {seconds:.1} s {which} the other topic's: brought together by the times of recording{times}"
        );
    }
    format!(
        "the clock of {name} was set {which} by {seconds:.1} s at message {place}{times}: its stamps are kept, and scans and \
         odometry go together as if it had not been"
    )
}

fn recording_oddities(report: &RecordingReport) -> Vec<String> {
    let stream = &report.stream;
    let mut odd: Vec<_> = damage_words(&report.survey.container, false).collect();
    odd.extend(range_oddities(&stream.odd_heads, &stream.ranges, "message"));
    odd.extend(stream.topics.iter().flat_map(|topic| topic_oddities(topic, "message")));
    odd.extend(jump_oddity(&stream.topics));
    odd.extend(time_oddities(stream.order));
    odd.extend(mount_oddity(stream.moved_mount));
    let mut note = |noted: &Noted, what: &str| {
        if let Some(place) = noted.first_places.first() {
            odd.push(format!("{what}: {}, first message {place}", grouped(noted.count)));
        }
    };
    note(&stream.late, "messages later than the other topic's, by more than the window of 2 s");
    note(&stream.unstamped, "headers without a stamp, which have the time of recording instead");
    let behind = match stream.odometry_behind_s {
        Some(s) if s < 0.0 => "scans without odometry near them (of readings that are all later)".to_owned(),
        Some(s) => format!("scans without odometry near them (the last reading {s:.3} s before)"),
        None => "scans before any odometry".to_owned(),
    };
    note(&stream.without_odometry, &behind);
    odd.extend(stream.first_clock_step.as_ref().map(|step| clock_words(step, stream.clock_steps)));
    odd.extend(stream.odometry_origin_m.map(far_origin));
    if let Some(first) = &stream.refused_turn_rates.first {
        odd.push(format!("turn rates left out: {}, first {first}", grouped(stream.refused_turn_rates.count)));
    }
    if report.survey.links.refused > 0 {
        odd.push(format!("transforms that cannot be: {}", grouped(report.survey.links.refused)));
    }
    odd
}
