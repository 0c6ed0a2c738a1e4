//! `map -> odom`, fifty times a second, whatever else is being done.

use super::clock::Clock;
use mapwright::{Pose2, Stamp};
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
    pub(super) map_from_odom: Pose2,
    pub(super) odom_from_robot: Pose2,
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

/// Whose frames they are.
pub(super) struct Frames {
    pub(super) map: String,
    pub(super) odom: String,
    pub(super) robot: String,
    pub(super) tolerance: Duration,
}

/// Tells it until it is over; a beat that was missed is not made up for.
pub(super) fn beat(publisher: &dyn Publisher, known: &Known, frames: &Frames, clock: &Clock, over: &AtomicBool) {
    let mut next = Instant::now();
    let mut told_odometry = Stamp(0);
    while !over.load(Ordering::Acquire) {
        if let (Some(place), Some(now)) = (known.get(), clock.stamp()) {
            let stamp = Stamp(now.0.saturating_add(frames.tolerance.as_nanos() as i64));
            let mut links =
                vec![Link { parent: &frames.map, child: &frames.odom, stamp, parent_from_child: place.map_from_odom }];
            if place.is_without_odometry && place.stamp > told_odometry {
                told_odometry = place.stamp;
                let (parent, child, stamp) = (&frames.odom, &frames.robot, place.stamp);
                links.push(Link { parent, child, stamp, parent_from_child: place.odom_from_robot });
            }
            // Whoever does not get this one gets the next.
            let _ = transforms(&links).map(|bytes| publisher.publish(&bytes));
        }
        next = (next + PERIOD).max(Instant::now());
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
}
