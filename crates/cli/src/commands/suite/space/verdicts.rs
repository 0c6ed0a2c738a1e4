//! `mapwright suite verdicts --3d`: whether what is said of a map of space is right.

use super::super::Measure;
use super::super::floors::Floor;
use super::super::judged::{self, Judged};
use super::{Drives, WORLDS};
use crate::failure::Failure;
use crate::simulated::{Simulated, Taken};
use crate::space::{SpaceFacts, Tally};
use mapwright::{Cloud, Pose3, Settings, SpaceMapper, SpaceSweep};
use mapwright_eval::EvalError;
use mapwright_sim::Rng;
use mapwright_sim::space::{SpaceDrive, TrueCloud};
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::Value;

/// Every so many-th cloud is recorded, of 10 a second: what turns by a right angle in a second then turns by 36 degrees a cloud.
const RECORDED: usize = 4;
/// Voxels as of `space.resolution_m=8`.
const COARSE_M: f64 = 8.0;
/// Noise on each range, metres.
const NOISE_M: f64 = 0.3;
/// Share of the points that are anywhere along their beams, nearer than so much, metres.
const RANDOM: f64 = 0.3;
const RANDOM_WITHIN_M: f64 = 20.0;
/// A sensor is covered for so many of so many clouds.
const COVERED: [usize; 2] = [12, 50];

pub(in super::super) struct Verdicts(pub(in super::super) Drives);

/// What is done to a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    /// So much is missing in the middle, seconds.
    Gap(f64),
    /// Every so many-th cloud is left.
    Every(usize),
    Covered,
    HalfCovered,
    Coarse,
    Noise,
    RandomPoints,
}

/// Each with what it is called.
const FAULTS: [(Fault, &str); 14] = [
    (Fault::None, "none"),
    (Fault::Gap(2.0), "2 s missing"),
    (Fault::Gap(4.0), "4 s missing"),
    (Fault::Gap(8.0), "8 s missing"),
    (Fault::Gap(16.0), "16 s missing"),
    (Fault::Every(2), "every 2nd cloud"),
    (Fault::Every(4), "every 4th cloud"),
    (Fault::Every(8), "every 8th cloud"),
    (Fault::Every(16), "every 16th cloud"),
    (Fault::Covered, "sensor covered for 5 of 20 s"),
    (Fault::HalfCovered, "half of the sensor covered"),
    (Fault::Coarse, "voxels of 8 m"),
    (Fault::Noise, "ranges with 0.3 m of noise"),
    (Fault::RandomPoints, "30 % random points"),
];

impl Fault {
    fn applied(self, clouds: &[TrueCloud], seed: u64) -> Vec<TrueCloud> {
        let middle = clouds.len() / 2;
        let from = clouds.get(middle).map(|taken| taken.cloud.stamp);
        let is_left = |(at, taken): &(usize, &TrueCloud)| match self {
            Self::Gap(length_s) => {
                from.is_none_or(|from| !(0.0..length_s).contains(&taken.cloud.stamp.secs_since(from)))
            }
            Self::Every(every) => at % every == 0,
            _ => true,
        };
        let changed = |(at, taken): (usize, &TrueCloud)| {
            let mut taken = taken.clone();
            self.change(&mut taken.cloud, at, &mut Rng::keyed(seed, at as u64));
            taken
        };
        clouds.iter().enumerate().filter(is_left).map(changed).collect()
    }

    fn change(self, cloud: &mut Cloud, at: usize, rng: &mut Rng) {
        let (near_m, far_m) = (cloud.sensor.range_min_m, RANDOM_WITHIN_M);
        for point in &mut cloud.points_m {
            let range_m = point.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
            let at_range = |point: &[f32; 3], new_m: f64| point.map(|v| (f64::from(v) * new_m / range_m) as f32);
            match self {
                Self::Covered if at % COVERED[1] >= COVERED[1] - COVERED[0] => *point = [f32::NAN; 3],
                Self::HalfCovered if point[1] > 0.0 => *point = [f32::NAN; 3],
                Self::Noise => *point = at_range(point, (range_m + rng.normal(NOISE_M)).max(near_m)),
                Self::RandomPoints if rng.chance(RANDOM) => *point = at_range(point, rng.uniform(near_m, far_m)),
                _ => {}
            }
        }
    }

    fn settings(self, settings: &Settings) -> Settings {
        let mut settings = *settings;
        if self == Self::Coarse {
            settings.space.resolution_m = COARSE_M;
        }
        settings
    }
}

/// A building, driven through once and mapped with every fault.
#[derive(Debug, Serialize)]
pub(in super::super) struct World {
    seed: u64,
    building: &'static str,
    with_odometry: bool,
    clouds: usize,
    runs: Vec<Run>,
}

#[derive(Debug, Serialize)]
struct Run {
    /// Of the ATE of all clouds.
    #[serde(flatten)]
    judged: Judged,
    facts: SpaceFacts,
}

impl Measure for Verdicts {
    type World = World;
    const NAME: &'static str = "verdicts in space";
    const FILES: [&'static str; 2] = ["verdicts-3d.jsonl", "verdicts-3d.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let of_worlds = WORLDS.len() as u64;
        let (building, site) = WORLDS[(seed % of_worlds) as usize];
        let with_odometry = (seed / of_worlds) % 2 == 1;
        let drive = self.0.drive(site(seed), seed);
        let recorded = (0..).step_by(RECORDED).map_while(|number| drive.cloud(number));
        let clouds: Vec<TrueCloud> = recorded
            .map(|mut taken| {
                taken.cloud.odom_from_robot = taken.cloud.odom_from_robot.filter(|_| with_odometry);
                taken
            })
            .collect();
        let mut runs: Vec<Run> = Vec::new();
        for (fault, name) in FAULTS {
            let (error_m, facts) = run(&drive, fault.applied(&clouds, seed), &fault.settings(&self.0.settings))
                .map_err(|reason| Failure::World { name: format!("{building}, seed {seed}, {name}"), reason })?;
            let clean_m = runs.first().map_or(error_m, |clean| clean.judged.error_m);
            let judged = Judged { fault: name, error_m, clean_m, word: facts.judged().word };
            runs.push(Run { judged, facts });
        }
        Ok(World { seed, building, with_odometry, clouds: clouds.len(), runs })
    }

    fn line(world: &World) -> String {
        let runs = world.runs.iter().map(|run| run.judged.line()).collect::<String>();
        let wheels = if world.with_odometry { "with odometry" } else { "without odometry" };
        format!("{:6} {}, {wheels}{runs}", world.seed, world.building)
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        judged::summary(&worlds.iter().flat_map(|world| &world.runs).map(|run| &run.judged).collect::<Vec<_>>())
    }
}

/// Error and evidence of a recording.
fn run(drive: &SpaceDrive, clouds: Vec<TrueCloud>, settings: &Settings) -> Result<(f64, SpaceFacts), String> {
    let mut mapper = SpaceMapper::new(*settings).map_err(|cause| cause.to_string())?;
    let (mut tally, mut scans) = (Tally::default(), Vec::<Taken<Pose3>>::new());
    for taken in clouds {
        scans.push(Taken::of_cloud(drive, &taken, &scans));
        tally.add(&taken.cloud, &mapper.add_cloud(&taken.cloud));
    }
    let facts = SpaceFacts::of(&tally, &mut mapper);
    let driven_m = spread_m(&scans.iter().map(|scan| scan.world_from_robot.translation).collect::<Vec<_>>());
    let world: Simulated<SpaceSweep> = Simulated::of(mapper.session().clone(), scans);
    let error_m = match world.trajectory_ate_m() {
        // the map has the robot in one place
        Err(EvalError::NotAlignable { .. }) => driven_m,
        error_m => error_m.map_err(|cause| cause.to_string())?,
    };
    Ok((error_m, facts))
}

/// Root of the mean square distance of places from their middle, metres.
fn spread_m(places_m: &[Vector3<f64>]) -> f64 {
    let count = places_m.len().max(1) as f64;
    let middle_m = places_m.iter().sum::<Vector3<f64>>() / count;
    (places_m.iter().map(|place_m| (place_m - middle_m).norm_squared()).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_that_stays_is_off_by_what_it_drove() {
        let way = [0.0, 2.0].map(|x| Vector3::new(x, 1.0, 0.0));
        assert_eq!((spread_m(&way), spread_m(&way[..1]), spread_m(&[])), (1.0, 0.0, 0.0));
    }
}
