//! `report.json` and the last lines on the terminal.

use crate::advice;
use crate::mapping::{Made, Mapping};
use crate::maps::{MadeMap, map_file};
use crate::tally::Tally;
use crate::terminal::{count, duration, grouped};
use crate::verdict::{Facts, Usable};
use mapwright::{Advice, LocalMapReport, Pose2, SeparateMap, Status, Visits};
use mapwright_formats::{Noted, OddHeads, OdometryJump, OrderReport, RangeReport, ReadReport, TopicReport};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::fmt::Write;
use std::path::Path;

/// What was read and what was dropped, with places and reasons.
pub(crate) fn read_report(report: &ReadReport) -> Value {
    let dropped: Map<_, _> = report
        .drops
        .iter()
        .map(|(reason, drops)| {
            let first: Vec<_> = drops.first.iter().map(ToString::to_string).collect();
            (reason.to_string(), json!({ "count": drops.count, "first": first }))
        })
        .collect();
    json!({
        "lines": report.lines,
        "bytes": report.bytes,
        "scans": report.scans,
        "odometry": report.odometry,
        "dropped_lines": report.dropped_lines(),
        "dropped": dropped,
        "torn": report.tear.as_ref().map(ToString::to_string),
        "scan_poses_refused": noted(&report.refused_scan_poses),
        "odometry_never_moved": report.odometry_never_moved,
        "odometry_origin_m": report.odometry_origin_m,
        "unstamped": noted(&report.unstamped),
        "non_finite_ranges": report.non_finite_ranges,
        "heads_that_contradict_themselves": heads_json(&report.odd_heads),
        "ranges": ranges_json(&report.ranges),
        "order": order_json(report.order),
        "other_lines": report.other_tags,
        "topics": report.topics.iter().map(topic_report).collect::<Vec<_>>(),
    })
}

/// In which order events were delivered.
pub(crate) fn order_json(order: OrderReport) -> Value {
    json!({
        "disordered": order.disordered,
        "moved": order.moved,
        "way_as_arrived": order.ways[0],
        "way_by_stamps": order.ways[1],
        "odometry_lag_s": order.lag_s.map(|[lag_s, _]| lag_s),
        "odometry_lag_sigma_s": order.lag_s.map(|[_, sigma_s]| sigma_s),
        "beams_at_once": order.at_once,
    })
}

/// That the robot's origin is another one than the log's, in words.
pub(crate) fn mount_oddity(moved: Option<[Pose2; 2]>) -> Option<String> {
    let [said, used] = moved?;
    let said_from_used = said * used.inverse();
    let (off_m, turned_deg) = (said_from_used.x.hypot(said_from_used.y), said_from_used.theta.to_degrees());
    let place = |at: Pose2| format!("x {:.4} m, y {:.4} m, yaw {:.2} deg", at.x, at.y, at.theta.to_degrees());
    (off_m > 1e-6 || turned_deg.abs() > 1e-4).then(|| {
        format!(
            "the laser is taken to sit at {}, as asked for, not at {}, where the log has it: poses are of a point {off_m:.3} m from the log's \
             robot, turned by {turned_deg:.2} deg",
            place(used),
            place(said)
        )
    })
}

/// What is odd about the times of a log's events, in words.
pub(crate) fn time_oddities(order: OrderReport) -> Vec<String> {
    let lag = order.lag_s.map(|[lag_s, sigma_s]| {
        let which = if lag_s > 0.0 { "behind" } else { "ahead of" };
        format!("odometry is {:.2} s {which} the scans (+- {sigma_s:.2}, by their turns): corrected", lag_s.abs())
    });
    let at_once = "undoing the motion during the sweeps by odometry makes successive scans less alike: it is left out, and all beams of a \
                   scan count as taken at once";
    lag.into_iter().chain(order.at_once.then(|| at_once.to_owned())).chain(order_oddity(order)).collect()
}

/// Events that were put in the order of their stamps, in words.
fn order_oddity(order: OrderReport) -> Option<String> {
    let OrderReport { moved, ways: [arrived, stamped], .. } = order;
    let words = || {
        // a stretch may cost no way at all, as where all of it is told apart by turns
        let times = if stamped > 0.0 { format!(", {:.1} times the way", arrived / stamped) } else { String::new() };
        format!(
            "scans and readings were recorded in another order than they were taken in: {} put before others by their stamps \
             (as recorded the robot would go to and fro there{times})",
            grouped(moved)
        )
    };
    (moved > 0).then(words)
}

pub(crate) fn topic_report(topic: &TopicReport) -> Value {
    json!({
        "name": topic.name,
        "events": topic.events,
        "stamps_backward": noted(&topic.stamps.backward),
        "stamps_repeated": noted(&topic.stamps.repeated),
        "odometry_jumps": noted(&topic.odometry.jumps),
        "odometry_begins_anew": topic.odometry.first.map(|jump| jump_report(&jump)),
        "beam_count_changes": noted(&topic.beam_count_changes),
    })
}

fn noted(noted: &Noted) -> Value {
    json!({ "count": noted.count, "first_lines": noted.first_places })
}

/// What a reader lost, in words.
pub(crate) fn read_losses(report: &ReadReport) -> Vec<String> {
    let mut losses = Vec::new();
    for (reason, drops) in &report.drops {
        let first = drops.first.first().map_or(String::new(), |dropped| format!(", first {dropped}"));
        losses.push(format!("{} dropped ({reason}{first})", count(drops.count, "line")));
    }
    losses.extend(report.tear.as_ref().map(ToString::to_string));
    if report.refused_scan_poses.count > 0 {
        losses.push(format!("{} had no usable odometry pose", count(report.refused_scan_poses.count, "scan")));
    }
    losses.extend(range_losses(&report.ranges));
    losses
}

/// Scans whose ranges are in no metres, in words.
pub(crate) fn range_losses(ranges: &RangeReport) -> Option<String> {
    let RangeReport { beyond_reach, largest, .. } = ranges;
    // As centimetres they would still be farther than lasers of the plane reach.
    let unit = if *largest > 15_000.0 { "millimetres" } else { "millimetres or centimetres" };
    (beyond_reach.count > 0).then(|| {
        format!(
            "{} left out, for they have readings of up to {largest} m: {unit}? `--range-unit 0.001` takes them as millimetres",
            count(beyond_reach.count, "scan")
        )
    })
}

/// Heads that contradict themselves, and ranges that say nothing, in words; `place` is what places of heads count.
pub(crate) fn range_oddities(heads: &OddHeads, ranges: &RangeReport, place: &str) -> Vec<String> {
    let mut odd: Vec<_> = heads
        .iter()
        .map(|(words, noted)| {
            let first = noted.first_places.first().copied().unwrap_or_default();
            format!("{words} ({}, first at {place} {first})", count(noted.count, "scan"))
        })
        .collect();
    odd.extend(ranges.limits.clone());
    odd.extend(ranges.codes.clone());
    let blank = "scans of which not one range can be used (0, negative, no number or nearer than the laser's least)";
    odd.extend(note(&ranges.blank, blank, "scan"));
    odd
}

pub(crate) fn heads_json(heads: &OddHeads) -> Value {
    heads.iter().map(|(words, of)| json!({ "words": words, "count": of.count, "first": of.first_places })).collect()
}

pub(crate) fn ranges_json(ranges: &RangeReport) -> Value {
    let scans = |noted: &Noted| json!({ "count": noted.count, "first_scans": noted.first_places });
    json!({
        "beyond_reach": scans(&ranges.beyond_reach),
        "largest_beyond_reach": ranges.largest,
        "blank": scans(&ranges.blank),
        "limits": ranges.limits,
        "codes": ranges.codes,
    })
}

/// What is subtracted from odometry that lies too far out, in words.
pub(crate) fn far_origin([x, y]: [f64; 2]) -> String {
    format!("odometry's places lie far out: ({x:.2}, {y:.2}) m is subtracted from each, its first one there")
}

/// What is odd about a log without being a loss, in words.
pub(crate) fn read_oddities(report: &ReadReport) -> Vec<String> {
    let mut odd = range_oddities(&report.odd_heads, &report.ranges, "line");
    odd.extend(report.topics.iter().flat_map(|topic| topic_oddities(topic, "line")));
    if report.odometry_never_moved {
        let why = "odometry never moves, though what is seen does: none is used, and poses are predicted by constant velocity";
        odd.push(why.to_owned());
    }
    odd.extend(mount_oddity(report.moved_mount));
    odd.extend(report.odometry_origin_m.map(far_origin));
    odd.extend(jump_oddity(&report.topics));
    odd.extend(time_oddities(report.order));
    odd.extend(note(&report.unstamped, "lines without a stamp of their own", "line"));
    if report.non_finite_ranges > 0 {
        odd.push(format!("ranges that are not finite: {}", grouped(report.non_finite_ranges)));
    }
    odd
}

/// What is odd about one topic; `place` is what its places count.
pub(crate) fn topic_oddities(topic: &TopicReport, place: &str) -> Vec<String> {
    let name = &topic.name;
    let noted = [
        (
            &topic.stamps.backward,
            format!(
                "{name} stamps that step backwards (kept; `--stamps repaired` makes those of trajectories increase, as evo wants them)"
            ),
        ),
        (&topic.stamps.repeated, format!("{name} stamps that repeat")),
        (&topic.beam_count_changes, format!("{name} changes of the number of beams")),
    ];
    noted.iter().filter_map(|(noted, what)| note(noted, what, place)).collect()
}

/// Where odometry first begins anew, in words: once, for scans and readings of a CARMEN log carry the same.
pub(crate) fn jump_oddity(topics: &[TopicReport]) -> Option<String> {
    let jumps = topics.iter().filter_map(|topic| Some((topic, topic.odometry.first?)));
    let (topic, first) = jumps.min_by_key(|(_, jump)| jump.stamp)?;
    Some(jump_words(&topic.name, &first, topic.odometry.jumps.count))
}

fn jump_words(name: &str, jump: &OdometryJump, times: u64) -> String {
    let OdometryJump { stamp, elapsed_s, step } = *jump;
    let (stamp_s, step_m, turned_deg) = (stamp.as_secs_f64(), step.x.hypot(step.y), step.theta.to_degrees().abs());
    let since = match elapsed_s {
        s if s > 0.0 => format!("from where it was {s:.2} s before"),
        _ => "from the reading before".to_owned(),
    };
    let more = if times > 1 { format!(" (the first of {})", grouped(times)) } else { String::new() };
    format!(
        "{name} odometry begins anew at {stamp_s:.3}, {step_m:.2} m and {turned_deg:.0} deg {since}, farther than this robot \
         drives{more}; it is used from there on"
    )
}

fn jump_report(jump: &OdometryJump) -> Value {
    json!({
        "stamp_s": jump.stamp.as_secs_f64(),
        "elapsed_s": jump.elapsed_s,
        "step": [jump.step.x, jump.step.y, jump.step.theta],
    })
}

fn note(noted: &Noted, what: &str, place: &str) -> Option<String> {
    let first = noted.first_places.first()?;
    Some(format!("{what}: {}, first at {place} {first}", grouped(noted.count)))
}

/// What a mapping run lost beside what the reader lost, in words.
pub(crate) fn mapping_losses(mapping: &Mapping, made: &Made) -> Vec<String> {
    let mut losses: Vec<_> = mapping
        .tally
        .refused
        .iter()
        .map(|(reason, &scans)| format!("{} refused: {reason}", count(scans, "scan")))
        .collect();
    let lost = mapping.tally.count(Status::Lost);
    if lost > 0 {
        losses.push(format!("{} not in the map, for they fit nowhere", count(lost, "scan")));
    }
    losses.extend(mapping.sonars.losses());
    losses.extend(made.pieces.losses());
    let keyframes_left_out: usize = made.maps.iter().map(|map| map.keyframes_left_out.len()).sum();
    let cells_left_out: u64 = made.maps.iter().map(|map| map.cells_left_out).sum();
    if keyframes_left_out > 0 {
        let what = count(keyframes_left_out as u64, "keyframe");
        losses.push(format!("{what} left out of the map, for the scan hardly fitted and contradicts the others"));
    }
    if cells_left_out > 0 {
        losses.push(format!(
            "{} lie too far out for the map's files (at most 100 million cells; a larger map.resolution_m helps)",
            count(cells_left_out, "known cell")
        ));
    }
    losses
}

/// The whole of `report.json`; `read` is [`read_report`]'s or what stands for it.
pub(crate) fn full_report(
    name: &str,
    read: Value,
    mapping: &mut Mapping,
    made: &Made,
    usable: &Usable,
    losses: &[String],
) -> Value {
    let status = mapping.tally.status_report();
    let sonars = mapping.sonars.to_json();
    let session = mapping.session();
    let mut report = json!({
        "mapwright": env!("CARGO_PKG_VERSION"),
        "verdict": usable.to_json(),
        "log": name,
        "log_seconds": mapping.tally.log_s(),
        "settings": mapping.settings,
        "command_line": mapping.switched,
        "read": read,
        "beams": mapping.tally.beam_report(),
        "keyframes": session.keyframes().len(),
        "edges": session.edges().count(),
        "path_m": made.path_m,
        "status": status,
        "matches": mapping.tally.match_report(),
        "live_map": live_report(mapping.local_map),
        "map": made.maps.first().map(MadeMap::to_json),
        "further_maps": further_maps(made),
        "parts": parts_report(mapping),
        "pieces": made.pieces.to_json(),
        "certainty": made.maps.first().map(|map| advice::report(&map.advice)),
        "losses": losses,
    });
    if let Some(sonars) = sonars {
        report["sonars"] = sonars;
    }
    report
}

/// Whether the map can be used; so many scans were left out before any was mapped.
pub(crate) fn usable(mapping: &Mapping, made: &Made, left_out: u64) -> Usable {
    let unknown = (Advice::default(), Visits::default());
    let (advice, visits) = made.maps.first().map_or((&unknown.0, unknown.1), |map| (&map.advice, map.visits));
    let tally = &mapping.tally;
    let unused = tally.share_unused(left_out);
    let facts = Facts { unused, ..Facts::of(tally, &mapping.turns, mapping.session(), advice, visits) };
    if !mapping.sonars.is_alone() {
        return Usable::of(&facts);
    }
    // Of a dozen walls that a stretch has shown many are new, and some wrong: that they fit badly is usual.
    let badly = facts.degraded + facts.lost;
    Usable::of(&Facts { degraded: 0.0, lost: 0.0, ..facts }).also(Some(crate::sonar::alone(badly)))
}

/// Those of pieces that nothing holds to the first one.
fn further_maps(made: &Made) -> Value {
    let further = made.maps.iter().enumerate().skip(1).map(|(number, map)| {
        let mut value = map.to_json();
        value["file"] = json!(map_file(number, "png"));
        value["certainty"] = advice::report(&map.advice);
        value
    });
    further.collect()
}

fn live_report(report: LocalMapReport) -> Value {
    json!({
        "keyframes": report.keyframes,
        "gated_out": report.gated_out,
        "let_in": report.let_in,
        "superseded": report.superseded,
    })
}

/// What a run says at its end.
pub(crate) struct LastWords<'a> {
    pub(crate) name: &'a str,
    pub(crate) usable: &'a Usable,
    pub(crate) made: &'a Made,
    pub(crate) timing: &'a Value,
    /// How a simulated run lies beside the truth.
    pub(crate) truth: String,
    pub(crate) losses: &'a [String],
    pub(crate) odd: &'a [String],
    /// What was used of a recording, and why.
    pub(crate) used: String,
    pub(crate) folder: &'a Path,
}

impl LastWords<'_> {
    /// In the order in which one wants to know it: whether the map can be used; what was made and how good it is; what to do next; where it
    /// is; and then details, of which some did no harm.
    pub(crate) fn of(&self, mapping: &Mapping) -> String {
        let numbers = numbers(self.name, mapping, self.made, self.timing);
        let next = |(number, map): (usize, &MadeMap)| advice::next_words(&map.advice, &map_file(number, "png"));
        let next: String = self.made.maps.iter().enumerate().map(next).collect();
        let verdict = self.usable.words();
        let lost = remarks(self.losses, &[]);
        let (files, used, truth) = (written(self.folder, mapping.output.names()), &self.used, &self.truth);
        let details = format!("{used}{}{}", mapping.tally.doubts.words(), remarks(&[], self.odd));
        format!("{verdict}{numbers}{truth}{lost}{next}{files}{}", in_detail(&details))
    }
}

/// Where the files are, and what shows them all.
pub(crate) fn written(output: &Path, files: &[Cow<'static, str>]) -> String {
    let folder = output.display();
    format!(
        "written  {folder}: {}\nlook     `mapwright report {folder}` makes one page of it to look at\n",
        files.join(" ")
    )
}

/// What follows when all that matters is said.
pub(crate) fn in_detail(words: &str) -> String {
    if words.is_empty() { String::new() } else { format!("\n{words}") }
}

/// What was made and how good it is.
fn numbers(name: &str, mapping: &Mapping, made: &Made, timing: &Value) -> String {
    let tally = &mapping.tally;
    let all = mapping.session().scans().len() as u64;
    let over = match tally.scans {
        new if new == all && mapping.parts.is_empty() => format!(" over {}", duration(tally.log_s())),
        new if new == all => String::new(),
        new => format!(", {} of them mapped now", grouped(new)),
    };
    let keyframes = count(mapping.session().keyframes().len() as u64, "keyframe");
    let mut text = format!("{name}: {}{over}, {:.0} m of path, {keyframes}\n", count(all, "scan"), made.path_m);
    text += &parts_words(mapping);
    for (number, map) in made.maps.iter().enumerate() {
        let name = if number == 0 { "map".to_owned() } else { format!("map-{}", number + 1) };
        let ([width_m, height_m], cell_m) = (map.sides_m, mapping.settings.map.resolution_m);
        let _ = writeln!(text, "{name:<8} {width_m:.0} x {height_m:.0} m, {cell_m} m a cell");
    }
    text += &mapping.sonars.words();
    text += &made.pieces.words();
    text += &made.maps.first().map(|map| advice::words(&map.advice)).unwrap_or_default();
    text + &quality_words(tally) + &speed_words(mapping, timing)
}

fn speed_words(mapping: &Mapping, timing: &Value) -> String {
    let number = |key: &str| timing[key].as_f64().unwrap_or(0.0);
    let mut text = format!("speed    {:.2} s", number("total_s"));
    if mapping.tally.scans > 0 {
        let _ = write!(text, ", {} scans/s", grouped(number("scans_per_second") as u64));
    }
    if mapping.tally.scans > 0 && mapping.parts.is_empty() {
        let _ = write!(text, ", {} x real time", grouped(number("times_real_time") as u64));
    }
    if let Some(mib) = timing["peak_memory_mib"].as_f64() {
        let _ = write!(text, ", {mib:.0} MiB at most");
    }
    text + "\n"
}

/// How scans have fitted, if any were mapped.
fn quality_words(tally: &Tally) -> String {
    if tally.scans == 0 {
        return String::new();
    }
    let percent = |status| 100.0 * tally.share(status);
    let [tracking, degraded, lost] = [Status::Tracking, Status::Degraded, Status::Lost].map(percent);
    let mut text = format!("quality  tracking {tracking:.2} %, degraded {degraded:.2} %, lost {lost:.2} %");
    if let Some(share) = tally.median_inlier_share() {
        let _ = write!(text, "; in the median {:.0} % of a scan's beams fit the map", 100.0 * share);
    }
    text.push('\n');
    text
}

/// Of each log or session of several: its name, how many keyframes it has, and which maps they are in.
fn parts(mapping: &Mapping) -> Vec<(&str, usize, Vec<String>)> {
    let (maps, keyframes) = (mapping.session().maps(), mapping.session().keyframes().len());
    let ends = mapping.parts.iter().skip(1).map(|(_, first)| *first).chain([keyframes]);
    let mut parts = Vec::new();
    for ((name, first), end) in mapping.parts.iter().zip(ends) {
        let shows = |map: &SeparateMap| map.keyframes.iter().any(|range| range.start < end && *first < range.end);
        let shown = maps.iter().enumerate().filter(|(_, map)| shows(map));
        let shown = shown.map(|(number, _)| map_file(number, "png")).collect();
        parts.push((name.as_str(), end.saturating_sub(*first), shown));
    }
    parts
}

fn parts_words(mapping: &Mapping) -> String {
    let line = |(name, keyframes, maps): (&str, usize, Vec<String>)| {
        format!("of       {name}: {}, in {}\n", count(keyframes as u64, "keyframe"), maps.join(", "))
    };
    parts(mapping).into_iter().map(line).collect()
}

/// The same for `report.json`.
fn parts_report(mapping: &Mapping) -> Value {
    let part = |(name, keyframes, maps): (&str, usize, Vec<String>)| json!({ "name": name, "keyframes": keyframes, "maps": maps });
    parts(mapping).into_iter().map(part).collect()
}

/// Losses and oddities as lines.
pub(crate) fn remarks(losses: &[String], oddities: &[String]) -> String {
    let lost = losses.iter().map(|loss| format!("lost     {loss}\n"));
    lost.chain(oddities.iter().map(|odd| format!("odd      {odd}\n"))).collect()
}
