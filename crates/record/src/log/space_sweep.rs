//! Prepared clouds as measurements of keyframes, and sensors of space and clouds as bytes.

use super::bytes::{Cursor, put_f64, put_pose, put_u32, text};
use crate::error::{EntryError, unless};
use crate::keyframe::Measurement;
use crate::left_out::Beams;
use mapwright_geom::Pose3;
use mapwright_sensor::{SpaceSensor, SpaceSweep};
use std::sync::Arc;

/// A coordinate's step is at most this, metres: it reaches 16 km.
const STEP_AT_MOST_M: f64 = 0.5;

/// Of the number of points: each has an intensity. A cloud has 2^24 points at most.
const HAS_INTENSITIES: u32 = 1 << 31;

impl Measurement for SpaceSweep {
    type Pose = Pose3;
    type Sensor = SpaceSensor;

    const CODE: u8 = 2;

    fn without(&self, beams: &Beams) -> Self {
        let empty = Self { points: Vec::new(), colours: Vec::new(), intensities: Vec::new(), ..self.clone() };
        let Beams::These(beams) = beams else { return empty };
        let mut stays = vec![true; self.points.len()];
        beams.iter().filter_map(|&beam| stays.get_mut(beam as usize).map(|stays| *stays = false)).for_each(drop);
        let kept = |k: &usize| stays[*k];
        Self {
            points: (0..self.points.len()).filter(kept).map(|k| self.points[k]).collect(),
            colours: (0..self.colours.len()).filter(kept).map(|k| self.colours[k]).collect(),
            intensities: (0..self.intensities.len()).filter(kept).map(|k| self.intensities[k]).collect(),
            ..empty
        }
    }

    fn check(&self) -> Result<(), EntryError> {
        self.sensor.check().map_err(|reason| EntryError {
            expected: "a cloud of a sensor that can be mapped with",
            found: reason.to_owned(),
        })?;
        let (points, colours) = (self.points.len(), self.colours.len());
        unless("no colours or one a point", colours == 0 || colours == points, || format!("{colours} for {points}"))?;
        let intensities = self.intensities.len();
        let is_whole = intensities == 0 || intensities == points;
        unless("no intensities or one a point", is_whole, || format!("{intensities} for {points}"))?;
        let fits = self.step_m > 0.0 && self.step_m <= STEP_AT_MOST_M;
        unless("a step of coordinates up to 0.5 m", fits, || self.step_m.to_string())
    }

    fn sensor(&self) -> &Arc<SpaceSensor> {
        &self.sensor
    }

    fn put_sensor(sensor: &SpaceSensor, out: &mut Vec<u8>) {
        let SpaceSensor { range_min_m, range_max_m, range_sigma_m, range_sigma_per_m, .. } = *sensor;
        let numbers = [range_min_m, range_max_m, range_sigma_m, range_sigma_per_m];
        numbers.into_iter().for_each(|number| put_f64(out, number));
        put_pose(out, sensor.robot_from_sensor);
        out.extend_from_slice(sensor.name.as_bytes());
    }

    fn take_sensor(bytes: &[u8]) -> Result<SpaceSensor, EntryError> {
        let mut cursor = Cursor::new(bytes);
        let mut number = || cursor.f64("a sensor's ranges");
        let [range_min_m, range_max_m, range_sigma_m, range_sigma_per_m] = [number()?, number()?, number()?, number()?];
        let robot_from_sensor = cursor.pose()?;
        let name = text(cursor.rest(), "a sensor's name")?;
        Ok(SpaceSensor { name, range_min_m, range_max_m, robot_from_sensor, range_sigma_m, range_sigma_per_m })
    }

    fn put(&self, out: &mut Vec<u8>) {
        put_f64(out, self.step_m);
        let flag = if self.intensities.is_empty() { 0 } else { HAS_INTENSITIES };
        put_u32(out, self.points.len() as u32 | flag);
        self.points.iter().flatten().for_each(|code| out.extend_from_slice(&code.to_le_bytes()));
        self.intensities.iter().for_each(|code| out.extend_from_slice(&code.to_le_bytes()));
        self.colours.iter().for_each(|colour| out.extend_from_slice(colour));
    }

    fn take(sensor: &Arc<SpaceSensor>, bytes: &[u8]) -> Result<Self, EntryError> {
        let mut cursor = Cursor::new(bytes);
        let (step_m, count) = (cursor.f64("a cloud's step")?, cursor.u32("how many points")?);
        let has_intensities = count & HAS_INTENSITIES != 0;
        let count = (count & !HAS_INTENSITIES) as usize;
        unless("intensities of points", count > 0 || !has_intensities, || "none".to_owned())?;
        let points = cursor.take(count.saturating_mul(6), "six bytes a point")?;
        let (points, _) = points.as_chunks::<6>();
        let point = |[x0, x1, y0, y1, z0, z1]: [u8; 6]| [[x0, x1], [y0, y1], [z0, z1]].map(i16::from_le_bytes);
        let intensities = if has_intensities { count.saturating_mul(2) } else { 0 };
        let (intensities, _) = cursor.take(intensities, "two bytes an intensity")?.as_chunks::<2>();
        let intensities = intensities.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect();
        let (colours, odd) = cursor.rest().as_chunks::<3>();
        unless("three bytes a colour", odd.is_empty(), || format!("{} bytes more", odd.len()))?;
        let points = points.iter().map(|bytes| point(*bytes)).collect();
        Ok(Self { sensor: Arc::clone(sensor), step_m, points, colours: colours.to_vec(), intensities })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud() -> SpaceSweep {
        let sensor = Arc::new(SpaceSensor::depth_camera("front"));
        SpaceSweep::new(&sensor, &[[1.0, 2.0, 3.0], [-1.0, 0.5, 0.25]], vec![[1, 2, 3], [255, 0, 7]])
    }

    #[test]
    fn a_cloud_and_its_sensor_come_back_to_the_bit() {
        let (cloud, mut bytes, mut sensor) = (cloud(), Vec::new(), Vec::new());
        cloud.put(&mut bytes);
        SpaceSweep::put_sensor(&cloud.sensor, &mut sensor);
        assert_eq!(SpaceSweep::take_sensor(&sensor).unwrap(), *cloud.sensor);
        assert_eq!(SpaceSweep::take(&cloud.sensor, &bytes).unwrap(), cloud);
        assert!(cloud.check().is_ok());
        let one = cloud.without(&Beams::These(vec![0, 9]));
        assert_eq!((one.points.len(), one.colours.as_slice()), (1, [[255, 0, 7]].as_slice()));
        assert!(cloud.without(&Beams::All).points.is_empty());
    }

    #[test]
    fn intensities_come_back_beside_colours_and_alone() {
        for colours in [vec![[1, 2, 3], [255, 0, 7]], Vec::new()] {
            let cloud = SpaceSweep { colours, ..cloud() }.with_intensities(&[17.0, 0.25]);
            let mut bytes = Vec::new();
            cloud.put(&mut bytes);
            assert_eq!(SpaceSweep::take(&cloud.sensor, &bytes).unwrap(), cloud);
            let one = cloud.without(&Beams::These(vec![0]));
            assert!(one.intensities().eq([0.25]) && cloud.check().is_ok());
            let short = SpaceSweep { intensities: vec![1], ..cloud.clone() };
            assert!(short.check().is_err() && SpaceSweep::take(&cloud.sensor, &bytes[..26]).is_err());
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_cloud_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let cloud = cloud();
            if let Ok(read) = SpaceSweep::take(&cloud.sensor, &bytes) {
                let mut again = Vec::new();
                read.put(&mut again);
                prop_assert_eq!(again, bytes);
                let _ = read.check();
            }
        }
    }
}
