//! `mapwright calibrate`

use crate::args::CalibrateArgs;
use crate::calibrated::Calibrated;
use crate::calibration::words::{CLEAR_SIGMAS, to_json, to_words};
use crate::calibration::{Calibration, Estimate, Sample, calibrate};
use crate::events::{Ending, Log};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::progress::{FirstPass, Progress};
use crate::settings;
use crate::space;
use crate::terminal::{say, say_json};
use crate::turns::Turns;
use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Status};
use mapwright_formats::LogEvent;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::sync::Arc;

pub(super) fn run(args: &CalibrateArgs) -> Result<Outcome, Failure> {
    let interrupt = Interrupt::watch()?;
    if args.log != Path::new("-") && (args.space || space::is_of_space(&args.log, &args.source)?) {
        return space::calibrate(args, &interrupt);
    }
    let first = pass(args, &interrupt, None)?;
    let presumed = first.collector.presumed();
    let Pass { name, outcome, ending, .. } = first;
    let found = first.collector.found();
    let mut found = found.map_err(|reason| Failure::NotCalibrated { name: name.clone(), reason })?.lagging(first.lag_s);
    // Matches are drawn to where the mapper has the laser: once more, with the laser where it was found. A stream is gone.
    let is_still_there = args.log.is_file() || args.log.is_dir();
    if ending == Ending::OfLog && is_still_there {
        let second = pass(args, &interrupt, Some(Mounts::of(presumed, &found)))?;
        if let (Ending::OfLog, Ok(better)) = (second.ending, second.collector.found()) {
            found = better.lagging(second.lag_s);
        }
    }
    if let Some(path) = &args.apply {
        let upside_down = first.collector.upside_down.unwrap_or(false);
        let text = Calibrated::of(&found, upside_down).to_text(&name);
        fs::write(path, text).map_err(|cause| Failure::write(path, cause))?;
    }
    if args.voice.json {
        let mut value = to_json(&name, &found, presumed);
        value["laser"] = json!(first.collector.laser.as_ref().map(|laser| &laser.name));
        value["lasers_left_out"] = json!(first.collector.left_out);
        say_json(&value)?;
    } else if !args.voice.quiet {
        say(&(to_words(&name, &found, presumed) + &first.collector.which()))?;
    }
    Ok(outcome)
}

/// A log that was read once.
struct Pass {
    collector: Collector,
    name: String,
    ending: Ending,
    outcome: Outcome,
    /// By how much odometry was found to lag, seconds, and was put right before the mapper had it.
    lag_s: f64,
}

/// Reads the log, with the laser where it was found before.
fn pass(args: &CalibrateArgs, interrupt: &Interrupt, mounts: Option<Mounts>) -> Result<Pass, Failure> {
    let mut collector = Collector::new(Mapper::new(settings::load(&args.settings)?)?, mounts);
    let quiet = args.voice.quiet || args.voice.json;
    let mut first_pass = FirstPass::new(interrupt, quiet);
    let logs = std::slice::from_ref(&args.log);
    let mut log = Log::open_all(logs, &args.source.choice(), &mut |name, messages| first_pass.look(name, messages))?;
    drop(first_pass);
    let mut progress = Progress::new(log.size_bytes(), quiet);
    let ending = log.for_each(interrupt, |event, position| {
        match event {
            LogEvent::Scan(scan) => {
                collector.add(scan);
                progress.scan(scan.stamp, position);
            }
            LogEvent::Odometry(odometry) => {
                collector.mapper.add_odometry(odometry);
                collector.odom_from_robot = Some(odometry.odom_from_robot);
            }
            _ => {}
        }
        Ok(())
    })?;
    progress.finish();
    let (name, lag_s) = (log.name(), log.lag_s());
    let outcome = Outcome::of_losses(&log.finish()?.losses());
    Ok(Pass { collector, name, ending, outcome, lag_s })
}

/// Where a log has its laser, and where it was found to sit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mounts {
    said: Pose2,
    found: Pose2,
}

impl Mounts {
    /// What was found, where it clearly is something else than the log says.
    pub(super) fn of(said: Pose2, found: &Calibration) -> Self {
        let clear = |said: f64, Estimate { value, sigma }: Estimate| {
            if (value - said).abs() > CLEAR_SIGMAS * sigma { value } else { said }
        };
        let [x, y] = [clear(said.x, found.x_m), clear(said.y, found.y_m)];
        Self { said, found: Pose2::new(x, y, clear(said.theta, found.yaw_rad)) }
    }
}

/// Tracked scans of the log's first laser in runs without a break; those of others, whose mounts may be as wrong, are left out.
pub(super) struct Collector {
    mapper: Mapper,
    odom_from_robot: Option<Pose2>,
    presumed: Option<Pose2>,
    /// The laser that is calibrated, as the log has it, and the names of those that are not.
    laser: Option<Arc<LaserModel>>,
    left_out: Vec<String>,
    upside_down: Option<bool>,
    runs: Vec<Vec<Sample>>,
    turns: Turns,
    mounts: Option<Mounts>,
    /// The log's laser of which the second was made, which sits where it was found.
    moved: Option<[Arc<LaserModel>; 2]>,
}

impl Collector {
    /// The mapper has a laser that a log has in one place in another.
    pub(super) fn new(mapper: Mapper, mounts: Option<Mounts>) -> Self {
        Self {
            mapper,
            mounts,
            moved: None,
            odom_from_robot: None,
            presumed: None,
            laser: None,
            left_out: Vec::new(),
            upside_down: None,
            runs: vec![Vec::new()],
            turns: Turns::default(),
        }
    }

    pub(super) fn add(&mut self, scan: &LaserScan) {
        if !self.laser.get_or_insert_with(|| Arc::clone(&scan.laser)).is_one_with(&scan.laser) {
            if !self.left_out.contains(&scan.laser.name) {
                self.left_out.push(scan.laser.name.clone());
            }
            return;
        }
        match self.moved(&scan.laser) {
            Some(laser) => self.take(&LaserScan { laser, ..scan.clone() }),
            None => self.take(scan),
        }
    }

    /// The laser where it was found to sit, if it was looked for.
    fn moved(&mut self, laser: &Arc<LaserModel>) -> Option<Arc<LaserModel>> {
        let Mounts { found, .. } = self.mounts.filter(|mounts| mounts.said == laser.robot_from_laser)?;
        let [_, moved] = match self.moved.take() {
            Some(moved) if Arc::ptr_eq(&moved[0], laser) => self.moved.insert(moved),
            _ => {
                let moved = Arc::new(LaserModel { robot_from_laser: found, ..(**laser).clone() });
                self.moved.insert([Arc::clone(laser), moved])
            }
        };
        Some(Arc::clone(moved))
    }

    fn take(&mut self, scan: &LaserScan) {
        let update = self.mapper.add_scan(scan);
        let mount = scan.laser.robot_from_laser;
        let odom_from_robot = scan.odom_from_robot.or(self.odom_from_robot);
        self.turns.add(&update, odom_from_robot, &scan.laser);
        self.upside_down.get_or_insert(scan.laser.inverted);
        if *self.presumed.get_or_insert(mount) != mount {
            return;
        }
        match (update.status, odom_from_robot, self.runs.last_mut()) {
            (Status::Tracking, Some(odom_from_robot), Some(run)) => {
                run.push(Sample { stamp: scan.stamp, odom_from_robot, map_from_laser: update.map_from_robot * mount });
            }
            (_, _, Some(run)) if run.is_empty() => {}
            _ => self.runs.push(Vec::new()),
        }
    }

    /// Where the mapper has the laser.
    fn presumed(&self) -> Pose2 {
        self.presumed.unwrap_or(Pose2::IDENTITY)
    }

    /// Which of several lasers it is; empty of one alone.
    fn which(&self) -> String {
        match &self.laser {
            Some(laser) if !self.left_out.is_empty() => format!(
                "of       {}, the first of the robot's lasers; left out: {} (--topic chooses another)\n",
                laser.name,
                self.left_out.join(", ")
            ),
            _ => String::new(),
        }
    }

    /// The calibration, or why there is none.
    pub(super) fn found(&self) -> Result<Calibration, String> {
        match self.turns.words() {
            Some(mirrored) => Err(mirrored),
            None => calibrate(&self.runs, self.presumed()),
        }
    }
}
