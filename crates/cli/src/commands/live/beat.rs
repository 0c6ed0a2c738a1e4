//! `map -> odom`, fifty times a second (`transform_publish_period`), whatever else is being done.

use super::clock::Clock;
use super::node::Node;
use super::robot::Names;
use mapwright::{Pose3, Stamp};
use mapwright_live::node::parameters::Setting;
use mapwright_live::outgoing::{Link, transforms};
use mapwright_live::wire::Publisher;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Between two of them.
const PERIOD: Duration = Duration::from_millis(20);

/// Where the robot is, as the newest scan has it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) stamp: Stamp,
    pub(super) map_from_odom: Pose3,
    pub(super) odom_from_robot: Pose3,
    /// Nobody else tells where odometry has the robot.
    pub(super) is_without_odometry: bool,
}

/// What one thread knows and another tells.
#[derive(Debug, Default)]
pub(super) struct Known(Mutex<Option<Place>>);

impl Known {
    pub(super) fn set(&self, place: Option<Place>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = place;
    }

    pub(super) fn get(&self) -> Option<Place> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Tells it until it is over; a beat that was missed is not made up for.
pub(super) fn beat(
    publisher: &dyn Publisher,
    known: &Known,
    (names, node): (&Names, &Node),
    clock: &Clock,
    over: &AtomicBool,
) {
    let mut next = Instant::now();
    let mut told_odometry = Stamp(0);
    while !over.load(Ordering::Acquire) {
        node.beat(clock);
        let period_s = node.number(Setting::TransformPeriod);
        let is_told = period_s > 0.0 && node.flag(Setting::Broadcast) && node.is_active();
        if let (true, Some(place), Some(now)) = (is_told, known.get(), clock.stamp()) {
            let tolerance = Duration::from_secs_f64(node.number(Setting::TransformTolerance).clamp(0.0, 10.0));
            let stamp = Stamp(now.0.saturating_add(tolerance.as_nanos() as i64));
            let (parent, child) = (&names.map_frame, &names.odom_frame);
            let mut links = vec![Link { parent, child, stamp, parent_from_child: place.map_from_odom }];
            if place.is_without_odometry && place.stamp > told_odometry {
                told_odometry = place.stamp;
                let (parent, child, stamp) = (&names.odom_frame, &names.robot_frame, place.stamp);
                links.push(Link { parent, child, stamp, parent_from_child: place.odom_from_robot });
            }
            // Whoever does not get this one gets the next.
            let _ = transforms(&links).map(|bytes| publisher.publish(&bytes));
        }
        let period = if period_s > 0.0 { Duration::from_secs_f64(period_s.clamp(0.005, 1.0)) } else { PERIOD };
        next = (next + period).max(Instant::now());
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
}
