//! The geometry of the lasers of a log, shared by their scans.

use super::Tag;
use super::params::{LaserParams, Params};
use mapwright_geom::{Pose2, wrap_angle};
use mapwright_sensor::{LaserModel, RANGE_MAX_UNSAID_M};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// Mounts that differ by less, in metres and radians, are one: the poses in a line are rounded.
pub(super) const SAME_MOUNT: f64 = 1e-3;

/// Models kept for sharing; a log with more of them is broken or hostile.
const MODELS_KEPT: usize = 64;

/// How the beams of one scan lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Geometry {
    pub(super) beams: usize,
    pub(super) angle_min_rad: f64,
    pub(super) angle_step_rad: f64,
    pub(super) range_max_m: f64,
    pub(super) robot_from_laser: Pose2,
}

impl Geometry {
    /// Of a `FLASER` or `RLASER`, whose lines do not say it: half a turn beginning at -90 degrees. An even number of
    /// beams leaves the last one out (180: -90 to +89 degrees), an odd number has it (181: -90 to +90).
    pub(super) fn conventional(beams: usize, laser: &LaserParams) -> Self {
        let steps = if beams.is_multiple_of(2) { beams } else { beams - 1 };
        Self {
            beams,
            angle_min_rad: if beams == 1 { 0.0 } else { -FRAC_PI_2 },
            angle_step_rad: PI / steps.max(1) as f64,
            range_max_m: laser.range_max_m.unwrap_or(RANGE_MAX_UNSAID_M),
            robot_from_laser: laser.robot_from_laser,
        }
    }

    /// Whether the two are one laser, up to the rounding of poses in a line.
    fn same(&self, other: &Self) -> bool {
        let beams = |g: &Self| (g.beams, g.angle_min_rad, g.angle_step_rad, g.range_max_m);
        beams(self) == beams(other) && same_mount(self.robot_from_laser, other.robot_from_laser)
    }
}

/// Whether two mounts differ by no more than the rounding of poses in a line.
pub(super) fn same_mount(a: Pose2, b: Pose2) -> bool {
    a.distance(b) <= SAME_MOUNT && wrap_angle(a.theta - b.theta).abs() <= SAME_MOUNT
}

#[derive(Debug)]
struct Known {
    tag: Tag,
    geometry: Geometry,
    params: Params,
    model: Arc<LaserModel>,
}

/// The models made so far, the one used last in front.
#[derive(Debug, Default)]
pub(super) struct ModelCache {
    known: Vec<Known>,
}

impl ModelCache {
    /// The one model of all scans of this tag and geometry.
    pub(super) fn model(&mut self, tag: Tag, geometry: Geometry, params: &Params) -> &Arc<LaserModel> {
        let fits = |k: &Known| k.tag == tag && k.geometry.same(&geometry) && k.params == *params;
        match self.known.iter().position(fits) {
            Some(0) => {}
            Some(at) => self.known[..=at].rotate_right(1),
            None => {
                self.known.truncate(MODELS_KEPT - 1);
                let model = Arc::new(build(tag, geometry, params));
                self.known.insert(0, Known { tag, geometry, params: *params, model });
            }
        }
        &self.known[0].model
    }
}

fn build(tag: Tag, geometry: Geometry, params: &Params) -> LaserModel {
    LaserModel {
        name: tag.name().to_owned(),
        angle_min_rad: geometry.angle_min_rad,
        angle_step_rad: geometry.angle_step_rad,
        range_min_m: params.range_min_m,
        range_max_m: geometry.range_max_m,
        robot_from_laser: geometry.robot_from_laser,
        inverted: params.inverted,
        beam_period_s: params.beam_period_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beams_lie_where_the_logs_have_them() {
        let front = Params::default().front;
        let cases = [(180, 1.0, 89.0), (181, 1.0, 90.0), (360, 0.5, 89.5), (361, 0.5, 90.0), (401, 0.45, 90.0)];
        for (beams, step_deg, last_deg) in cases {
            let geometry = Geometry::conventional(beams, &front);
            assert_eq!(geometry.angle_min_rad, -FRAC_PI_2);
            assert!((geometry.angle_step_rad.to_degrees() - step_deg).abs() < 1e-12);
            let last_rad = geometry.angle_min_rad + geometry.angle_step_rad * (beams - 1) as f64;
            assert!((last_rad.to_degrees() - last_deg).abs() < 1e-10);
        }
        assert!(Geometry::conventional(1, &front).angle_step_rad.is_finite());
    }

    #[test]
    fn scans_share_one_model_and_memory_stays_bounded() {
        let (params, mut cache) = (Params::default(), ModelCache::default());
        let geometry = Geometry::conventional(180, &params.front);
        let first = Arc::clone(cache.model(Tag::FrontLaser, geometry, &params));
        let rear = Arc::clone(cache.model(Tag::RearLaser, geometry, &params));
        assert!(Arc::ptr_eq(&first, cache.model(Tag::FrontLaser, geometry, &params)));
        assert!(!Arc::ptr_eq(&first, &rear));
        for beams in 1..1000 {
            cache.model(Tag::FrontLaser, Geometry { beams, ..geometry }, &params);
        }
        assert_eq!(cache.known.len(), MODELS_KEPT);
    }
}
