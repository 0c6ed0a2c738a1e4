//! Where one frame was in another, over a bounded time.

use mapwright_geom::{Pose3, Stamp};
use std::collections::VecDeque;

/// Transforms in order of their stamps, or one for all times.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track {
    held: Option<Pose3>,
    poses: VecDeque<(Stamp, Pose3)>,
}

/// What a track says about a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Found {
    /// The pose, interpolated.
    At(Pose3),
    /// The time is not between those known.
    Outside { first: Stamp, last: Stamp },
}

impl Track {
    /// One pose for all times.
    pub(crate) fn hold(&mut self, pose: Pose3) -> bool {
        self.held = Some(pose);
        self.poses.clear();
        true
    }

    /// One pose; false where it is older than the window. The same stamp again replaces.
    pub(crate) fn insert(&mut self, stamp: Stamp, pose: Pose3, window_s: f64, limit: usize) -> bool {
        if self.poses.back().is_some_and(|(last, _)| last.secs_since(stamp) > window_s) {
            return false;
        }
        self.held = None;
        let place = self.poses.partition_point(|(known, _)| *known < stamp);
        match self.poses.get_mut(place) {
            Some((known, old)) if *known == stamp => *old = pose,
            _ => self.poses.insert(place, (stamp, pose)),
        }
        let newest = self.poses.back().map_or(stamp, |(last, _)| *last);
        while self.poses.front().is_some_and(|(first, _)| newest.secs_since(*first) > window_s)
            || self.poses.len() > limit.max(1)
        {
            self.poses.pop_front();
        }
        true
    }

    /// First and last stamp; none where the pose holds for all times.
    pub(crate) fn span(&self) -> Option<(Stamp, Stamp)> {
        Some((self.poses.front()?.0, self.poses.back()?.0))
    }

    pub(crate) fn at(&self, stamp: Stamp) -> Found {
        if let Some(pose) = self.held {
            return Found::At(pose);
        }
        let (first, last) = self.span().unwrap_or_default();
        let after = self.poses.partition_point(|(known, _)| *known < stamp);
        let later = self.poses.get(after);
        match (after.checked_sub(1).and_then(|before| self.poses.get(before)), later) {
            (_, Some((known, pose))) if *known == stamp => Found::At(*pose),
            (Some(before), Some(later)) => Found::At(between(*before, *later, stamp)),
            _ => Found::Outside { first, last },
        }
    }
}

/// Translations move evenly along a line, rotations along the shorter arc.
fn between((before, a): (Stamp, Pose3), (after, b): (Stamp, Pose3), stamp: Stamp) -> Pose3 {
    let share = stamp.secs_since(before) / after.secs_since(before);
    let nearer = if share < 0.5 { a.rotation } else { b.rotation };
    Pose3 {
        translation: a.translation + share * (b.translation - a.translation),
        // half a turn has no shorter arc
        rotation: a.rotation.try_slerp(&b.rotation, share, 1e-9).unwrap_or(nearer),
    }
}
