//! The points of a cloud as mapping in space wants them.

use super::Cloud;
use super::access::Access;
use super::time::SWEEP_S;
use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud as SensorCloud, SpaceSensor, SweepTimes};
use std::sync::Arc;

/// All points of a cloud, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudPoints {
    /// Metres in the sensor's frame; not finite for beams that brought nothing back.
    pub points_m: Vec<[f32; 3]>,
    /// How many of them are not finite.
    pub not_finite: usize,
    /// From the header's stamp to the first point, seconds.
    pub start_s: f64,
    /// When each was taken after the first, seconds; empty where that is not known.
    pub times_s: Vec<f32>,
    /// The field of times, where its numbers are no times of one sweep.
    pub refused_time: Option<String>,
    /// Red, green and blue of each; empty where there are none.
    pub colours: Vec<[u8; 3]>,
    /// How bright each came back; empty where the cloud does not say, or says the same of all.
    pub intensities: Vec<f32>,
}

impl Cloud<'_> {
    /// The points with their times, colours and intensities.
    #[must_use]
    pub fn to_points(&self) -> CloudPoints {
        let mut points_m = Vec::with_capacity(self.len());
        self.for_each_position(|place| points_m.push(place.map(|v| v as f32)));
        let is_there = |point: &[f32; 3]| point.iter().all(|v| v.is_finite());
        let not_finite = points_m.iter().filter(|point| !is_there(point)).count();
        let colours = self.colour.as_ref().map(|colour| self.rows().map(|point| colour.read(point)).collect());
        let read = |access: &Access| -> Vec<f32> { self.rows().map(|point| access.read(point) as f32).collect() };
        let mut intensities = self.intensity.as_ref().map(read).unwrap_or_default();
        if intensities.windows(2).all(|pair| pair[0] == pair[1]) {
            intensities.clear();
        }
        let mut refused_time = self.refused_time.clone();
        let mut timed = None;
        if let Some((access, time)) = &self.time {
            let seconds: Vec<f64> = self.rows().map(|point| time.seconds(access.read(point))).collect();
            let brings_something = |point: &[f32; 3]| is_there(point) && *point != [0.0; 3];
            timed = after_first(&seconds, points_m.iter().map(is_there), time.absolute)
                .or_else(|| after_first(&seconds, points_m.iter().map(brings_something), time.absolute));
            refused_time = timed.is_none().then(|| time.field.clone());
        }
        let (start_s, times_s) = timed.unwrap_or_default();
        CloudPoints {
            points_m,
            not_finite,
            start_s,
            times_s,
            refused_time,
            colours: colours.unwrap_or_default(),
            intensities,
        }
    }
}

impl CloudPoints {
    /// Brings times to seconds by what they are, or takes them away; then what they should be and are, in words. `is_absolute` where they are of
    /// the stamp's own clock.
    pub fn settle_times(&mut self, times: SweepTimes, is_absolute: bool) -> Option<[String; 2]> {
        if let Some(field) = &self.refused_time {
            return Some([format!("`{field}` within a sweep of {SWEEP_S} s"), "other numbers".to_owned()]);
        }
        if self.times_s.is_empty() {
            return None;
        }
        match times {
            SweepTimes::Seconds => None,
            // times of the stamp's own clock are no shares of anything
            SweepTimes::Shares { sweep_s } if !is_absolute => {
                self.times_s.iter_mut().for_each(|time| *time *= sweep_s as f32);
                self.start_s *= sweep_s;
                None
            }
            SweepTimes::Shares { sweep_s: interval_s } | SweepTimes::Refused { interval_s } => {
                let last_s = self.times_s.iter().copied().fold(0.0, f32::max);
                self.times_s.clear();
                self.start_s = if is_absolute { self.start_s } else { 0.0 };
                let expected = format!("times within a sweep, as clouds come every {interval_s:.2} s");
                Some([expected, format!("times that span {last_s:.2} s")])
            }
        }
    }

    /// A cloud of a sensor, whose message has this stamp; without odometry.
    #[must_use]
    pub fn into_cloud(self, stamp: Stamp, sensor: Arc<SpaceSensor>) -> SensorCloud {
        SensorCloud {
            stamp: Stamp(stamp.0.saturating_add(Stamp::from_secs_f64(self.start_s).0)),
            sensor,
            points_m: self.points_m,
            times_s: self.times_s,
            colours: self.colours,
            intensities: self.intensities,
            sigmas_m: Vec::new(),
            odom_from_robot: None,
        }
    }
}

/// The first time and all of them after it; none where a point that is there has none, or they are not of one sweep. What is
/// relative to the stamp and not before it stays so.
fn after_first(
    seconds: &[f64],
    is_there: impl Iterator<Item = bool> + Clone,
    absolute: bool,
) -> Option<(f64, Vec<f32>)> {
    let there = || seconds.iter().zip(is_there.clone()).filter(|(_, is_there)| *is_there).map(|(time, _)| *time);
    if !there().all(f64::is_finite) {
        return None;
    }
    let (first, last) = there().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    if first >= last {
        let alone_s = if absolute && first == last { first } else { 0.0 };
        return Some((alone_s, Vec::new()));
    }
    let start_s = if absolute { first } else { first.min(0.0) };
    if last - start_s > SWEEP_S {
        return None;
    }
    let after = |(time, is_there): (&f64, bool)| if is_there { (time - start_s) as f32 } else { 0.0 };
    Some((start_s, seconds.iter().zip(is_there).map(after).collect()))
}
