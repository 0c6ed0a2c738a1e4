//! What a team leaves in its folder: the session of all, maps, trajectories, `fleet.json` and the page.

use crate::failure::Failure;
use crate::maps::{MadeMap, MapWriter, PAGE, remove_outdated_maps};
use crate::output::{OutputFolder, write_whole};
use crate::page::{Beside, FLEET, report};
use crate::picture::RunNames;
use crate::robots::Robot;
use crate::terminal::count;
use mapwright::{FragmentStart, Piece, Pose2, RunId, SeparateMap, Session, Settings, Stamp};
use mapwright_fleet::Node;
use mapwright_formats::TumWriter;
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::io::Write as _;
use std::path::Path;

/// What is known of a robot in the end; what nobody knows is none.
#[derive(Debug, Clone, Default)]
pub(in crate::commands) struct RobotResult {
    pub(in crate::commands) name: String,
    pub(in crate::commands) is_alive: bool,
    pub(in crate::commands) is_solving: bool,
    /// When its own map and that of the team became one, seconds.
    pub(in crate::commands) joined_s: Option<f64>,
    /// What its own map took, and what the team took, seconds.
    pub(in crate::commands) map_s: Option<f64>,
    pub(in crate::commands) team_s: Option<f64>,
    pub(in crate::commands) refused: Vec<Refused>,
    /// Messages before which some were missing.
    pub(in crate::commands) early: u64,
    /// Where it was in the map of all at each of its scans; where that is not known its keyframes say it.
    pub(in crate::commands) way: Vec<(Stamp, Pose2)>,
}

impl RobotResult {
    /// Of a simulated robot.
    pub(in crate::commands) fn of(robot: &Robot, map: Option<&Session>) -> Self {
        Self {
            name: robot.name.clone(),
            is_alive: robot.is_alive,
            is_solving: robot.team.is_solving(),
            joined_s: robot.joined_s,
            map_s: Some(robot.mapped.as_secs_f64()),
            team_s: Some(robot.shared.as_secs_f64()),
            refused: refused_by(robot.team.node()),
            early: robot.team.node().early(),
            way: map.map_or_else(Vec::new, |map| way_in(map, robot.mapper.session())),
        }
    }
}

/// What a robot did not use: why, of whom where that is known, how often.
#[derive(Debug, Clone)]
pub(in crate::commands) struct Refused {
    pub(in crate::commands) why: &'static str,
    pub(in crate::commands) of: Option<String>,
    pub(in crate::commands) times: u64,
}

/// All that a node has refused.
pub(in crate::commands) fn refused_by(node: &Node) -> Vec<Refused> {
    let one = |(why, of, times): (mapwright_fleet::Refusal, Option<&str>, u64)| Refused {
        why: why.words(),
        of: of.map(str::to_owned),
        times,
    };
    node.refused().map(one).collect()
}

/// Where a robot was at each scan of its own session, in the map of all.
pub(in crate::commands) fn way_in(map: &Session, own: &Session) -> Vec<(Stamp, Pose2)> {
    let pose = |scan: &mapwright::ScanPose| {
        let map_from_keyframe = map.map_from_keyframe().get(map.place(scan.keyframe?)?)?;
        Some((scan.stamp, *map_from_keyframe * scan.keyframe_from_robot))
    };
    own.scans().iter().filter_map(pose).collect()
}

/// What a team has made.
pub(in crate::commands) struct TeamResult<'a> {
    pub(in crate::commands) settings: &'a Settings,
    /// The session of all, if there is one.
    pub(in crate::commands) map: Option<&'a Session>,
    /// In the order of the roster.
    pub(in crate::commands) robots: &'a [RobotResult],
    /// What else `fleet.json` tells.
    pub(in crate::commands) facts: Map<String, Value>,
    pub(in crate::commands) losses: Vec<String>,
}

/// What was written.
pub(in crate::commands) struct Written {
    pub(in crate::commands) files: Vec<Cow<'static, str>>,
    /// `fleet.json`.
    pub(in crate::commands) value: Value,
    pub(in crate::commands) losses: Vec<String>,
}

/// Writes and commits all files of a team, and the page that shows them.
pub(in crate::commands) fn write_results(
    team: TeamResult<'_>,
    mut output: OutputFolder,
    folder: &Path,
) -> Result<Written, Failure> {
    let mut losses = team.losses.clone();
    let maps = match team.map {
        Some(map) => write_map(&team, map, &mut output)?,
        None => {
            losses.push("no robot has a map of all".to_owned());
            Vec::new()
        }
    };
    if maps.len() > 1 {
        losses.push(format!("the robots' maps are {} that nothing joins", maps.len()));
    }
    losses.extend(team.map.and_then(left_out));
    let value = fleet_json(&team, &maps, &losses);
    output.write_json(FLEET, &value)?;
    let mut files = output.commit()?;
    if team.map.is_some() {
        let page = report(folder, Beside { reference: None, relations: None })?;
        let path = folder.join(PAGE);
        write_whole(&path, |file| file.write_all(page.html.as_bytes()).map_err(|error| Failure::write(&path, error)))?;
        files.push(Cow::Borrowed(PAGE));
    }
    Ok(Written { files, value, losses })
}

fn fleet_json(team: &TeamResult<'_>, maps: &[MadeMap], losses: &[String]) -> Value {
    let names: Vec<&str> = team.robots.iter().map(|robot| robot.name.as_str()).collect();
    let robots: Vec<Value> = team.robots.iter().map(|robot| robot_json(robot, team.map)).collect();
    let further: Vec<Value> = maps.iter().skip(1).map(MadeMap::to_json).collect();
    let mut value = json!({
        "log": names.join(", "),
        "robots": robots,
        "pieces": maps.len(),
        "keyframes": team.map.map_or(0, |map| map.keyframes().len()),
        "map": maps.first().map(MadeMap::to_json),
        "further_maps": further,
        "losses": losses,
    });
    team.facts.iter().for_each(|(key, fact)| value[key] = fact.clone());
    value
}

fn robot_json(robot: &RobotResult, map: Option<&Session>) -> Value {
    let refused: Vec<Value> =
        robot.refused.iter().map(|r| json!({ "why": r.why, "of": r.of, "times": r.times })).collect();
    json!({
        "name": robot.name,
        "alive": robot.is_alive,
        "solves": robot.is_solving,
        "keyframes": map.map_or(0, |map| keyframes_of(map, &robot.name).count()),
        "one_map_s": robot.joined_s,
        "map_s": robot.map_s,
        "team_s": robot.team_s,
        "refused": refused,
        "early": robot.early,
    })
}

/// Places of a robot's keyframes in the map of all.
fn keyframes_of<'a>(map: &'a Session, name: &str) -> impl Iterator<Item = usize> + 'a {
    let robot = RunId::of_robot(name).robot;
    let keyframes = map.keyframes().iter().enumerate();
    keyframes.filter(move |(_, keyframe)| keyframe.id.robot == robot).map(|(place, _)| place)
}

/// Whether nothing but what a robot's own readings contradict is in a map: nobody can say where it belongs.
fn is_contradicted(pieces: &[Piece], map: &SeparateMap) -> bool {
    let mut fragments = map.pieces.iter().filter_map(|piece| pieces.get(*piece)).flat_map(|piece| &piece.fragments);
    fragments.all(|fragment| fragment.start == FragmentStart::Contradicted)
}

/// The maps that are drawn.
fn believed(session: &Session) -> Vec<SeparateMap> {
    let (pieces, mut maps) = (session.pieces(), session.maps());
    maps.retain(|map| map.pieces.is_empty() || !is_contradicted(&pieces, map));
    maps
}

/// Those that are not, in words.
fn left_out(session: &Session) -> Option<String> {
    let (pieces, maps) = (session.pieces(), session.maps());
    let left = maps.iter().filter(|map| !map.pieces.is_empty() && is_contradicted(&pieces, map));
    let keyframes: usize = left.map(|map| map.places().count()).sum();
    let words = || {
        format!(
            "left out of all maps, for their robots' own readings contradict them: {}",
            count(keyframes as u64, "keyframe")
        )
    };
    (keyframes > 0).then(words)
}

/// The session, its maps, and where each robot was.
fn write_map(team: &TeamResult<'_>, map: &Session, output: &mut OutputFolder) -> Result<Vec<MadeMap>, Failure> {
    output.write("session.mapwright", |writer| Ok(writer.write_all(&map.encode())?))?;
    let maps = believed(map);
    let names = RunNames::of_robots(team.robots.iter().map(|robot| robot.name.as_str()));
    let writer = MapWriter {
        settings: team.settings,
        session: map,
        drawn: None,
        sonars: None,
        turn_upright: true,
        picture_side: None,
        names: &names,
    };
    let mut made = Vec::new();
    for (number, separate) in maps.iter().enumerate() {
        let own = |robot: &RobotResult| keyframes_of(map, &robot.name).collect::<Vec<_>>();
        let keyframes = team.robots.iter().flat_map(own).filter(|place| separate.has(*place));
        // Of one robot alone there is one run, and its way is drawn as that of any.
        let way: Vec<Pose2> = keyframes.map(|place| map.map_from_keyframe()[place]).collect();
        made.push(writer.write(output, (number, separate), &way)?);
    }
    remove_outdated_maps(output, maps.len());
    let mut all: Vec<(Stamp, Pose2)> = Vec::new();
    for robot in team.robots {
        let keyframe = |place: usize| (map.keyframes()[place].stamp, map.map_from_keyframe()[place]);
        let poses = match &robot.way[..] {
            [] => keyframes_of(map, &robot.name).map(keyframe).collect(),
            way => way.to_vec(),
        };
        write_poses(output, format!("trajectory-{}.tum", robot.name), &poses)?;
        all.extend(poses);
    }
    all.sort_by_key(|(stamp, _)| *stamp);
    write_poses(output, "trajectory.tum".to_owned(), &all)?;
    Ok(made)
}

fn write_poses(output: &mut OutputFolder, name: String, poses: &[(Stamp, Pose2)]) -> Result<(), Failure> {
    output.write(name, |writer| {
        let mut tum = TumWriter::new(writer);
        poses.iter().try_for_each(|(stamp, pose)| tum.write_planar(*stamp, *pose))?;
        tum.finish().map(drop)
    })
}
