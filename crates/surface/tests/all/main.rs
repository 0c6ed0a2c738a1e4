//! Surfaces of simulated clouds.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

mod bad_input;
mod exactness;
mod files;
mod shapes;
mod simulated;
