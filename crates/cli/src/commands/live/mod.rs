//! `mapwright live`: a robot maps while it drives.
//!
//! Threads: those of the wire, or a player, put what arrives in at the door; this one maps; one draws the map; one tells `map -> odom`. None waits for
//! another but by the door.

mod asking;
mod beat;
mod cable;
mod clock;
mod drawer;
mod driver;
mod node;
mod play;
mod robot;
mod view;
mod wires;

use crate::args::LiveArgs;
use crate::events::Interrupt;
use crate::failure::{Failure, Outcome};
use crate::mapping::{Mapping, settings_of};
use crate::output::OutputFolder;
use crate::session::{earlier_in_plane, to_go_on_with};
#[cfg(feature = "view")]
pub(crate) use view::{access, pen};

use clock::Clock;
use drawer::Outlet;
use driver::{Live, Localising, Ros, Work};
use mapwright::{Mapper, Pose2, Settings};
use mapwright_geom::Cov3;
use mapwright_live::node::NodeName;
use mapwright_live::node::parameters::{Parameters, Setting};
use mapwright_live::{Arrived, Door, Gate, GateSettings, Heard, Lane};
use node::Node;
use robot::{Names, Told};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;
use view::View;

/// Messages that wait at the door at most: of one topic of scans, of transforms, of all else.
const SCANS_MOST: usize = 20;
const TRANSFORMS_MOST: usize = 2000;
const OTHERS_MOST: usize = 2000;
/// How often it is looked whether somebody wants to stop.
const LOOK: Duration = Duration::from_millis(50);

/// What arrives, on its way to the mapper.
pub(super) type Entrance = Door<(Arrived, Heard)>;

/// Which lane of the door is whose: first those of the topics of scans.
#[derive(Debug, Clone)]
pub(super) struct Lanes {
    scans: Vec<String>,
}

impl Lanes {
    fn of_scan(&self, topic: &str) -> Lane {
        self.scans.iter().position(|name| name == topic).unwrap_or(0)
    }

    fn transforms(&self) -> Lane {
        self.scans.len()
    }

    fn others(&self) -> Lane {
        self.scans.len() + 1
    }

    fn door(&self) -> Entrance {
        let most: Vec<usize> = self.scans.iter().map(|_| SCANS_MOST).chain([TRANSFORMS_MOST, OTHERS_MOST]).collect();
        Door::new(&most)
    }
}

/// What the parameters say of where a robot begins.
struct Begin {
    /// A session, and whether the robot is only found in it.
    session: Option<(PathBuf, bool)>,
    /// Where it is in that session's map.
    pose: Option<(Pose2, Cov3)>,
}

/// What is done with scans: a map that begins, that goes on, or that is finished.
fn work(args: &LiveArgs, settings: Settings, begin: Begin) -> Result<Work, Failure> {
    let (named, is_found) = begin.session.map_or((None, false), |(path, is_found)| (Some(path), is_found));
    let finished = args.localise.clone().or_else(|| named.clone().filter(|_| is_found));
    if let Some(path) = finished {
        let mut localising = localising(&path, settings)?;
        if let Some((map_from_robot, covariance)) = begin.pose {
            localising.mapper.place(map_from_robot, covariance);
        }
        return Ok(Work::Localising(Box::new(localising)));
    }
    let is_there = |name: &str| args.output.join(name).exists();
    let goes_on = args.goes_on && (is_there("session.mapwright") || is_there("session.mapwright.part"));
    let resumed = args.mapping.resume.clone().or_else(|| named.filter(|_| !args.goes_on));
    let earlier = if goes_on {
        Some(to_go_on_with(&args.output)?)
    } else {
        resumed.as_deref().map(earlier_in_plane).transpose()?
    };
    let is_earlier = earlier.is_some();
    let output = OutputFolder::create(&args.output)?;
    let mut mapping = Mapping::begin_with(&args.mapping, settings, output, None, earlier)?;
    if is_earlier {
        // Nobody has watched the robot since: it may be anywhere.
        mapping.switch_on()?;
    }
    Ok(Work::Mapping(Box::new(mapping)))
}

pub(crate) fn run(args: &LiveArgs) -> Result<Outcome, Failure> {
    let mut settings = settings_of(&args.mapping)?;
    if let Some(lidar) = args.lidar.as_ref().filter(|lidar| !lidar.kind.is_serial()) {
        return Err(Failure::Usage(format!(
            "{:?} is a lidar of space, which is not mapped while it drives yet; record it as .pcap and map that",
            lidar.kind
        )));
    }
    if !args.mapping.settings.set.iter().any(|(key, _)| key == "loops.jobs") {
        settings.set("loops.jobs", "handed-out")?;
    }
    let node = NodeName::new(&args.ros_names.node).map_err(|error| Failure::Usage(error.to_string()))?;
    let (parameters, words) = robot::parameters(&args.ros_names, &node)?;
    robot::apply(&parameters, &args.mapping, &mut settings)?;
    let interrupt = Interrupt::watch()?;
    let begin = Begin { session: robot::session(&parameters)?, pose: robot::start(&parameters) };
    let work = work(args, settings, begin)?;
    drive(args, (work, settings), (node, parameters, words), &interrupt)
}

fn localising(path: &Path, settings: Settings) -> Result<Localising, Failure> {
    let (session, _) = earlier_in_plane(path)?;
    if session.keyframes().is_empty() {
        let cause = "expected a map, found no keyframe".to_owned();
        return Err(Failure::Session { path: path.to_owned(), cause });
    }
    Ok(Localising { mapper: Mapper::localising(settings, session)?, scans: 0, located: 0, first: None })
}

fn drive(
    args: &LiveArgs,
    (work, settings): (Work, Settings),
    (node, parameters, words): (NodeName, Parameters, Vec<String>),
    interrupt: &Interrupt,
) -> Result<Outcome, Failure> {
    let names = Names::of(&args.ros_names, &parameters, &node);
    let is_heard = args.log.is_none() && args.lidar.is_none();
    let scans = match (&args.log, &args.lidar) {
        (Some(_), _) => vec![play::TOPIC.to_owned()],
        (None, Some(_)) => vec![cable::TOPIC.to_owned()],
        (None, None) => names.scans.clone(),
    };
    let lanes = Lanes { scans };
    let (door, clock, over) =
        (Arc::new(lanes.door()), Arc::new(Clock::start(names.is_simulated)), AtomicBool::new(false));
    let mut gate = Gate::new(GateSettings {
        robot_frame: names.robot_frame.clone(),
        odom_frame: names.odom_frame.clone(),
        wait: Duration::from_secs_f64(parameters.number(Setting::TransformWait).clamp(0.0, 10.0)),
        ..GateSettings::default()
    });
    let mut wire = if args.ros || is_heard { Some(wires::join(args.ros_names.wire, &node)?) } else { None };
    let (mut ros, mut outlet) = (None, None);
    if let Some(wire) = wire.as_deref_mut() {
        let (to_draw, heard) = channel();
        let (told, node) = (Arc::new(Told::advertise(wire, &node)?), Arc::new(Node::new(wire, node, parameters)?));
        outlet = Some((Outlet::advertise(wire, &names)?, heard));
        let others = (&door, lanes.others());
        node::serve(wire, &node, others, (&clock, &names.map_frame), &to_draw)?;
        node::hear(wire, &node, others, &clock)?;
        if is_heard {
            robot::hear(wire, &names, &lanes, &door, &clock)?;
        }
        ros = Some(Ros { names, told, node, to_draw });
    }
    let ended = ros.as_ref().map(|ros| Arc::clone(&ros.node));
    let view = View::open(&args.view, &settings)?;
    let mut live =
        Live::new((work, settings), (lanes.clone(), Arc::clone(&door)), Arc::clone(&clock), args, (ros, view));
    words.iter().for_each(|words| live.notice(words));
    let (at_cable, held) = (Arc::clone(&live.at_cable), Arc::clone(&live.is_held));
    let played = thread::scope(|scope| {
        let (over, door, clock) = (&over, &*door, &*clock);
        let player = args.log.as_deref().map(|log| {
            scope.spawn(|| {
                let played = play::play(log, args, (door, &lanes), clock, (&held, over));
                door.close();
                played
            })
        });
        if let Some(place) = &args.lidar {
            scope.spawn(|| {
                cable::read(
                    place,
                    args.lidar_mount.unwrap_or(Pose2::IDENTITY),
                    (door, &lanes),
                    clock,
                    (&at_cable, over),
                )
            });
        }
        if let Some(outlet) = outlet {
            live.start(scope, outlet, &args.output);
        }
        scope.spawn(|| {
            let is_shut_down = || ended.as_ref().is_some_and(|node| node.is_shut_down.load(Ordering::Acquire));
            while !interrupt.came() && !is_shut_down() && !over.load(Ordering::Acquire) {
                thread::sleep(LOOK);
            }
            over.store(true, Ordering::Release);
            door.close();
        });
        let mapped = mapwright_live::map(door, &|| clock.since_start(), &mut gate, &mut live);
        over.store(true, Ordering::Release);
        live.stop();
        let played = player.map(|player| player.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        mapped.map_err(|error| Failure::Log(error.to_string()))?;
        played.transpose()
    })?;
    drop(wire);
    live.finish(args, played, &mut gate, interrupt.came())
}
