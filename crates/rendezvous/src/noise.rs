//! How wrong odometry and sightings are.

/// Errors of odometry as a random walk: variances that grow with time, way and turning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryNoise {
    /// Of the heading, per second.
    pub heading_rad2_per_s: f64,
    /// Of the heading, per radian turned.
    pub heading_rad2_per_rad: f64,
    /// Of each coordinate, per second.
    pub position_m2_per_s: f64,
    /// Of each coordinate, per metre driven.
    pub position_m2_per_m: f64,
}

impl Default for OdometryNoise {
    /// Small robots on wheels: 1 deg and 5 mm after a second, 3 deg after a radian, 2 cm after a metre.
    fn default() -> Self {
        Self {
            heading_rad2_per_s: 1.0_f64.to_radians().powi(2),
            heading_rad2_per_rad: 3.0_f64.to_radians().powi(2),
            position_m2_per_s: 0.005_f64.powi(2),
            position_m2_per_m: 0.02_f64.powi(2),
        }
    }
}

impl OdometryNoise {
    /// All variances times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            heading_rad2_per_s: factor * self.heading_rad2_per_s,
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
    fn default() -> Self {
        Self { lasting_share: 0.8, half_life_s: 2.5 }
    }
}

impl Likeness {
    /// Correlation of the errors of two different sightings by one observer.
    pub(crate) fn correlation(&self, seconds: f64) -> f64 {
        self.lasting_share * (-std::f64::consts::LN_2 * seconds / self.half_life_s).exp()
    }
}
