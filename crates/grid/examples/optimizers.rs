//! The optimisers side by side, in simulated rooms: what each costs, where it ends, from how far it gets there.
//!
//! `cargo run --release -p mapwright-grid --example optimizers`

#![allow(clippy::print_stdout, reason = "an example shows its result")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{View, map_of, views};
use mapwright_geom::Pose2;
use mapwright_grid::{LocalMap, Matcher, Prior};
use mapwright_sim::{Rng, worlds};
use std::sync::Arc;
use std::time::{Duration, Instant};

const METHODS: [(&str, Method); 3] =
    [("gradient ascent, unscaled", unscaled_ascent), ("gradient ascent", gradient_ascent), ("Gauss-Newton", newton)];
/// Initial errors, metres and degrees: both growing, then mostly the one, mostly the other.
const STARTS: [(f64, f64); 8] =
    [(0.05, 2.0), (0.1, 5.0), (0.2, 10.0), (0.3, 15.0), (0.4, 20.0), (0.5, 30.0), (0.5, 2.0), (0.05, 30.0)];

/// Pose and evaluations of a match.
type Method = fn(&LocalMap, &[[f64; 2]], &Prior) -> (Pose2, u32);

fn newton(map: &LocalMap, points: &[[f64; 2]], prior: &Prior) -> (Pose2, u32) {
    let result = Matcher::default().gauss_newton(map, points, prior, prior.world_from_robot);
    (result.world_from_robot, result.evaluations)
}

fn gradient_ascent(map: &LocalMap, points: &[[f64; 2]], prior: &Prior) -> (Pose2, u32) {
    let result = Matcher::default().gradient_ascent(map, points, prior, prior.world_from_robot);
    (result.world_from_robot, result.evaluations)
}

fn unscaled_ascent(map: &LocalMap, points: &[[f64; 2]], prior: &Prior) -> (Pose2, u32) {
    let result = Matcher::default().unscaled_gradient_ascent(map, points, prior, prior.world_from_robot);
    (result.world_from_robot, result.evaluations)
}

/// Ten suites of rooms: a map of 40 scans each, and 15 scans of another drive.
fn rooms() -> Vec<(LocalMap, Vec<View>)> {
    let suite = |seed| {
        let site = Arc::new(worlds::rooms(seed));
        (map_of(&views(&site, seed, 6, 40)), views(&site, seed + 1_000, 16, 15))
    };
    (0..10).map(suite).collect()
}

/// What came of a method's matches from one initial error.
#[derive(Default)]
struct Outcome {
    matches: u32,
    successes: u32,
    evaluations: u32,
    time: Duration,
    /// Of the successes.
    squared_m: f64,
    /// Of the successes.
    squared_rad: f64,
}

fn run(method: Method, rooms: &[(LocalMap, Vec<View>)], (error_m, error_deg): (f64, f64)) -> Outcome {
    let mut outcome = Outcome::default();
    let mut rng = Rng::new(1);
    for (map, queries) in rooms {
        for view in queries {
            let bearing = rng.uniform(-3.2, 3.2);
            let turn = if rng.chance(0.5) { error_deg } else { -error_deg }.to_radians();
            let off = Pose2::new(error_m * bearing.cos(), error_m * bearing.sin(), turn);
            let expected = view.world_from_robot * off;
            let variances = [error_m.powi(2), error_m.powi(2), error_deg.to_radians().powi(2)];
            let prior = Prior { world_from_robot: expected, variances, tail: 1e8 };
            let begun = Instant::now();
            let (found, evaluations) = method(map, &view.points.hits, &prior);
            outcome.time += begun.elapsed();
            outcome.evaluations += evaluations;
            outcome.matches += 1;
            let error = view.world_from_robot.between(found);
            let squared_m = error.x * error.x + error.y * error.y;
            if squared_m < 0.05 * 0.05 && error.theta.abs() < 0.02 {
                outcome.successes += 1;
                outcome.squared_m += squared_m;
                outcome.squared_rad += error.theta * error.theta;
            }
        }
    }
    outcome
}

fn main() {
    let rooms = rooms();
    println!("success: within 5 cm and 0.02 rad of the truth; errors are rms over the successes\n");
    println!("| optimiser | start off by | success | error mm | error mrad | evaluations | microseconds |");
    println!("|---|---|---|---|---|---|---|");
    for (name, method) in METHODS {
        for start in STARTS {
            let o = run(method, &rooms, start);
            let (all, good) = (f64::from(o.matches), f64::from(o.successes.max(1)));
            println!(
                "| {name} | {:.2} m, {:.0} deg | {:.1} % | {:.1} | {:.2} | {:.1} | {:.0} |",
                start.0,
                start.1,
                100.0 * f64::from(o.successes) / all,
                1e3 * (o.squared_m / good).sqrt(),
                1e3 * (o.squared_rad / good).sqrt(),
                f64::from(o.evaluations) / all,
                1e6 * o.time.as_secs_f64() / all,
            );
        }
    }
}
