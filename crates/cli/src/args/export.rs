//! What results and logs can become.

use super::values::{parse_side, parse_slice};
use super::{SourceArgs, StampPolicy};
use clap::{Args as ClapArgs, ValueEnum};
use mapwright_logs::SliceBounds;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(crate) struct ExportArgs {
    /// Folder of results of `mapwright map`, or its session.mapwright.
    pub(crate) results: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    pub(crate) to: ExportTo,
    /// The file; otherwise export.tum, export.mcap and so on in the folder of results.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Of a session whose pieces nothing holds together, in the plane for --to pgm, worldfile and mcap, in space for --to mesh: which of its
    /// maps, as map-2.png is numbered. Otherwise the first; meshes of all.
    #[arg(long, value_name = "NUMBER")]
    pub(crate) map: Option<NonZeroUsize>,
    /// Of a session of space: side of the map's voxels, metres; of a cloud one point in each is kept. Otherwise 0.1, and for --to mesh half of
    /// how far apart the points lie that keyframes keep.
    #[arg(long, value_name = "METRES", value_parser = parse_side)]
    pub(crate) resolution: Option<f64>,
    /// Of a session of space, for --to pgm: what stands between these heights above the robot's way is an obstacle, metres. The
    /// way is that of the robot's origin, which is the sensor where nothing else is said. Otherwise -0.3:0.3.
    #[arg(long, value_name = "ZMIN:ZMAX", value_parser = parse_slice, allow_hyphen_values = true)]
    pub(crate) band: Option<SliceBounds>,
    /// Of a session of space, for --to ply: small discs of surfaces with normals and radius instead of points.
    #[arg(long)]
    pub(crate) surfels: bool,
    /// Stamps of poses and messages: the log's own, or made to increase. Otherwise the log's own, but for --to mcap, of which viewers play
    /// messages in the order of their stamps.
    #[arg(long, value_enum)]
    pub(crate) stamps: Option<StampPolicy>,
    /// Threads to use for --to mesh; the results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

impl ExportArgs {
    /// How stamps are written.
    pub(crate) fn stamps(&self) -> StampPolicy {
        let usual = if self.to == ExportTo::Mcap { StampPolicy::Repaired } else { StampPolicy::Log };
        self.stamps.unwrap_or(usual)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportTo {
    /// Trajectory: stamp x y z qx qy qz qw.
    Tum,
    /// Trajectory: 12 numbers a line, the upper rows of the pose's matrix; stamps in a file of their own beside it, .times.
    Kitti,
    /// Trajectory with odometry's beside it, a line of names first: in the plane x, y, theta; in space x, y, z and a quaternion.
    Csv,
    /// Map, path, transforms, scans and closures for Foxglove and ROS 2; of a session of space the map as points, without scans.
    Mcap,
    /// Map for Nav2, with its .yaml; of a session of space a plan of its floor.
    Pgm,
    /// Map as a plain PNG with a world file (.pgw), for QGIS and others.
    Worldfile,
    /// Of space: points with their colours and intensities, binary PLY.
    Ply,
    /// Of space: points with their colours and intensities, binary PCD.
    Pcd,
    /// Of space: what is occupied, free and unknown, as OctoMap's .bt.
    Octomap,
    /// Of space: the surface as triangles, with colours or, in grey, intensities; -o NAME.glb (glTF, which any viewer opens) or NAME.ply.
    /// One for each map that there is.
    Mesh,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ConvertArgs {
    /// Log: ROS 1 bag, MCAP file, ROS 2 bag (folder or file), CARMEN log (plain, .gz or .bz2; `-` is the standard input).
    pub(crate) log: PathBuf,
    /// The new log; its ending says in which format.
    #[arg(value_name = "OUT", value_parser = parse_log_name)]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// One JSON object instead of words.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Formats that logs are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LogFormat {
    Carmen,
    Bag1,
    Mcap,
}

impl LogFormat {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "clf" | "log" | "carmen" => Some(Self::Carmen),
            "bag" => Some(Self::Bag1),
            "mcap" => Some(Self::Mcap),
            _ => None,
        }
    }
}

impl ConvertArgs {
    /// The parser has seen to it that there is one.
    pub(crate) fn format(&self) -> LogFormat {
        LogFormat::of(&self.output).unwrap_or(LogFormat::Carmen)
    }
}

fn parse_log_name(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let known = LogFormat::of(&path).is_some();
    if known { Ok(path) } else { Err("expected a name that ends in .clf, .log, .bag or .mcap".to_owned()) }
}
