//! How the input of two logs differs.

use super::contents::{Contents, Laser};
use crate::terminal::{count, duration, grouped};
use mapwright::{Pose2, Stamp};
use mapwright_formats::LogEvent;
use serde_json::{Value, json};
use std::fmt::Write;

/// Scans of two logs are the same one where their stamps differ by less than this share of the usual period.
const SAME_SHARE: f64 = 0.25;
/// The same, where the period is not known, seconds.
const SAME_S: f64 = 0.05;

/// The scans of a log with odometry's pose, in their order; twenty bytes and a pose each are all that is kept.
#[derive(Debug, Default)]
pub(super) struct Steps {
    scans: Vec<(Stamp, Option<Pose2>)>,
    odom_from_robot: Option<Pose2>,
}

impl Steps {
    pub(super) fn add(&mut self, event: LogEvent<'_>) {
        match event {
            LogEvent::Scan(scan) => self.scans.push((scan.stamp, scan.odom_from_robot.or(self.odom_from_robot))),
            LogEvent::Odometry(odometry) => self.odom_from_robot = Some(odometry.odom_from_robot),
            _ => {}
        }
    }
}

/// A log to compare.
pub(super) struct Log<'a> {
    pub(super) name: &'a str,
    pub(super) contents: &'a Contents,
    pub(super) steps: &'a Steps,
}

/// What differs between two logs.
#[derive(Debug, Default)]
pub(super) struct Differences {
    /// Whether it is the same in both, and what.
    words: Vec<(bool, String)>,
    /// Scans of the log with fewer that are in the other as well.
    common: u64,
    of: u64,
    stamps_most_s: f64,
    steps: u64,
    steps_most: [f64; 2],
    steps_mean: [f64; 2],
}

impl Differences {
    pub(super) fn of(a: &Log<'_>, b: &Log<'_>) -> Self {
        let mut found = Self::default();
        found.spans(a, b);
        found.lasers(a, b);
        let (fewer, more) = if a.steps.scans.len() <= b.steps.scans.len() { (a, b) } else { (b, a) };
        found.scans(fewer, more);
        found
    }

    fn spans(&mut self, a: &Log<'_>, b: &Log<'_>) {
        let scans = |log: &Log<'_>| {
            let span_s = log.contents.lasers.first().map_or(0.0, |laser| laser.topic.span_s());
            format!("{} over {}", count(log.steps.scans.len() as u64, "scan"), duration(span_s))
        };
        let same = scans(a) == scans(b);
        self.words.push((same, format!("scans: {} in {}, {} in {}", scans(a), a.name, scans(b), b.name)));
        let odometry = |log: &Log<'_>| grouped(log.contents.odometry.stamps.len() as u64);
        let same = odometry(a) == odometry(b);
        self.words.push((same, format!("readings of odometry beside scans: {} and {}", odometry(a), odometry(b))));
    }

    fn lasers(&mut self, a: &Log<'_>, b: &Log<'_>) {
        for (first, second) in a.contents.lasers.iter().zip(&b.contents.lasers) {
            self.laser(first, second);
        }
        let [a, b] = [a, b].map(|log| log.contents.lasers.len());
        if a != b {
            self.words.push((false, format!("lasers: {a} and {b}")));
        }
    }

    fn laser(&mut self, first: &Laser, second: &Laser) {
        let (a, b) = (&first.model, &second.model);
        let mut differ = |what: &str, values: [f64; 2], unit: &str| {
            if (values[0] - values[1]).abs() > 1e-4 {
                self.words.push((false, format!("{what}: {:.4} and {:.4} {unit}", values[0], values[1])));
            }
        };
        differ("beams", [first.beams.1 as f64, second.beams.1 as f64], "");
        differ("first bearing", [a.angle_min_rad, b.angle_min_rad].map(f64::to_degrees), "deg");
        differ("step of bearings", [a.angle_step_rad, b.angle_step_rad].map(f64::to_degrees), "deg");
        differ("least range", [a.range_min_m, b.range_min_m], "m");
        differ("largest range", [a.range_max_m, b.range_max_m], "m");
        differ("time between beams", [a.beam_period_s, b.beam_period_s].map(|s| 1e6 * s), "us");
        let (a, b) = (a.robot_from_laser, b.robot_from_laser);
        differ("laser on the robot, x", [a.x, b.x], "m");
        differ("laser on the robot, y", [a.y, b.y], "m");
        differ("laser on the robot, yaw", [a.theta, b.theta].map(f64::to_degrees), "deg");
    }

    /// Each scan of the log with fewer, beside the nearest in time of the other.
    fn scans(&mut self, fewer: &Log<'_>, more: &Log<'_>) {
        self.of = fewer.steps.scans.len() as u64;
        let mut sorted = more.steps.scans.clone();
        sorted.sort_by_key(|(stamp, _)| *stamp);
        let period_s = fewer.contents.lasers.first().and_then(|laser| laser.topic.period_s());
        let same_s = period_s.map_or(SAME_S, |period_s| SAME_SHARE * period_s);
        let mut before: Option<[Pose2; 2]> = None;
        for &(stamp, pose) in &fewer.steps.scans {
            let Some((other_stamp, other_pose)) = nearest(&sorted, stamp).filter(|o| apart_s(o.0, stamp) <= same_s)
            else {
                before = None;
                continue;
            };
            self.common += 1;
            self.stamps_most_s = self.stamps_most_s.max(apart_s(other_stamp, stamp));
            let now = pose.zip(other_pose).map(|(a, b)| [a, b]);
            if let (Some(before), Some(now)) = (before, now) {
                self.step(before[0].between(now[0]), before[1].between(now[1]));
            }
            before = now;
        }
        let (common, of) = (grouped(self.common), grouped(self.of));
        let words = format!("scans of {} that are in {} as well: {common} of {of}", fewer.name, more.name);
        self.words.push((self.common == self.of, words));
        if self.common > 0 {
            // stamps are written to the microsecond
            self.words.push(if self.stamps_most_s < 5e-7 {
                (true, "their stamps".to_owned())
            } else {
                (false, format!("their stamps, by up to {:.6} s", self.stamps_most_s))
            });
        }
        if self.steps > 0 {
            self.steps_mean = self.steps_mean.map(|sum| sum / self.steps as f64);
            let ([most_m, most_rad], [mean_m, mean_rad]) = (self.steps_most, self.steps_mean);
            if most_m < 5e-4 && most_rad.to_degrees() < 5e-3 {
                self.words.push((true, "odometry from scan to scan".to_owned()));
                return;
            }
            let words = format!(
                "odometry from scan to scan, by up to {most_m:.3} m and {:.2} deg, in the mean by {mean_m:.4} m and {:.3} deg",
                most_rad.to_degrees(),
                mean_rad.to_degrees()
            );
            self.words.push((false, words));
        } else {
            self.words.push((false, "odometry, which cannot be compared: not both have it at common scans".to_owned()));
        }
    }

    fn step(&mut self, a: Pose2, b: Pose2) {
        let apart = a.between(b);
        let apart = [apart.x.hypot(apart.y), apart.theta.abs()];
        self.steps += 1;
        for part in 0..2 {
            self.steps_most[part] = self.steps_most[part].max(apart[part]);
            self.steps_mean[part] += apart[part];
        }
    }

    pub(super) fn to_words(&self) -> String {
        self.words.iter().fold(String::new(), |mut text, (same, word)| {
            let _ = writeln!(text, "{:<9}{word}", if *same { "same" } else { "differ" });
            text
        })
    }

    pub(super) fn to_json(&self) -> Value {
        let words =
            |same: bool| self.words.iter().filter(|(is, _)| *is == same).map(|(_, word)| word).collect::<Vec<_>>();
        json!({
            "differ": words(false),
            "same": words(true),
            "common_scans": self.common,
            "of_scans": self.of,
            "stamps_most_s": self.stamps_most_s,
            "odometry_steps": self.steps,
            "odometry_step_most_m": self.steps_most[0],
            "odometry_step_most_deg": self.steps_most[1].to_degrees(),
            "odometry_step_mean_m": self.steps_mean[0],
            "odometry_step_mean_deg": self.steps_mean[1].to_degrees(),
        })
    }
}

fn nearest(sorted: &[(Stamp, Option<Pose2>)], stamp: Stamp) -> Option<(Stamp, Option<Pose2>)> {
    let after = sorted.partition_point(|(other, _)| *other < stamp);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| sorted.get(at));
    around.min_by(|a, b| apart_s(a.0, stamp).total_cmp(&apart_s(b.0, stamp))).copied()
}

fn apart_s(a: Stamp, b: Stamp) -> f64 {
    a.secs_since(b).abs()
}
