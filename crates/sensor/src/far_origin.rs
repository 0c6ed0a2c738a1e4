//! Odometry that lies too far out to be mapped in.

use mapwright_geom::{Pose, Pose2};

/// No coordinates of a place on earth are larger, metres: its girth is 4 * 10^7.
const FAR_M: f64 = 1e8;

/// What odometry's places are relative to, where they lie too far out to be mapped in, as coordinates of UTM do.
#[derive(Debug, Clone, Copy)]
pub struct FarOrigin {
    at_m: Option<[f64; 2]>,
    has_readings: bool,
    /// The reading before was refused, for it lay too far out.
    was_far: bool,
}

impl FarOrigin {
    /// The first reading becomes the origin where it lies too far out, or two in a row.
    #[must_use]
    pub fn at_first_reading() -> Self {
        Self { at_m: None, has_readings: false, was_far: false }
    }

    /// Only two readings in a row do: texts that are damaged have single ones, the first as well.
    #[must_use]
    pub fn at_two_readings() -> Self {
        Self { at_m: None, has_readings: true, was_far: false }
    }

    /// The origin, metres, where there is one.
    #[must_use]
    pub fn at_m(&self) -> Option<[f64; 2]> {
        self.at_m
    }

    /// The pose relative to the origin; none where it lies too far out by itself, which is a fault.
    pub fn near(&mut self, said: Pose2) -> Option<Pose2> {
        let from_origin = |[x, y]: [f64; 2]| Pose2::new(said.x - x, said.y - y, said.theta);
        let known = self.at_m.map_or(said, from_origin);
        let is_first = !std::mem::replace(&mut self.has_readings, true);
        if known.is_within_bounds() {
            self.was_far = false;
            return Some(known);
        }
        let is_place = said.is_finite() && said.x.abs().max(said.y.abs()) <= FAR_M;
        if !is_place || !(is_first || self.was_far) {
            self.was_far |= is_place;
            return None;
        }
        self.was_far = false;
        self.at_m = Some([said.x, said.y]);
        Some(Pose2::new(0.0, 0.0, said.theta))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_far_out_are_used_from_the_first_on_and_a_single_one_is_a_fault() {
        let near =
            |origin: &mut FarOrigin, x: f64| origin.near(Pose2::new(x, 5_572_094.25, 0.1)).map(|pose| [pose.x, pose.y]);
        let mut utm = FarOrigin::at_first_reading();
        assert_eq!([500_000.5, 500_001.0].map(|x| near(&mut utm, x)), [Some([0.0, 0.0]), Some([0.5, 0.0])]);
        let mut utm = FarOrigin::at_two_readings();
        assert_eq!([500_000.5, 500_001.0].map(|x| near(&mut utm, x)), [None, Some([0.0, 0.0])]);
        let mut origin = FarOrigin::at_first_reading();
        let said = [0.0, 7e6, 1.0, 7e6, 7e6 + 2.0, f64::NAN, 1e9, 7e6 + 3.0].map(|x| Pose2::new(x, 0.0, 0.0));
        let found = said.map(|said| origin.near(said).map(|pose| pose.x));
        assert_eq!(found, [Some(0.0), None, Some(1.0), None, Some(0.0), None, None, Some(1.0)]);
    }
}
