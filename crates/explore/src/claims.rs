//! Where robots go that decide for themselves.

use crate::assign::Claim;
use crate::frontier::Views;
use crate::map::OccupancyMap;
use crate::robot::{Decides, Explorer};
use std::collections::BTreeMap;

/// A way is at most so many times as long as the straight line, mostly.
const DETOUR: f64 = 4.0;
/// A robot may take so many times as long as the way takes at its speed.
const SLOW_TIMES: f64 = 3.0;

/// What robots have said of where they go.
#[derive(Debug, Clone, Default)]
pub(crate) struct Claims {
    of: BTreeMap<u32, Said>,
    /// Where robots said they go, and how often they began to.
    places: Vec<([f64; 2], u32)>,
}

#[derive(Debug, Clone, Copy)]
struct Said {
    goal_m: Option<[f64; 2]>,
    since_s: f64,
    /// A claim is heeded until then.
    deadline_s: f64,
    /// Which place it is.
    place: usize,
}

/// A claim that is heeded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Claimed {
    goal_m: [f64; 2],
    reach_m: f64,
    robot: u32,
}

impl Claims {
    /// Notes what robots say; whether one has chosen anew, or was not heard any more.
    pub(crate) fn hear(
        &mut self,
        robots: &[Explorer],
        now_s: f64,
        same_m: f64,
        patience_s: impl Fn(&Explorer) -> f64,
    ) -> bool {
        let before = self.of.len();
        self.of.retain(|id, _| robots.iter().any(|robot| robot.id == *id && robot.decides != Decides::Here));
        let mut has_changed = before != self.of.len();
        for robot in robots {
            let Decides::Itself { goal_m } = robot.decides else { continue };
            let goal_m = goal_m.filter(|goal_m| goal_m.iter().all(|m| m.is_finite()));
            let is_same = |said: &&mut Said| match (said.goal_m, goal_m) {
                (Some(before), Some(now)) => apart_m(before, now) <= same_m,
                (before, now) => before.is_none() && now.is_none(),
            };
            if let Some(said) = self.of.get_mut(&robot.id).filter(is_same) {
                said.goal_m = goal_m;
                continue;
            }
            has_changed = true;
            let straight_m = goal_m.map_or(0.0, |goal_m| apart_m(goal_m, robot.at_m()));
            let way_s = DETOUR * straight_m / robot.speed_m_per_s.max(1e-3);
            let deadline_s = now_s + SLOW_TIMES * way_s + patience_s(robot);
            let place = goal_m.map_or(usize::MAX, |goal_m| self.count(goal_m, same_m));
            self.of.insert(robot.id, Said { goal_m, since_s: now_s, deadline_s, place });
        }
        has_changed
    }

    /// Counts a claim; at which place.
    fn count(&mut self, goal_m: [f64; 2], same_m: f64) -> usize {
        let known = self.places.iter().position(|(at_m, _)| apart_m(*at_m, goal_m) <= same_m);
        let place = known.unwrap_or_else(|| {
            self.places.push((goal_m, 0));
            self.places.len() - 1
        });
        self.places[place].1 += 1;
        place
    }

    /// The claims that are left to who made them: not too old, nor made there too often.
    pub(crate) fn heeded(&self, robots: &[Explorer], now_s: f64, at_most: u32) -> Vec<Claimed> {
        let heeded = |robot: &Explorer| {
            let said = self.of.get(&robot.id)?;
            let times = self.places.get(said.place)?.1;
            let is_heeded = now_s <= said.deadline_s && times <= at_most;
            Some(Claimed { goal_m: said.goal_m.filter(|_| is_heeded)?, reach_m: robot.reach_m, robot: robot.id })
        };
        robots.iter().filter_map(heeded).collect()
    }

    /// Whether a robot is about to choose: it has had no goal since a moment ago.
    pub(crate) fn is_choosing(&self, robot: &Explorer, now_s: f64, within_s: f64) -> bool {
        self.of.get(&robot.id).is_some_and(|said| said.goal_m.is_none() && now_s - said.since_s < within_s)
    }
}

impl Claimed {
    /// What is seen from there, for who gives goals to robots with that number and higher ones.
    pub(crate) fn seen(&self, map: &OccupancyMap, views: &mut Views<'_>, sight_m: f64, first: u32) -> Option<Claim> {
        let blocks = views.seen_from(map.index_of(self.goal_m)?, self.reach_m, sight_m);
        Some(Claim { blocks, is_first: self.robot < first })
    }
}

fn apart_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
