//! The whole pipeline: one program, so that it is linked once and its tests share the processors.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests may")]

mod support;

mod advice;
mod breaks_space;
mod carried;
mod closing;
mod consistency;
mod corrupted_logs;
mod deskew;
mod gate;
mod guard;
mod held;
mod hostile;
mod hostile_lasers;
mod hostile_space;
mod inertial;
mod jobs;
mod lasers;
mod optimizers;
mod people;
mod people_space;
mod render;
mod render_space;
mod repair;
mod resume;
mod runs;
mod same_bytes;
mod slips;
mod space;
mod two_lasers;
mod two_lidars;
mod updates;
mod visits;
mod wheels;
mod wheels_space;
