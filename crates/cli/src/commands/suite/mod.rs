//! `mapwright suite`: many simulated worlds mapped and measured against their truth.

mod breaks;
mod calibrations;
mod explore;
mod fleet;
mod floors;
mod homes;
mod judged;
mod kidnapped;
mod legs;
mod localise;
mod look_alike;
mod loops;
mod nested;
mod noise;
mod offices;
mod parallel;
mod sonar;
mod space;
mod verdicts;

use crate::args::{LookAlikeArgs, RunArgs, Suite, SuiteArgs, WorldsArgs};
use crate::events::{Ending, Interrupt};
use crate::failure::{Failure, Outcome};
use crate::output::OutputFolder;
use crate::terminal::say;
use floors::Floor;
use mapwright::Settings;
use serde::Serialize;
use serde_json::{Value, json};
use std::io::Write;
use std::ops::Range;
use std::time::Instant;

/// What is measured in each of many worlds.
trait Measure: Sync {
    /// What is found in one world.
    type World: Serialize + Send;
    /// Its name, and those of its files.
    const NAME: &'static str;
    const FILES: [&'static str; 2];
    /// What a world is called.
    const KIND: &'static str = "world";
    /// Maps the world of a seed.
    fn world(&self, seed: u64) -> Result<Self::World, Failure>;
    /// One line for a world.
    fn line(world: &Self::World) -> String;
    /// Whether that line is said.
    fn is_told(&self, _world: &Self::World) -> bool {
        true
    }
    /// The last lines over all worlds, the same for programs, and what must hold.
    fn summary(&self, worlds: &[Self::World]) -> (String, Value, Vec<Floor>);
}

pub(super) fn run(args: &SuiteArgs) -> Result<Outcome, Failure> {
    match &args.suite {
        Suite::Loops(args) if args.space.space => {
            let drives = space::Drives::new(&args.space.lidar, settings_of(&args.worlds.run)?);
            measure(&space::Loops(drives), seeds_of(&args.worlds, 5), &args.worlds.run)
        }
        Suite::Loops(args) => {
            let settings = settings_of(&args.worlds.run)?;
            measure(&loops::Loops { length_m: args.length, settings }, seeds_of(&args.worlds, 50), &args.worlds.run)
        }
        Suite::Nested(args) => {
            let settings = settings_of(&args.worlds.run)?;
            let nested = nested::Nested { length_m: args.length, wheels: args.wheels, noise: args.noise, settings };
            measure(&nested, seeds_of(&args.worlds, 20), &args.worlds.run)
        }
        Suite::LookAlike(args) if args.space.space => {
            let drives = space::Drives::new(&args.space.lidar, settings_of(&args.worlds.run)?);
            measure(&space::LookAlikes(drives), seeds_of(&args.worlds, 10), &args.worlds.run)
        }
        Suite::LookAlike(LookAlikeArgs { worlds, .. }) => {
            let settings = settings_of(&worlds.run)?;
            measure(&look_alike::LookAlikes { settings }, seeds_of(worlds, 200), &worlds.run)
        }
        Suite::Drives(args) => {
            let drives = space::Drives::new(&args.lidar, settings_of(&args.worlds.run)?);
            measure(&space::Honesty(drives), seeds_of(&args.worlds, 8), &args.worlds.run)
        }
        Suite::Kidnapped(args) => {
            measure(&kidnapped::Kidnapped { settings: settings_of(&args.run)? }, seeds_of(args, 100), &args.run)
        }
        Suite::Localise(args) if args.space.space => {
            let drives = space::Drives::new(&args.space.lidar, settings_of(&args.worlds.run)?);
            measure(&space::Localise(drives), seeds_of(&args.worlds, 50), &args.worlds.run)
        }
        Suite::Localise(LookAlikeArgs { worlds, .. }) => {
            measure(&localise::Localise { settings: settings_of(&worlds.run)? }, seeds_of(worlds, 100), &worlds.run)
        }
        Suite::Cut(args) => {
            let drives = space::Drives::new(&args.lidar, settings_of(&args.worlds.run)?);
            measure(&space::Cut(drives), seeds_of(&args.worlds, 8), &args.worlds.run)
        }
        Suite::Offices(args) => {
            let settings = settings_of(&args.worlds.run)?;
            let offices = offices::Offices { people: args.people as usize, settings };
            measure(&offices, seeds_of(&args.worlds, 50), &args.worlds.run)
        }
        Suite::Homes(args) => {
            measure(&homes::Homes { settings: settings_of(&args.run)? }, seeds_of(args, 50), &args.run)
        }
        Suite::Sonar(args) => {
            let settings = crate::settings::load_over(Settings::of_sonars(), &args.run.settings)?;
            measure(&sonar::SonarOffices { settings }, seeds_of(args, 20), &args.run)
        }
        Suite::Explore(args) => {
            let settings = settings_of(&args.worlds.run)?;
            let explore = explore::Explore {
                slam: !args.true_poses,
                hungarian: args.hungarian,
                radio: args.radio,
                loss: args.loss,
                settings,
            };
            measure(&explore, seeds_of(&args.worlds, 20), &args.worlds.run)
        }
        Suite::Fleet(args) => {
            let fleets = fleet::Fleets::new(args.robots(), args.cell, settings_of(&args.worlds.run)?);
            measure(&fleets, seeds_of(&args.worlds, 100), &args.worlds.run)
        }
        Suite::Partition(args) => {
            let fleets = fleet::Fleets::new(args.robots(), args.cell, settings_of(&args.worlds.run)?);
            measure(&fleet::Partitions(fleets), seeds_of(&args.worlds, 100), &args.worlds.run)
        }
        Suite::Liars(args) => {
            let liars = fleet::Liars::new(args.liars as usize, args.cell, settings_of(&args.worlds.run)?);
            measure(&liars, seeds_of(&args.worlds, 72), &args.worlds.run)
        }
        Suite::Legs(args) => {
            let settings = settings_of(&args.worlds.run)?;
            measure(&legs::Legs { wheels: args.wheels, settings }, seeds_of(&args.worlds, 100), &args.worlds.run)
        }
        Suite::Noise(args) => {
            let noise = noise::Noise::read(args, settings_of(&args.run)?)?;
            measure(&noise, seeds_from(args.run.seed, args.seeds), &args.run)
        }
        Suite::Verdicts(args) if args.space.space => {
            let drives = space::Drives::new(&args.space.lidar, settings_of(&args.worlds.run)?);
            measure(&space::Verdicts(drives), seeds_of(&args.worlds, 8), &args.worlds.run)
        }
        Suite::Verdicts(args) => {
            let settings = settings_of(&args.worlds.run)?;
            measure(&verdicts::Verdicts { settings }, seeds_of(&args.worlds, 14), &args.worlds.run)
        }
        Suite::Calibrations(args) => {
            measure(&calibrations::Calibrations { settings: settings_of(&args.run)? }, seeds_of(args, 100), &args.run)
        }
        Suite::Breaks(args) => {
            let breaks = breaks::Breaks::prepare(args, settings_of(&args.worlds.run)?)?;
            measure(&breaks, 0..breaks.runs(), &args.worlds.run)
        }
    }
}

fn settings_of(args: &RunArgs) -> Result<Settings, Failure> {
    crate::settings::load(&args.settings)
}

fn seeds_of(args: &WorldsArgs, by_default: u32) -> Range<u64> {
    seeds_from(args.run.seed, args.worlds.unwrap_or(by_default))
}

fn seeds_from(first: u64, count: u32) -> Range<u64> {
    first..first.saturating_add(u64::from(count))
}

/// A line for each world as soon as it and those before it are done, then what holds over all of them.
fn measure<M: Measure>(measure: &M, seeds: Range<u64>, args: &RunArgs) -> Result<Outcome, Failure> {
    let interrupt = Interrupt::watch()?;
    let mut output = args.output.as_deref().map(OutputFolder::create).transpose()?;
    let mut lines = output.as_mut().map(|output| output.begin(M::FILES[0])).transpose()?;
    let (started, mut worlds) = (Instant::now(), Vec::new());
    let ending = parallel::in_order(
        seeds,
        args.threads,
        &interrupt,
        |seed| measure.world(seed),
        |world: M::World| {
            if let Some(lines) = &mut lines {
                let line = serde_json::to_string(&world).map_err(std::io::Error::from);
                let written = line.and_then(|line| writeln!(lines, "{line}"));
                written.map_err(|error| Failure::write(M::FILES[0], error))?;
            }
            if measure.is_told(&world) {
                say(&format!("{}\n", M::line(&world)))?;
            }
            worlds.push(world);
            Ok(())
        },
    )?;
    let (words, mut value, floors) = measure.summary(&worlds);
    let seconds = started.elapsed().as_secs_f64();
    let each_s = seconds * f64::from(args.threads) / worlds.len().max(1) as f64;
    say(&format!("\n{}: {} {}s\n{words}{}", M::NAME, worlds.len(), M::KIND, floors::in_words(&floors)))?;
    say(&format!("time     {seconds:.1} s, {each_s:.2} s a {} and thread\n", M::KIND))?;
    let interrupted = ending == Ending::Interrupted;
    if interrupted {
        say(&format!("lost     interrupted; the {}s so far are complete\n", M::KIND))?;
    }
    if let Some(mut output) = output {
        value["suite"] = json!(M::NAME);
        value[format!("{}s", M::KIND)] = json!(worlds.len());
        value["floors"] = floors.iter().map(Floor::to_json).collect();
        output.write_json(M::FILES[1], &value)?;
        output.commit()?;
    }
    let held = floors.iter().all(|floor| floor.holds) && !interrupted;
    Ok(if held { Outcome::Done } else { Outcome::WithLoss })
}
