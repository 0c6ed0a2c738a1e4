//! `mapwright suite verdicts`

use super::Measure;
use super::floors::Floor;
use super::judged::{self, Judged};
use crate::failure::Failure;
use crate::simulated::{PEOPLE, office, true_relations};
use crate::verdict::{Facts, Usable};
use mapwright::{LaserModel, Pose2, Settings, Stamp};
use mapwright_eval::{StampedPose, relation_errors};
use mapwright_sim::{Drive, DriveSettings, Event, PerturbScans, TrueScan, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::sync::Arc;

pub(super) struct Verdicts {
    pub(super) settings: Settings,
}

/// What is done to a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    OdometryNoise15,
    OdometryNoise50,
    NoOdometry,
    EveryFifth,
    EveryTwentiethWithoutOdometry,
    RandomBeams30,
    OdometryScale,
    Gap60,
    OdometryAnew,
    UpsideDown,
    MountTurned,
    AngleStep,
    RangesShort,
    HalfBlind,
}

const FAULTS: [Fault; 15] = [
    Fault::None,
    Fault::OdometryNoise15,
    Fault::OdometryNoise50,
    Fault::NoOdometry,
    Fault::EveryFifth,
    Fault::EveryTwentiethWithoutOdometry,
    Fault::RandomBeams30,
    Fault::OdometryScale,
    Fault::Gap60,
    Fault::OdometryAnew,
    Fault::UpsideDown,
    Fault::MountTurned,
    Fault::AngleStep,
    Fault::RangesShort,
    Fault::HalfBlind,
];

impl Fault {
    fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::OdometryNoise15 => "odometry with 15 % noise",
            Self::OdometryNoise50 => "odometry with 50 % noise",
            Self::NoOdometry => "no odometry",
            Self::EveryFifth => "every 5th scan",
            Self::EveryTwentiethWithoutOdometry => "every 20th scan, no odometry",
            Self::RandomBeams30 => "30 % random beams",
            Self::OdometryScale => "wheels 30 % too small",
            Self::Gap60 => "60 s missing",
            Self::OdometryAnew => "odometry begins anew",
            Self::UpsideDown => "laser upside down, unsaid",
            Self::MountTurned => "mount 1 rad wrong",
            Self::AngleStep => "angle step 20 % too small",
            Self::RangesShort => "ranges 20 % short",
            Self::HalfBlind => "laser covered for 15 of 40 s",
        }
    }

    fn applied(self, scans: &[TrueScan], seed: u64) -> Vec<TrueScan> {
        let all = || scans.iter().cloned();
        let with_laser = |change: &dyn Fn(&mut LaserModel)| {
            let mut changed: Option<Arc<LaserModel>> = None;
            all()
                .map(|mut scan| {
                    let laser = changed.get_or_insert_with(|| {
                        let mut laser = (*scan.scan.laser).clone();
                        change(&mut laser);
                        Arc::new(laser)
                    });
                    scan.scan.laser = Arc::clone(laser);
                    scan
                })
                .collect::<Vec<_>>()
        };
        let without_odometry = |mut scan: TrueScan| {
            scan.scan.odom_from_robot = None;
            scan
        };
        let middle = scans.len() / 2;
        match self {
            Self::None => all().collect(),
            Self::OdometryNoise15 => all().perturb_odometry(0.15, seed).collect(),
            Self::OdometryNoise50 => all().perturb_odometry(0.5, seed).collect(),
            Self::NoOdometry => all().map(without_odometry).collect(),
            Self::EveryFifth => all().step_by(5).collect(),
            Self::EveryTwentiethWithoutOdometry => all().step_by(20).map(without_odometry).collect(),
            Self::RandomBeams30 => all().replace_beams_with_noise(0.3, seed).collect(),
            Self::OdometryScale => all().scale_odometry(1.3).collect(),
            Self::Gap60 => {
                let from = scans.get(middle).map_or(Stamp(0), |scan| scan.scan.stamp);
                all().drop_window(from, Stamp(from.0 + 60_000_000_000)).collect()
            }
            Self::OdometryAnew => {
                let anew = scans.get(middle).and_then(|scan| scan.scan.odom_from_robot).unwrap_or(Pose2::IDENTITY);
                let reset = |(k, mut scan): (usize, TrueScan)| {
                    if k >= middle {
                        scan.scan.odom_from_robot = scan.scan.odom_from_robot.map(|odom| anew.between(odom));
                    }
                    scan
                };
                all().enumerate().map(reset).collect()
            }
            Self::UpsideDown => with_laser(&|laser| {
                laser.angle_min_rad = -laser.angle_min_rad;
                laser.angle_step_rad = -laser.angle_step_rad;
            }),
            Self::MountTurned => with_laser(&|laser| laser.robot_from_laser.theta += 1.0),
            Self::AngleStep => with_laser(&|laser| laser.angle_step_rad *= 0.8),
            Self::RangesShort => {
                let short = |mut scan: TrueScan| {
                    scan.scan.ranges_m.iter_mut().for_each(|range_m| *range_m *= 0.8);
                    scan
                };
                all().map(short).collect()
            }
            Self::HalfBlind => {
                let covered = |(k, mut scan): (usize, TrueScan)| {
                    if k % 400 > 250 {
                        scan.scan.ranges_m.iter_mut().for_each(|range_m| *range_m = f32::INFINITY);
                    }
                    scan
                };
                all().enumerate().map(covered).collect()
            }
        }
    }
}

/// A building, driven through once and mapped with every fault.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    site: &'static str,
    runs: Vec<Run>,
}

#[derive(Debug, Serialize)]
struct Run {
    /// Of the mean relation error.
    #[serde(flatten)]
    judged: Judged,
    /// Of the verdict, metres.
    expected_error_m: Option<f64>,
    facts: Facts,
}

impl Measure for Verdicts {
    type World = World;
    const NAME: &'static str = "verdicts";
    const FILES: [&'static str; 2] = ["verdicts.jsonl", "verdicts.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let long = DriveSettings::long_drive(seed);
        let (site, scans): (_, Vec<TrueScan>) = match seed % 3 {
            0 => ("office", office(seed, PEOPLE).scans().collect()),
            1 => ("loop", Drive::new(worlds::loop_of(seed, 250.0).into(), long).scans().collect()),
            _ => ("corridors", Drive::new(worlds::corridor_grid(seed, 400.0).into(), long).scans().collect()),
        };
        let truth: Vec<StampedPose> = scans
            .iter()
            .map(|scan| StampedPose { stamp: scan.scan.stamp, world_from_robot: scan.world_from_robot })
            .collect();
        let mut runs: Vec<Run> = Vec::new();
        for fault in FAULTS {
            let (error_m, facts) = self.run(&fault.applied(&scans, seed), &truth)?;
            let clean_m = runs.first().map_or(error_m, |clean| clean.judged.error_m);
            let usable = Usable::of(&facts);
            let judged = Judged { fault: fault.name(), error_m, clean_m, word: usable.word };
            runs.push(Run { judged, expected_error_m: usable.expected_error_m, facts });
        }
        Ok(World { seed, site, runs })
    }

    fn line(world: &World) -> String {
        let runs = world.runs.iter().map(|run| run.judged.line()).collect::<String>();
        format!("{:6} {}{runs}", world.seed, world.site)
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let runs = || worlds.iter().flat_map(|world| &world.runs);
        let (words, mut value, mut floors) = judged::summary(&runs().map(|run| &run.judged).collect::<Vec<_>>());
        let known = runs().filter_map(|run| Some((run.expected_error_m?, run.judged.error_m)));
        let correlation = rank_correlation(&known.collect::<Vec<_>>());
        value["rank_correlation"] = json!(correlation);
        floors.push(Floor {
            what: "rank correlation of the expected error with the true one at least 0.6",
            found: format!("{correlation:.2}"),
            holds: correlation >= LEAST_CORRELATION,
        });
        (words, value, floors)
    }
}

const LEAST_CORRELATION: f64 = 0.6;

/// Spearman's: how far two orders are the same, -1 to 1; ties share their ranks.
fn rank_correlation(pairs: &[(f64, f64)]) -> f64 {
    let (a, b) = (ranks(pairs, |pair| pair.0), ranks(pairs, |pair| pair.1));
    let mean = (pairs.len() as f64 - 1.0) / 2.0;
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum::<f64>();
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt().max(f64::MIN_POSITIVE)
}

fn ranks(pairs: &[(f64, f64)], of: impl Fn(&(f64, f64)) -> f64) -> Vec<f64> {
    let rank = |pair: &(f64, f64)| {
        let (below, same) = pairs.iter().fold((0, 0), |(below, same), other| {
            (below + usize::from(of(other) < of(pair)), same + usize::from(of(other).total_cmp(&of(pair)).is_eq()))
        });
        below as f64 + (same as f64 - 1.0) / 2.0
    };
    pairs.iter().map(rank).collect()
}

impl Verdicts {
    fn run(&self, scans: &[TrueScan], truth: &[StampedPose]) -> Result<(f64, Facts), Failure> {
        let (session, facts) = judged::map(scans.iter().cloned().map(Event::Scan), &self.settings)?;
        let of_scans: std::collections::HashSet<Stamp> = scans.iter().map(|scan| scan.scan.stamp).collect();
        let kept: Vec<StampedPose> = truth.iter().filter(|pose| of_scans.contains(&pose.stamp)).copied().collect();
        let poses: Vec<StampedPose> = session
            .trajectory()
            .map(|pose| StampedPose { stamp: pose.stamp, world_from_robot: pose.map_from_robot })
            .collect();
        let errors = relation_errors(&poses, &true_relations(&kept)).all.ok_or_else(|| Failure::World {
            name: "a drive".to_owned(),
            reason: "expected scans with poses, found none".to_owned(),
        })?;
        Ok((errors.translation_m.mean, facts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_compared_by_rank() {
        let by = |of: fn(f64) -> f64| (0..20).map(|k| (f64::from(k), of(f64::from(k)))).collect::<Vec<_>>();
        assert!((rank_correlation(&by(|x| x * x)) - 1.0).abs() < 1e-12);
        assert!((rank_correlation(&by(|x| -x)) + 1.0).abs() < 1e-12);
        assert!(rank_correlation(&by(|x| (x * 2.5).sin())).abs() < 0.4);
        assert!(rank_correlation(&by(|_| 1.0)).abs() < 1e-12 && rank_correlation(&[]).abs() < 1e-12);
    }
}
