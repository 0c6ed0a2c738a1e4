//! What an inertial sensor gains on simulated drives: `cargo run --release -p mapwright --example inertial -- [seconds] [seeds]`.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "an example")]

#[path = "../tests/support/inertial.rs"]
#[allow(dead_code, reason = "shared with tests")]
mod inertial;

use inertial::{Given, Wanted, mapped};

fn main() {
    let number =
        |at: usize, otherwise: u64| std::env::args().nth(at).and_then(|word| word.parse().ok()).unwrap_or(otherwise);
    let (seconds, seeds) = (number(1, 40) as f64, number(2, 2));
    println!("every  given                 rotation predicted     lost  ATE      from cloud to cloud  roll and pitch");
    println!(
        "                             (median, worst, deg)         (m)      (m, deg, median)     (worst, at the end, deg)"
    );
    for (every, turn_rate_rad_per_s) in [(1, 1.2), (4, 2.4)] {
        for seed in 1..=seeds {
            let wanted = Wanted { seed, seconds, every, turn_rate_rad_per_s, ..Wanted::default() };
            for given in [Given::Nothing, Given::Imu, Given::Wheels, Given::WheelsAndImu, Given::TurnsOnly] {
                let found = mapped(&wanted, given);
                println!(
                    "{every:<6} {:<20} {:>8.3} {:>8.3} {:>9} {:>8.4} {:>10.4} {:>7.3} {:>9.3} {:>8.3}   {:.1} s; {} {:?}",
                    format!("{given:?}"),
                    found.predicted_deg[0],
                    found.predicted_deg[1],
                    found.untracked,
                    found.errors.absolute.translation_m.rmse,
                    found.errors.relative.translation_m.median,
                    found.errors.relative.rotation_deg.median,
                    found.lean_deg[0],
                    found.lean_deg[1],
                    found.mapping_s,
                    gravity_in_words(&found),
                    found.report,
                );
            }
        }
    }
}

fn gravity_in_words(found: &inertial::Found) -> String {
    format!("{:?}", found.gravity_sigmas)
}
