//! `mapwright calibrate`

use crate::args::CalibrateArgs;
use crate::calibrated::Calibrated;
use crate::calibration::{Calibration, Estimate, Sample, calibrate};
use crate::events::{Ending, Log};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::progress::{FirstPass, Progress};
use crate::settings;
use crate::terminal::{say, say_json};
use crate::turns::Turns;
use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Status};
use mapwright_formats::LogEvent;
use serde_json::{Value, json};
use std::fs;
use std::sync::Arc;

/// Values smaller than so many standard deviations may as well be zero.
const CLEAR_SIGMAS: f64 = 3.0;

pub(super) fn run(args: &CalibrateArgs) -> Result<Outcome, Failure> {
    let interrupt = Interrupt::watch()?;
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

fn to_words(name: &str, found: &Calibration, presumed: Pose2) -> String {
    let lag = |lag: Estimate| format!("they lag {} ms", plus_minus(lag, 1000.0, 0));
    let no_lag = || "the scans' stamps come in bursts or seconds apart, and tell no lag".to_owned();
    let scale =
        |estimate: Estimate| format!("{:+.2} +- {:.2} %", 100.0 * (estimate.value - 1.0), 100.0 * estimate.sigma);
    format!(
        "{name}: {}\n\
         laser    x {} m, y {} m, yaw {} deg (the log says {:.3}, {:.3}, {:.2})\n\
         wheels   true distance is {} of theirs, true turn {}, unreported drift {} deg/m; {}\n\
         from     {} stretches of half a metre or a turn of 23 deg at most; +- is one standard deviation\n",
        in_words(found),
        plus_minus(found.x_m, 1.0, 4),
        plus_minus(found.y_m, 1.0, 4),
        plus_minus(found.yaw_rad, DEGREES, 2),
        presumed.x,
        presumed.y,
        presumed.theta.to_degrees(),
        scale(found.translation_scale),
        scale(found.rotation_scale),
        plus_minus(found.drift_rad_per_m, DEGREES, 3),
        found.lag_s.map_or_else(no_lag, lag),
        found.stretches
    )
}

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

fn plus_minus(estimate: Estimate, unit: f64, decimals: usize) -> String {
    format!("{:+.decimals$} +- {:.decimals$}", unit * estimate.value, unit * estimate.sigma)
}

/// Where the laser sits, as one would say it.
fn in_words(found: &Calibration) -> String {
    let place = |estimate: Estimate, plus: &str, minus: &str| {
        let clear = estimate.value.abs() > CLEAR_SIGMAS * estimate.sigma;
        let side = if estimate.value > 0.0 { plus } else { minus };
        clear.then(|| format!("{:.1} cm {side}", 100.0 * estimate.value.abs()))
    };
    let mut parts: Vec<_> = [place(found.x_m, "ahead", "behind"), place(found.y_m, "to the left", "to the right")]
        .into_iter()
        .flatten()
        .collect();
    if parts.is_empty() {
        parts.push("over the robot's centre".to_owned());
    }
    if found.yaw_rad.value.abs() > CLEAR_SIGMAS * found.yaw_rad.sigma {
        let side = if found.yaw_rad.value > 0.0 { "left" } else { "right" };
        parts.push(format!("turned {:.2} deg to the {side}", DEGREES * found.yaw_rad.value.abs()));
    }
    format!("your laser sits {}", parts.join(", "))
}

fn to_json(name: &str, found: &Calibration, presumed: Pose2) -> Value {
    let value = |estimate: Estimate| json!({ "value": estimate.value, "sigma": estimate.sigma });
    json!({
        "log": name,
        "presumed": [presumed.x, presumed.y, presumed.theta],
        "x_m": value(found.x_m),
        "y_m": value(found.y_m),
        "yaw_rad": value(found.yaw_rad),
        "translation_scale": value(found.translation_scale),
        "rotation_scale": value(found.rotation_scale),
        "drift_rad_per_m": value(found.drift_rad_per_m),
        "lag_s": found.lag_s.map(value),
        "stretches": found.stretches,
    })
}
