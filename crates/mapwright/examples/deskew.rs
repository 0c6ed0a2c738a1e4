//! What undoing the motion during a sweep gains in fast turns.
//!
//! `cargo run --release -p mapwright --example deskew [SEEDS]` drives through simulated offices, one minute each, with a
//! whole turn on the spot every eight seconds, wheels as noisy as the simulator's or a tenth of that, and a laser whose beams are spread over nine tenths of the time between scans.
#![allow(clippy::print_stdout, reason = "an example's result")]

#[path = "../tests/all/support/turns.rs"]
mod turns;

use std::error::Error;
use turns::{Deskew, Errors, turning};

fn main() -> Result<(), Box<dyn Error>> {
    let seeds: u64 = std::env::args().nth(1).map_or(Ok(4), |text| text.parse())?;
    println!(
        "turns  wheels   with a gyroscope    undone as read      carried on          not undone          all beams at once   (ATE mean, worst; heading)"
    );
    for (wheels, rad_per_s) in [0.1, 1.0].into_iter().flat_map(|wheels| [1.0, 2.0, 3.0, 4.0].map(|rate| (wheels, rate)))
    {
        let mut line = format!("{rad_per_s:.0} rad/s x{wheels:<4}");
        for deskew in [Deskew::Gyroscope, Deskew::On, Deskew::CarriedOn, Deskew::Off, Deskew::NotNeeded] {
            let runs: Result<Vec<_>, _> = (0..seeds).map(|seed| turning(rad_per_s, wheels, seed, deskew)).collect();
            line += &in_words(&runs?);
        }
        println!("{line}");
    }
    Ok(())
}

fn in_words(runs: &[Errors]) -> String {
    let count = runs.len().max(1) as f64;
    let position_m = runs.iter().map(|run| run.position_m).sum::<f64>() / count;
    let worst_m = runs.iter().map(|run| run.position_m).fold(0.0, f64::max);
    let heading_deg = runs.iter().map(|run| run.heading_deg).sum::<f64>() / count;
    format!("  {position_m:.3} {worst_m:.3} m {heading_deg:.2} deg")
}
