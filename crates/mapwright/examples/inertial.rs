//! What an inertial sensor gains on simulated drives: `cargo run --release -p mapwright --example inertial -- [seconds] [seeds]`.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "an example")]

#[path = "../tests/all/support/inertial.rs"]
#[allow(dead_code, reason = "shared with tests")]
mod support;

use support::{Given, Wanted, mapped};

fn main() {
    let number =
        |at: usize, otherwise: u32| std::env::args().nth(at).and_then(|word| word.parse().ok()).unwrap_or(otherwise);
    let (seconds, seeds) = (f64::from(number(1, 40)), number(2, 2));
    println!(
        "                             predicted rotation   ATE     cloud to cloud   roll and pitch       gravity edges"
    );
    println!(
        "clouds  given         seed   median, worst (deg)  (m)     (m, deg)         worst, end (deg)     number, error (sigmas)"
    );
    for (every, turn_rate_rad_per_s) in [(1, 1.2), (4, 2.4)] {
        for seed in 1..=u64::from(seeds) {
            let wanted = Wanted { seed, seconds, every, turn_rate_rad_per_s, ..Wanted::default() };
            for given in [Given::Nothing, Given::TurnsOnly, Given::Imu, Given::Wheels, Given::WheelsAndImu] {
                let found = mapped(&wanted, given);
                let ([median, worst], [lean, at_end]) = (found.predicted_deg, found.lean_deg);
                let (absolute, relative) = (&found.errors.absolute, &found.errors.relative);
                println!(
                    "{every:<7} {:<14} {seed:<5} {median:>8.3} {worst:>8.3} {:>10.4} {:>8.4} {:>6.3} {lean:>9.2} {at_end:>6.2} {:>13} {:>6.2}",
                    format!("{given:?}"),
                    absolute.translation_m.rmse,
                    relative.translation_m.median,
                    relative.rotation_deg.median,
                    found.report.gravity,
                    found.gravity_sigmas[0],
                );
            }
        }
    }
}
