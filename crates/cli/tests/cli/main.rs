//! The command as users meet it: what it writes, what it says, how it ends.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stderr, reason = "tests may")]

mod bad_input;
mod bad_input_space;
mod browser;
mod commands;
mod doubt;
mod explain;
mod explore;
mod export;
mod export_space;
#[cfg(feature = "net")]
mod fleet_net;
mod lag;
mod lasers;
mod live;
mod map;
mod merge_maps;
mod optimize;
mod page;
mod pieces;
mod real_logs;
mod recordings;
mod rendezvous;
mod robot;
#[cfg(feature = "dds")]
mod ros;
mod runs;
mod scripts;
mod session;
mod show;
mod small_robots;
mod sonar;
mod space;
mod space_calibrate;
mod space_imu;
mod stereo;
mod suite;
mod support;
mod terminal;
mod trajectories;
mod wrong_fields;
mod wrong_files;
mod wrong_input;
