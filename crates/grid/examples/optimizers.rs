//! The optimisers side by side, in simulated rooms: what each costs, where it ends, from how far it gets there.
//!
//! `cargo run --release -p mapwright-grid --example optimizers`

#![allow(clippy::print_stdout, reason = "an example shows its result")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{View, map_of, views};
use mapwright_geom::Pose2;
use mapwright_grid::{LiveMap, Matcher, Prior};
use mapwright_sim::{Rng, worlds};
use nalgebra::Vector3;
use std::sync::Arc;
use std::time::{Duration, Instant};

const METHODS: [(&str, Method); 3] =
    [("gradient ascent, unscaled", unscaled_ascent), ("gradient ascent", gradient_ascent), ("Gauss-Newton", newton)];
/// Initial errors, metres and degrees: both growing, then mostly the one, mostly the other.
const STARTS: [(f64, f64); 8] =
    [(0.05, 2.0), (0.1, 5.0), (0.2, 10.0), (0.3, 15.0), (0.4, 20.0), (0.5, 30.0), (0.5, 2.0), (0.05, 30.0)];

/// Pose and evaluations of a match.
type Method = fn(&LiveMap, &[[f64; 2]], &Prior) -> (Pose2, u32);

fn newton(map: &LiveMap, points: &[[f64; 2]], prior: &Prior) -> (Pose2, u32) {
    let result = Matcher::default().gauss_newton(map, points, prior, prior.world_from_robot);
    (result.world_from_robot, result.evaluations)
}

fn gradient_ascent(map: &LiveMap, points: &[[f64; 2]], prior: &Prior) -> (Pose2, u32) {
    let result = Matcher::default().gradient_ascent(map, points, prior, prior.world_from_robot);
    (result.world_from_robot, result.evaluations)
}

/// `Matcher::gradient_ascent` with a radian counted as a metre, whatever the range.
fn unscaled_ascent(map: &LiveMap, points: &[[f64; 2]], prior: &Prior) -> (Pose2, u32) {
    let matcher = Matcher::default();
    let settings = matcher.settings;
    let middle_m = (settings.capture_sigma_m * settings.sigma_m).sqrt();
    let stages = [
        (settings.capture_sigma_m, 0.2 * settings.capture_sigma_m),
        (middle_m, 0.2 * middle_m),
        (settings.sigma_m, settings.step_m),
    ];
    let mut pose = prior.world_from_robot;
    let mut all_evaluations = 0;
    for (sigma_m, tolerance_m) in stages {
        let at = |pose: Pose2| {
            let scan = matcher.evaluate(map, points, pose, sigma_m);
            let error = Vector3::from(prior.world_from_robot.between(pose).log());
            let weighted = error.component_div(&Vector3::from(prior.variances));
            (scan.cost + 0.5 * weighted.dot(&error), scan.gradient + weighted, scan.hits)
        };
        let mut here = at(pose);
        let (mut kappa, mut evaluations) = (1.0, 1);
        while evaluations < settings.max_evaluations {
            let step = here.1 * (-kappa * sigma_m * sigma_m / here.2.max(1e-6));
            if step[0].hypot(step[1]).max(step[2].abs()) < 0.2 * tolerance_m {
                break;
            }
            let next_pose = pose * Pose2::exp(step.into());
            let next = at(next_pose);
            evaluations += 1;
            if next.0 < here.0 {
                (pose, here, kappa) = (next_pose, next, kappa * 1.5);
            } else {
                kappa *= 0.4;
            }
        }
        all_evaluations += evaluations;
    }
    (pose, all_evaluations)
}

/// Ten suites of rooms: a map of 40 scans each, and 15 scans of another drive.
fn rooms() -> Vec<(LiveMap, Vec<View>)> {
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

fn run(method: Method, rooms: &[(LiveMap, Vec<View>)], (error_m, error_deg): (f64, f64)) -> Outcome {
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
