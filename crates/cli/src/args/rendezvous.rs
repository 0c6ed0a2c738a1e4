//! `mapwright rendezvous`

use super::Voice;
use super::values::parse_positive;
use clap::Args as ClapArgs;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(crate) struct RendezvousArgs {
    /// A data set of UTIAS MRCLAM: its folder with `Barcodes.dat`, `Robot1_Odometry.dat`, `Robot1_Measurement.dat` and so on, or
    /// the archive of it (.tar or .tar.zst).
    pub(crate) data: PathBuf,
    /// The encounters as a table (CSV): stamp, robots, relative pose, its covariance.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Two sightings of each other within this time are mutual, seconds.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = parse_positive)]
    pub(crate) within: f64,
    /// Standard deviation of ranges, metres.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = parse_positive)]
    pub(crate) range_sigma: f64,
    /// Standard deviation of bearings, radians.
    #[arg(long, value_name = "RAD", default_value_t = 0.011, value_parser = parse_positive)]
    pub(crate) bearing_sigma: f64,
    /// Variances of odometry as a multiple of those of small robots that report the velocities they were told to drive.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_positive)]
    pub(crate) odometry_noise: f64,
    #[command(flatten)]
    pub(crate) voice: Voice,
}
