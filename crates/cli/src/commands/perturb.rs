//! `mapwright perturb`

use crate::args::PerturbArgs;
use crate::events::Log;
use crate::failure::{Failure, Outcome};
use crate::reading::Reading;
use crate::terminal::{count, say};
use mapwright_formats::{CarmenWriter, FormatError, LogEvent};
use mapwright_geom::Pose2;
use mapwright_sensor::LaserScan;
use mapwright_sim::PerturbScans;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

pub(super) fn run(args: &PerturbArgs) -> Result<Outcome, Failure> {
    let mut scans = Scans::open(&args.log)?;
    let file = File::create(&args.output).map_err(|error| Failure::write(&args.output, error))?;
    let mut writer = CarmenWriter::new(BufWriter::with_capacity(1 << 16, file));
    let written = write_harder(&mut scans, args, &mut writer).and_then(|n| writer.finish().map(|_| n));
    let written = written.map_err(|cause| Failure::write(&args.output, cause))?;
    let losses = scans.finish()?.losses();
    say(&format!("{}: {}\n", args.output.display(), count(written, "scan")))?;
    Ok(Outcome::of_losses(&losses))
}

fn write_harder(
    scans: &mut Scans,
    args: &PerturbArgs,
    writer: &mut CarmenWriter<BufWriter<File>>,
) -> Result<u64, FormatError> {
    let mut harder: Box<dyn Iterator<Item = LaserScan> + '_> = Box::new(scans.every_nth(args.every as usize));
    if args.noise_beams > 0.0 {
        harder = Box::new(harder.replace_beams_with_noise(args.noise_beams, args.seed));
    }
    if args.scale_odometry != 1.0 {
        harder = Box::new(harder.scale_odometry(args.scale_odometry));
    }
    if args.odometry_noise > 0.0 {
        harder = Box::new(harder.perturb_odometry(args.odometry_noise, args.seed));
    }
    let mut written = 0;
    for scan in harder {
        writer.scan(&scan)?;
        written += 1;
    }
    Ok(written)
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
                    let odom_from_robot = scan.odom_from_robot.or(self.odom_from_robot);
                    return Some(LaserScan { odom_from_robot, ..scan.clone() });
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
