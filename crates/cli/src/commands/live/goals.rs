//! Where the robot should drive to see what its map does not show yet, as goals for whoever drives it.

use super::beat::{Known, Place};
use crate::failure::Failure;
use crate::terminal::count;
use mapwright::{CountGrid, Pose2, Settings, Stamp};
use mapwright_explore::{Decides, Exploration, ExploreSettings, Explorer, OccupancyMap, Order};
use mapwright_live::outgoing::goal;
use mapwright_live::wire::{Delivery, Publisher, Topic, Wire};
use std::sync::Arc;
use std::time::Duration;

/// How fast a robot is taken to drive until it was seen to, m/s: that of small robots indoors.
const SPEED_M_PER_S: f64 = 0.3;
/// The number by which the one robot goes.
const ROBOT: u32 = 1;

/// What a robot is told of where to go, and what it was told.
pub(super) struct Goals {
    publisher: Box<dyn Publisher>,
    frame: String,
    known: Arc<Known>,
    exploration: Exploration,
    radius_m: f64,
    reach_m: f64,
    /// What it was told last.
    told_m: Option<[f64; 2]>,
    is_done: bool,
}

impl Goals {
    pub(super) fn advertise(
        wire: &mut dyn Wire,
        (topic, frame): (&str, &str),
        settings: &Settings,
        (radius_m, known): (f64, &Arc<Known>),
    ) -> Result<Self, Failure> {
        let topic = Topic::new(topic, "geometry_msgs/msg/PoseStamped", Delivery::Reliable { depth: 1 });
        Ok(Self {
            publisher: wire.advertise(&topic)?,
            frame: frame.to_owned(),
            known: Arc::clone(known),
            exploration: Exploration::new(ExploreSettings::default()),
            radius_m,
            reach_m: settings.scan.free_range_m,
            told_m: None,
            is_done: false,
        })
    }

    /// Decides where to go by the map as it is drawn, and tells it where that is another place than before; what there is to be said comes back.
    pub(super) fn decide(
        &mut self,
        counts: &CountGrid,
        passes_per_hit: u32,
        (now, stamp): (Duration, Stamp),
    ) -> Option<String> {
        let place = self.known.get()?;
        let map = OccupancyMap::of_counts(&[counts], passes_per_hit)?;
        let robot = Explorer {
            id: ROBOT,
            map_from_robot: at(&place),
            heard_s: now.as_secs_f64(),
            radius_m: self.radius_m,
            speed_m_per_s: SPEED_M_PER_S,
            reach_m: self.reach_m,
            decides: Decides::Here,
        };
        let decision = self.exploration.decide(&map, &[robot], now.as_secs_f64());
        let order = decision.orders.first();
        if let Some((order, goal_m)) = order.and_then(|order| Some((order, order.goal_m?)))
            && self.told_m != Some(goal_m)
        {
            // Where nobody hears it, it is told again with the next map.
            let is_told = goal(&self.frame, stamp, facing(order, goal_m))
                .is_ok_and(|message| self.publisher.listeners() > 0 && self.publisher.publish(&message).is_ok());
            self.told_m = is_told.then_some(goal_m);
        }
        let was_done = std::mem::replace(&mut self.is_done, decision.done);
        (decision.done && !was_done).then(|| {
            let left = decision.left.len() as u64;
            format!("nothing is left to be explored that can be reached; {} left", count(left, "frontier"))
        })
    }
}

fn at(place: &Place) -> Pose2 {
    let pose = place.map_from_odom * place.odom_from_robot;
    Pose2::new(pose.translation.x, pose.translation.y, pose.rotation.euler_angles().2)
}

/// A goal as it is come to: the way's last part says which way the robot looks then.
fn facing(order: &Order, goal_m: [f64; 2]) -> Pose2 {
    let from_m =
        order.path_m.iter().rev().find(|point| Pose2::new(point[0], point[1], 0.0).distance(there(goal_m)) > 0.0);
    let heading = from_m.map_or(0.0, |from| (goal_m[1] - from[1]).atan2(goal_m[0] - from[0]));
    Pose2::new(goal_m[0], goal_m[1], heading)
}

fn there([x, y]: [f64; 2]) -> Pose2 {
    Pose2::new(x, y, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_is_faced_as_it_is_come_to() {
        let order = |path_m: &[[f64; 2]]| Order { robot: 1, goal_m: Some([2.0, 1.0]), path_m: path_m.to_vec() };
        let come_from_below = facing(&order(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]]), [2.0, 1.0]);
        assert!((come_from_below.theta - std::f64::consts::FRAC_PI_2).abs() < 1e-12, "{come_from_below:?}");
        assert_eq!(facing(&order(&[]), [2.0, 1.0]), Pose2::new(2.0, 1.0, 0.0));
    }
}
