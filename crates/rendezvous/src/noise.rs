//! How wrong odometry and sightings are.

/// Errors of odometry: a random walk whose variances grow with time, way and turning, and a drift of the heading that lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryNoise {
    /// Of the heading, per second.
    pub heading_rad2_per_s: f64,
    /// Standard deviation of the drift, radians per second.
    pub drift_rad_per_s: f64,
    /// Of the heading, per radian turned.
    pub heading_rad2_per_rad: f64,
    /// Of each coordinate, per second.
    pub position_m2_per_s: f64,
    /// Of each coordinate, per metre driven.
    pub position_m2_per_m: f64,
}

impl Default for OdometryNoise {
    /// Small robots that report the velocities they were told to drive: 1.5 deg and 1 cm after a second, 10 deg after a radian (a
    /// tenth of a second late in each turn), 4 cm after a metre; 12 deg a minute of drift.
    fn default() -> Self {
        Self {
            heading_rad2_per_s: 1.5_f64.to_radians().powi(2),
            drift_rad_per_s: 0.2_f64.to_radians(),
            heading_rad2_per_rad: 10.0_f64.to_radians().powi(2),
            position_m2_per_s: 0.01_f64.powi(2),
            position_m2_per_m: 0.04_f64.powi(2),
        }
    }
}

impl OdometryNoise {
    /// All variances times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            heading_rad2_per_s: factor * self.heading_rad2_per_s,
            drift_rad_per_s: factor.sqrt() * self.drift_rad_per_s,
            heading_rad2_per_rad: factor * self.heading_rad2_per_rad,
            position_m2_per_s: factor * self.position_m2_per_s,
            position_m2_per_m: factor * self.position_m2_per_m,
        }
    }

    /// Variances of a coordinate (m^2) and of the heading (rad^2) after so much time, way and turning.
    pub(crate) fn after(&self, seconds: f64, way_m: f64, turned_rad: f64) -> [f64; 2] {
        [
            self.position_m2_per_s * seconds + self.position_m2_per_m * way_m,
            self.heading_rad2_per_s * seconds + self.heading_rad2_per_rad * turned_rad,
        ]
    }
}

/// How errors of successive sightings are alike: one sensor sees one robot from one side, and errs alike for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Likeness {
    /// Share of the variance that lasts; the rest is new in each sighting.
    pub lasting_share: f64,
    /// After this time half of what lasts is left, seconds.
    pub half_life_s: f64,
}

impl Default for Likeness {
    /// Nine tenths, for 5 s: as long as a robot keeps about the same distance and side.
    fn default() -> Self {
        Self { lasting_share: 0.9, half_life_s: 5.0 }
    }
}

impl Likeness {
    /// Correlation of the errors of two different sightings by one observer.
    pub(crate) fn correlation(&self, seconds: f64) -> f64 {
        self.lasting_share * (-std::f64::consts::LN_2 * seconds / self.half_life_s).exp()
    }
}
