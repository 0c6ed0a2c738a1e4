//! `mapwright perturb`

mod gaps;

use crate::args::PerturbArgs;
use crate::events::{Log, input, name_of};
use crate::failure::{Failure, Outcome};
use crate::reading::Reading;
use crate::recorded::{Missing, Recorded};
use crate::terminal::{count, say, say_json};
use mapwright_formats::{CarmenWriter, LogEvent};
use mapwright_geom::Pose2;
use mapwright_sensor::LaserScan;
use mapwright_sim::{Event, HasScan, PerturbScans};
use serde_json::json;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

pub(super) fn run(args: &PerturbArgs) -> Result<Outcome, Failure> {
    if args.gap.is_empty() {
        return streamed(args);
    }
    if args.keeps_scans() { gaps::run(args) } else { with_gaps(args) }
}

/// One scan after another, in memory that does not depend on the log's length.
fn streamed(args: &PerturbArgs) -> Result<Outcome, Failure> {
    let mut scans = Scans::open(&args.log)?;
    let all = scans.by_ref().map(|scan| Marked { scan, is_missing: false });
    let written = write_harder(all, args)?;
    let losses = scans.finish()?.losses();
    tell(args, written, "", &losses)?;
    Ok(Outcome::of_losses(&losses))
}

/// The log is held in memory: where its gaps are is known at its end. What is left of it is as without gaps.
fn with_gaps(args: &PerturbArgs) -> Result<Outcome, Failure> {
    let log = Recorded::read(input(&args.log)?, &args.log)?;
    let times: Vec<_> = log.events.iter().map(Event::event_time).collect();
    let missing = Missing::of(&name_of(&args.log), &times, &args.gap)?;
    let scans = || times.iter().zip(&missing.events).filter(|(time, _)| time.is_scan);
    if scans().step_by(args.every as usize).all(|(_, is_missing)| *is_missing) {
        let name = name_of(&args.log);
        return Err(Failure::Log(format!("{name}: nothing is left: every scan that --every keeps lies in a gap")));
    }
    let mut odom_from_robot = None;
    let scans = log.events.into_iter().zip(&missing.events).filter_map(|(event, &is_missing)| match event {
        Event::Odometry(odometry) => {
            odom_from_robot = Some(odometry.odom_from_robot);
            None
        }
        Event::Scan(scan) => Some(Marked { scan: with_odometry(scan, odom_from_robot), is_missing }),
    });
    let written = write_harder(scans, args)?;
    let losses = log.reading.losses();
    tell(args, written, &format!("; {}", missing.words(args.gap.len())), &losses)?;
    Ok(Outcome::of_losses(&losses))
}

/// Says what was written.
fn tell(args: &PerturbArgs, scans: u64, taken_out: &str, losses: &[String]) -> Result<(), Failure> {
    if args.json {
        return say_json(&json!({ "file": args.output, "scans": scans, "lost": losses }));
    }
    say(&format!("{}: {}{taken_out}\n", args.output.display(), count(scans, "scan")))
}

/// A scan, and whether it lies in a gap.
struct Marked {
    scan: LaserScan,
    is_missing: bool,
}

impl HasScan for Marked {
    fn scan(&self) -> &LaserScan {
        &self.scan
    }

    fn scan_mut(&mut self) -> &mut LaserScan {
        &mut self.scan
    }
}

/// Writes the scans that lie in no gap; returns how many.
fn write_harder(scans: impl Iterator<Item = Marked>, args: &PerturbArgs) -> Result<u64, Failure> {
    let failed = |cause| Failure::write(&args.output, cause);
    let mut writer = CarmenWriter::new(create(args)?);
    let mut written = 0;
    for scan in harder(scans, args).filter(|scan| !scan.is_missing) {
        writer.scan(&scan.scan).map_err(failed)?;
        written += 1;
    }
    writer.finish().map_err(failed)?;
    Ok(written)
}

fn create(args: &PerturbArgs) -> Result<BufWriter<File>, Failure> {
    let file = File::create(&args.output).map_err(|error| Failure::write(&args.output, error))?;
    Ok(BufWriter::with_capacity(1 << 16, file))
}

fn harder<'a>(scans: impl Iterator<Item = Marked> + 'a, args: &PerturbArgs) -> Box<dyn Iterator<Item = Marked> + 'a> {
    let mut harder: Box<dyn Iterator<Item = Marked> + 'a> = Box::new(scans.every_nth(args.every as usize));
    if args.noise_beams > 0.0 {
        harder = Box::new(harder.replace_beams_with_noise(args.noise_beams, args.seed));
    }
    if args.scale_odometry != 1.0 {
        harder = Box::new(harder.scale_odometry(args.scale_odometry));
    }
    if args.odometry_noise > 0.0 {
        harder = Box::new(harder.perturb_odometry(args.odometry_noise, args.seed));
    }
    harder
}

/// A scan with this pose of odometry where it has none of its own.
fn with_odometry(scan: LaserScan, odom_from_robot: Option<Pose2>) -> LaserScan {
    LaserScan { odom_from_robot: scan.odom_from_robot.or(odom_from_robot), ..scan }
}

/// The scans of a log, each with the latest pose of odometry where it has none of its own.
pub(super) struct Scans {
    log: Log,
    odom_from_robot: Option<Pose2>,
    failure: Option<Failure>,
}

impl Scans {
    pub(super) fn open(path: &Path) -> Result<Self, Failure> {
        Ok(Self { log: Log::open(path)?, odom_from_robot: None, failure: None })
    }

    /// The reader's report, once all scans are read; or what ended them.
    pub(super) fn finish(self) -> Result<Reading, Failure> {
        match self.failure {
            Some(failure) => Err(failure),
            None => self.log.finish(),
        }
    }
}

impl Iterator for Scans {
    type Item = LaserScan;

    fn next(&mut self) -> Option<LaserScan> {
        loop {
            match self.log.next_event() {
                Ok(Some(LogEvent::Scan(scan))) => {
                    return Some(with_odometry(scan.clone(), self.odom_from_robot));
                }
                Ok(Some(LogEvent::Odometry(odometry))) => self.odom_from_robot = Some(odometry.odom_from_robot),
                Ok(Some(_)) => {}
                Ok(None) => return None,
                Err(failure) => {
                    self.failure = Some(failure);
                    return None;
                }
            }
        }
    }
}
