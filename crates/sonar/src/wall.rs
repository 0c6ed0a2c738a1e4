//! A wall, or as much of it as echoes have shown.

use mapwright_geom::sin_cos;

/// A straight piece of something that answered several times.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Direction of its normal away from the robot, radians.
    pub normal_rad: f64,
    /// How far along that normal it lies, metres.
    pub depth_m: f64,
    /// From where to where echoes came, along the normal turned left, metres.
    pub seen_m: [f64; 2],
    /// So far beyond either end its line is known to within half a cell, metres.
    pub known_beyond_m: f64,
    /// Which echoes it was made of, with the place along it where each came from, metres.
    pub echoes: Vec<(usize, f64)>,
}

/// A wall's line counts as known where its standard deviation is smaller, metres: half a cell of a map of sonars.
pub(crate) const KNOWN_TO_M: f64 = 0.05;

impl Wall {
    /// Unit normal away from the robot, and the direction along it.
    #[must_use]
    pub fn axes(&self) -> ([f64; 2], [f64; 2]) {
        let (sin, cos) = sin_cos(self.normal_rad);
        ([cos, sin], [-sin, cos])
    }

    /// A point of its line, metres.
    #[must_use]
    pub fn at(&self, along_m: f64) -> [f64; 2] {
        let (normal, along) = self.axes();
        [0, 1].map(|k| self.depth_m * normal[k] + along_m * along[k])
    }

    /// Where a ray meets it from the robot's side, metres along the ray; none where it is not known to go so far.
    #[must_use]
    pub fn met_m(&self, from: [f64; 2], direction: [f64; 2]) -> Option<f64> {
        let (normal, along) = self.axes();
        let towards = direction[0] * normal[0] + direction[1] * normal[1];
        let before_m = self.depth_m - (from[0] * normal[0] + from[1] * normal[1]);
        if before_m <= 0.0 || towards <= 1e-6 {
            return None;
        }
        let range_m = before_m / towards;
        let at_m = [0, 1].map(|k| (from[k] + range_m * direction[k]) * along[k]).iter().sum::<f64>();
        let [from_m, to_m] = self.known_m();
        (from_m <= at_m && at_m <= to_m).then_some(range_m)
    }

    /// From where to where it is known, metres along it.
    #[must_use]
    pub fn known_m(&self) -> [f64; 2] {
        [self.seen_m[0] - self.known_beyond_m, self.seen_m[1] + self.known_beyond_m]
    }
}
