//! What can be asked of `mapwright suite`.

use super::SettingsArgs;
use super::values::{
    parse_drive, parse_error, parse_factor, parse_gap, parse_gap_seconds, parse_length, parse_seconds, parse_share,
};
use clap::{Args as ClapArgs, Subcommand};
use mapwright_sim::Gap;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(crate) struct SuiteArgs {
    #[command(subcommand)]
    pub(crate) suite: Suite,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Suite {
    /// Long loops: whether they close, and the trajectory's error beside that of a batch solve given all true closures.
    ///
    /// A world is `worlds::loop_of(seed, length)`, driven by `DriveSettings::long_drive(seed)`. An edge closes when it is
    /// a closure, or a match between keyframes more than 20 m of way apart; those withdrawn do not count. It is right
    /// when what it measured and what the final map says of its keyframes both lie within 0.3 m and 3 degrees of the
    /// truth, else wrong. The loop is closed when a right one joins the first and the last 30 m of the way.
    ///
    /// ATE is that of the keyframes' final poses, aligned rigidly, rmse. The batch solve has the same keyframes, the
    /// odometry and match edges that do not close, and from every keyframe on ground seen before the true pose of the
    /// earlier keyframe it overlaps most (sigma 0.01 m, 0.002 rad); a step in which the pose jumped counts with what the
    /// wheels say. Floors: every loop closed, ratio of the two ATE at
    /// most 1.3 in every world.
    ///
    /// With `--3d` a world is `space::worlds::loops_1km(seed)`, a building of two storeys with three nested loops each, and
    /// closing edges, those that are wrong, ATE and the batch solve are the same. A loop is a stretch of at least 3 m on ground
    /// that the robot has come back to: on more than 20 m of way in one go it saw nothing of it. Other stretches on ground seen
    /// more than 20 m of way before, as on from a door along a corridor after a look into the room, count as stayed. A loop is
    /// closed when a right closing edge joins a keyframe of it, or taken at most 5 s after it, to one that truly saw before what is
    /// seen on it. Times on known ground are closed as in `look-alike`. Floors: no closing edge wrong, every loop closed, ratio
    /// at most 1.3 in every world.
    Loops(LoopsArgs),
    /// Corridors that look alike, driven in loops within loops: which closures are wrong, and the error.
    ///
    /// A world is `worlds::corridor_grid(seed, length)`, driven by `DriveSettings::long_drive(seed)`. Closing edges, which of
    /// them are wrong, ATE and the batch solve are as in `loops`; most of such a drive is known ground, where the batch solve has
    /// the truth at every keyframe. Floors: 999 of 1000 closing edges right, ATE at most 0.4 m in every world.
    Nested(NestedArgs),
    /// Buildings made to deceive: no wrong closure, and true returns found all the same.
    ///
    /// A world is `worlds::look_alike(seed)`; the alias lies inside odometry's two-sigma ellipse for even seeds, outside
    /// of three sigma for odd ones. Closing edges, and which of them are wrong, are as in `loops`; those wrong as measured
    /// and those wrong in the final map are counted apart too. Deceived is a world whose final map has the copy within
    /// 0.5 m and 5 degrees of where the deception would have it.
    ///
    /// A time on ground seen before, sampled every metre, is closed when the final map has it within 0.3 m and 3 degrees
    /// of the truth relative to the earlier time it overlaps most, and a right closing edge's newer keyframe was taken in
    /// the same stretch of known ground, at most 5 s after it. Pairs: all pairs of times that see the same place, and how
    /// many of them the final map has right. Floors: no edge wrong, 80 % of the times closed.
    ///
    /// With `--3d` a world is `space::worlds::look_alike_storeys(seed)`: three storeys that cannot be told apart, one above the
    /// other. What is measured is as in `loops --3d`. Floors: no closing edge wrong, 80 % of the times closed.
    LookAlike(LookAlikeArgs),
    /// Drives through buildings in space: whether the stated covariances are honest, and the error.
    ///
    /// World `seed` is `two_storey`, `courtyard`, `look_alike_storeys` or `loops_1km` of `space::worlds`, by turns. NEES is that of
    /// the robot's pose relative to the keyframe that it was matched with, of every cloud that was tracked (6 on average where
    /// covariances are honest, 5.35 in the middle), and that of keyframes alone, whose poses are not extrapolated. Floors: mean and median over all clouds from 4 to 8.
    Drives(DrivesArgs),
    /// Robots carried away: when what they map since is joined with what was mapped before, and whether it lies where it is.
    ///
    /// A world is `kidnapping(seed)`: even seeds are put down on known ground. A pose is right when it lies within 0.3 m
    /// and 3 degrees of the truth relative to the keyframe from before that is truly nearest, all as the map was at the
    /// time. Joined: the first scan after being put down that is said to be joined and not lost, at the right pose. Home: when
    /// half of what is seen was known for at least half of ten seconds. Keyframes: those made since it was put down; apart are
    /// those in pieces of the map that nothing joins in the end, misplaced those of the others that the final map has wrong, in the
    /// air those made on the way. Wrong: scans that are said to be joined at a wrong pose, until they are at the right one, and
    /// closures from before to after that were measured wrong. Floors: none misplaced, of the robots that come to known ground
    /// 95 % joined at the end and 80 % within 10 s.
    Kidnapped(WorldsArgs),
    /// Robots located in a finished map, half of them in buildings with places that look alike: after how long, and how often wrongly.
    ///
    /// A world is `worlds::relocalisation(seed)`: a building, a drive that maps it, and a later one of 120 s at most that begins anywhere and
    /// meets two people. Odd seeds are office floors and suites of rooms; for even seeds a long room with two ends alike, equal rooms in a
    /// row, and two equal wings take turns, where the later drive begins, and leads on to where they can be told apart. A pose is right when
    /// it lies within 0.3 m and 3 degrees of the truth relative to the keyframe of the map that is truly nearest. Located: the first scan that
    /// is said to be located and is right. Floors: none located wrongly for more than 5 s at a stretch, 95 % located rightly at the end.
    ///
    /// With `--3d` the buildings are those of `drives`, but for the last: a drive maps it, a later one of 60 s begins anywhere on the same
    /// way, the other way round for odd seeds. Those with storeys that cannot be told apart count as two places alike.
    Localise(LookAlikeArgs),
    /// Drives in space cut in three, merged with nobody knowing how the pieces belong together: the error beside that of the whole drive.
    ///
    /// Buildings and drives are those of `drives`. Each piece is mapped by itself; the sessions are taken in one after the other, as `mapwright
    /// merge` does. ATE is that of all clouds, aligned rigidly, rmse. Floors: one map, and a ratio of at most 1.3, in every world.
    Cut(DrivesArgs),
    /// Office floors with people who walk along with the robot and in its way: the trajectory's error.
    ///
    /// A world is `worlds::office_floor(seed)` with that many people, as `mapwright demo` has it. ATE is that of all scans,
    /// aligned rigidly, rmse. Floor: ATE at most 0.05 m in every world.
    Offices(OfficesArgs),
    /// Apartments full of furniture, seen by cheap lasers on cheap wheels or carried by hand: the error, and whether what is said is right.
    ///
    /// World `seed` is `worlds::home(seed)` with up to two people, seen by a laser of 360 beams all around that turns five times a second
    /// and reaches 3.5 m (even seeds) or 8 m. Of four drives two are by a robot at 0.2 to 0.4 m/s, 240 s at most, whose wheels err 4.5 % and
    /// 3 degrees a metre and slip every 50 m; two are by hand at 0.8 to 1.2 m/s, 90 s at most, without wheels, and with the carrier's body in
    /// every scan. ATE is that of all scans, aligned rigidly, rmse. Floors: with wheels at most 0.05 m in the median; at most 0.3 m in every
    /// drive; none called good beyond 0.15 m.
    Homes(WorldsArgs),
    /// Offices heard by sixteen sonars on bad wheels: the error beside odometry's, and which cells of the map are right.
    ///
    /// World `seed` is `worlds::small_office(seed)`, 40 by 20 m. The ring has 16 cones of 25 degrees that hear 5 m; smooth walls answer within 10
    /// degrees of the perpendicular, beyond it the sound goes away or comes by a detour; 2 % of the echoes are missed, 1 % are another sonar's. Wheels err
    /// by 10 % of each metre and radian (sigma), by 3 % of all ways and turns, and turn by 0.5 degrees a metre (sigma). ATE is that of all stretches,
    /// aligned rigidly, rmse, beside that of odometry at the same times. A cell is right where the truth is as it says within 0.15 m. Walls: those in
    /// sight of the way within 3 m, and how many the map has. Floors: ATE at most half of odometry's, and 80 % of the cells right, in every world.
    Sonar(WorldsArgs),
    /// Robots that share the exploration of an office floor: how much faster many are than one, and whether they end.
    ///
    /// World `seed` is `worlds::large_office(seed)`, 2,800 m2, explored by 1, 2, 3, 4 and 8 robots that start together, by 4 that each go to the
    /// nearest frontier, and by 4 of which one is switched off after a quarter of the time that 4 took. Each maps by itself from a
    /// known start, and their common map is all their keyframes. What there is to see is what a laser of 12 m sees from anywhere a robot
    /// can get to; seen is what scans in the map truly showed. Ratios are means over the worlds. Floors: 2, 4 and 8 robots 1.7, 3.0 and
    /// 4.5 times as fast as one to 99 %, 4 robots 1.8 times as fast as uncoordinated ones, one dead 1.1 times as slow as 3 robots, none
    /// that never ends.
    Explore(ExploreSuiteArgs),
    /// Robots that share one map over a bad radio: whether all who live end with the same bytes, and whether these are right.
    ///
    /// World `seed` is `worlds::three_rooms(seed)`, in which 2 to 6 robots drive for 20 s, each from a place of its own that the others do not know. Of
    /// their messages 0 to 90 % are lost, a tenth is doubled, and all are up to 0.5 s late, so that they overtake each other. For 5 to 15 s some
    /// of them do not hear the others, and in most of the worlds with more than two robots one dies. Agreed: seconds after the drives and the partition until all who live first have
    /// the same map with all that they have mapped. Maps are those of the robots, and into how many closures join them. A closure
    /// between robots is wrong if it is 0.3 m or 3 degrees from the truth. Error is that of all keyframes of the largest map, aligned rigidly. Floors: all
    /// end with identical bytes, no wrong closure between robots.
    Fleet(FleetSuiteArgs),
    /// The same robots, of which some do not hear the others until after all have driven: whether each part goes on, and when they agree again.
    ///
    /// As `fleet`, but cut in two from after 4 to 10 s until up to 10 s after the drives. Floors besides: of the teams that lose at most 30 % of the messages 95 %
    /// agree within 10 s after the partition.
    Partition(FleetSuiteArgs),
    /// One robot of a team lies: the others' error beside the same team with nobody lying, and what is refused of whom.
    ///
    /// World `seed` is `worlds::three_rooms(seed)`, in which 3 to 8 robots drive for 20 s as in `fleet`; up to 30 % of the messages are lost. One robot,
    /// each in turn, lies from 3 to 14 s on: of where it is (`offset`, 10 m; `rotation`, 30 degrees; `scaled`, a tenth of its way), of what it sees
    /// (`replay`, `forged`), or, as the robot that solves, of what it has found (`solution`; those before it in the roster are cut off from the
    /// others until 15 s after the drives, so that it solves). Error is that of the keyframes of all other robots, each of the maps that they are in aligned
    /// rigidly by itself, rmse. Accused: breaks where the way of an honest robot is called contradicted, and what honest robots refuse of each
    /// other, with the lie and without. Floors: the others' error at most 1.1 times that without the lie, or no more beyond it than the noise of one
    /// sweep (laser's sigma by the root of half its beams, 2 mm); nobody accused; honest robots end with identical bytes.
    Liars(LiarsArgs),
    /// Robots that somebody pushes: two legs walk behind, in every scan, and posts stand on every second robot.
    ///
    /// World `seed` is a hall, a suite of rooms or an office floor, by turns, 60 s of it, seen by a laser of 360 beams all around that
    /// reaches 8 or 12 m, five times a second, without wheels. Legs are 0.12 to 0.24 m across, swing in turn and stay 0.4 to 0.9 m
    /// behind. The same drive is mapped with nobody behind. ATE is that of all scans, aligned rigidly, rmse. Floors: none called good
    /// while its ATE is beyond 3 times that with nobody behind; ATE below 0.05 m in 90 of 100 drives.
    Legs(LegsArgs),
    /// A real log with noise on every increment of odometry, scored against surveyed relations.
    ///
    /// Translation and rotation of each increment are multiplied by `1 + N(0, amount)` each, anew for every seed. The
    /// only floor is that all of the log could be read.
    Noise(NoiseArgs),
    /// Drives with faults of every kind: whether what is said of a map is right.
    ///
    /// World `seed` is an office floor as of `offices`, a loop of 250 m or corridors of 400 m, by turns, recorded once and mapped with
    /// each of 15 faults. Error is the mean relation error as of `breaks`, times that of the same recording without a fault. Floors: of the
    /// maps called good 95 % below 3 times it, of those beyond 10 times it 98 % not called good, and a rank correlation of the expected
    /// error with the true one of 0.6.
    ///
    /// With `--3d` world `seed` is a building as of `drives`, every fourth of its clouds recorded, in every second round of the four
    /// buildings with odometry, and mapped with each of 14 faults. Error is ATE of all clouds that are left. Floors: the first two.
    Verdicts(VerdictsArgs),
    /// Drives whose laser sits anywhere: whether `mapwright calibrate` finds where, as surely as it says.
    ///
    /// World `seed` is a building as of `verdicts`, driven through with a laser up to 0.3 m ahead of the robot's centre or behind it, 0.1 m
    /// aside and 0.2 rad turned, and with odometry that lags or leads by up to 0.15 s; the log says that the laser sits in the centre.
    /// Floors: x, y, yaw and lag each within 3 of their stated standard deviations in 95 of 100 drives.
    Calibrations(WorldsArgs),
    /// Logs with a gap each, as of `mapwright perturb --gap`: what a break of the recording costs.
    ///
    /// Each log is mapped whole, then with every gap by itself. Without logs it is office floors as of `offices`, with what a
    /// surveyor would relate in their truth: scans some metres of way apart, and those of different visits to a place. Gaps begin at
    /// places spread evenly over the log, the same for all lengths, 10 s from its ends at least; the seed says how far along.
    ///
    /// Error is the mean relation error of all scans that are left, the bound 1.3 times that of the whole log and 0.01 m. Left out
    /// are scans that the robot was lost at; pieces are parts of the graph of keyframes that no edge joins; CPU is the time that
    /// mapping took, as a multiple of the whole log's. A line for every run that is beyond a floor says how to repeat it. Floors: 90 %
    /// of the runs within the bound, no error above 0.5 m, no scan left out, CPU at most 2.5 times in every run.
    Breaks(BreaksArgs),
}

/// Which worlds, and what becomes of the results.
#[derive(Debug, Clone, ClapArgs)]
pub(crate) struct RunArgs {
    /// The first seed.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Worlds mapped at a time; nothing that is printed depends on it but the seconds.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: u32,
    /// Folder for one JSON line per world and a summary; made if need be.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
}

#[derive(Debug, Clone, ClapArgs)]
pub(crate) struct WorldsArgs {
    /// How many seeds; by default those that the floors are for: 50 loops, 200 look-alikes, 100 kidnappings, 100 buildings to be located in, 100 fleets, 50 offices and homes,
    /// 20 drives of nested loops, one office with breaks; in space 5 loops, 10 look-alikes, 8 drives.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) worlds: Option<u32>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct LoopsArgs {
    /// Length of each loop, metres.
    #[arg(long, value_name = "M", default_value_t = 500.0, value_parser = parse_length, conflicts_with = "space")]
    pub(crate) length: f64,
    #[command(flatten)]
    pub(crate) space: SpaceArgs,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

/// The same in space.
#[derive(Debug, Clone, ClapArgs)]
#[group(skip)]
pub(crate) struct SpaceArgs {
    /// Worlds in space, seen by a spinning lidar, every second of its clouds mapped.
    #[arg(long = "3d")]
    pub(crate) space: bool,
    #[command(flatten)]
    pub(crate) lidar: LidarArgs,
}

/// A drive in space.
#[derive(Debug, Clone, ClapArgs)]
#[group(skip)]
pub(crate) struct LidarArgs {
    /// Beams of the lidar.
    #[arg(long, value_name = "N", default_value_t = 64, requires = "space", value_parser = clap::value_parser!(u32).range(4..=128))]
    pub(crate) beams: u32,
    /// Each drive ends then, seconds, or with its way.
    #[arg(long, value_name = "S", requires = "space", value_parser = parse_seconds)]
    pub(crate) seconds: Option<f64>,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct LookAlikeArgs {
    #[command(flatten)]
    pub(crate) space: SpaceArgs,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct VerdictsArgs {
    #[command(flatten)]
    pub(crate) space: SpaceArgs,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DrivesArgs {
    /// Worlds in space, seen by a spinning lidar, every second of its clouds mapped; there are no others yet.
    #[arg(long = "3d", required = true)]
    pub(crate) space: bool,
    #[command(flatten)]
    pub(crate) lidar: LidarArgs,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct NestedArgs {
    /// Length of each drive, metres.
    #[arg(long, value_name = "M", default_value_t = 1900.0, value_parser = parse_drive)]
    pub(crate) length: f64,
    /// Wheels so many times as bad as the default ones.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_factor)]
    pub(crate) wheels: f64,
    /// Relative standard deviation of noise on each increment of odometry from scan to scan, on top of the wheels' own.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_share)]
    pub(crate) noise: f64,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct OfficesArgs {
    /// People on each floor.
    #[arg(long, value_name = "N", default_value_t = crate::simulated::PEOPLE as u32, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub(crate) people: u32,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ExploreSuiteArgs {
    /// Scans are drawn where they were truly taken: what exploration does without mapping's errors.
    #[arg(long)]
    pub(crate) true_poses: bool,
    /// Goals are assigned by the best sum instead of the best pair first.
    #[arg(long)]
    pub(crate) hungarian: bool,
    /// Robots share what they tell over a simulated radio: each makes its map of what it hears, and decides for itself.
    #[arg(long, conflicts_with = "true_poses")]
    pub(crate) radio: bool,
    /// Share of the radio's messages that is lost.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_share, requires = "radio")]
    pub(crate) loss: f64,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct FleetSuiteArgs {
    /// So many robots in every world; otherwise 2 to 6, by the seed.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=64))]
    robots: Option<u32>,
    /// Cells of the maps, metres: a little coarser than usual, for looking for places of others then takes a fifth of the time.
    #[arg(long, value_name = "M", default_value_t = 0.07, value_parser = parse_cell)]
    pub(crate) cell: f64,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct LiarsArgs {
    /// So many liars; more than one of eight robots, without floors.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=7))]
    pub(crate) liars: u32,
    /// Cells of the maps, metres, as in `fleet`.
    #[arg(long, value_name = "M", default_value_t = 0.07, value_parser = parse_cell)]
    pub(crate) cell: f64,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

fn parse_cell(text: &str) -> Result<f64, String> {
    let cell_m: f64 = text.parse().map_err(|_| format!("expected metres, found {text:?}"))?;
    if (0.02..=0.2).contains(&cell_m) { Ok(cell_m) } else { Err(format!("expected 0.02 to 0.2 m, found {cell_m}")) }
}

impl FleetSuiteArgs {
    pub(crate) fn robots(&self) -> Option<usize> {
        self.robots.map(|robots| robots as usize)
    }
}

#[derive(Debug, ClapArgs)]
pub(crate) struct LegsArgs {
    /// With the wheels' readings.
    #[arg(long)]
    pub(crate) wheels: bool,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct NoiseArgs {
    /// CARMEN log, plain, .gz or .bz2.
    #[arg(long, value_name = "FILE")]
    pub(crate) log: PathBuf,
    /// Surveyed relations (Kümmerle et al. 2009): t1 t2 x y z roll pitch yaw.
    #[arg(long, value_name = "FILE")]
    pub(crate) relations: PathBuf,
    /// Relative standard deviation of the noise.
    #[arg(long, value_name = "SHARE", default_value_t = 0.15, value_parser = parse_share)]
    pub(crate) amount: f64,
    /// How many seeds.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) seeds: u32,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct BreaksArgs {
    /// Logs as for `map`, each with its relations; without any simulated office floors.
    #[arg(value_name = "LOG", conflicts_with = "worlds", requires = "relations")]
    pub(crate) logs: Vec<PathBuf>,
    /// Surveyed relations (Kümmerle et al. 2009) of each log, in the order of the logs.
    #[arg(long, value_name = "FILE", requires = "logs")]
    pub(crate) relations: Vec<PathBuf>,
    /// Lengths of the gaps, seconds.
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "3,10,30,60,120", value_parser = parse_gap_seconds)]
    pub(crate) lengths: Vec<f64>,
    /// Gaps of each length.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) places: u32,
    /// Only this gap, as of `mapwright perturb`; may be repeated.
    #[arg(long, value_name = "FRACTION:SECONDS", value_parser = parse_gap, conflicts_with_all = ["lengths", "places"])]
    pub(crate) gap: Vec<Gap>,
    /// Bound of a run's error, metres, whatever that of the whole log is.
    #[arg(long, value_name = "M", value_parser = parse_error)]
    pub(crate) within: Option<f64>,
    /// A line for every run.
    #[arg(long)]
    pub(crate) all: bool,
    #[command(flatten)]
    pub(crate) worlds: WorldsArgs,
}
