//! Readings gathered over stretches of way.

use crate::arc::Arc2;
use crate::compass::{Compass, LEVER_M};
use crate::drawn::DrawnEchoes;
use crate::hough::walls;
use crate::place::stands;
use crate::scan::ranges_m;
use crate::wall::Wall;
use mapwright_geom::{FARTHEST_M, Pose2, Stamp, wrap_angle};
use mapwright_sensor::{Echo, LaserModel, LaserScan, Odometry, SonarReading, SonarRing};
use std::collections::VecDeque;
use std::sync::Arc;

/// How readings are gathered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GathererSettings {
    /// Length of a stretch, metres. Shorter ones show too little of a wall to tell its direction; over longer ones odometry bends it.
    pub stretch_m: f64,
    /// A turn counts as so much way, metres a radian: about as far as half of what is seen lies away.
    pub lever_m: f64,
    /// Beams of the scan that stands for a stretch.
    pub beams: usize,
}

impl Default for GathererSettings {
    fn default() -> Self {
        Self { stretch_m: 1.0, lever_m: LEVER_M, beams: 360 }
    }
}

/// What became of the readings of single sonars. The fields add up to their number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EchoCounts {
    /// Echoes of walls that answered several times.
    pub used: u64,
    /// Echoes that no others bear out: detours, other sonars' sound, small things.
    pub alone: u64,
    /// Nothing came back: nothing in reach, or a smooth wall that threw the sound away.
    pub nothing: u64,
    /// Below the least range.
    pub too_near: u64,
    /// Not fired, or not a number.
    pub not_fired: u64,
    /// Taken while the robot stood where it had been heard from already: they say nothing new.
    pub standing: u64,
    /// Readings without odometry to place them by.
    pub unplaced: u64,
}

impl EchoCounts {
    /// All readings of single sonars.
    #[must_use]
    pub fn total(&self) -> u64 {
        let Self { used, alone, nothing, too_near, not_fired, standing, unplaced } = *self;
        used + alone + nothing + too_near + not_fired + standing + unplaced
    }
}

/// A stretch of way, and what was heard on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The scan that stands for its walls, taken where the robot was at its stamp, in the middle of the stretch.
    pub scan: LaserScan,
    /// What its echoes say of the cells, in the robot's frame at that stamp.
    pub echoes: DrawnEchoes,
    /// Its walls, in that frame.
    pub walls: Vec<Wall>,
}

/// Walls that so many echoes agree on stand in the scan: those of fewer are drawn, but too often wrong
/// by a cell to say where the robot is.
const SURE_ECHOES: usize = 5;
/// Odometry is interpolated between two readings no farther apart, seconds: as for lasers' scans.
const ODOMETRY_GAP_S: f64 = 2.0;
/// A stretch ends with so many readings of single sonars, wherever the robot is.
const READINGS_MOST: usize = 16_384;
/// Groups of sonars that take turns, at most.
const TURNS_MOST: usize = 64;
/// Readings that wait for odometry at most.
const WAITING_MOST: usize = 4096;

/// One reading, placed.
#[derive(Debug, Clone)]
struct Placed {
    stamp: Stamp,
    odom_from_robot: Pose2,
    ring: Arc<SonarRing>,
    ranges_m: Vec<f32>,
}

/// Gathers readings and hands out a stretch whenever the robot has driven far enough.
///
/// Readings that bring no pose of odometry wait until odometry's readings before and after them are known.
#[derive(Debug, Clone, Default)]
pub struct Gatherer {
    settings: GathererSettings,
    waiting: VecDeque<SonarReading>,
    odometry: Option<Odometry>,
    /// Readings used where the robot stands: by odometry, and which sonars fired.
    here: Vec<(Pose2, Vec<bool>)>,
    compass: Compass,
    placed: Vec<Placed>,
    way_m: f64,
    laser: Option<Arc<LaserModel>>,
    counts: EchoCounts,
    ready: VecDeque<Stretch>,
}

impl Gatherer {
    /// With these settings.
    #[must_use]
    pub fn new(settings: GathererSettings) -> Self {
        Self { settings, ..Self::default() }
    }

    /// What became of the readings so far; those of a stretch that has not ended are not among them.
    #[must_use]
    pub fn counts(&self) -> EchoCounts {
        self.counts
    }

    /// Takes a ring's readings.
    pub fn add(&mut self, reading: &SonarReading) {
        match reading.odom_from_robot.filter(is_in_reach) {
            Some(odom_from_robot) => self.place(reading.clone(), odom_from_robot),
            None if self.odometry.is_some_and(|last| last.stamp == reading.stamp) && self.waiting.is_empty() => {
                let at = self.odometry.map_or(Pose2::IDENTITY, |last| last.odom_from_robot);
                self.place(reading.clone(), at);
            }
            None if self.waiting.len() < WAITING_MOST => self.waiting.push_back(reading.clone()),
            None => self.unplaced(reading),
        }
    }

    /// Takes a reading of the wheels: those of sonars up to it are placed.
    pub fn add_odometry(&mut self, odometry: &Odometry) {
        if !is_in_reach(&odometry.odom_from_robot) {
            return;
        }
        let before = self.odometry.replace(*odometry);
        while let Some(reading) = self.waiting.pop_front_if(|reading| reading.stamp <= odometry.stamp) {
            match pose_between(before.as_ref(), odometry, reading.stamp) {
                Some(odom_from_robot) => self.place(reading, odom_from_robot),
                None => self.unplaced(&reading),
            }
        }
    }

    /// The next stretch that has ended.
    pub fn next_stretch(&mut self) -> Option<Stretch> {
        self.ready.pop_front()
    }

    /// No more readings will come, or what comes is of another way: what was gathered is a stretch.
    pub fn end(&mut self) {
        for reading in std::mem::take(&mut self.waiting) {
            self.unplaced(&reading);
        }
        self.odometry = None;
        self.here.clear();
        self.compass.end();
        self.gather_corrected();
        self.end_stretch();
    }

    /// Walls that told directions so far, and how many of them were parallel or at right angles to the others.
    #[must_use]
    pub fn directions_told(&self) -> [f64; 2] {
        self.compass.walls()
    }

    fn unplaced(&mut self, reading: &SonarReading) {
        self.counts.unplaced += singles(&reading.ring, &reading.ranges_m);
    }

    /// Sonars that take turns are each heard once from where the robot stands.
    fn place(&mut self, reading: SonarReading, odom_from_robot: Pose2) {
        let fires: Vec<bool> = reading.ranges_m.iter().map(|range| !range.is_nan()).collect();
        self.here.retain(|(at, _)| stands(*at, odom_from_robot));
        if self.here.len() >= TURNS_MOST || self.here.iter().any(|(_, fired)| *fired == fires) {
            self.counts.standing += singles(&reading.ring, &reading.ranges_m);
            return;
        }
        self.here.push((odom_from_robot, fires));
        self.compass.add(reading, odom_from_robot);
        self.gather_corrected();
    }

    fn gather_corrected(&mut self) {
        while let Some((reading, odom_from_robot)) = self.compass.next_corrected() {
            self.gather(reading, odom_from_robot);
        }
    }

    fn gather(&mut self, reading: SonarReading, odom_from_robot: Pose2) {
        if let Some(last) = self.placed.last() {
            let step = last.odom_from_robot.between(odom_from_robot);
            let way_m = step.x.hypot(step.y) + self.settings.lever_m * wrap_angle(step.theta).abs();
            if way_m > self.settings.stretch_m {
                self.end_stretch();
            } else {
                self.way_m += way_m;
            }
        }
        let SonarReading { stamp, ring, ranges_m, .. } = reading;
        self.placed.push(Placed { stamp, odom_from_robot, ring, ranges_m });
        let readings: usize = self.placed.iter().map(|placed| placed.ranges_m.len()).sum();
        if self.way_m >= self.settings.stretch_m || readings >= READINGS_MOST {
            self.end_stretch();
        }
    }

    fn end_stretch(&mut self) {
        self.way_m = 0.0;
        let placed = std::mem::take(&mut self.placed);
        let Some(middle) = placed.get(placed.len() / 2) else { return };
        let arcs = self.arcs(&placed, middle.odom_from_robot);
        let walls = walls(&arcs, 0.5 * self.settings.stretch_m);
        let used: usize = walls.iter().map(|wall| wall.echoes.len()).sum();
        self.counts.used += used as u64;
        self.counts.alone += (arcs.len() - used) as u64;
        let scan = LaserScan {
            stamp: middle.stamp,
            laser: self.laser(&middle.ring),
            ranges_m: ranges_m(walls.iter().filter(|wall| wall.echoes.len() >= SURE_ECHOES), self.settings.beams),
            odom_from_robot: Some(middle.odom_from_robot),
        };
        self.ready.push_back(Stretch { scan, echoes: DrawnEchoes::new(&arcs, &walls), walls });
    }

    fn arcs(&mut self, placed: &[Placed], odom_from_stretch: Pose2) -> Vec<Arc2> {
        let (mut arcs, mut place) = (Vec::new(), 0);
        for (k, now) in placed.iter().enumerate() {
            if k > 0 && !stands(placed[k - 1].odom_from_robot, now.odom_from_robot) {
                place += 1;
            }
            let stretch_from_robot = odom_from_stretch.between(now.odom_from_robot);
            for (sonar, &range_m) in now.ring.sonars.iter().zip(&now.ranges_m) {
                match sonar.echo(range_m) {
                    Echo::At(range_m) => arcs.push(Arc2 {
                        stretch_from_sonar: stretch_from_robot * sonar.robot_from_sonar,
                        half_rad: 0.5 * sonar.opening_rad,
                        range_m,
                        place,
                    }),
                    Echo::Nothing => self.counts.nothing += 1,
                    Echo::TooNear => self.counts.too_near += 1,
                    Echo::NotFired => self.counts.not_fired += 1,
                }
            }
        }
        arcs
    }

    fn laser(&mut self, ring: &SonarRing) -> Arc<LaserModel> {
        let wanted = ring.stands_for(self.settings.beams);
        match &self.laser {
            Some(laser) if **laser == wanted => Arc::clone(laser),
            _ => Arc::clone(self.laser.insert(Arc::new(wanted))),
        }
    }
}

/// Readings of single sonars.
fn singles(ring: &SonarRing, ranges_m: &[f32]) -> u64 {
    ring.sonars.len().min(ranges_m.len()) as u64
}

/// Whether odometry can be there.
fn is_in_reach(pose: &Pose2) -> bool {
    pose.is_finite() && pose.x.abs() <= FARTHEST_M && pose.y.abs() <= FARTHEST_M
}

/// Odometry's pose at a stamp that lies between two readings, or is that of the later one.
fn pose_between(before: Option<&Odometry>, after: &Odometry, stamp: Stamp) -> Option<Pose2> {
    if stamp == after.stamp {
        return Some(after.odom_from_robot);
    }
    let before = before.filter(|before| before.stamp <= stamp)?;
    let gap_s = after.stamp.secs_since(before.stamp);
    let share = stamp.secs_since(before.stamp) / gap_s;
    let step = before.odom_from_robot.between(after.odom_from_robot).log();
    let pose = before.odom_from_robot * Pose2::exp(step.map(|part| part * share));
    (gap_s > 0.0 && gap_s <= ODOMETRY_GAP_S && is_in_reach(&pose)).then_some(pose)
}
