//! A cloud as keyframes keep it.

use crate::cloud::SpaceSensor;
use std::sync::Arc;

/// A cloud that was prepared: undistorted, thinned, in the robot's frame at its stamp. Six bytes a point, and three more where
/// it has colours.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceSweep {
    /// What took it.
    pub sensor: Arc<SpaceSensor>,
    /// Metres per step of a coordinate.
    pub step_m: f64,
    /// Coordinates in steps.
    pub points: Vec<[i16; 3]>,
    /// Red, green and blue of each point; empty where there are none.
    pub colours: Vec<[u8; 3]>,
}

impl SpaceSweep {
    /// Points in the robot's frame, metres, all finite, rounded to steps as fine as the farthest of them allows.
    #[must_use]
    pub fn new(sensor: &Arc<SpaceSensor>, points_m: &[[f32; 3]], colours: Vec<[u8; 3]>) -> Self {
        let farthest_m = points_m.iter().flatten().fold(0.0_f32, |most, v| most.max(v.abs()));
        let step_m = (f64::from(farthest_m) / f64::from(i16::MAX)).max(1e-6);
        let code = |v: f32| (f64::from(v) / step_m).round() as i16;
        Self {
            sensor: Arc::clone(sensor),
            step_m,
            points: points_m.iter().map(|point| point.map(code)).collect(),
            colours,
        }
    }

    /// Its points in the robot's frame, metres.
    pub fn points_m(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        self.points.iter().map(|point| point.map(|code| (f64::from(code) * self.step_m) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_back_within_half_a_step() {
        let sensor = Arc::new(SpaceSensor::lidar("top"));
        let points = [[1.0, -2.0, 0.3], [80.0, 0.0, -0.001], [0.0, 0.0, 0.0]];
        let sweep = SpaceSweep::new(&sensor, &points, Vec::new());
        assert!(sweep.step_m < 0.0025);
        for (was, is) in points.iter().flatten().zip(sweep.points_m().flatten()) {
            assert!((was - is).abs() <= 0.51 * sweep.step_m as f32, "{was} {is}");
        }
        assert!(SpaceSweep::new(&sensor, &[], Vec::new()).points.is_empty());
    }
}
