//! Clouds that wait for odometry, inertial readings and those of other sensors.

use crate::merge::{WINDOW_BYTES, WINDOW_MESSAGES, WINDOW_S};
use mapwright_geom::Stamp;
use mapwright_sensor::Cloud;
use std::collections::VecDeque;

/// A cloud that waits.
#[derive(Debug)]
pub(super) struct Waiting {
    pub(super) cloud: Cloud,
    /// When its last point was taken.
    pub(super) end: Stamp,
    pub(super) recorded: Stamp,
    pub(super) offset_bytes: u64,
}

/// The clouds of each sensor in the order of their arrival, and those of several in that of their stamps: over at most [`WINDOW_S`] seconds
/// of arrival, [`WINDOW_MESSAGES`] clouds and [`WINDOW_BYTES`] bytes of them.
#[derive(Debug)]
pub(super) struct Queue {
    of_each: Vec<VecDeque<Waiting>>,
    count: usize,
    bytes: usize,
}

impl Queue {
    /// Of so many sensors.
    pub(super) fn new(sensors: usize) -> Self {
        Self { of_each: (0..sensors).map(|_| VecDeque::new()).collect(), count: 0, bytes: 0 }
    }

    /// One more of a sensor.
    pub(super) fn push(&mut self, sensor: usize, waiting: Waiting) {
        self.bytes += held_bytes(&waiting.cloud);
        self.count += 1;
        self.of_each[sensor].push_back(waiting);
    }

    /// The next cloud and the number of its sensor, at a time of arrival: where `is_due` says so and every sensor has one that is no
    /// older, or where one has waited for long enough.
    pub(super) fn pop(
        &mut self,
        now: Stamp,
        is_end: bool,
        is_due: impl Fn(&Waiting) -> bool,
    ) -> Option<(usize, Waiting)> {
        let is_full = self.count > WINDOW_MESSAGES || self.bytes > WINDOW_BYTES;
        let is_late = |waiting: &Waiting| is_full || now.secs_since(waiting.recorded) > WINDOW_S;
        let fronts = || self.of_each.iter().enumerate().filter_map(|(sensor, queue)| Some((sensor, queue.front()?)));
        let latest = fronts().filter(|(_, first)| is_late(first)).min_by_key(|(_, first)| first.recorded);
        let are_all_here = is_end || self.of_each.iter().all(|queue| !queue.is_empty());
        let earliest = || fronts().min_by_key(|(_, first)| first.cloud.stamp).filter(|_| are_all_here);
        let next = latest.filter(|_| !is_end).or_else(|| earliest().filter(|(_, first)| is_end || is_due(first)));
        let sensor = next?.0;
        let waiting = self.of_each[sensor].pop_front()?;
        self.bytes = self.bytes.saturating_sub(held_bytes(&waiting.cloud));
        self.count -= 1;
        Some((sensor, waiting))
    }
}

fn held_bytes(cloud: &Cloud) -> usize {
    let of_points = cloud.points_m.capacity() * size_of::<[f32; 3]>() + cloud.times_s.capacity() * size_of::<f32>();
    let of_intensities = cloud.intensities.capacity() * size_of::<f32>();
    of_points + of_intensities + cloud.colours.capacity() * size_of::<[u8; 3]>()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright_sensor::SpaceSensor;
    use std::sync::Arc;

    fn push(queue: &mut Queue, sensor: usize, stamp_ms: i64, recorded_ms: i64) {
        let cloud = Cloud {
            stamp: Stamp(stamp_ms * 1_000_000),
            sensor: Arc::new(SpaceSensor::lidar("top")),
            points_m: Vec::new(),
            times_s: Vec::new(),
            colours: Vec::new(),
            intensities: Vec::new(),
            sigmas_m: Vec::new(),
            odom_from_robot: None,
        };
        let recorded = Stamp(recorded_ms * 1_000_000);
        queue.push(sensor, Waiting { end: cloud.stamp, cloud, recorded, offset_bytes: 0 });
    }

    fn popped(queue: &mut Queue, now_ms: i64, is_end: bool) -> Vec<(usize, i64)> {
        let next = || queue.pop(Stamp(now_ms * 1_000_000), is_end, |_| true);
        std::iter::from_fn(next).map(|(sensor, waiting)| (sensor, waiting.cloud.stamp.0 / 1_000_000)).collect()
    }

    #[test]
    fn clouds_of_several_come_in_the_order_of_their_stamps() {
        let mut queue = Queue::new(2);
        push(&mut queue, 1, 100, 110);
        assert_eq!(popped(&mut queue, 110, false), []);
        push(&mut queue, 0, 50, 120);
        push(&mut queue, 0, 100, 130);
        assert_eq!(popped(&mut queue, 130, false), [(0, 50), (0, 100)], "of equals the first sensor's");
        push(&mut queue, 0, 150, 160);
        assert_eq!(popped(&mut queue, 160, false), [(1, 100)]);
        assert_eq!(popped(&mut queue, 160, true), [(0, 150)]);
    }

    #[test]
    fn a_sensor_that_falls_silent_or_has_another_clock_holds_the_others_up_for_a_while() {
        let mut queue = Queue::new(2);
        push(&mut queue, 0, 100, 100);
        push(&mut queue, 0, 200, 200);
        assert_eq!(popped(&mut queue, 2050, false), []);
        assert_eq!(popped(&mut queue, 2150, false), [(0, 100)]);
        for k in 0..40 {
            push(&mut queue, 1, 100 * k - 9000, 2200 + 100 * k);
            let _ = popped(&mut queue, 2200 + 100 * k, false);
        }
        assert_eq!(queue.of_each[0].len(), 0, "nobody waits for ever");
    }

    #[test]
    fn one_sensor_s_clouds_come_as_they_arrived() {
        let mut queue = Queue::new(1);
        [30, 10, 20].into_iter().for_each(|stamp| push(&mut queue, 0, stamp, stamp));
        assert!(queue.pop(Stamp(0), false, |_| false).is_none());
        assert_eq!(popped(&mut queue, 0, false), [(0, 30), (0, 10), (0, 20)]);
    }
}
