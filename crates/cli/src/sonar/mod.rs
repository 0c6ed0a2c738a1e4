//! Readings of sonars on their way through a mapping run: gathered, mapped by the scans that stand for them, and drawn.

mod score;
mod simulated;

pub(crate) use score::CellScore;
pub(crate) use simulated::{SonarOffice, sonar_office};

use crate::terminal::{count, grouped};
use crate::verdict::{Reason, Usability};
use mapwright::{CountGrid, LaserScan, Odometry, Pose2, Stamp};
use mapwright_grid::Change;
use mapwright_sensor::{SonarReading, SonarRing, SweepPoints};
use mapwright_sonar::{DrawnEchoes, EchoCounts, Gatherer, HeardWalls};
use serde_json::{Value, json};
use std::sync::Arc;

/// Cells of a map of sonars, metres: their echoes are known to half of it.
pub(crate) const CELL_M: f64 = 0.1;

/// The sonars of a run.
#[derive(Debug, Default)]
pub(crate) struct Sonars {
    gatherer: Gatherer,
    drawn: Vec<(Stamp, DrawnEchoes)>,
    ring: Option<Arc<SonarRing>>,
    readings: u64,
    /// A laser sees as well: it says where the robot is, and the sonars' echoes are drawn there.
    beside_laser: bool,
}

impl Sonars {
    /// Takes readings of a ring; the scans that are to be mapped now.
    pub(crate) fn add(&mut self, reading: &SonarReading) -> Vec<LaserScan> {
        self.readings += 1;
        if self.ring.as_ref().is_none_or(|ring| !Arc::ptr_eq(ring, &reading.ring)) {
            self.ring = Some(Arc::clone(&reading.ring));
        }
        self.gatherer.add(reading);
        self.take_ready()
    }

    /// Takes a reading of the wheels; the scans that are to be mapped now.
    pub(crate) fn add_odometry(&mut self, odometry: &Odometry) -> Vec<LaserScan> {
        self.gatherer.add_odometry(odometry);
        self.take_ready()
    }

    /// Takes note of a laser's scan.
    pub(crate) fn see_laser(&mut self, scan: &LaserScan) {
        self.beside_laser = true;
        if let Some(odom_from_robot) = scan.odom_from_robot {
            self.gatherer.add_odometry(&Odometry { stamp: scan.stamp, odom_from_robot });
        }
    }

    /// No more readings of this log will come; the scans that are to be mapped now.
    pub(crate) fn end(&mut self) -> Vec<LaserScan> {
        self.gatherer.end();
        self.take_ready()
    }

    fn take_ready(&mut self) -> Vec<LaserScan> {
        let mut scans = Vec::new();
        while let Some(stretch) = self.gatherer.next_stretch() {
            self.drawn.push((stretch.scan.stamp, stretch.echoes));
            // Where a laser sees, walls known to half a cell of a sonar's map would only blur its own.
            if !self.beside_laser {
                scans.push(stretch.scan);
            }
        }
        scans
    }

    pub(crate) fn is_heard(&self) -> bool {
        self.readings > 0
    }

    /// Whether the run has no other sensor that sees.
    pub(crate) fn is_alone(&self) -> bool {
        self.readings > 0 && !self.beside_laser
    }

    /// All echoes at the trajectory's poses, on any number of threads the same.
    pub(crate) fn draw(&self, trajectory: &[(Stamp, Pose2)]) -> CountGrid {
        let (mut grid, mut touched, mut points) = (CountGrid::new(CELL_M), Vec::new(), SweepPoints::default());
        let mut walls = HeardWalls::new(CELL_M);
        let placed = self.drawn.iter().filter_map(|(stamp, echoes)| Some((pose_at(trajectory, *stamp)?, echoes)));
        for (map_from_robot, echoes) in placed.clone() {
            for echo in 0..echoes.len() {
                echoes.fill(echo, &mut points);
                walls.add(&points, map_from_robot);
            }
        }
        for (map_from_robot, echoes) in placed {
            for echo in 0..echoes.len() {
                echoes.fill(echo, &mut points);
                let Some(arc) = echoes.arc(echo) else { continue };
                walls.shorten(&mut points, arc, map_from_robot);
                grid.draw(&points, map_from_robot, Change::Add, &mut touched);
            }
            touched.clear();
        }
        grid
    }

    pub(crate) fn counts(&self) -> EchoCounts {
        self.gatherer.counts()
    }

    /// One or two lines for people; nothing where no sonar was heard.
    pub(crate) fn words(&self) -> String {
        let Some(ring) = self.ring.as_ref().filter(|_| self.is_heard()) else { return String::new() };
        let EchoCounts { used, alone, nothing, too_near, not_fired, standing, unplaced } = self.counts();
        let echoes = used + alone;
        let percent = |part: u64| 100.0 * part as f64 / (echoes.max(1)) as f64;
        let mut text = format!(
            "sonars   {} echoes of {}, {:.0} % of walls, {:.0} % that no others bear out; silent {}, too near {}",
            grouped(echoes),
            count(ring.sonars.len() as u64, "sonar"),
            percent(used),
            percent(alone),
            grouped(nothing),
            grouped(too_near)
        );
        for (what, times) in [("not fired", not_fired), ("while standing", standing), ("without odometry", unplaced)] {
            if times > 0 {
                text += &format!(", {what} {}", grouped(times));
            }
        }
        text += "\n";
        let [walls, parallel] = self.gatherer.directions_told();
        if walls > 0.0 && !self.beside_laser {
            let percent = 100.0 * parallel / walls;
            text += &format!(
                "         {walls:.0} walls told a direction, {percent:.0} % of them parallel or at right angles: they hold the heading\n"
            );
        }
        if self.beside_laser {
            text += "         the laser says where the robot was; what the sonars heard is drawn there: sonar.png\n";
        }
        text
    }

    /// What was lost, in words; that no odometry follows the last reading of the ring is of any log, and only counted.
    pub(crate) fn losses(&self) -> Vec<String> {
        let once = self.ring.as_ref().map_or(0, |ring| ring.sonars.len() as u64);
        let unplaced = self.counts().unplaced;
        let words = || format!("{} without odometry before and after: not used", count(unplaced, "single reading"));
        (unplaced > once).then(words).into_iter().collect()
    }

    /// For `report.json`; nothing where no sonar was heard.
    pub(crate) fn to_json(&self) -> Option<Value> {
        let ring = self.ring.as_ref().filter(|_| self.is_heard())?;
        let EchoCounts { used, alone, nothing, too_near, not_fired, standing, unplaced } = self.counts();
        let directions = self.gatherer.directions_told();
        Some(json!({
            "sonars": ring.sonars.len(),
            "readings": self.readings,
            "stretches": self.drawn.len(),
            "beside_laser": self.beside_laser,
            "echoes_of_walls": used,
            "echoes_alone": alone,
            "silent": nothing,
            "too_near": too_near,
            "not_fired": not_fired,
            "while_standing": standing,
            "without_odometry": unplaced,
            "walls_told": directions[0],
            "walls_parallel": directions[1].round(),
        }))
    }
}

/// A map of sonars alone is always to be checked: such a share of its stretches fits badly, and there odometry decides.
pub(crate) fn alone(badly: f64) -> Reason {
    let words = format!(
        "sonars alone made it, and {:.0} % of the stretches fit the map badly: odometry decides there, and nothing but your own look tells \
         how well",
        100.0 * badly
    );
    Reason { word: Usability::Check, what: "of_sonars", words, evidence: json!({ "fit_badly": badly }) }
}

/// The trajectory's pose at a stamp: its own, or between the two around it; none before the first and after the last.
fn pose_at(trajectory: &[(Stamp, Pose2)], stamp: Stamp) -> Option<Pose2> {
    let after = trajectory.partition_point(|(at, _)| *at < stamp);
    let (later, pose) = *trajectory.get(after)?;
    if later == stamp {
        return Some(pose);
    }
    let (earlier, before) = *trajectory.get(after.checked_sub(1)?)?;
    let share = stamp.secs_since(earlier) / later.secs_since(earlier);
    Some(before * Pose2::exp(before.between(pose).log().map(|part| part * share)))
}
