//! What `fleet join` leaves behind.

use super::member::Member;
use super::report::{RobotResult, TeamResult, Written, refused_by, way_in, write_results};
use super::robot::RobotFiles;
use super::told::plain;
use crate::args::FleetJoinArgs;
use crate::failure::{Failure, Outcome};
use crate::output::OutputFolder;
use crate::terminal::{count, say, say_json};
use mapwright::{Mapper, Settings};
use serde_json::{Map, Value, json};
use std::path::Path;

/// A robot whose log is over.
pub(super) struct Run<'a> {
    pub(super) args: &'a FleetJoinArgs,
    pub(super) robot: &'a RobotFiles,
    pub(super) settings: Settings,
    pub(super) mapper: &'a Mapper,
    pub(super) member: Member<'a>,
    pub(super) settled_s: Option<f64>,
    pub(super) losses: Vec<String>,
}

/// Writes the map of all, where this robot was in it, and what was heard of whom.
pub(super) fn write(run: Run<'_>, output: OutputFolder, folder: &Path) -> Result<Outcome, Failure> {
    let Run { args, robot, settings, mapper, member, settled_s, mut losses } = run;
    let map = member.team.map();
    if map.is_none() {
        losses.push("there is no map of all yet; session.mapwright is this robot's own".to_owned());
    }
    let session = map.unwrap_or_else(|| mapper.session());
    let way = way_in(session, mapper.session());
    if way.len() < mapper.session().scans().len() {
        let left = (mapper.session().scans().len() - way.len()) as u64;
        losses.push(format!("where this robot was at {} is not in the map of all", count(left, "scan")));
    }
    let own = member.of_itself();
    let never = robot.names().into_iter().filter(|name| *name != robot.name);
    let never: Vec<String> = never.filter(|name| !own.hears.iter().any(|heard| heard.robot == *name)).collect();
    if !never.is_empty() {
        losses.push(format!("never heard: {}", never.join(", ")));
    }
    if settled_s.is_none() && !losses.iter().any(|loss| loss.starts_with("interrupted")) {
        losses.push(format!("the team had not settled {:.0} s after the log", args.wait));
    }
    let complaints = member.wire.as_ref().map(mapwright_net::Wire::complaints).unwrap_or_default();
    let complaints: Vec<Value> =
        complaints.iter().map(|said| json!({ "what": plain(&said.what), "times": said.times })).collect();
    let remarks: Vec<&String> = member.remarks().collect();
    let others: Value = member.told.iter().map(|(name, (_, told))| (name.clone(), json!(told))).collect();
    let facts = json!({
        "robot": robot.name,
        "team": robot.team.team,
        "in_map": session.keyframes().len(),
        "settled_s": settled_s,
        "records_mapped": { "count": member.mapped.count, "since_clock_s": member.clock_s(member.mapped) },
        "keyframes_in_map": { "count": member.in_map.count, "since_clock_s": member.clock_s(member.in_map) },
        "log_over_clock_s": member.log_over_s.map(|at_s| member.clock_at(at_s)),
        "own": own,
        "others": others,
        "never_heard": never,
        "unsaid": member.team.unsaid(),
        "remarks": remarks,
        "links": complaints,
    });
    let facts: Map<String, Value> = facts.as_object().cloned().unwrap_or_default();
    let result = |name: String| {
        let is_own = name == robot.name;
        let told = member.told.get(&name).map(|(_, told)| told);
        RobotResult {
            is_alive: is_own || own.hears.iter().any(|heard| heard.robot == name),
            is_solving: if is_own { own.solves } else { told.is_some_and(|told| told.solves) },
            refused: if is_own { refused_by(member.team.node()) } else { Vec::new() },
            early: if is_own { own.early } else { told.map_or(0, |told| told.early) },
            way: if is_own { way.clone() } else { Vec::new() },
            name,
            ..RobotResult::default()
        }
    };
    let robots: Vec<RobotResult> = robot.names().into_iter().map(result).collect();
    let team = TeamResult { settings: &settings, map: Some(session), robots: &robots, facts, losses };
    let Written { value, losses, .. } = write_results(team, output, folder)?;
    if args.voice.json {
        say_json(&value)?;
    } else if !args.voice.quiet {
        let settled =
            settled_s.map_or("not settled".to_owned(), |s| format!("all held the same {s:.0} s after the log"));
        let heard = own.hears.iter().map(|heard| heard.robot.as_str()).collect::<Vec<_>>().join(", ");
        let mut lines = vec![
            format!(
                "{} in the map of all, {} of this robot",
                count(session.keyframes().len() as u64, "keyframe"),
                own.keyframes
            ),
            format!("heard {}; {settled}", if heard.is_empty() { "nobody" } else { &heard }),
        ];
        lines.extend(own.refused.iter().map(|refused| {
            let of = refused.of.as_ref().map_or(String::new(), |of| format!(" of {of}"));
            format!("refused{of}, {}: {}", count(refused.times, "time"), refused.why)
        }));
        lines.extend(losses.iter().map(|loss| format!("! {loss}")));
        if !never.is_empty() {
            lines.extend(complaints.iter().filter_map(|said| Some(format!("  {}", said["what"].as_str()?))));
        }
        lines.push(format!("results in {}", folder.display()));
        say(&(lines.join("\n") + "\n"))?;
    }
    Ok(Outcome::of_losses(&losses))
}
