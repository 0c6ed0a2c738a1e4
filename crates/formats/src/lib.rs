//! Logs in, maps and trajectories out.
//!
//! Readers and writers take [`Read`](std::io::Read) and [`Write`](std::io::Write), never paths; they read no clock and
//! print nothing. Bad sensor data is no error: it is dropped, counted and described in a [`ReadReport`].
//!
//! - [`open_log`]: plain, gzip and bzip2 streams, told by their first bytes.
//! - [`CarmenReader`], [`CarmenWriter`]: CARMEN logs.
//! - [`TumWriter`], [`TrajectoryReader`], [`read_relations`]: trajectories and relations as text.
//! - [`read_mrclam_odometry`], [`read_mrclam_measurements`]: logs of robots that see each other.
//! - [`write_kitti`], [`write_csv`]: trajectories for other tools; of space [`write_space_kitti`], [`write_space_csv`].
//! - [`GridImage`]: maps as PGM with YAML for Nav2 ([`write_pgm`], [`write_map_yaml`]) and as a picture to look at
//!   ([`write_png`]), or with a world file ([`write_plain_png`], [`write_world_file`]).
//! - [`read_map_yaml`], [`read_map_image`]: such maps of any robot, PGM or PNG.
//! - [`SpacePicture`]: maps of space from above and from the side ([`write_space_png`]).
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod carmen;
mod compression;
mod error;
mod excerpt;
mod export;
mod jump;
mod lines;
mod map;
mod mrclam;
mod noted;
mod number;
mod open;
mod pcd;
mod ply;
mod report;
mod stamp_watch;
mod text_rows;
mod trajectory;

pub use carmen::{CarmenReader, CarmenWriter, LogEvent};
pub use compression::Compression;
pub use error::FormatError;
pub use excerpt::Excerpt;
pub use export::{CsvPose, write_csv, write_kitti, write_space_csv, write_space_kitti, write_stamps};
pub use jump::{JumpWatch, OdometryJump};
pub use map::{
    Confidence, Frame, GridImage, MAX_MAP_CELLS, MapDescription, MapMode, Picture, PlanePlacement, RUN_COLOURS, RunWay,
    Runs, SpacePicture, UNKNOWN, dominant_wall_angle, read_map_image, read_map_yaml, run_colour, upward,
};
pub use map::{
    Curve, RobotWay, write_curve_png, write_map_yaml, write_pgm, write_plain_png, write_png, write_rgb_png,
    write_space_png, write_tinted_png, write_ways_png, write_world_file,
};
pub use map::{
    SpacePlacement, SpaceView, ViewPlacement, height_colour, wall_direction, write_bare_png, write_bare_space_png,
};
pub use mrclam::{
    MrclamPose, MrclamRows, MrclamSighting, MrclamVelocity, read_mrclam_barcodes, read_mrclam_measurements,
    read_mrclam_odometry, read_mrclam_truth,
};
pub use noted::{Noted, OddHeads, OrderReport, RangeReport};
pub use open::{LogStream, open_log};
pub use pcd::write_pcd;
pub use ply::{Disc, write_ply, write_ply_discs};
pub use report::{DropReason, DroppedLine, Drops, ReadReport, TopicReport};
pub use stamp_watch::{StampStep, StampWatch};
pub use trajectory::{
    Relation, SpaceTrajectory, StampedPose2, StampedPose3, TrajectoryReader, TumWriter, read_relations,
    read_space_trajectory, read_stamps, read_trajectory,
};
