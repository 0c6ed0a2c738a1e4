//! Odometry that says nothing: it never moves, though what is seen does.

use mapwright_geom::Pose3;

/// A range has changed by more than this, metres and a share of it: lasers err by less.
const CHANGED_M: f32 = 0.1;
const CHANGED_SHARE: f32 = 0.05;
/// What is seen has changed where one of so many beams has: fewer are people.
const CHANGED_ONE_OF: usize = 4;
/// Beams to judge by, at least.
const BEAMS_AT_LEAST: usize = 8;
/// Odometry stands still within so many metres and radians: what is left of rounding.
const STILL_M: f64 = 2e-3;
const STILL_RAD: f64 = 2e-3;

/// Whether poses ever differ from the first.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Movement {
    first: Option<Pose3>,
    pub(crate) has_moved: bool,
}

impl Movement {
    /// Whether there are poses, all like the first.
    pub(crate) fn stands_still(&self) -> bool {
        self.first.is_some() && !self.has_moved
    }

    /// Looks at a pose; what cannot be read is none.
    pub(crate) fn see(&mut self, pose: impl FnOnce() -> Option<Pose3>) {
        if self.has_moved {
            return;
        }
        let Some(now) = pose().filter(|pose| pose.is_finite()) else { return };
        let first = self.first.get_or_insert(now);
        self.has_moved = first.translation.metric_distance(&now.translation) > STILL_M
            || first.rotation.angle_to(&now.rotation) > STILL_RAD;
    }
}

/// Whether scans ever differ from the first.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Scenery {
    first: Vec<f32>,
    pub(crate) has_changed: bool,
}

impl Scenery {
    /// Looks at a scan.
    pub(crate) fn see(&mut self, ranges: impl ExactSizeIterator<Item = f32>) {
        if self.has_changed {
            return;
        }
        if self.first.len() != ranges.len() {
            self.first = ranges.collect();
            return;
        }
        let both = self.first.iter().zip(ranges).filter(|(then, now)| then.is_finite() && now.is_finite());
        let (mut beams, mut changed) = (0, 0);
        for (then, now) in both {
            beams += 1;
            changed += usize::from((then - now).abs() > CHANGED_M.max(CHANGED_SHARE * then.abs()));
        }
        if beams >= BEAMS_AT_LEAST && changed * CHANGED_ONE_OF >= beams {
            (self.has_changed, self.first) = (true, Vec::new());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_and_noise_are_no_motion_of_the_robot() {
        let mut scenery = Scenery::default();
        let room: Vec<f32> = (0..40).map(|k| 2.0 + 0.05 * k as f32).collect();
        let noisy = |k: usize| room.iter().map(move |range_m| range_m + 0.03 * (k % 3) as f32);
        for k in 0..10 {
            scenery.see(noisy(k).collect::<Vec<_>>().into_iter());
            let somebody: Vec<_> =
                noisy(k).enumerate().map(|(at, r)| if (k..k + 8).contains(&at) { 1.0 } else { r }).collect();
            scenery.see(somebody.into_iter());
        }
        assert!(!scenery.has_changed);
        scenery.see(room.iter().map(|range_m| range_m + 0.4).collect::<Vec<_>>().into_iter());
        assert!(scenery.has_changed);
    }

    #[test]
    fn poses_that_differ_move() {
        let mut movement = Movement::default();
        (0..10).for_each(|_| movement.see(|| Some(Pose3::identity())));
        assert!(!movement.has_moved);
        let mut ahead = Pose3::identity();
        ahead.translation.x = 0.01;
        movement.see(|| Some(ahead));
        movement.see(|| Some(Pose3::identity()));
        assert!(movement.has_moved);
    }
}
