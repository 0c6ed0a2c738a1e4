//! What can be asked for.

mod export;
mod fleet;
mod fleet_net;
mod live;
mod merge_maps;
mod rendezvous;
mod source;
mod suite;
mod switched;
mod values;

pub(crate) use export::{ConvertArgs, ExportArgs, ExportTo, LogFormat};
pub(crate) use fleet::{FleetArgs, FleetCommand, FleetSimulateArgs};
pub(crate) use fleet_net::{FleetJoinArgs, FleetKeysArgs, FleetStatusArgs};
pub(crate) use live::{LiveArgs, RosArgs, ViewArgs, ViewResultsArgs, WireKind};
pub(crate) use merge_maps::MergeMapsArgs;
pub(crate) use rendezvous::RendezvousArgs;
pub(crate) use source::SourceArgs;
pub(crate) use suite::{BreaksArgs, LidarArgs, LookAlikeArgs, NoiseArgs, RunArgs, Suite, SuiteArgs, WorldsArgs};

use anstream::ColorChoice;
use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use mapwright::Pose2;
use mapwright_eval::Delta;
use mapwright_sim::Gap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use values::{
    parse_assignment, parse_delta, parse_factor, parse_gap, parse_length, parse_pose, parse_radius, parse_reach,
    parse_seconds, parse_share,
};

/// The version, the commit and the features.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("MAPWRIGHT_BUILD"), ")");

/// Maps from moving sensors. Exit codes: 0 done, 1 failed, 2 usage, 3 done but something was lost.
#[derive(Debug, Parser)]
#[command(name = "mapwright", version = VERSION, arg_required_else_help = true)]
pub(crate) struct Args {
    /// Colours in what is said: on terminals (unless NO_COLOR is set or TERM is dumb), always or never.
    #[arg(long, value_enum, value_name = "WHEN", default_value_t = Colour::Auto, global = true, hide_default_value = true)]
    color: Colour,
    #[command(subcommand)]
    pub(crate) command: Command,
}

impl Args {
    /// Whether words have colours.
    pub(crate) fn colour(&self) -> ColorChoice {
        match self.color {
            Colour::Auto => ColorChoice::Auto,
            Colour::Always => ColorChoice::Always,
            Colour::Never => ColorChoice::Never,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Colour {
    Auto,
    Always,
    Never,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Map a log: trajectory, map, picture, report.
    Map(MapArgs),
    /// One map of several logs or sessions, of one robot or of several, wherever each began.
    Merge(MergeArgs),
    /// Two finished maps as one, of robots that share nothing else: where the one lies in the other is found, or refused with the reason.
    MergeMaps(MergeMapsArgs),
    /// Where the robot of a log is in a finished map, which stays as it is.
    Localise(LocaliseArgs),
    /// Map while the robot drives, heard over ROS 2; or play a recording as if it drove.
    Live(Box<LiveArgs>),
    /// A finished run in a browser, with a time line.
    View(ViewResultsArgs),
    /// Several robots with one map, made while they drive.
    Fleet(FleetArgs),
    /// What is in a log, and everything odd about it.
    Info(InfoArgs),
    /// Score trajectories against surveyed relations or a reference trajectory.
    Eval(EvalArgs),
    /// Where the laser or lidar sits on the robot, how wrong its odometry is, and how an inertial sensor sits beside a lidar, from a log.
    Calibrate(CalibrateArgs),
    /// Every setting as TOML, with unit and meaning; `--config` reads it back.
    Config(SettingsArgs),
    /// Map a simulated office floor and compare with the truth; needs no data.
    Demo(DemoArgs),
    /// Simulated robots share the exploration of an office floor: map, curve of the area seen, what is left and why.
    Explore(ExploreArgs),
    /// Optimise a pose graph in g2o's format, of the plane or of space.
    Optimize(OptimizeArgs),
    /// A harder version of a log: fewer scans, gaps, random beams, worse odometry.
    Perturb(PerturbArgs),
    /// Every place where the robot may have come back, from a folder of results: what was found, decided and why; and the
    /// wheels' slips.
    Explain(ExplainArgs),
    /// One self-contained page of a folder of results, to look at and to mail: map, closures, errors, status, settings.
    Report(ReportArgs),
    /// One such page of two folders of results side by side.
    Compare(CompareArgs),
    /// Results for other tools, from a folder of results: trajectories, maps, or everything as MCAP.
    Export(ExportArgs),
    /// A log in another format, told by the ending of its name: CARMEN (.clf, .log), ROS 1 bag (.bag), MCAP (.mcap).
    Convert(ConvertArgs),
    /// Many simulated worlds mapped and measured against their truth; exit code 3 where a floor is missed.
    Suite(SuiteArgs),
    /// Robots that see each other: their relative poses with covariances, from sightings and odometry (UTIAS MRCLAM).
    Rendezvous(RendezvousArgs),
    /// What a shell needs to complete commands and options, on the standard output.
    Completions(CompletionsArgs),
    /// Manual pages: mapwright.1, mapwright-map.1 and so on.
    Man(ManArgs),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct CompletionsArgs {
    /// For which shell.
    pub(crate) shell: clap_complete::Shell,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ManArgs {
    /// Folder for the pages; made if need be.
    #[arg(value_name = "FOLDER")]
    pub(crate) folder: PathBuf,
}

/// The settings in force: defaults, then the file, then each `--set`.
#[derive(Debug, Clone, ClapArgs)]
pub(crate) struct SettingsArgs {
    /// Settings as TOML; `mapwright config` prints them all.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// One setting, such as map.resolution_m=0.1; may be repeated.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_assignment)]
    pub(crate) set: Vec<(String, String)>,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct MapArgs {
    /// Logs of one drive in a row: ROS 1 bags, MCAP files, ROS 2 bags (folder or file), CARMEN logs (plain, .gz or .bz2; `-`
    /// is the standard input). Or one recording of space: a folder of KITTI, PCD or PLY clouds, of depth images (TUM, 7-Scenes,
    /// Open3D) or of pairs of images (KITTI, EuRoC, Middlebury), packets of a Velodyne, Ouster or Hesai (.pcap), or a ROS bag or MCAP file of PointCloud2, a lidar's own messages or images of depth.
    #[arg(required = true, value_name = "LOG")]
    pub(crate) logs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Map the point clouds or images of depth of a recording in space, even where it has scans of a planar laser.
    #[arg(long, conflicts_with = "slice")]
    pub(crate) space: bool,
    /// Folder for the results; made if need be. Otherwise `mapwright-` and the name of the first log, where you are.
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Go on with the session in the folder of results, be it finished, stopped or killed: with the rest of the log that it was made of,
    /// or with another log, which may begin anywhere.
    #[arg(long = "continue", conflicts_with_all = ["resume", "start"])]
    pub(crate) goes_on: bool,
    /// Of a recording of space: the map's surface as well, mesh.glb, as `mapwright export --to mesh` makes it.
    #[arg(long, conflicts_with = "slice")]
    pub(crate) mesh: bool,
    #[command(flatten)]
    pub(crate) mapping: MappingArgs,
}

impl MapArgs {
    /// Where the results go.
    pub(crate) fn output(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| folder_of_log(self.logs.first().map_or(Path::new("-"), |log| log)))
    }
}

/// Endings of logs, also of those that are compressed: what is left of `intel.clf.bz2` is `intel`.
const LOG_ENDINGS: [&str; 16] = [
    "gz", "bz2", "zst", "zstd", "clf", "log", "carmen", "txt", "bag", "mcap", "db3", "pcap", "pcapng", "pcd", "ply",
    "bin",
];

fn folder_of_log(log: &Path) -> PathBuf {
    let whole = std::path::absolute(log).unwrap_or_else(|_| log.to_owned());
    let mut name = whole.file_name().map_or_else(|| "-".to_owned(), |name| name.to_string_lossy().into_owned());
    while let Some((stem, ending)) = name.rsplit_once('.') {
        if stem.is_empty() || !LOG_ENDINGS.contains(&ending.to_ascii_lowercase().as_str()) {
            break;
        }
        name = stem.to_owned();
    }
    PathBuf::from(format!("mapwright-{}", if name == "-" { "stdin" } else { &name }))
}

#[derive(Debug, ClapArgs)]
pub(crate) struct MergeArgs {
    /// Logs as for `map`, folders of results or their `session.mapwright`; in this order. A recording of several robots counts as a log
    /// of each.
    #[arg(required = true, num_args = 1.., value_name = "LOG|SESSION")]
    pub(crate) inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Folder for the results; made if need be.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) mapping: MappingArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct LocaliseArgs {
    /// Logs of one drive in a row, as for `map`.
    #[arg(required = true, value_name = "LOG")]
    pub(crate) logs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// The finished map: a folder of results or its `session.mapwright`. Nothing is written there.
    #[arg(long, value_name = "SESSION")]
    pub(crate) map: PathBuf,
    /// Where the poses go, one a scan, each as it was known at that scan: a name ending in .csv with the quality of each, else TUM, in which
    /// scans that were not located are left out.
    #[arg(short, long, value_name = "POSES")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Predict with constant velocity even where the log has odometry.
    #[arg(long)]
    pub(crate) no_odometry: bool,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

/// How to map and what to say about it.
#[derive(Debug, Clone, ClapArgs)]
pub(crate) struct MappingArgs {
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Threads to use; the results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Pose of the robot at the first scan: metres, metres, radians.
    #[arg(long, value_name = "X,Y,YAW", value_parser = parse_pose, allow_hyphen_values = true)]
    pub(crate) start: Option<Pose2>,
    /// Go on with an earlier run: its folder of results or its `session.mapwright`. The results hold both.
    #[arg(long, value_name = "SESSION", conflicts_with = "start")]
    pub(crate) resume: Option<PathBuf>,
    /// Stamps of the trajectories: the log's own, or made to increase.
    #[arg(long, value_enum, default_value_t = StampPolicy::Log)]
    pub(crate) stamps: StampPolicy,
    /// How `map.png` is turned: until its walls are upright, where they have a direction; or as the map lies. All other files keep the
    /// map's frame.
    #[arg(long, value_enum, default_value_t = Align::Walls)]
    pub(crate) align: Align,
    /// The picture's longer side in pixels, margins included; otherwise as suits the map.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(200..=16_000))]
    pub(crate) picture_side: Option<u16>,
    /// Predict with constant velocity even where the log has odometry.
    #[arg(long)]
    pub(crate) no_odometry: bool,
    /// How the past is corrected when a loop is closed: graph, spread or none; short for `--set loops.correction=...`.
    #[arg(long, value_name = "HOW")]
    pub(crate) correction: Option<String>,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

/// How much is said.
#[derive(Debug, Clone, Copy, ClapArgs)]
pub(crate) struct Voice {
    /// One JSON object on the standard output instead of words.
    #[arg(long)]
    pub(crate) json: bool,
    /// Say nothing but errors.
    #[arg(long, conflicts_with = "json")]
    pub(crate) quiet: bool,
}

/// Whether the command is asked to say what it says as JSON: a failure too.
pub(crate) fn asks_for_json(words: &[OsString]) -> bool {
    words.iter().any(|word| word == "--json")
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum StampPolicy {
    Log,
    Repaired,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Align {
    None,
    Walls,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct InfoArgs {
    /// Logs as for `map`; of two, the differences are listed as well.
    #[arg(required = true, value_name = "LOG")]
    pub(crate) logs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
#[command(group = clap::ArgGroup::new("truth").required(true))]
pub(crate) struct EvalArgs {
    /// Trajectories (TUM, stamp x y theta, or KITTI's 12 numbers), or folders of results of `mapwright map`, of which `trajectory.tum` is
    /// read; of several, mean and worst are printed as well. With `--revisits` folders.
    #[arg(required = true)]
    pub(crate) trajectories: Vec<PathBuf>,
    /// Surveyed relations (Kümmerle et al. 2009): t1 t2 x y z roll pitch yaw.
    #[arg(long, value_name = "FILE", group = "truth")]
    pub(crate) relations: Option<PathBuf>,
    /// Reference trajectory for ATE and RPE, as evo computes them: TUM, stamp x y theta, or KITTI's 12 numbers. Where one of both has
    /// height or tilt they are compared in space, and with KITTI's errors over 100 to 800 m where the way is so long.
    #[arg(long, value_name = "FILE", group = "truth")]
    pub(crate) reference: Option<PathBuf>,
    /// Without a reference: by how much clouds of different visits ask to be moved onto each other. Of maps of space.
    #[arg(long, group = "truth")]
    pub(crate) revisits: bool,
    /// Judge this trajectory of the robot (TUM) on the same clouds instead, paired by stamps; may be given several times.
    #[arg(long, value_name = "FILE", requires = "revisits")]
    pub(crate) trajectory: Vec<PathBuf>,
    /// Clouds of different visits lie so many scans apart in order, at least; unless said, as many as it takes to drive twice the distance
    /// of --within, and 60 at most.
    #[arg(long, value_name = "SCANS", requires = "revisits")]
    pub(crate) apart: Option<u64>,
    /// and less than so many metres in place.
    #[arg(long, value_name = "M", default_value_t = 5.0, value_parser = parse_reach, requires = "revisits")]
    pub(crate) within: f64,
    /// Stamps of KITTI's poses, one a row; without them rows are paired by their numbers.
    #[arg(long, value_name = "FILE", requires = "reference")]
    pub(crate) times: Option<PathBuf>,
    /// How the trajectory is brought to the reference for ATE.
    #[arg(long, value_enum, default_value_t = AlignTo::Rigid, requires = "reference")]
    pub(crate) alignment: AlignTo,
    /// Distance of the poses of a pair for RPE: frames or metres, such as 1f or 5m.
    #[arg(long, default_value = "1f", value_parser = parse_delta, requires = "reference")]
    pub(crate) delta: Delta,
    /// RPE over pairs from every pose instead of end to end.
    #[arg(long, requires = "reference")]
    pub(crate) all_pairs: bool,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum AlignTo {
    None,
    Rigid,
    Similarity,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct CalibrateArgs {
    /// Log as for `map`; a CARMEN log may come from the standard input, `-`.
    pub(crate) log: PathBuf,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Calibrate the lidar or depth camera of a recording of clouds, even where it has scans of a planar laser.
    #[arg(long, conflicts_with = "slice")]
    pub(crate) space: bool,
    /// Write what was found, for `--calibration` of other commands.
    #[arg(long, value_name = "FILE", conflicts_with = "calibration")]
    pub(crate) apply: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DemoArgs {
    /// Which floor, drive and noise.
    #[arg(long, default_value_t = 5)]
    pub(crate) seed: u64,
    /// Instead of the office: a building of two storeys, mapped in space with a spinning lidar.
    #[arg(long = "3d", conflicts_with = "show", groups = ["driven", "in_space"])]
    pub(crate) space: bool,
    /// The building of --3d, mapped with a depth camera.
    #[arg(long, conflicts_with = "show", groups = ["driven", "in_space"])]
    pub(crate) depth: bool,
    /// The building of --3d, mapped with a stereo camera that sees textured walls.
    #[arg(long, conflicts_with = "show", groups = ["driven", "in_space"])]
    pub(crate) stereo: bool,
    /// Instead of the office: four robots that explore a floor, tell each other over a lossy radio and make one map; one of them dies.
    #[arg(long, conflicts_with = "show", group = "driven")]
    pub(crate) fleet: bool,
    /// Instead of the office's laser: sixteen sonars and wheels that err by 10 %, on a floor of 40 by 20 m.
    #[arg(long, conflicts_with_all = ["show", "in_space", "fleet"])]
    pub(crate) sonar: bool,
    /// The drive of --3d, --depth, --stereo or --fleet ends then, seconds, or with its way.
    #[arg(long, value_name = "S", value_parser = parse_seconds, requires = "driven")]
    pub(crate) seconds: Option<f64>,
    /// The robot of --3d, --depth or --stereo has an inertial sensor.
    #[arg(long, requires = "in_space")]
    pub(crate) imu: bool,
    /// Instead of the office: a loop before and after, as before.png and after.png, with the errors of both.
    #[arg(long, value_enum)]
    pub(crate) show: Option<Show>,
    /// Length of that loop, metres.
    #[arg(long, value_name = "M", default_value_t = 150.0, value_parser = parse_length, requires = "show")]
    pub(crate) length: f64,
    /// Folder for the results; made if need be.
    #[arg(short, long, value_name = "FOLDER", default_value = "mapwright-demo")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) mapping: MappingArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Show {
    /// Matched along the way and left open; then closed, the error spread and the graph optimised.
    NoClosure,
    /// A false closure among true ones, obeyed by least squares; then outvoted.
    FalseClosure,
    /// Wheels that turn too much; then the closure's error spread backwards over the loop.
    Spread,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ExploreArgs {
    /// How many robots; they start together.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(crate) robots: u32,
    /// Which floor and noise.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Three furnished rooms of 100 square metres in all instead of an office floor.
    #[arg(long)]
    pub(crate) rooms: bool,
    /// Each robot goes to the frontier nearest to it and does not know where the others go: to compare with. They share their map.
    #[arg(long)]
    pub(crate) uncoordinated: bool,
    /// As --uncoordinated, and each knows nothing but the map that it made itself.
    #[arg(long, conflicts_with = "uncoordinated")]
    pub(crate) alone: bool,
    /// Robots know of each other what they tell over a simulated radio: each maps from a start of its own, makes one map of what it hears,
    /// and decides for itself. They hear each other as far as walls let them.
    #[arg(long, conflicts_with_all = ["uncoordinated", "alone", "true_poses"])]
    pub(crate) radio: bool,
    /// Share of the radio's messages that is lost.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_share, requires = "radio")]
    pub(crate) loss: f64,
    /// Scans are drawn where they were truly taken, instead of where each robot's own mapping has them.
    #[arg(long)]
    pub(crate) true_poses: bool,
    /// The last robot is switched off then, seconds, and stands in the way.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub(crate) dies: Option<f64>,
    /// Folder for the results; made if need be.
    #[arg(short, long, value_name = "FOLDER", default_value = "mapwright-explore")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct PerturbArgs {
    /// Log as for `map`; a CARMEN log may come from the standard input, `-`.
    pub(crate) log: PathBuf,
    /// The harder log, a plain CARMEN log of its scans; where there is nothing but gaps, of its odometry's readings as well.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Take out all scans and odometry readings of so many seconds, from a share of the time between the first scan and the
    /// last on, such as 0.25:30; may be repeated. What is left stays as it was, of a CARMEN log each line to the byte, so that
    /// odometry goes on with what the wheels did meanwhile.
    #[arg(long, value_name = "FRACTION:SECONDS", value_parser = parse_gap)]
    pub(crate) gap: Vec<Gap>,
    /// Keep the first scan and every Nth after it.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) every: u32,
    /// Replace this share of the beams by ranges uniform in 0 to 30 m.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_share)]
    pub(crate) noise_beams: f64,
    /// Multiply the translations of odometry.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_factor)]
    pub(crate) scale_odometry: f64,
    /// Relative standard deviation of noise on each increment of odometry.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_share)]
    pub(crate) odometry_noise: f64,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

impl PerturbArgs {
    /// Whether the scans that are left stay as they were.
    pub(crate) fn keeps_scans(&self) -> bool {
        self.every == 1 && self.noise_beams == 0.0 && self.scale_odometry == 1.0 && self.odometry_noise == 0.0
    }
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ExplainArgs {
    /// Folder of results of `mapwright map`, or its closures.json.
    pub(crate) results: PathBuf,
    /// Only those that were refused or withdrawn.
    #[arg(long, conflicts_with = "accepted")]
    pub(crate) refused: bool,
    /// Only those that became closures.
    #[arg(long)]
    pub(crate) accepted: bool,
    /// Only those that this keyframe takes part in.
    #[arg(long, value_name = "N")]
    pub(crate) keyframe: Option<u32>,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

/// What errors are shown beside.
#[derive(Debug, Clone, ClapArgs)]
pub(crate) struct BesideArgs {
    /// Reference trajectory to draw errors beside: TUM, stamp x y theta, or KITTI's 12 numbers, a row for each scan; or surveyed relations.
    /// Otherwise the truth that a simulated run has left in its folder.
    #[arg(long, value_name = "FILE")]
    pub(crate) reference: Option<PathBuf>,
    /// Surveyed relations (Kümmerle et al. 2009) to tell errors beside, as `eval --relations` does.
    #[arg(long, value_name = "FILE")]
    pub(crate) relations: Option<PathBuf>,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ReportArgs {
    /// Folder of results of `mapwright map`, of the plane or of space.
    #[arg(value_name = "OUT")]
    pub(crate) results: PathBuf,
    #[command(flatten)]
    pub(crate) beside: BesideArgs,
    /// The page; otherwise report.html in the folder of results.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct CompareArgs {
    /// Folder of results of `mapwright map`.
    #[arg(value_name = "OUT1")]
    pub(crate) first: PathBuf,
    /// The other one.
    #[arg(value_name = "OUT2")]
    pub(crate) second: PathBuf,
    #[command(flatten)]
    pub(crate) beside: BesideArgs,
    /// The page; otherwise compare.html in the present folder.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct OptimizeArgs {
    /// Pose graph with tags of g2o or TORO.
    pub(crate) graph: PathBuf,
    /// The optimised graph, with tags of g2o.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Where the search starts: the poses of the file, or those that odometry alone would give.
    #[arg(long, value_enum, default_value_t = StartFrom::File)]
    pub(crate) from: StartFrom,
    /// Believe only closures that agree with odometry and each other; refuse where too many false ones do.
    #[arg(long)]
    pub(crate) robust: bool,
    /// Steps at most, with `--robust` after the false closures are out.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub(crate) max_iterations: u32,
    /// What the information of rotations in space belongs to: angles, to which the optima usually quoted belong, or
    /// quaternions, as g2o itself reads it.
    #[arg(long, value_enum, default_value_t = Information::Angles)]
    pub(crate) information: Information,
    #[command(flatten)]
    pub(crate) voice: Voice,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum StartFrom {
    File,
    Odometry,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Information {
    Quaternions,
    Angles,
}
