//! What a robot says of another one that it sees.

use mapwright_geom::Stamp;

/// Number of a robot.
pub type RobotId = u32;

/// One robot sees another: by a camera and a tag, a reflector, an ultra-wideband radio. The sensor's frame is the robot's.
///
/// Stamps are taken as given: the clocks of the robots must agree to a fraction of the time in which a robot turns by
/// `bearing_sigma_rad`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Who sees.
    pub observer: RobotId,
    /// Who is seen; none where the sensor cannot say.
    pub observed: Option<RobotId>,
    /// When.
    pub stamp: Stamp,
    /// Distance of the two robots, metres.
    pub range_m: Option<f64>,
    /// Direction of the observed robot in the observer's frame, radians, to the left positive.
    pub bearing_rad: Option<f64>,
    /// Standard deviation of the range, metres.
    pub range_sigma_m: f64,
    /// Standard deviation of the bearing, radians.
    pub bearing_sigma_rad: f64,
}

impl Sighting {
    /// Whether it says something: at least one finite measurement, no negative range, and a standard deviation for each.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let range = self.range_m.is_none_or(|m| m.is_finite() && m >= 0.0 && is_positive(self.range_sigma_m));
        let bearing = self.bearing_rad.is_none_or(|rad| rad.is_finite() && is_positive(self.bearing_sigma_rad));
        range && bearing && (self.range_m.is_some() || self.bearing_rad.is_some())
    }
}

fn is_positive(sigma: f64) -> bool {
    sigma > 0.0 && sigma.is_finite()
}
