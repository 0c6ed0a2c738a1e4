//! What `fleet join` leaves behind.

use super::member::Member;
use super::robot::RobotFiles;
use super::told::plain;
use crate::args::FleetJoinArgs;
use crate::failure::{Failure, Outcome};
use crate::maps::{MapWriter, remove_outdated_maps};
use crate::output::OutputFolder;
use crate::terminal::{count, say, say_json};
use mapwright::{Mapper, Pose2, ScanPose, Session, Settings, Stamp};
use mapwright_formats::TumWriter;
use serde_json::{Value, json};
use std::io::Write;

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
pub(super) fn write(run: Run<'_>, mut output: OutputFolder) -> Result<Outcome, Failure> {
    let Run { args, robot, settings, mapper, member, settled_s, mut losses } = run;
    let map = member.team.map();
    if map.is_none() {
        losses.push("there is no map of all yet; session.mapwright is this robot's own".to_owned());
    }
    let session = map.unwrap_or_else(|| mapper.session());
    let pieces = write_maps(settings, session, &mut output)?;
    let placed = write_trajectory(mapper, session, &mut output)?;
    if placed < mapper.session().scans().len() {
        let left = (mapper.session().scans().len() - placed) as u64;
        losses.push(format!("where this robot was at {} is not in the map of all", count(left, "scan")));
    }
    if pieces > 1 {
        losses.push(format!("the robots' maps are {pieces} that nothing joins"));
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
    let value = json!({
        "robot": robot.name,
        "team": robot.team.team,
        "pieces": pieces,
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
        "losses": losses,
    });
    output.write_json("fleet.json", &value)?;
    let folder = output.path("");
    output.commit()?;
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

fn write_maps(settings: Settings, session: &Session, output: &mut OutputFolder) -> Result<usize, Failure> {
    output.write("session.mapwright", |writer| Ok(writer.write_all(&session.encode())?))?;
    let maps = session.maps();
    let writer = MapWriter { settings: &settings, session, drawn: None, turn_upright: true, picture_side: None };
    for (number, separate) in maps.iter().enumerate() {
        writer.write(output, (number, separate), &[])?;
    }
    remove_outdated_maps(output, maps.len());
    Ok(maps.len())
}

/// At how many of its scans it is known where the robot was.
fn write_trajectory(mapper: &Mapper, map: &Session, output: &mut OutputFolder) -> Result<usize, Failure> {
    let pose = |scan: &ScanPose| -> Option<(Stamp, Pose2)> {
        let map_from_keyframe = map.map_from_keyframe().get(map.place(scan.keyframe?)?)?;
        Some((scan.stamp, *map_from_keyframe * scan.keyframe_from_robot))
    };
    let poses: Vec<(Stamp, Pose2)> = mapper.session().scans().iter().filter_map(pose).collect();
    output.write("trajectory.tum", |writer| {
        let mut tum = TumWriter::new(writer);
        poses.iter().try_for_each(|(stamp, pose)| tum.write_planar(*stamp, *pose))?;
        tum.finish().map(drop)
    })?;
    Ok(poses.len())
}
