//! `mapwright suite legs`

use super::Measure;
use super::floors::{Floor, stats};
use super::judged::{GOOD_TIMES, map_beside_truth, without_wheels};
use crate::failure::Failure;
use crate::verdict::{Usability, Usable};
use mapwright::Settings;
use mapwright_sim::{Drive, DriveSettings, Event, Incident, LaserSettings, Rng, RobotSettings, Site, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// The error may be so much, metres, in such a share of the drives.
const MOST_ERROR_M: f64 = 0.05;
const LEAST_SHARE: f64 = 0.9;
/// A drive ends then, seconds.
const DRIVE_S: f64 = 60.0;

pub(super) struct Legs {
    pub(super) wheels: bool,
    pub(super) settings: Settings,
}

/// A drive with nobody behind the robot, and the same with legs.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    site: &'static str,
    reach_m: f64,
    posts: usize,
    /// ATE of all scans, metres, and what was said.
    clean_m: f64,
    clean_word: Usability,
    error_m: f64,
    word: Usability,
    words: String,
}

impl World {
    fn is_silently_wrong(&self) -> bool {
        self.word == Usability::Good && self.error_m > GOOD_TIMES * self.clean_m
    }
}

/// What is drawn of a seed.
struct Pushed {
    name: &'static str,
    site: Arc<Site>,
    settings: DriveSettings,
    on_robot: Vec<Incident>,
}

impl Pushed {
    fn draw(seed: u64) -> Self {
        let mut rng = Rng::keyed(seed, 0x6c65_6773);
        let (name, site) = match seed % 3 {
            0 => ("hall", worlds::hall(seed)),
            1 => ("rooms", worlds::rooms(seed)),
            _ => ("floor", worlds::office_floor(seed)),
        };
        let mut laser = LaserSettings::with_field_of_view(TAU, 360);
        laser.range_sigma_m = 0.012;
        let model = Arc::make_mut(&mut laser.model);
        model.range_max_m = if rng.chance(0.5) { 8.0 } else { 12.0 };
        model.range_min_m = 0.1;
        // Some logs begin on the way.
        let acceleration_m_per_s2 = if rng.chance(0.5) { 0.5 } else { 5.0 };
        let robot =
            RobotSettings { speed_m_per_s: rng.uniform(0.4, 0.75), acceleration_m_per_s2, ..RobotSettings::default() };
        let settings =
            DriveSettings { robot, laser, scan_rate_hz: 5.0, duration_s: DRIVE_S, seed, ..DriveSettings::default() };
        let on_robot = on_robot(seed, &mut rng);
        Self { name, site: Arc::new(site), settings, on_robot }
    }

    fn drive(&self, on_robot: &[Incident]) -> Drive {
        let settings = DriveSettings { incidents: on_robot.to_vec(), ..self.settings.clone() };
        Drive::new(Arc::clone(&self.site), settings)
    }
}

/// Two legs, and up to four posts on every second robot.
fn on_robot(seed: u64, rng: &mut Rng) -> Vec<Incident> {
    let radius_m = rng.uniform(0.06, 0.12);
    let swing_m = rng.uniform(0.1, 0.17);
    let mut things = vec![Incident::Pushed {
        distance_m: rng.uniform(0.4, 0.9).max(swing_m + radius_m + 0.2),
        radius_m,
        apart_m: 2.0 * radius_m + rng.uniform(0.02, 0.12),
        swing_m,
        strides_per_s: rng.uniform(0.6, 0.95),
    }];
    let posts = if seed.is_multiple_of(2) { 0 } else { 1 + rng.below(4) };
    things.extend((0..posts).map(|_| Incident::Blocked {
        from_s: 0.0,
        to_s: f64::INFINITY,
        bearing_rad: rng.uniform(-PI, PI),
        distance_m: rng.uniform(0.18, 0.35),
        radius_m: rng.uniform(0.01, 0.03),
    }));
    things
}

impl Legs {
    fn run(&self, pushed: &Pushed, on_robot: &[Incident]) -> Result<(f64, Usable), Failure> {
        let drive = pushed.drive(on_robot);
        let events: Box<dyn Iterator<Item = Event>> =
            if self.wheels { Box::new(drive) } else { Box::new(without_wheels(drive)) };
        map_beside_truth(&format!("{} pushed", pushed.name), events, &self.settings)
    }
}

impl Measure for Legs {
    type World = World;
    const NAME: &'static str = "legs";
    const FILES: [&'static str; 2] = ["legs.jsonl", "legs.json"];
    const KIND: &'static str = "drive";

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let pushed = Pushed::draw(seed);
        let (clean_m, clean) = self.run(&pushed, &[])?;
        let (error_m, usable) = self.run(&pushed, &pushed.on_robot)?;
        Ok(World {
            seed,
            site: pushed.name,
            reach_m: pushed.settings.laser.model.range_max_m,
            posts: pushed.on_robot.len() - 1,
            clean_m,
            clean_word: clean.word,
            error_m,
            word: usable.word,
            words: usable.words().trim_end().to_owned(),
        })
    }

    fn line(world: &World) -> String {
        let wrong = if world.is_silently_wrong() { "  SILENTLY WRONG" } else { "" };
        format!(
            "{:6}  {:5} {:4.0} m, {} posts  clean {:6.3} m {:8}  pushed {:6.3} m {}{wrong}",
            world.seed,
            world.site,
            world.reach_m,
            world.posts,
            world.clean_m,
            world.clean_word.name(),
            world.error_m,
            world.words,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let clean = stats(worlds, |world| world.clean_m);
        let pushed = stats(worlds, |world| world.error_m);
        let row = |what: &str, stats: &Option<mapwright_eval::ErrorStats>| {
            stats.as_ref().map_or(String::new(), |stats| {
                format!("{what:8} mean {:.3} m, median {:.3} m, worst {:.3} m\n", stats.mean, stats.median, stats.max)
            })
        };
        let within = worlds.iter().filter(|world| world.error_m < MOST_ERROR_M).count();
        let wrong = worlds.iter().filter(|world| world.is_silently_wrong()).count();
        let clean_within = worlds.iter().filter(|world| world.clean_m < MOST_ERROR_M).count();
        let words = row("clean", &clean)
            + &row("pushed", &pushed)
            + &format!("clean    {}\n", super::floors::percent(clean_within, worlds.len()) + " below 0.05 m");
        let value = json!({
            "wheels": self.wheels,
            "clean_m_median": clean.as_ref().map(|stats| stats.median),
            "error_m_median": pushed.as_ref().map(|stats| stats.median),
            "error_m_worst": pushed.as_ref().map(|stats| stats.max),
            "silently_wrong": wrong,
        });
        let floors = vec![
            Floor::none("none called good beyond 3 times the error with nobody behind", wrong),
            Floor::share("error below 0.05 m in 90 % of the drives", LEAST_SHARE, within, worlds.len()),
        ];
        (words, value, floors)
    }
}
