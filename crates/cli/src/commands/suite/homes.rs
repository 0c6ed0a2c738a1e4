//! `mapwright suite homes`

use super::Measure;
use super::floors::{Floor, stats};
use super::judged::{map_beside_truth, without_wheels};
use crate::failure::Failure;
use crate::verdict::Usability;
use mapwright::Settings;
use mapwright_eval::ErrorStats;
use mapwright_sim::{Drive, DriveSettings, Event, Incident, LaserSettings, OdometryNoise, Rng, RobotSettings, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// The error may be so much in the middle of the drives with wheels, and at worst in any, metres.
const MEDIAN_M: f64 = 0.05;
const WORST_M: f64 = 0.3;
/// A map that is called good is no farther off than this, metres.
const GOOD_M: f64 = 0.15;
/// Scans a second; the laser turns all the time.
const RATE_HZ: f64 = 5.0;
const BEAMS: usize = 360;

pub(super) struct Homes {
    pub(super) settings: Settings,
}

/// A drive through an apartment.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    by_hand: bool,
    reach_m: f64,
    scans: usize,
    /// ATE of all scans, metres, and what was said.
    error_m: f64,
    word: Usability,
    words: String,
}

impl World {
    fn is_silently_wrong(&self) -> bool {
        self.word == Usability::Good && self.error_m > GOOD_M
    }
}

/// The apartment of a seed and who drives or walks through it: the laser reaches 3.5 m or 8 m by turns, and two of four are carried.
fn events(seed: u64) -> (bool, f64, Box<dyn Iterator<Item = Event>>) {
    let mut rng = Rng::keyed(seed, 0x686f_6d65_7266);
    let reach_m = if seed.is_multiple_of(2) { 3.5 } else { 8.0 };
    let by_hand = seed % 4 >= 2;
    let mut laser = LaserSettings::with_field_of_view(TAU, BEAMS);
    laser.range_sigma_m = rng.uniform(0.008, 0.02);
    laser.no_return_probability = 0.01;
    laser.no_return_reading_m = if rng.chance(0.5) { f64::INFINITY } else { 0.0 };
    let model = Arc::make_mut(&mut laser.model);
    (model.range_min_m, model.range_max_m) = (0.12, reach_m);
    model.beam_period_s = 1.0 / (RATE_HZ * BEAMS as f64);
    let people = rng.below(3);
    let robot = if by_hand {
        RobotSettings {
            speed_m_per_s: rng.uniform(0.8, 1.2),
            turn_rate_rad_per_s: 1.2,
            acceleration_m_per_s2: 1.5,
            ..RobotSettings::default()
        }
    } else {
        RobotSettings { speed_m_per_s: rng.uniform(0.2, 0.4), ..RobotSettings::default() }
    };
    // Who carries a laser stands behind it.
    let carrier = Incident::Blocked {
        from_s: 0.0,
        to_s: f64::INFINITY,
        bearing_rad: PI,
        distance_m: rng.uniform(0.4, 0.6),
        radius_m: 0.2,
    };
    let settings = DriveSettings {
        robot,
        laser,
        odometry: OdometryNoise::default().times(1.5).with_slips(),
        scan_rate_hz: RATE_HZ,
        incidents: if by_hand { vec![carrier] } else { Vec::new() },
        duration_s: if by_hand { 90.0 } else { 240.0 },
        seed,
        ..DriveSettings::default()
    };
    let drive = Drive::new(Arc::new(worlds::home(seed).with_people(people, seed)), settings);
    (by_hand, reach_m, if by_hand { Box::new(without_wheels(drive)) } else { Box::new(drive) })
}

impl Measure for Homes {
    type World = World;
    const NAME: &'static str = "homes";
    const FILES: [&'static str; 2] = ["homes.jsonl", "homes.json"];
    const KIND: &'static str = "drive";

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let (by_hand, reach_m, events) = events(seed);
        let mut scans = 0;
        let events = events.inspect(|event| scans += usize::from(matches!(event, Event::Scan(_))));
        let (error_m, usable) = map_beside_truth(&format!("home, seed {seed}"), events, &self.settings)?;
        let words = usable.words().trim_end().to_owned();
        Ok(World { seed, by_hand, reach_m, scans, error_m, word: usable.word, words })
    }

    fn line(world: &World) -> String {
        let wrong = if world.is_silently_wrong() { "  SILENTLY WRONG" } else { "" };
        let how = if world.by_hand { "by hand" } else { "wheels" };
        let World { seed, reach_m, scans, error_m, words, .. } = world;
        format!("{seed:6}  {how:7} {reach_m:3.1} m, {scans:4} scans  ATE {error_m:6.3} m  {words}{wrong}")
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let (mut words, mut rows, mut median_m) = (String::new(), serde_json::Map::new(), 0.0);
        for (by_hand, name) in [(false, "wheels"), (true, "by hand")] {
            let of = worlds.iter().filter(|world| world.by_hand == by_hand);
            let Some(ate) = ErrorStats::of(&of.map(|world| world.error_m).collect::<Vec<_>>()) else { continue };
            words += &format!("{name:8} mean {:.3} m, median {:.3} m, worst {:.3} m\n", ate.mean, ate.median, ate.max);
            rows.insert(name.to_owned(), json!({ "median_m": ate.median, "mean_m": ate.mean, "worst_m": ate.max }));
            if !by_hand {
                median_m = ate.median;
            }
        }
        let worst_m = stats(worlds, |world| world.error_m).map_or(0.0, |ate| ate.max);
        let wrong = worlds.iter().filter(|world| world.is_silently_wrong()).count();
        let within = |what: &'static str, found: f64, most: f64| Floor {
            what,
            found: format!("{found:.3} m"),
            holds: found <= most,
        };
        let floors = vec![
            within("ATE with wheels at most 0.05 m in the median", median_m, MEDIAN_M),
            within("ATE at most 0.3 m in every drive", worst_m, WORST_M),
            Floor::none("none called good with an ATE beyond 0.15 m", wrong),
        ];
        (words, json!({ "by": rows, "silently_wrong": wrong }), floors)
    }
}
