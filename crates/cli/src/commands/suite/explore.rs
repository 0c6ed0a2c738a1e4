//! `mapwright suite explore`

use super::Measure;
use super::floors::{Floor, stats};
use crate::exploring::{BEAMS, Building, LIMIT_S, Plan, Run, Sharing};
use crate::failure::Failure;
use mapwright::Settings;
use mapwright_explore::{ExploreSettings, Strategy};
use serde::Serialize;
use serde_json::{Value, json};

/// How many times as fast as one robot fleets are at least: robots, times.
const SPEED_UPS: [(usize, f64, &str); 3] = [
    (2, 1.7, "2 robots at least 1.7 times as fast as one"),
    (4, 3.0, "4 robots at least 3.0 times as fast as one"),
    (8, 4.5, "8 robots at least 4.5 times as fast as one"),
];
/// How many times as fast as uncoordinated ones four robots are at least.
const COORDINATION: f64 = 1.8;
/// A fleet of four that loses one at a quarter of the time takes so many times as long as three robots at most.
const DEATH: f64 = 1.1;

pub(super) struct Explore {
    pub(super) slam: bool,
    pub(super) hungarian: bool,
    /// Robots tell each other over the air what they map and where they go.
    pub(super) radio: bool,
    pub(super) loss: f64,
    pub(super) settings: Settings,
}

/// A building explored by one robot, by fleets, by robots that do not share the work, and by four of which one dies.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    area_m2: f64,
    runs: Vec<Explored>,
}

#[derive(Debug, Serialize)]
struct Explored {
    what: &'static str,
    robots: usize,
    /// Until 99 % was seen, and until the robots said that nothing is left.
    seconds: Option<f64>,
    done_s: Option<f64>,
    share: f64,
    driven_m: f64,
    bumps: u32,
    error_m: Option<f64>,
    plan_ms: f64,
}

const RUNS: [(&str, usize); 7] =
    [("one", 1), ("two", 2), ("three", 3), ("four", 4), ("eight", 8), ("nearest", 4), ("one dies", 4)];

impl Explored {
    fn of(what: &'static str, robots: usize, run: &Run) -> Self {
        Self {
            what,
            robots,
            seconds: run.seconds,
            done_s: run.done_s,
            share: run.share(),
            driven_m: run.driven_m,
            bumps: run.bumps,
            error_m: run.error_m,
            plan_ms: run.deciding.as_secs_f64() * 1e3 / f64::from(run.plans.max(1)),
        }
    }
}

impl World {
    fn seconds(&self, what: &str) -> Option<f64> {
        self.runs.iter().find(|run| run.what == what)?.seconds
    }

    /// How many times as long one kind of run takes as another.
    fn times(&self, slow: &str, fast: &str) -> Option<f64> {
        Some(self.seconds(slow)? / self.seconds(fast)?.max(1.0))
    }
}

impl Measure for Explore {
    type World = World;
    const NAME: &'static str = "explore";
    const FILES: [&'static str; 2] = ["explore.jsonl", "explore.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let building = Building::office(seed);
        let mut world = World { seed, area_m2: building.area_m2(), runs: Vec::new() };
        for (what, robots) in RUNS {
            let (strategy, sharing) = match (what, self.hungarian) {
                ("nearest", _) => (Strategy::Nearest, Sharing::Map),
                (_, hungarian) => {
                    let strategy = if hungarian { Strategy::Hungarian } else { Strategy::Greedy };
                    (strategy, if self.radio { Sharing::Told } else { Sharing::Work })
                }
            };
            let four_s = world.seconds("four").unwrap_or(0.0);
            let dies = (what == "one dies").then_some((seed as usize % 4, 0.25 * four_s));
            let explore = ExploreSettings { strategy, ..ExploreSettings::default() };
            let run = building.run(
                &Plan {
                    seed,
                    robots,
                    explore,
                    sharing,
                    slam: self.slam,
                    loss: self.loss,
                    dies,
                    until_s: LIMIT_S,
                    beams: BEAMS,
                },
                &self.settings,
            )?;
            world.runs.push(Explored::of(what, robots, &run));
        }
        Ok(world)
    }

    fn line(world: &World) -> String {
        let seconds = |run: &Explored| {
            let seconds = run.seconds.map_or("never".to_owned(), |s| format!("{s:.0} s"));
            format!("  {} {seconds}{}", run.what, if run.done_s.is_none() { " NEVER ENDS" } else { "" })
        };
        format!("{:6}  {:.0} m2{}", world.seed, world.area_m2, world.runs.iter().map(seconds).collect::<String>())
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let mut words = "run        robots  to 99 %   done   seen    way each  held  error    plan\n".to_owned();
        let runs = |what: &str| {
            worlds.iter().flat_map(|world| &world.runs).filter(move |run| run.what == what).collect::<Vec<_>>()
        };
        for (what, robots) in RUNS {
            words += &row(what, robots, &runs(what));
        }
        let ratio = |slow: &str, fast: &str| {
            let times: Vec<f64> = worlds.iter().filter_map(|world| world.times(slow, fast)).collect();
            times.iter().sum::<f64>() / times.len().max(1) as f64
        };
        let names = [(2, "two"), (4, "four"), (8, "eight")];
        let mut floors = Vec::new();
        for (robots, least, what) in SPEED_UPS {
            let name = names.iter().find(|name| name.0 == robots).map_or("", |name| name.1);
            floors.push(at_least(what, ratio("one", name), least));
        }
        let (nearest, dies) = (ratio("nearest", "four"), ratio("one dies", "three"));
        floors.push(at_least("4 robots at least 1.8 times as fast as uncoordinated ones", nearest, COORDINATION));
        floors.push(Floor {
            what: "one of 4 dead at a quarter of the time at most 1.1 times as slow as 3 robots",
            found: format!("{dies:.2} times"),
            holds: dies <= DEATH,
        });
        let all: Vec<&Explored> = worlds.iter().flat_map(|world| &world.runs).collect();
        floors.push(Floor::none("runs that never end", all.iter().filter(|run| run.done_s.is_none()).count()));
        let short = all.iter().filter(|run| run.seconds.is_none()).count();
        floors.push(Floor::none("runs that end before 99 % was seen", short));
        let value = json!({
            "slam": self.slam,
            "hungarian": self.hungarian,
            "radio": self.radio,
            "loss": self.loss,
            "area_m2": stats(worlds, |world| world.area_m2).map(|stats| stats.mean),
            "times_nearest": nearest,
            "times_dead": dies,
        });
        (words, value, floors)
    }
}

fn at_least(what: &'static str, found: f64, least: f64) -> Floor {
    Floor { what, found: format!("{found:.2} times"), holds: found >= least }
}

/// Means over the worlds.
fn row(what: &str, robots: usize, runs: &[&Explored]) -> String {
    let mean = |pick: &dyn Fn(&Explored) -> Option<f64>| {
        let picked: Vec<f64> = runs.iter().filter_map(|run| pick(run)).collect();
        if picked.is_empty() { f64::NAN } else { picked.iter().sum::<f64>() / picked.len() as f64 }
    };
    format!(
        "{what:<9}  {robots:6}  {:5.0} s {:5.0} s  {:5.2} %  {:5.0} m  {:4.0}  {:.3} m  {:4.1} ms\n",
        mean(&|run| run.seconds),
        mean(&|run| run.done_s),
        mean(&|run| Some(100.0 * run.share)),
        mean(&|run| Some(run.driven_m / run.robots as f64)),
        mean(&|run| Some(f64::from(run.bumps))),
        mean(&|run| run.error_m),
        mean(&|run| Some(run.plan_ms)),
    )
}
