//! A cloud as keyframes keep it.

use crate::cloud::SpaceSensor;
use std::sync::Arc;

/// A cloud that was prepared: undistorted, thinned, in the robot's frame at its stamp. Six bytes a point, three more where it has
/// colours, and two where it has intensities.
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
    /// How bright each point came back, as the upper half of a float: integers to 256 exactly, all else within 0.4 %. Empty where the
    /// sensor does not say.
    pub intensities: Vec<u16>,
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
            intensities: Vec::new(),
        }
    }

    /// The same with an intensity for each point, or none.
    #[must_use]
    pub fn with_intensities(self, intensities: &[f32]) -> Self {
        Self { intensities: intensities.iter().map(|&intensity| upper_half(intensity)).collect(), ..self }
    }

    /// Where the points were seen from, in the robot's frame, metres.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 3] {
        self.sensor.origin_m()
    }

    /// The intensities of its points.
    pub fn intensities(&self) -> impl ExactSizeIterator<Item = f32> + '_ {
        self.intensities.iter().map(|&code| f32::from_bits(u32::from(code) << 16))
    }

    /// Its points in the robot's frame, metres.
    pub fn points_m(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        self.points.iter().map(|point| point.map(|code| (f64::from(code) * self.step_m) as f32))
    }
}

/// The upper half of a float's bits, rounded to the nearest; zero for what is no number.
fn upper_half(number: f32) -> u16 {
    if !number.is_finite() {
        return 0;
    }
    let bits = number.to_bits();
    let rounded = bits.saturating_add(0x8000) >> 16;
    // the largest floats would become infinite
    if (rounded & 0x7f80) == 0x7f80 { (bits >> 16) as u16 } else { rounded as u16 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intensities_come_back_as_well_as_any_sensor_knows_them() {
        let sensor = Arc::new(SpaceSensor::lidar("top"));
        let given: Vec<f32> = (0..=256).map(|k| k as f32).chain([0.37, 65_535.0, -12.5, f32::MAX, f32::NAN]).collect();
        let sweep = SpaceSweep::new(&sensor, &vec![[1.0; 3]; given.len()], Vec::new()).with_intensities(&given);
        let back: Vec<f32> = sweep.intensities().collect();
        assert_eq!(back[..257], given[..257]);
        assert!(given[257..261].iter().zip(&back[257..]).all(|(was, is)| (was - is).abs() <= 0.004 * was.abs()));
        assert_eq!(back[261], 0.0);
    }

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
