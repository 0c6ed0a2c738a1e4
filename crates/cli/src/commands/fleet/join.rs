//! `mapwright fleet join`

use super::member::{Ended, Member, Stay};
use super::results;
use super::robot::RobotFiles;
use super::state::{NoState, State};
use super::told::{SUBJECT, unusual};
use crate::args::FleetJoinArgs;
use crate::events::{Ending, Interrupt, Log};
use crate::failure::{Failure, Outcome};
use crate::output::OutputFolder;
use crate::progress::FirstPass;
use crate::terminal::say;
use mapwright::{Mapper, Pose2, RunId, Settings, Stamp, Update};
use mapwright_fleet::{MESSAGE_AT_MOST, Node, NodeSettings, Team};
use mapwright_formats::LogEvent;
use mapwright_net::{Wire, WireSettings};
use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

/// How often a robot that waits for the next scan looks whether the user ends it.
const LOOK: Duration = Duration::from_millis(50);
/// Certificates that end within so many days are told.
const SOON_DAYS: u64 = 14;

pub(super) fn run(args: &FleetJoinArgs) -> Result<Outcome, Failure> {
    let robot = RobotFiles::read(&args.config)?;
    let settings = settings(args, &robot)?;
    let interrupt = Interrupt::watch()?;
    let is_quiet = args.voice.quiet || args.voice.json;
    let mut first_pass = FirstPass::new(&interrupt, is_quiet);
    let mut watch = |name: &str, messages| first_pass.look(name, messages);
    let mut log = Log::open_all(std::slice::from_ref(&args.log), &args.source.choice(), &mut watch)?;
    drop(first_pass);
    let folder = args.output.clone().unwrap_or_else(|| PathBuf::from(format!("mapwright-{}", robot.name)));
    let output = OutputFolder::create(&folder)?;
    let (state, unwritten) = match State::begin(&robot.state) {
        Ok(state) => (Some(state), None),
        Err(NoState::Failure(failure)) => return Err(failure),
        Err(NoState::Unwritten(failure)) => {
            (None, Some(format!("{failure}; this robot maps and says nothing to others")))
        }
    };
    let session = state.as_ref().map_or(0, |state| state.session);
    let wire = state.is_some().then(|| open(&robot)).transpose()?;
    let roster = robot.roster.clone();
    let node = Node::new(NodeSettings::default(), roster, &robot.name, robot.secret.clone(), session);
    let node = node.ok_or_else(|| Failure::Usage(format!("expected {} in the team, with its key", robot.name)))?;
    let id = RunId { session, ..RunId::of_robot(&robot.name) };
    let mut mapper = Mapper::of_run(settings, id, Pose2::IDENTITY)?;
    let (may_speak, files) = (state.is_some(), &robot);
    let again = Box::new(move || may_speak.then(|| open(files).ok()).flatten());
    let member = Member::new(Team::new(node, settings)?, wire, again, unusual(&settings), is_quiet);
    if !is_quiet {
        say(&begun(&robot, unwritten.as_ref()))?;
    }
    let stay = Stay { quiet_s: args.stay, at_most_s: args.wait };
    let (sender, updates) = channel();
    let (ending, ended) = std::thread::scope(|scope| {
        let interrupt = &interrupt;
        let thread = scope.spawn(move || member.run(&updates, interrupt, stay));
        let ending = drive(&mut log, &mut mapper, args.rate, interrupt, sender);
        (ending, thread.join())
    });
    let Ok(ended) = ended else {
        return Err(Failure::Usage("the robot's part in the team has failed; that is a fault of mapwright".to_owned()));
    };
    let ending = ending?;
    let mut losses: Vec<String> = unwritten.into_iter().collect();
    let read = log.finish()?;
    losses.extend(read.losses());
    if ending == Ending::Interrupted || interrupt.came() {
        losses.push("interrupted; the results are those up to there".to_owned());
    }
    drop(state);
    let Ended { member, settled_s } = ended;
    results::write(
        results::Run { args, robot: &robot, settings, mapper: &mapper, member, settled_s, losses },
        output,
        &folder,
    )
}

fn settings(args: &FleetJoinArgs, robot: &RobotFiles) -> Result<Settings, Failure> {
    let mut settings = robot.settings;
    for (key, value) in &args.set {
        settings.set(key, value)?;
    }
    settings.validate()?;
    Ok(settings)
}

/// What the wire is told of a robot; `status` listens nowhere.
pub(super) fn wire_settings(robot: &RobotFiles) -> WireSettings {
    WireSettings {
        team: robot.team.team.clone(),
        robots: robot.names(),
        relays: robot.relays.clone(),
        listen: robot.listen.clone(),
        connect: robot.connect.clone(),
        message_at_most: MESSAGE_AT_MOST,
    }
}

fn open(robot: &RobotFiles) -> Result<Wire, Failure> {
    let failed = |cause: mapwright_net::NetError| Failure::Usage(format!("{}: {cause}", robot.name));
    let wire = Wire::open(wire_settings(robot), &robot.credentials).map_err(failed)?;
    wire.also_hear(SUBJECT).map_err(failed)?;
    Ok(wire)
}

fn begun(robot: &RobotFiles, unwritten: Option<&String>) -> String {
    let others = robot.names().into_iter().filter(|name| *name != robot.name).collect::<Vec<_>>().join(", ");
    let mut text =
        format!("{} of {}, with {others}; listens at {}\n", robot.name, robot.team.team, robot.listen.join(", "));
    let days = robot.credentials.days_left();
    if days < SOON_DAYS {
        text += &format!("! its certificate ends in {days} days: mapwright fleet keys {} --force\n", robot.name);
    }
    if let Some(unwritten) = unwritten {
        text += &format!("! {unwritten}\n");
    }
    text
}

/// The log through the robot's mapper, as fast as it was driven or faster; its updates go to the team.
fn drive(
    log: &mut Log,
    mapper: &mut Mapper,
    rate: f64,
    interrupt: &Interrupt,
    updates: Sender<Update>,
) -> Result<Ending, Failure> {
    let begun = Instant::now();
    let mut first: Option<Stamp> = None;
    let ending = log.for_each(interrupt, |event, _| {
        let stamp = match &event {
            LogEvent::Scan(scan) => scan.stamp,
            LogEvent::Odometry(odometry) => odometry.stamp,
            LogEvent::TurnRate(rate) => rate.stamp,
            _ => return Ok(()),
        };
        let due_s = stamp.secs_since(*first.get_or_insert(stamp)) / rate;
        wait_until(begun, due_s, interrupt);
        match event {
            LogEvent::Scan(scan) => {
                // The other side goes on until this one is done.
                let _ = updates.send(mapper.add_scan(scan));
            }
            LogEvent::Odometry(odometry) => mapper.add_odometry(odometry),
            LogEvent::TurnRate(rate) => drop(mapper.add_turn_rate(rate)),
            _ => {}
        }
        Ok(())
    })?;
    if ending == Ending::OfLog {
        let _ = updates.send(mapper.look_again());
    }
    Ok(ending)
}

fn wait_until(begun: Instant, due_s: f64, interrupt: &Interrupt) {
    loop {
        let left_s = due_s - begun.elapsed().as_secs_f64();
        if left_s.is_nan() || left_s <= 0.0 || interrupt.came() {
            return;
        }
        std::thread::sleep(LOOK.min(Duration::from_secs_f64(left_s)));
    }
}
