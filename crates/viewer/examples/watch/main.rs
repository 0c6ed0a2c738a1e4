//! A simulated robot that maps while it drives, in real time, with the view: 1440 beams at 40 Hz, loops closed on another thread. Prints
//! what the view costs.
//!
//! ```sh
//! cargo run --release -p mapwright-viewer --example watch [SECONDS]           # open the address that it prints
//! cargo run --release -p mapwright-viewer --example watch cost                # a grid of 2000 x 2000 cells
//! cargo run --release -p mapwright-viewer --example watch replay [SECONDS]    # maps at once, then plays the run
//! cargo run --release -p mapwright-viewer --example watch space [SECONDS]     # the same of a lidar in space
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, reason = "an example prints what it measures")]

mod cost;
mod drive;

use mapwright_viewer::ViewerError;
use std::env;

fn main() -> Result<(), ViewerError> {
    let mut words = env::args().skip(1);
    let first = words.next().unwrap_or_default();
    let seconds = |text: Option<String>, otherwise: f64| text.map_or(otherwise, |text| text.parse().expect("seconds"));
    match first.as_str() {
        "cost" => cost::measure(),
        "replay" => drive::replay(seconds(words.next(), 120.0)),
        "space" => drive::space(seconds(words.next(), 60.0)),
        "" => drive::watch(120.0),
        _ => drive::watch(seconds(Some(first), 120.0)),
    }
}
