//! Scans and odometry of one log, counted and measured.

use crate::terminal::{count, duration, grouped};
use mapwright::{BeamCounts, LaserModel, LaserScan, Odometry, Pose2, Stamp, Sweep};
use mapwright_formats::{JumpWatch, LogEvent};
use mapwright_sensor::{Echo, SonarReading, SonarRing};
use serde_json::{Value, json};
use std::fmt::Write;
use std::sync::Arc;

/// A pause of a topic this many times its median period is a gap.
const GAP_PERIODS: f64 = 10.0;
/// The shortest pause that is called a gap, seconds.
const GAP_AT_LEAST_S: f64 = 1.0;
/// Gaps that are listed.
const GAPS_SHOWN: usize = 5;

/// What is in a log.
#[derive(Debug, Default)]
pub(super) struct Contents {
    pub(super) odometry: Topic,
    pub(super) lasers: Vec<Laser>,
    pub(super) sonars: Option<Sonars>,
}

/// The rings of sonars of the log, as the last of them.
#[derive(Debug)]
pub(super) struct Sonars {
    ring: Arc<SonarRing>,
    topic: Topic,
    echoes: u64,
    silent: u64,
    unusable: u64,
}

/// Times and path of one kind of event.
#[derive(Debug, Default)]
pub(super) struct Topic {
    /// In the order of the file. Twelve bytes an event are all that is kept of it.
    pub(super) stamps: Vec<Stamp>,
    odometry: JumpWatch,
    path_m: f64,
    turned_rad: f64,
    poses: u64,
}

/// One laser of the log.
#[derive(Debug)]
pub(super) struct Laser {
    pub(super) model: Arc<LaserModel>,
    pub(super) topic: Topic,
    pub(super) beams: (usize, usize),
    /// The least and the largest field of view.
    view_deg: (f64, f64),
    counts: BeamCounts,
    farthest_m: f32,
    sweep: Sweep,
}

impl Contents {
    pub(super) fn add(&mut self, event: LogEvent<'_>) {
        match event {
            LogEvent::Scan(scan) => self.add_scan(scan),
            LogEvent::Odometry(odometry) => self.odometry.add(odometry.stamp, Some(odometry.odom_from_robot)),
            LogEvent::Sonar(reading) => Sonars::add(&mut self.sonars, reading),
            _ => {}
        }
    }

    fn add_scan(&mut self, scan: &LaserScan) {
        let same = |laser: &Laser| laser.is_of(&scan.laser);
        let at = self.lasers.iter().position(same).unwrap_or_else(|| {
            self.lasers.push(Laser::new(&scan.laser));
            self.lasers.len() - 1
        });
        self.lasers[at].add(scan);
    }

    pub(super) fn to_words(&self) -> String {
        let mut text = String::new();
        for laser in &self.lasers {
            let _ = write!(text, "{}", laser.to_words());
        }
        if let Some(sonars) = &self.sonars {
            text += &sonars.to_words();
        }
        if self.odometry.poses > 0 {
            let _ = write!(text, "odometry {}", self.odometry.to_words("reading"));
        }
        text
    }

    pub(super) fn to_json(&self, name: &str) -> Value {
        let mut value = json!({
            "log": name,
            "lasers": self.lasers.iter().map(Laser::to_json).collect::<Vec<_>>(),
            "odometry": self.odometry.to_json(),
        });
        if let Some(sonars) = &self.sonars {
            value["sonars"] = sonars.to_json();
        }
        value
    }
}

impl Sonars {
    fn add(sonars: &mut Option<Self>, reading: &SonarReading) {
        let ring = Arc::clone(&reading.ring);
        let it = sonars.get_or_insert_with(|| Self {
            ring: Arc::clone(&ring),
            topic: Topic::default(),
            echoes: 0,
            silent: 0,
            unusable: 0,
        });
        it.topic.add(reading.stamp, reading.odom_from_robot);
        for (sonar, &range_m) in ring.sonars.iter().zip(&reading.ranges_m) {
            match sonar.echo(range_m) {
                Echo::At(_) => it.echoes += 1,
                Echo::Nothing => it.silent += 1,
                Echo::TooNear | Echo::NotFired => it.unusable += 1,
            }
        }
        it.ring = ring;
    }

    fn to_words(&self) -> String {
        let cone_deg = self.ring.sonars.first().map_or(0.0, |sonar| sonar.opening_rad.to_degrees());
        format!(
            "sonars   {}: {} cones of {cone_deg:.0} deg, up to {} m\n         {} echoes, {} silent, {} not fired or too near\n         {}",
            self.ring.name,
            self.ring.sonars.len(),
            self.ring.reach_m(),
            grouped(self.echoes),
            grouped(self.silent),
            grouped(self.unusable),
            self.topic.to_words("reading")
        )
    }

    fn to_json(&self) -> Value {
        json!({
            "name": self.ring.name,
            "sonars": self.ring.sonars.len(),
            "reach_m": self.ring.reach_m(),
            "echoes": self.echoes,
            "silent": self.silent,
            "not_fired_or_too_near": self.unusable,
            "readings": self.topic.to_json(),
        })
    }
}

impl Laser {
    fn new(model: &Arc<LaserModel>) -> Self {
        Self {
            model: Arc::clone(model),
            topic: Topic::default(),
            beams: (usize::MAX, 0),
            view_deg: (f64::INFINITY, 0.0),
            counts: BeamCounts::default(),
            farthest_m: 0.0,
            sweep: Sweep::empty(model),
        }
    }

    /// Whether a scan's laser is this one, whose number of beams and with it their bearings may vary from scan to scan.
    fn is_of(&self, model: &LaserModel) -> bool {
        let kept = &self.model;
        *model
            == LaserModel {
                angle_min_rad: model.angle_min_rad,
                angle_step_rad: model.angle_step_rad,
                beam_period_s: model.beam_period_s,
                ..(**kept).clone()
            }
    }

    fn add(&mut self, scan: &LaserScan) {
        self.topic.add(scan.stamp, scan.odom_from_robot);
        let beams = scan.ranges_m.len();
        let view_deg = (scan.laser.angle_step_rad * beams.saturating_sub(1) as f64).abs().to_degrees();
        self.view_deg = (self.view_deg.0.min(view_deg), self.view_deg.1.max(view_deg));
        self.beams = (self.beams.0.min(beams), self.beams.1.max(beams));
        let limits_m = (0.0, f64::INFINITY);
        self.counts.add(&self.sweep.fill(scan, [0.0; 3], limits_m));
        let reach_m = self.model.range_max_m as f32;
        let returns = scan.ranges_m.iter().filter(|&&range_m| range_m < reach_m);
        self.farthest_m = returns.fold(self.farthest_m, |farthest_m, &range_m| farthest_m.max(range_m));
    }

    fn view_words(&self) -> String {
        let (least, most) = (format!("{:.0}", self.view_deg.0), format!("{:.0}", self.view_deg.1));
        if least == most { most } else { format!("{least} to {most}") }
    }

    fn to_words(&self) -> String {
        let (model, mount) = (&self.model, self.model.robot_from_laser);
        let beams = if self.beams.0 == self.beams.1 {
            self.beams.0.to_string()
        } else {
            format!("{} to {}", self.beams.0, self.beams.1)
        };
        let all = f64::from(self.counts.returns) + f64::from(self.counts.no_return);
        let bad = self.counts.too_near + self.counts.not_a_number;
        format!(
            "laser    {}: {beams} beams over {} deg, up to {} m; on the robot at x {:.3} m, y {:.3} m, yaw {:.2} deg{}\n\
             \x20        farthest return {:.1} m, no return {:.1} %, unusable beams {}\n         {}",
            model.name,
            self.view_words(),
            (1e4 * model.range_max_m).round() / 1e4,
            mount.x,
            mount.y,
            mount.theta.to_degrees(),
            if model.inverted { ", upside down" } else { "" },
            self.farthest_m,
            100.0 * f64::from(self.counts.no_return) / all.max(1.0),
            grouped(u64::from(bad)),
            self.topic.to_words("scan"),
        )
    }

    fn to_json(&self) -> Value {
        let mount = self.model.robot_from_laser;
        json!({
            "name": self.model.name,
            "beams": [self.beams.0, self.beams.1],
            "field_of_view_deg": self.view_deg.1,
            "range_max_m": self.model.range_max_m,
            "robot_from_laser": [mount.x, mount.y, mount.theta],
            "inverted": self.model.inverted,
            "farthest_return_m": self.farthest_m,
            "returns": self.counts.returns,
            "no_return": self.counts.no_return,
            "too_near": self.counts.too_near,
            "not_a_number": self.counts.not_a_number,
            "topic": self.topic.to_json(),
        })
    }
}

impl Topic {
    fn add(&mut self, stamp: Stamp, odom_from_robot: Option<Pose2>) {
        self.stamps.push(stamp);
        let Some(odom_from_robot) = odom_from_robot else { return };
        self.poses += 1;
        // a jump is no path
        if let Some(step) = self.odometry.observe(self.poses, Odometry { stamp, odom_from_robot }) {
            self.path_m += step.x.hypot(step.y);
            self.turned_rad += step.theta.abs();
        }
    }

    /// Time from the earliest to the latest stamp, seconds.
    pub(super) fn span_s(&self) -> f64 {
        match (self.stamps.iter().min(), self.stamps.iter().max()) {
            (Some(&first), Some(&last)) => last.secs_since(first),
            _ => 0.0,
        }
    }

    /// Median time from the latest stamp so far to one that is later, seconds.
    pub(super) fn period_s(&self) -> Option<f64> {
        let mut periods: Vec<_> = self.steps().map(|(_, step_s)| step_s).filter(|&step_s| step_s > 0.0).collect();
        periods.sort_by(f64::total_cmp);
        periods.get(periods.len() / 2).copied()
    }

    /// From the latest stamp so far to each: one that steps back is no pause, nor is the step forward that follows it.
    fn steps(&self) -> impl Iterator<Item = (Stamp, f64)> + '_ {
        let mut latest = self.stamps.first().copied();
        self.stamps.iter().skip(1).filter_map(move |&stamp| {
            let last = latest?;
            latest = Some(last.max(stamp));
            Some((last, stamp.secs_since(last)))
        })
    }

    /// Events a second: by the median period, unless that is far off the mean outside of gaps, for they come in bursts.
    fn rate_words(&self, period_s: f64) -> String {
        let paused_s: f64 = self.gaps().iter().map(|(_, gap_s)| gap_s).sum();
        let running_s = self.span_s() - paused_s;
        let (median_hz, mean_hz) = (1.0 / period_s, self.stamps.len().saturating_sub(1) as f64 / running_s);
        if running_s > 0.0 && !(0.5..=2.0).contains(&(median_hz / mean_hz)) {
            return format!("{mean_hz:.1} a second in the mean, unevenly");
        }
        format!("{median_hz:.1} a second in the median")
    }

    /// Pauses and where they begin, longest first.
    fn gaps(&self) -> Vec<(Stamp, f64)> {
        let least_s = (GAP_PERIODS * self.period_s().unwrap_or(0.0)).max(GAP_AT_LEAST_S);
        let mut gaps: Vec<_> = self.steps().filter(|&(_, step_s)| step_s > least_s).collect();
        gaps.sort_by(|a, b| b.1.total_cmp(&a.1));
        gaps
    }

    fn to_words(&self, what: &str) -> String {
        let mut text = format!("{} over {}", count(self.stamps.len() as u64, what), duration(self.span_s()));
        if let Some(period_s) = self.period_s() {
            let _ = write!(text, ", {}", self.rate_words(period_s));
        }
        if self.poses > 0 {
            let turns = self.turned_rad / std::f64::consts::TAU;
            let _ = write!(text, "; by odometry {:.0} m of path, {turns:.0} full turns", self.path_m);
        }
        let gaps = self.gaps();
        if !gaps.is_empty() {
            let shown = gaps.iter().take(GAPS_SHOWN);
            let listed: Vec<_> = shown.map(|(from, s)| format!("{s:.1} s after {:.3}", from.as_secs_f64())).collect();
            let _ = write!(text, "\n         {}: {}", count(gaps.len() as u64, "gap"), listed.join(", "));
        }
        text + "\n"
    }

    fn to_json(&self) -> Value {
        let gaps = self.gaps();
        let listed = gaps.iter().take(20).map(|(from, s)| json!({ "after_s": from.as_secs_f64(), "length_s": s }));
        json!({
            "events": self.stamps.len(),
            "span_s": self.span_s(),
            "period_s": self.period_s(),
            "path_m": self.path_m,
            "turned_rad": self.turned_rad,
            "gap_count": gaps.len(),
            "gaps": listed.collect::<Vec<_>>(),
        })
    }
}
