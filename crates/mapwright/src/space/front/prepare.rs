//! Step 1: points in the robot's frame, undistorted and thinned, and what was dropped.
//!
//! A sweep is undistorted to its middle. A velocity that is wrong then bends the cloud to either side and does not move it; undistorted
//! to its beginning it would move it ahead, the velocity would follow, and grow.

use super::span::{Span, is_time};
use super::sweep_motion::SweepMotion;
use crate::settings::Settings;
use crate::space::scale::{DRAWN_SHARE, Scale};
use mapwright_sensor::{BeamCounts, Cloud, SpaceSweep};
use mapwright_voxel::{PointColumns, Seen, Thinner};
use nalgebra::Vector3;

/// Points of the first cloud at least.
const LEAST_POINTS: usize = 100;
/// Of the points within so many of the smallest voxels along each axis, one is matched.
const MATCHED_SHARE: f64 = 0.8;
/// Points whose standard deviation is more than such a share of a voxel's side are not used: they lie in it or in the next.
const UNCERTAIN_SHARE: f64 = 1.0 / 3.0;
/// A cloud may hold so many points.
const POINTS_AT_MOST: usize = 1 << 24;

/// The present cloud.
#[derive(Debug, Clone, Default)]
pub(super) struct Preparation {
    scale: Option<Scale>,
    all: PointColumns,
    drawn: PointColumns,
    matched: PointColumns,
    /// Where they were seen from, in the robot's frame, metres.
    origin_m: [f32; 3],
    thinner: Thinner,
}

impl Preparation {
    /// Of a run that goes on.
    pub(super) fn of_scale(scale: Option<Scale>) -> Self {
        Self { scale, ..Self::default() }
    }

    pub(super) fn scale(&self) -> Option<Scale> {
        self.scale
    }

    /// Points that are drawn.
    pub(super) fn points(&self) -> &[[f32; 3]] {
        &self.drawn.points_m
    }

    /// Points that are matched.
    pub(super) fn match_points(&self) -> &[[f32; 3]] {
        &self.matched.points_m
    }

    /// The same with the time of each after the middle of the sweep, where times are known.
    pub(super) fn seen(&self) -> Seen<'_> {
        Seen {
            points_m: &self.matched.points_m,
            times_s: &self.matched.times_s,
            sigmas_m: &self.matched.sigmas_m,
            origins_m: std::slice::from_ref(&self.origin_m),
        }
    }

    pub(super) fn sweep(&self, cloud: &Cloud) -> SpaceSweep {
        let PointColumns { points_m, colours, intensities, .. } = &self.drawn;
        SpaceSweep::new(&cloud.sensor, points_m, colours.clone()).with_intensities(intensities)
    }

    /// Points that are not drawn.
    pub(super) fn leave_out(&mut self, is_left_out: impl Fn(&[f32; 3]) -> bool) {
        self.drawn.retain(|point| !is_left_out(point));
    }

    /// Whether a cloud can be used at all.
    pub(super) fn check(&self, cloud: &Cloud) -> Result<(), &'static str> {
        cloud.sensor.check()?;
        let count = cloud.points_m.len();
        if count > POINTS_AT_MOST {
            return Err("the cloud has more than 16 million points");
        }
        if !(cloud.times_s.is_empty() || cloud.times_s.len() == count)
            || !(cloud.colours.is_empty() || cloud.colours.len() == count)
            || !(cloud.intensities.is_empty() || cloud.intensities.len() == count)
            || !(cloud.sigmas_m.is_empty() || cloud.sigmas_m.len() == count)
        {
            return Err("the cloud has not as many times, colours, intensities or standard deviations as points");
        }
        Ok(())
    }

    pub(super) fn prepare(
        &mut self,
        settings: &Settings,
        cloud: &Cloud,
        motion: &SweepMotion,
        is_sound: bool,
    ) -> BeamCounts {
        self.all.clear();
        self.origin_m = cloud.sensor.origin_m().map(|v| v as f32);
        let mut counts = BeamCounts::default();
        if is_sound {
            self.take(settings, cloud, motion, &mut counts);
        } else {
            counts.refused = cloud.points_m.len().min(u32::MAX as usize) as u32;
        }
        if self.scale.is_none() && self.all.points_m.len() >= LEAST_POINTS {
            self.scale = Some(Scale::of(settings, &cloud.sensor, &self.all.points_m, &self.all.sigmas_m));
        }
        let resolution_m = self.scale.map_or(1.0, |scale| scale.resolution_m);
        self.leave_out_uncertain(resolution_m, &mut counts);
        self.thinner.thin_columns(&self.all, DRAWN_SHARE * resolution_m, &mut self.drawn);
        self.thinner.thin_columns(&self.drawn, MATCHED_SHARE * resolution_m, &mut self.matched);
        counts
    }

    /// Leaves out points that are known by themselves to lie anywhere in a voxel.
    fn leave_out_uncertain(&mut self, resolution_m: f64, counts: &mut BeamCounts) {
        if self.all.sigmas_m.is_empty() {
            return;
        }
        let most_m = (UNCERTAIN_SHARE * resolution_m) as f32;
        let before = self.all.points_m.len();
        let is_certain: Vec<bool> = self.all.sigmas_m.iter().map(|sigma_m| *sigma_m <= most_m).collect();
        self.all.retain_numbers(|number| is_certain[number]);
        let left_out = (before - self.all.points_m.len()) as u32;
        counts.uncertain += left_out;
        counts.returns -= left_out;
    }

    /// Takes the returns, in the robot's frame in the middle of the sweep.
    fn take(&mut self, settings: &Settings, cloud: &Cloud, motion: &SweepMotion, counts: &mut BeamCounts) {
        let sensor = &cloud.sensor;
        let least_m = sensor.range_min_m.max(settings.scan.min_range_m);
        let most_m = sensor.range_max_m.min(settings.space.max_range_m);
        let rotation = sensor.robot_from_sensor.rotation.to_rotation_matrix();
        let middle_s = Span::of(cloud).middle_s();
        for (number, point) in cloud.points_m.iter().enumerate() {
            let point = Vector3::from(point.map(f64::from));
            let range_m = point.norm();
            if !range_m.is_finite() {
                counts.not_a_number += 1;
            } else if range_m < least_m {
                counts.too_near += 1;
            } else if range_m >= most_m {
                counts.no_return += 1;
            } else {
                counts.returns += 1;
                let mut at = rotation * point + sensor.robot_from_sensor.translation;
                if let Some(&read_s) = cloud.times_s.get(number) {
                    let time_s = if is_time(&read_s) { f64::from(read_s) } else { middle_s };
                    if let Some(middle_from_robot) = motion.middle_from_robot(time_s) {
                        at = middle_from_robot.transform(at);
                    }
                    self.all.times_s.push((time_s - middle_s) as f32);
                }
                self.all.points_m.push([at.x as f32, at.y as f32, at.z as f32]);
                self.all.colours.extend(cloud.colours.get(number));
                self.all.intensities.extend(cloud.intensities.get(number));
                self.all.sigmas_m.extend(cloud.sigmas_m.get(number));
            }
        }
    }
}
