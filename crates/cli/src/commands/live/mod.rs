//! `mapwright live`: a robot maps while it drives.
//!
//! Threads: those of the wire, or a player, put what arrives in at the door; this one maps; one draws the map; one tells `map -> odom`. None waits for
//! another but by the door.

mod asking;
mod beat;
mod cable;
mod clock;
mod clouds;
mod datagrams;
mod drawer;
mod driver;
mod goals;
mod node;
mod pictures;
mod plane;
mod play;
mod replay;
mod robot;
mod view;
mod wires;
mod work;

use crate::args::LiveArgs;
use crate::events::Interrupt;
use crate::failure::{Failure, Outcome};
use crate::mapping::{Mapping, settings_of};
use crate::output::OutputFolder;
use crate::session::{earlier_in_plane, earlier_in_space, to_go_on_with, to_go_on_with_in_space};
use crate::space::Drive;
#[cfg(feature = "view")]
pub(crate) use view::{access, pen};

use beat::Known;
use clock::Clock;
use clouds::Clouds;
use drawer::{Drawn, Wanted};
use driver::{Live, Ros};
use mapwright::{Mapper, Pose2, Settings};
use mapwright_geom::Cov3;
use mapwright_live::node::NodeName;
use mapwright_live::node::parameters::{Parameters, Setting};
use mapwright_live::{Arrived, Door, Gate, GateSettings, Heard, KnownSensors, Lane};
use mapwright_logs::Choice;
use node::Node;
use plane::{Localising, Plane};
use replay::Replay;
use robot::{Names, Told};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;
use view::View;
use work::Work;

/// Messages that wait at the door at most: of one topic of scans, or of clouds, of transforms, of all else.
const SCANS_MOST: usize = 20;
const CLOUDS_MOST: usize = 10;
const TRANSFORMS_MOST: usize = 2000;
const OTHERS_MOST: usize = 2000;
/// A large cloud, and the beginning of the next one, bytes.
const RECEIVED_LEAST: u64 = 4 << 20;
/// How often it is looked whether somebody wants to stop.
const LOOK: Duration = Duration::from_millis(50);

/// What arrives, on its way to the mapper.
pub(super) type Entrance = Door<(Arrived, Heard)>;

/// Which lane of the door is whose: first those of the topics of scans.
#[derive(Debug, Clone)]
pub(super) struct Lanes {
    scans: Vec<String>,
    /// Whether these are topics of clouds.
    are_clouds: bool,
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
        let of_one = if self.are_clouds { CLOUDS_MOST } else { SCANS_MOST };
        let most: Vec<usize> = self.scans.iter().map(|_| of_one).chain([TRANSFORMS_MOST, OTHERS_MOST]).collect();
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
fn in_plane(args: &LiveArgs, settings: Settings, begin: Begin) -> Result<Plane, Failure> {
    let (named, is_found) = begin.session.map_or((None, false), |(path, is_found)| (Some(path), is_found));
    let finished = args.localise.clone().or_else(|| named.clone().filter(|_| is_found));
    if let Some(path) = finished {
        let mut localising = localising(&path, settings)?;
        if let Some((map_from_robot, covariance)) = begin.pose {
            localising.mapper.place(map_from_robot, covariance);
        }
        return Ok(Plane::Localising(Box::new(localising)));
    }
    let resumed = args.mapping.resume.clone().or_else(|| named.filter(|_| !args.goes_on));
    let earlier = if goes_on(args) {
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
    Ok(Plane::Mapping(Box::new(mapping)))
}

/// What is done with clouds: a map that begins or goes on.
fn in_space(args: &LiveArgs, settings: Settings, begin: Begin) -> Result<Clouds, Failure> {
    let is_found = begin.session.as_ref().is_some_and(|(_, is_found)| *is_found);
    if args.localise.is_some() || is_found {
        let words = "to be found in a finished map is for planar lasers yet, found clouds";
        return Err(Failure::Usage(words.to_owned()));
    }
    if args.mapping.start.is_some() {
        return Err(Failure::Usage("--start is for planar lasers: maps of space begin at their origin".to_owned()));
    }
    let named = begin.session.map(|(path, _)| path);
    let resumed = args.mapping.resume.clone().or_else(|| named.filter(|_| !args.goes_on));
    let earlier = if goes_on(args) {
        Some(to_go_on_with_in_space(&args.output)?)
    } else {
        resumed.as_deref().map(earlier_in_space).transpose()?
    };
    let output = OutputFolder::create(&args.output)?;
    Ok(Clouds(Drive::begin(&args.mapping, settings, output, earlier)?))
}

/// Whether there is something to go on with, where that is asked for.
fn goes_on(args: &LiveArgs) -> bool {
    let is_there = |name: &str| args.output.join(name).exists();
    args.goes_on && (is_there("session.mapwright") || is_there("session.mapwright.part"))
}

pub(crate) fn run(args: &LiveArgs) -> Result<Outcome, Failure> {
    let mut settings = settings_of(&args.mapping)?;
    if !args.mapping.settings.set.iter().any(|(key, _)| key == "loops.jobs") {
        settings.set("loops.jobs", "handed-out")?;
    }
    let node = NodeName::new(&args.ros_names.node).map_err(|error| Failure::Usage(error.to_string()))?;
    let (parameters, words) = robot::parameters(&args.ros_names, &node)?;
    robot::apply(&parameters, &args.mapping, &mut settings)?;
    let interrupt = Interrupt::watch()?;
    let begin = Begin { session: robot::session(&parameters)?, pose: robot::start(&parameters) };
    let is_of_space = args.log.as_ref().map_or(Ok(false), |log| play::is_of_space(log, args))?;
    let is_lidar_of_space = args.lidar.as_ref().is_some_and(|lidar| !lidar.kind.is_serial());
    if is_of_space || is_lidar_of_space || !args.ros_names.points.is_empty() {
        let clouds = in_space(args, settings, begin)?;
        let replay = args.replay.as_deref().map(|path| {
            let earlier = earlier_in_space(path)?;
            Replay::of(path, &earlier.session, clouds.newest().next_scan(), &settings)
        });
        return drive(args, (clouds, settings, replay.transpose()?), (node, parameters, words), &interrupt);
    }
    if args.ros_names.band.is_some() {
        return Err(Failure::Usage("--band is of clouds: scans of a planar laser make a grid without it".to_owned()));
    }
    let plane = in_plane(args, settings, begin)?;
    let replay = args.replay.as_deref().map(|path| {
        let (session, _) = earlier_in_plane(path)?;
        Replay::of(path, &session, plane.newest().next_scan(), &settings)
    });
    drive(args, (plane, settings, replay.transpose()?), (node, parameters, words), &interrupt)
}

fn localising(path: &Path, settings: Settings) -> Result<Localising, Failure> {
    let (session, _) = earlier_in_plane(path)?;
    if session.keyframes().is_empty() {
        let cause = "expected a map, found no keyframe".to_owned();
        return Err(Failure::Session { path: path.to_owned(), cause });
    }
    Ok(Localising { mapper: Mapper::localising(settings, session)?, scans: 0, located: 0, first: None })
}

/// What to type where the system keeps less of what arrives than a cloud is long.
fn short_buffers() -> Option<String> {
    let most = std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?;
    let most: u64 = most.trim().parse().ok()?;
    (most < RECEIVED_LEAST).then(|| {
        format!(
            "the system keeps {most} bytes of what arrives at most, less than a large cloud, whose parts then have to be sent again: \
             sudo sysctl -w net.core.rmem_max={RECEIVED_LEAST}"
        )
    })
}

/// What a calibration, or who mounted them, says of a robot's sensors.
fn known_sensors(choice: &Choice) -> KnownSensors {
    KnownSensors {
        laser: choice.mount.map(|mount| (mount.robot_from_laser, mount.inverted)),
        lidar: choice.space.and_then(|space| space.robot_from_sensor),
        imu: choice.imu_mount,
        imu_lag_s: choice.space.map_or(0.0, |space| space.imu_lag_s),
        odometry: choice.odometry,
    }
}

/// Refuses what is said of a recording where none is played: it would be of no effect.
fn only_of_recordings(choice: &Choice, is_cable: bool) -> Result<(), Failure> {
    let has_known = known_sensors(choice) != KnownSensors::default();
    let given = [
        (!choice.topics.is_empty(), "--topic", "--scan, --points, --odometry and --imu name topics that are heard"),
        (choice.robot.is_some(), "--robot", "topics that are heard are named one by one"),
        (choice.slice.is_some(), "--slice", "clouds that are heard are mapped in space"),
        (choice.range_unit_m.is_some(), "--range-unit", "scans that are heard are in metres"),
        (is_cable && choice.frame.is_some(), "--frame", "a lidar on a cable has none"),
        (
            is_cable && has_known,
            "--mount, --imu-mount or --calibration",
            "--lidar-mount says where a lidar on a cable sits",
        ),
    ];
    match given.into_iter().find(|(is_given, ..)| *is_given) {
        Some((_, option, instead)) => {
            Err(Failure::Usage(format!("{option} is for recordings that are played: {instead}")))
        }
        None => Ok(()),
    }
}

fn drive<W: Work>(
    args: &LiveArgs,
    (work, settings, replay): (W, Settings, Option<Replay>),
    (node, parameters, words): (NodeName, Parameters, Vec<String>),
    interrupt: &Interrupt,
) -> Result<Outcome, Failure> {
    let names = Names::of(&args.ros_names, &parameters, &node);
    let is_heard = args.log.is_none() && args.lidar.is_none();
    let scans = match (&args.log, &args.lidar) {
        (Some(_), _) => vec![if W::Maps::IS_IN_SPACE { play::CLOUDS } else { play::TOPIC }.to_owned()],
        (None, Some(_)) => vec![cable::TOPIC.to_owned()],
        (None, None) if names.clouds.is_empty() => names.scans.clone(),
        (None, None) => names.clouds.clone(),
    };
    let lanes = Lanes { scans, are_clouds: W::Maps::IS_IN_SPACE };
    let (door, clock, over) =
        (Arc::new(lanes.door()), Arc::new(Clock::start(names.is_simulated)), AtomicBool::new(false));
    let choice = args.source.choice();
    if args.log.is_none() {
        only_of_recordings(&choice, args.lidar.is_some())?;
    }
    let mut gate = Gate::new(GateSettings {
        known: if is_heard { known_sensors(&choice) } else { KnownSensors::default() },
        waiting_most: if W::Maps::IS_IN_SPACE { CLOUDS_MOST } else { GateSettings::default().waiting_most },
        robot_frame: choice.frame.clone().unwrap_or_else(|| names.robot_frame.clone()),
        odom_frame: names.odom_frame.clone(),
        is_in_space: W::Maps::IS_IN_SPACE,
        wait: Duration::from_secs_f64(parameters.number(Setting::TransformWait).clamp(0.0, 10.0)),
    });
    let mut wire = if args.ros || is_heard { Some(wires::join(args.ros_names.wire, &node)?) } else { None };
    if args.ros_names.band.is_some() && wire.is_none() {
        return Err(Failure::Usage(
            "--band tells others a grid: with --ros, where nobody is heard over ROS 2".to_owned(),
        ));
    }
    let metadata = args.lidar_metadata.as_deref().map(datagrams::metadata).transpose()?;
    let (known, mut ros, mut outlet) = (Arc::<Known>::default(), None, None);
    if let Some(wire) = wire.as_deref_mut() {
        let (to_draw, heard) = channel();
        let (told, node) = (Arc::new(Told::advertise(wire, &node)?), Arc::new(Node::new(wire, node, parameters)?));
        let wanted = Wanted {
            settings: &settings,
            explores: args.ros_names.explore,
            radius_m: args.ros_names.robot_radius,
            band: args.ros_names.band,
            known: &known,
        };
        outlet = Some((W::Maps::advertise(wire, &names, &wanted)?, heard));
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
        Live::new((work, settings), (lanes.clone(), Arc::clone(&door)), (Arc::clone(&clock), known), args, (ros, view));
    let short = (is_heard && W::Maps::IS_IN_SPACE).then(short_buffers).flatten();
    live.replay = replay;
    words.iter().chain(&short).for_each(|words| live.notice(words));
    let (at_cable, held) = (Arc::clone(&live.at_cable), Arc::clone(&live.is_held));
    let played = thread::scope(|scope| {
        let (over, door, clock, lanes, at_cable) = (&over, &*door, &*clock, &lanes, &*at_cable);
        let player = args.log.as_deref().map(|log| {
            scope.spawn(|| {
                let played = play::play(log, args, (door, lanes), clock, (&held, over));
                door.close();
                played
            })
        });
        if let Some(place) = &args.lidar {
            let mount = args.lidar_mount.unwrap_or(Pose2::IDENTITY);
            scope.spawn(move || match place.kind.is_serial() {
                true => cable::read(place, mount, (door, lanes), clock, (at_cable, over)),
                false => datagrams::read(place, metadata, mount, (door, lanes), clock, (at_cable, over)),
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
