//! `mapwright fleet simulate`

use super::report::{RobotResult, TeamResult, write_results};
use crate::args::FleetSimulateArgs;
use crate::events::{Ending, Interrupt, Log, name_of};
use crate::failure::{Failure, Outcome};
use crate::liar::Liar;
use crate::output::OutputFolder;
use crate::progress::FirstPass;
use crate::robots::{STEP_S, Simulated};
use crate::settings;
use crate::terminal::{count, say, say_json};
use mapwright::{LaserScan, Odometry, Settings, Stamp, TurnRate};
use mapwright_fleet::{Chain, Kind, Record};
use mapwright_formats::LogEvent;
use mapwright_sim::RadioSettings;
use serde_json::{Map, Value, json};

/// After the logs robots have so long to agree, seconds.
const AGREE_S: f64 = 600.0;
/// Whether they agree is asked so often, steps.
const ASKED_EVERY: u64 = 20;

/// What a log says.
enum Event {
    Scan(LaserScan),
    Odometry(Odometry),
    TurnRate(TurnRate),
}

impl Event {
    fn stamp(&self) -> Stamp {
        match self {
            Self::Scan(scan) => scan.stamp,
            Self::Odometry(odometry) => odometry.stamp,
            Self::TurnRate(rate) => rate.stamp,
        }
    }
}

pub(super) fn run(args: &FleetSimulateArgs) -> Result<Outcome, Failure> {
    let settings = settings::load(&args.settings)?;
    let interrupt = Interrupt::watch()?;
    refuse(args)?;
    let mut logs = Vec::new();
    for path in &args.logs {
        let quiet = args.voice.quiet || args.voice.json;
        let mut first_pass = FirstPass::new(&interrupt, quiet);
        let mut log = Log::open_all(std::slice::from_ref(path), &args.source.choice(), &mut |name, messages| {
            first_pass.look(name, messages)
        })?;
        let mut events = Vec::new();
        let ending = log.for_each(&interrupt, |event, _| {
            match event {
                LogEvent::Scan(scan) => events.push(Event::Scan(scan.clone())),
                LogEvent::Odometry(odometry) => events.push(Event::Odometry(*odometry)),
                LogEvent::TurnRate(rate) => events.push(Event::TurnRate(*rate)),
                _ => {}
            }
            Ok(())
        })?;
        if ending == Ending::Interrupted {
            return Err(Failure::Usage("interrupted before all logs were read; nothing was written".to_owned()));
        }
        if !events.iter().any(|event| matches!(event, Event::Scan(_))) {
            return Err(Failure::NoScan { name: name_of(path), found: "none".to_owned() });
        }
        logs.push(events);
    }
    let names = names(args);
    let radio = RadioSettings { loss: args.loss, doubled: 0.05, delay_s: [0.005, 0.2], seed: args.seed };
    let mut team = Simulated::new(&names, settings, radio)?;
    team.split = args.split;
    for &(robot, lie, from_s) in &args.lies {
        team.robots[robot - 1].liar = Some(Liar::new(lie, from_s, args.seed));
    }
    let ended = drive(&mut team, &logs, args, &interrupt);
    let output = OutputFolder::create(&args.output)?;
    report(args, settings, &team, &ended, output)
}

fn refuse(args: &FleetSimulateArgs) -> Result<(), Failure> {
    let robots = args.logs.len();
    let wrong = args.dies.iter().map(|(robot, _)| *robot).find(|robot| !(1..=robots).contains(robot));
    if let Some(robot) = wrong {
        return Err(Failure::Usage(format!("--dies: expected a robot from 1 to {robots}, found {robot}")));
    }
    let wrong = args.lies.iter().map(|(robot, ..)| *robot).find(|robot| !(1..=robots).contains(robot));
    if let Some(robot) = wrong {
        return Err(Failure::Usage(format!("--lies: expected a robot from 1 to {robots}, found {robot}")));
    }
    if let Some((first, _)) = args.split.filter(|(first, _)| !(1..robots).contains(first)) {
        return Err(Failure::Usage(format!("--split: expected 1 to {} robots, found {first}", robots - 1)));
    }
    Ok(())
}

/// Robots are called by their logs, in their order.
fn names(args: &FleetSimulateArgs) -> Vec<String> {
    let digits = args.logs.len().to_string().len();
    let stem = |path: &std::path::Path| {
        let name = path.file_name().map_or_else(|| "log".to_owned(), |name| name.to_string_lossy().into_owned());
        name.split('.').next().unwrap_or("log").to_owned()
    };
    args.logs.iter().enumerate().map(|(k, path)| format!("{:0digits$}-{}", k + 1, stem(path))).collect()
}

/// How a simulation ended.
struct Ended {
    /// Seconds that the logs took, and until all agreed after them; none where they did not.
    drove_s: f64,
    agreed_s: Option<f64>,
    interrupted: bool,
}

fn drive(team: &mut Simulated, logs: &[Vec<Event>], args: &FleetSimulateArgs, interrupt: &Interrupt) -> Ended {
    let mut next = vec![0; logs.len()];
    let begins: Vec<Stamp> = logs.iter().map(|log| log.iter().map(Event::stamp).min().unwrap_or(Stamp(0))).collect();
    let (mut step, mut drove_s) = (0_u64, None::<f64>);
    loop {
        let seconds = step as f64 * STEP_S;
        let now = Stamp((seconds * 1e9) as i64);
        for (robot, log) in logs.iter().enumerate() {
            let dies_s = args.dies.iter().filter(|(who, _)| *who == robot + 1).map(|(_, at_s)| *at_s);
            if dies_s.fold(f64::INFINITY, f64::min) <= seconds {
                team.robots[robot].is_alive = false;
                next[robot] = log.len();
            }
            while let Some(event) = log.get(next[robot])
                && event.stamp().secs_since(begins[robot]) <= seconds
            {
                team.map(robot, now, |mapper| match event {
                    Event::Scan(scan) => Some(mapper.add_scan(scan)),
                    Event::Odometry(odometry) => {
                        mapper.add_odometry(odometry);
                        None
                    }
                    Event::TurnRate(rate) => {
                        mapper.add_turn_rate(rate);
                        None
                    }
                });
                next[robot] += 1;
                if next[robot] == log.len() {
                    team.map(robot, now, |mapper| Some(mapper.look_again()));
                    team.robots[robot].team.finish();
                }
            }
        }
        let has_worked = team.step(now, seconds);
        team.note_joins(seconds);
        step += 1;
        let has_driven = next.iter().zip(logs).all(|(next, log)| *next == log.len());
        if has_driven {
            drove_s = drove_s.or(Some(seconds));
        }
        let asks = !has_worked && step.is_multiple_of(ASKED_EVERY);
        if let Some(end_s) = drove_s
            && asks
            && is_over(team, seconds - end_s)
        {
            return Ended { drove_s: end_s, agreed_s: Some(seconds - end_s), interrupted: false };
        }
        if interrupt.came() || drove_s.is_some_and(|end_s| seconds - end_s > AGREE_S) {
            return Ended { drove_s: drove_s.unwrap_or(seconds), agreed_s: None, interrupted: interrupt.came() };
        }
    }
}

/// All have the same map, and none is about to look for old places once more.
fn is_over(team: &Simulated, since_end_s: f64) -> bool {
    since_end_s >= 15.0 && team.is_agreed()
}

fn report(
    args: &FleetSimulateArgs,
    settings: Settings,
    team: &Simulated,
    ended: &Ended,
    output: OutputFolder,
) -> Result<Outcome, Failure> {
    let honest = team.robots.iter().filter(|robot| robot.is_honest());
    let map = honest.filter(|robot| robot.is_alive).find_map(|robot| robot.team.map());
    let mut losses = Vec::new();
    if ended.interrupted {
        losses.push("interrupted; the results are those up to there".to_owned());
    } else if ended.agreed_s.is_none() {
        losses.push(format!("robots do not have the same map {AGREE_S} s after the end"));
    }
    let robots: Vec<RobotResult> = team.robots.iter().map(|robot| RobotResult::of(robot, map)).collect();
    let facts = facts(args, team, ended);
    let result = TeamResult { settings: &settings, map, robots: &robots, facts, losses };
    let written = write_results(result, output, &args.output)?;
    if args.voice.json {
        say_json(&written.value)?;
    } else if !args.voice.quiet {
        say(&words(team, ended, &written.value, &written.losses))?;
        say(&format!("written  {}: {}\n", args.output.display(), written.files.join(" ")))?;
    }
    Ok(Outcome::of_losses(&written.losses))
}

/// What `fleet.json` tells of the simulation.
fn facts(args: &FleetSimulateArgs, team: &Simulated, ended: &Ended) -> Map<String, Value> {
    let keyframes: usize = team.robots.iter().map(|robot| robot.mapper.keyframes().len()).sum();
    let (messages, sent_bytes) = team.radio.sent();
    let said = |kind: Kind| -> f64 {
        let chains = team.robots.first().into_iter().flat_map(|robot| robot.team.node().chains().values());
        let records = chains.flat_map(Chain::records).filter(|record| record.kind == kind);
        records.map(Record::message_bytes).sum::<usize>() as f64 / keyframes.max(1) as f64
    };
    let facts = [
        ("drove_s", json!(ended.drove_s)),
        ("agreed_s", json!(ended.agreed_s)),
        ("keyframes_mapped", json!(keyframes)),
        ("bytes_per_keyframe", json!({ "mapped": said(Kind::Entries), "solution": said(Kind::Solution) })),
        ("sent", json!({ "messages": messages, "bytes": sent_bytes })),
        ("loss", json!(args.loss)),
    ];
    facts.into_iter().map(|(key, fact)| (key.to_owned(), fact)).collect()
}

fn words(team: &Simulated, ended: &Ended, value: &Value, losses: &[String]) -> String {
    let mut lines = Vec::new();
    for robot in &team.robots {
        let role = if robot.team.is_solving() { ", solves" } else { "" };
        let life = if robot.is_alive { "" } else { ", died" };
        let joined = robot.joined_s.map_or("never one map".to_owned(), |s| format!("one map after {s:.0} s"));
        lines.push(format!(
            "{}: {}, {joined}, took {:.1} s for its own map, {:.1} s for the team{role}{life}",
            robot.name,
            count(robot.mapper.keyframes().len() as u64, "keyframe"),
            robot.mapped.as_secs_f64(),
            robot.shared.as_secs_f64(),
        ));
    }
    let agreed = ended.agreed_s.map_or("not agreed".to_owned(), |s| format!("agreed {s:.0} s later"));
    lines.push(format!("drove for {:.0} s, {agreed}", ended.drove_s));
    let bytes = |of: &str| value["bytes_per_keyframe"][of].as_f64().unwrap_or(0.0);
    lines.push(format!(
        "told {:.0} bytes a keyframe, {:.0} of them of the solution",
        bytes("mapped") + bytes("solution"),
        bytes("solution")
    ));
    lines.extend(losses.iter().map(|loss| format!("! {loss}")));
    lines.join("\n") + "\n"
}
