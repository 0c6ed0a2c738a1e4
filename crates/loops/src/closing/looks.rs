//! When robots have looked for old places, each by the length of its own way.

use super::run_of;

/// Length of a robot's way when old places were looked for last, and asked for by what they look like, metres.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Looked {
    pub(super) checked_m: f64,
    pub(super) asked_m: f64,
}

impl Looked {
    /// Whether these are of the robot whose way is so long.
    fn is_at(self, way_m: f64) -> bool {
        run_of(self.checked_m) == run_of(way_m)
    }
}

/// Of the robot whose keyframe is the newest, and of others that drive at the same time.
#[derive(Debug, Clone, Default)]
pub(super) struct Looks {
    pub(super) present: Looked,
    others: Vec<Looked>,
    /// Whether robots drive at the same time: then each looks for what the others have mapped.
    pub(super) takes_turns: bool,
}

impl Looks {
    pub(super) fn of(present: Looked) -> Self {
        Self { present, ..Self::default() }
    }

    /// The newest keyframe is of the robot whose way is so long.
    pub(super) fn turn_to(&mut self, way_m: f64) {
        if self.present.is_at(way_m) {
            return;
        }
        let known = self.others.iter().position(|looked| looked.is_at(way_m));
        self.takes_turns |= known.is_some();
        let looked = known.map(|at| self.others.swap_remove(at)).unwrap_or_default();
        self.others.push(std::mem::replace(&mut self.present, looked));
    }

    /// Length of way since the robot whose way is so long has looked, metres.
    pub(super) fn since_m(&self, way_m: f64) -> f64 {
        let all = std::iter::once(&self.present).chain(&self.others);
        way_m - all.copied().find(|looked| looked.is_at(way_m)).unwrap_or_default().checked_m
    }
}
