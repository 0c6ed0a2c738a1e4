//! Sonars: wide cones that say how far the nearest echo came from, and nothing of the direction within the cone.

use crate::scan::LaserModel;
use mapwright_geom::{Pose2, Stamp};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// One sonar of a ring.
#[derive(Debug, Clone, PartialEq)]
pub struct Sonar {
    /// Pose on the robot; the cone's axis is its x axis.
    pub robot_from_sonar: Pose2,
    /// Angle between the cone's two edges, radians: more than zero, at most pi.
    pub opening_rad: f64,
    /// Readings below are no echoes, metres.
    pub range_min_m: f64,
    /// Readings at or above are no echoes: nothing came back, metres.
    pub range_max_m: f64,
}

/// The sonars of a robot that are read together.
#[derive(Debug, Clone, PartialEq)]
pub struct SonarRing {
    /// Name for reports: `SONAR`, or a topic.
    pub name: String,
    /// Its sonars, in the order of their readings.
    pub sonars: Vec<Sonar>,
}

/// Readings of a ring at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct SonarReading {
    /// When they were taken.
    pub stamp: Stamp,
    /// The sonars.
    pub ring: Arc<SonarRing>,
    /// Range of the first echo of each sonar in metres, as delivered; NaN where it was not fired.
    pub ranges_m: Vec<f32>,
    /// Odometry's pose of the robot at the stamp, where the log has it.
    pub odom_from_robot: Option<Pose2>,
}

/// What a reading of one sonar says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Echo {
    /// Something within the cone is so far away, metres, and nothing in it is nearer.
    At(f64),
    /// No echo: nothing is in reach, or what is there throws the sound elsewhere.
    Nothing,
    /// Below the least range, or negative.
    TooNear,
    /// Not fired, or not a number.
    NotFired,
}

/// No sonar in air hears farther than this, metres; ranges of a thousand times that are millimetres.
pub const SONAR_REACH_MOST_M: f64 = 50.0;

impl Sonar {
    /// What a reading says.
    #[must_use]
    pub fn echo(&self, range_m: f32) -> Echo {
        let range_m = f64::from(range_m);
        if range_m.is_nan() {
            Echo::NotFired
        } else if range_m >= self.range_max_m {
            Echo::Nothing
        } else if range_m > self.range_min_m.max(0.0) {
            Echo::At(range_m)
        } else {
            Echo::TooNear
        }
    }

    /// Whether a sonar like this can be mapped with.
    ///
    /// # Errors
    /// What is wrong, in words: an opening of zero or more than pi, limits that leave no range or more than any sonar hears, a place
    /// farther than 1 km from the robot.
    pub fn check(&self) -> Result<(), String> {
        if !(self.opening_rad > 0.0 && self.opening_rad <= PI) {
            return Err(format!(
                "expected a cone that opens by more than 0 and at most pi radians, found {}",
                self.opening_rad
            ));
        }
        let Self { range_min_m, range_max_m, robot_from_sonar, .. } = *self;
        if !(range_min_m >= 0.0 && range_max_m > range_min_m && range_max_m <= SONAR_REACH_MOST_M) {
            return Err(format!(
                "expected ranges from a least to a greatest one of at most {SONAR_REACH_MOST_M} m, found {range_min_m} to {range_max_m} m"
            ));
        }
        let Pose2 { x, y, theta } = robot_from_sonar;
        if !(x.abs() <= 1000.0 && y.abs() <= 1000.0 && theta.abs() <= 100.0) {
            return Err(format!("expected a place within 1 km of the robot, found {x} {y} m, {theta} rad"));
        }
        Ok(())
    }
}

impl SonarRing {
    /// So many sonars evenly around a robot of that radius, looking outwards, the first ahead.
    #[must_use]
    pub fn around(name: &str, count: usize, radius_m: f64, opening_rad: f64, range_max_m: f64) -> Self {
        let sonar = |k: usize| {
            let bearing_rad = TAU * k as f64 / count.max(1) as f64;
            let (sin, cos) = mapwright_geom::sin_cos(bearing_rad);
            let robot_from_sonar = Pose2::new(radius_m * cos, radius_m * sin, bearing_rad);
            Sonar { robot_from_sonar, opening_rad, range_min_m: 0.1, range_max_m }
        };
        Self { name: name.to_owned(), sonars: (0..count).map(sonar).collect() }
    }

    /// Whether the ring can be mapped with.
    ///
    /// # Errors
    /// The first sonar that cannot, by its number from 0, and why.
    pub fn check(&self) -> Result<(), String> {
        let mut sonars = self.sonars.iter().enumerate();
        sonars.try_for_each(|(number, sonar)| sonar.check().map_err(|why| format!("sonar {number}: {why}")))
    }

    /// The greatest range of its sonars, metres.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.sonars.iter().map(|sonar| sonar.range_max_m).fold(0.0, f64::max)
    }

    /// The laser whose scans stand for what the ring saw over a stretch of way: so many beams all around the robot's origin.
    #[must_use]
    pub fn stands_for(&self, beams: usize) -> LaserModel {
        LaserModel {
            name: self.name.clone(),
            angle_min_rad: -PI,
            angle_step_rad: TAU / beams.max(1) as f64,
            range_min_m: 0.0,
            // The ends of a stretch see walls that its middle is farther from.
            range_max_m: 2.0 * self.reach_m(),
            robot_from_laser: Pose2::IDENTITY,
            inverted: false,
            beam_period_s: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cones_and_limits_that_no_sonar_has_are_refused_with_what_was_found() {
        let good = SonarRing::around("SONAR", 4, 0.2, 0.4, 5.0);
        assert_eq!(good.check(), Ok(()));
        for opening_rad in [0.0, -0.1, 3.2, f64::NAN] {
            let mut ring = good.clone();
            ring.sonars[2].opening_rad = opening_rad;
            let why = ring.check().err().unwrap_or_default();
            assert!(why.starts_with("sonar 2: expected a cone") && why.contains(&format!("{opening_rad}")), "{why}");
        }
        for (range_min_m, range_max_m) in [(1.0, 1.0), (-1.0, 5.0), (0.0, 5000.0), (0.0, f64::NAN)] {
            assert!(Sonar { range_min_m, range_max_m, ..good.sonars[0].clone() }.check().is_err());
        }
    }

    #[test]
    fn a_reading_is_an_echo_between_the_limits_only() {
        let sonar = Sonar { robot_from_sonar: Pose2::IDENTITY, opening_rad: 0.4, range_min_m: 0.1, range_max_m: 5.0 };
        let said = [0.0, 0.05, 0.5, 5.0, f32::INFINITY, f32::NAN, -1.0].map(|range_m| sonar.echo(range_m));
        use Echo::{At, NotFired, Nothing, TooNear};
        assert_eq!(said, [TooNear, TooNear, At(0.5), Nothing, Nothing, NotFired, TooNear]);
    }
}
