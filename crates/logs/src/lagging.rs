//! Odometry that lags behind the laser, put at the time at which it was true.

use crate::choice::Choice;
use crate::lag::{Lag, LagEstimator};
use crate::merge::{WINDOW_BYTES, WINDOW_MESSAGES};
use crate::order::Event;
use crate::plan::Plan;
use crate::scans::end_of;
use crate::stream::Stream;
use crate::survey::Survey;
use mapwright_bags::BagError;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserModel, LaserScan, Odometry, OdometryReading, Pace};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

/// So many events are held back at most until the lag is known, and as many bytes as in the window.
const HELD_MOST: usize = 32_768;
/// Readings that were true during a scan stand at most so many events behind it: five seconds at a hundred a second.
const BEHIND_MOST: usize = 512;
/// After so many scans without odometry there is none.
const SCANS_WITHOUT: usize = 64;

/// What is known of the times of a log.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Timing {
    /// Where it clearly lags.
    pub(crate) lag: Option<Lag>,
    /// Undoing the motion during the sweeps makes successive scans less alike: their beams count as taken at once.
    pub(crate) at_once: bool,
}

impl Timing {
    fn of(learnt: &LagEstimator) -> Self {
        let Some(mut lag) = learnt.estimate() else { return Self::default() };
        let at_once = learnt.undoing_harms(lag.lag_s);
        if at_once {
            // taken at the stamp, not half a sweep later
            lag.lag_s += learnt.half_sweep_s();
        }
        Self { lag: Some(lag).filter(|lag| lag.is_clear()), at_once }
    }

    /// Of a recording, which is read so far that more would say little.
    pub(crate) fn of_recording(path: &Path, survey: &Survey, plan: &Plan) -> Result<Self, BagError> {
        let mut stream = Stream::open(path, survey.clone(), plan.clone())?;
        let (mut learnt, mut without) = (LagEstimator::default(), 0);
        while let Some(event) = stream.next_event()? {
            let Event::Scan(scan) = event else { continue };
            without += usize::from(!learn(&mut learnt, &scan));
            if learnt.knows_enough() || without > SCANS_WITHOUT {
                break;
            }
        }
        let timing = Self::of(&learnt);
        // a gyroscope says how the robot turned during a sweep, not the wheels
        Ok(Self { at_once: timing.at_once && plan.turning.is_none(), ..timing })
    }
}

/// Takes in a scan with its odometry; whether it has any. That is of the scans' times, however unevenly the wheels were read.
fn learn(learnt: &mut LagEstimator, scan: &LaserScan) -> bool {
    learnt.add_scan(scan);
    let reading = reading_of(scan);
    if let Some(reading) = reading {
        learnt.add_odometry(&reading);
    }
    reading.is_some()
}

fn reading_of(scan: &LaserScan) -> Option<Odometry> {
    scan.odom_from_robot.map(|odom_from_robot| Odometry { stamp: scan.stamp, odom_from_robot })
}

/// Lasers whose beams count as taken at once.
#[derive(Debug, Default)]
pub(crate) struct AtOnce(Option<[Arc<LaserModel>; 2]>);

impl AtOnce {
    pub(crate) fn put(&mut self, laser: &mut Arc<LaserModel>) {
        if let Some([_, used]) = self.0.as_ref().filter(|[said, _]| said == laser) {
            laser.clone_from(used);
            return;
        }
        let used = Arc::new(LaserModel { beam_period_s: 0.0, ..(**laser).clone() });
        let said = std::mem::replace(laser, Arc::clone(&used));
        self.0 = Some([said, used]);
    }
}

/// Events of a log that is read once: held back until it is known by how much its odometry lags, and then for as long as that.
#[derive(Debug, Default)]
pub(crate) struct Lagging {
    held: VecDeque<Event>,
    bytes: usize,
    learning: Option<Box<LagEstimator>>,
    without: usize,
    pub(crate) timing: Timing,
    /// The lag is given, not learnt: it is that of the readings as well, which are nearer to each other than scans.
    is_given: bool,
    /// Odometry of the scans, in the order of their stamps.
    readings: VecDeque<OdometryReading<Pose2>>,
    pace: Pace,
    is_over: bool,
}

impl Lagging {
    /// Of a log whose lag is given, or learnt, or none.
    pub(crate) fn of(choice: Option<f64>, learns: bool) -> Self {
        let lag = choice.filter(|lag_s| *lag_s != 0.0).map(|lag_s| Lag { lag_s, sigma_s: 0.0 });
        let timing = Timing { lag, at_once: false };
        Self { learning: learns.then(Box::default), timing, is_given: lag.is_some(), ..Self::default() }
    }

    /// The log has ended.
    pub(crate) fn end(&mut self) {
        self.is_over = true;
        self.decide();
    }

    pub(crate) fn is_over(&self) -> bool {
        self.is_over
    }

    pub(crate) fn push(&mut self, event: Event) {
        self.bytes += event.held_bytes();
        if let Event::Scan(scan) = &event {
            if let Some(learning) = &mut self.learning {
                self.without += usize::from(!learn(learning, scan));
            }
            if let Some(reading) = reading_of(scan) {
                self.remember(reading);
            }
        }
        if let (Event::Odometry(reading), true) = (&event, self.is_given) {
            self.remember(*reading);
        }
        self.held.push_back(event);
        let is_full = self.held.len() >= HELD_MOST || self.bytes > WINDOW_BYTES || self.without > SCANS_WITHOUT;
        if is_full || self.learning.as_mut().is_some_and(|learning| learning.knows_enough()) {
            self.decide();
        }
    }

    fn decide(&mut self) {
        if let Some(learnt) = self.learning.take() {
            self.timing = Timing::of(&learnt);
        }
    }

    fn remember(&mut self, reading: Odometry) {
        let last = self.readings.back().copied();
        let since_s = last.map_or(0.0, |last| reading.stamp.secs_since(last.stamp));
        let step = last.map(|last| last.odom_from_robot.between(reading.odom_from_robot));
        let is_anew = since_s < 0.0 || step.is_some_and(|step| !self.pace.add(since_s, step));
        let Odometry { stamp, odom_from_robot } = reading;
        self.readings.push_back(OdometryReading { stamp, odom_from_robot, is_anew });
        if self.readings.len() > HELD_MOST {
            self.readings.pop_front();
        }
    }

    /// The next event whose odometry is known.
    pub(crate) fn pop(&mut self) -> Option<Event> {
        if self.learning.is_some() {
            return None;
        }
        let Some(Lag { lag_s, .. }) = self.timing.lag else { return self.take(0) };
        let first = self.held.iter().position(|event| matches!(event, Event::Scan(_)));
        let Some(Event::Scan(scan)) = first.and_then(|at| self.held.get(at)) else {
            // readings that a scan to come may have to wait for do no harm earlier
            return self.take(0).map(|event| earlier(event, lag_s));
        };
        let (at, end) = (later(scan.stamp, lag_s), end_of(scan));
        let is_known = self.readings.back().is_some_and(|last| last.stamp >= at);
        if !is_known && !self.is_over && self.held.len() < WINDOW_MESSAGES && self.bytes <= WINDOW_BYTES {
            return None;
        }
        let is_before = |event: &Event| match event {
            Event::Odometry(odometry) => later(odometry.stamp, -lag_s) <= end,
            Event::TurnRate(rate) => rate.stamp <= end,
            Event::Sonar(reading) => reading.stamp <= end,
            Event::Scan(_) => false,
        };
        let place = self.held.iter().take(BEHIND_MOST).position(is_before).or(first)?;
        let odom_from_robot = scan.odom_from_robot.map(|own| self.odometry_at(at).unwrap_or(own));
        Some(match self.take(place)? {
            Event::Scan(scan) => Event::Scan(LaserScan { odom_from_robot, ..scan }),
            event => earlier(event, lag_s),
        })
    }

    fn take(&mut self, place: usize) -> Option<Event> {
        let event = self.held.remove(place)?;
        self.bytes = self.bytes.saturating_sub(event.held_bytes());
        Some(event)
    }

    /// Between the scans around a time; at most a window after the last one where it was.
    fn odometry_at(&self, at: Stamp) -> Option<Pose2> {
        let after = self.readings.iter().position(|reading| reading.stamp >= at);
        let next = after.and_then(|after| self.readings.get(after));
        if let Some(same) = next.filter(|same| same.stamp == at) {
            return Some(same.odom_from_robot);
        }
        let before = after.unwrap_or(self.readings.len()).checked_sub(1)?;
        self.readings.get(before)?.interpolated(next, at)
    }
}

fn later(stamp: Stamp, by_s: f64) -> Stamp {
    Stamp(stamp.0.saturating_add(Stamp::from_secs_f64(by_s).0))
}

fn earlier(event: Event, lag_s: f64) -> Event {
    match event {
        Event::Odometry(odometry) => Event::Odometry(Odometry { stamp: later(odometry.stamp, -lag_s), ..odometry }),
        event => event,
    }
}

/// Whether it is to be learnt how a log's odometry lags.
pub(crate) fn is_learnt(choice: &Choice) -> bool {
    choice.odometry.is_none() && !choice.odometry_as_stamped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scans::no_scan;

    /// Where a robot is that speeds up evenly.
    fn x_m(at_s: f64) -> f64 {
        0.05 * at_s * at_s
    }

    fn stamp(tenth: i64) -> Stamp {
        Stamp(100_000_000 * tenth)
    }

    fn scan(tenth: i64, lag_s: f64) -> Event {
        let odom_from_robot = Some(Pose2::new(x_m(0.1 * tenth as f64 - lag_s), 0.0, 0.0));
        Event::Scan(LaserScan { stamp: stamp(tenth), odom_from_robot, ..no_scan() })
    }

    fn reading(tenth: i64, lag_s: f64) -> Event {
        let odom_from_robot = Pose2::new(x_m(0.1 * tenth as f64 - lag_s), 0.0, 0.0);
        Event::Odometry(Odometry { stamp: stamp(tenth), odom_from_robot })
    }

    #[test]
    fn scans_wait_for_the_odometry_that_says_where_they_were_taken() {
        for lag_s in [0.25, -0.25] {
            let mut lagging = Lagging::of(Some(lag_s), false);
            let mut handed = Vec::new();
            for tenth in 0..100 {
                lagging.push(if tenth % 2 == 0 { scan(tenth, lag_s) } else { reading(tenth, lag_s) });
                handed.extend(std::iter::from_fn(|| lagging.pop()));
            }
            lagging.end();
            handed.extend(std::iter::from_fn(|| lagging.pop()));
            assert_eq!(handed.len(), 100);
            let mut scans = Vec::new();
            for event in &handed {
                let (Event::Scan(LaserScan { stamp, odom_from_robot: Some(pose), .. })
                | Event::Odometry(Odometry { stamp, odom_from_robot: pose })) = event
                else {
                    panic!("{event:?}");
                };
                // at the ends there is nothing to go by
                if (1.0..9.0).contains(&stamp.as_secs_f64()) {
                    assert!((pose.x - x_m(stamp.as_secs_f64())).abs() < 0.002, "{lag_s}: {event:?}");
                }
                if let Event::Scan(scan) = event {
                    scans.push(scan.stamp);
                }
            }
            assert!(scans.is_sorted() && scans.len() == 50);
        }
    }

    #[test]
    fn without_a_lag_events_go_through_as_they_are() {
        let mut lagging = Lagging::of(None, false);
        lagging.push(scan(0, 0.1));
        lagging.push(reading(1, 0.1));
        let Some(Event::Scan(first)) = lagging.pop() else { panic!("no scan") };
        assert_eq!(first.odom_from_robot.map(|pose| pose.x), Some(x_m(-0.1)));
        assert!(matches!(lagging.pop(), Some(Event::Odometry(_))) && lagging.pop().is_none());
    }

    #[test]
    fn what_is_learnt_of_is_held_back_and_comes_at_the_end() {
        let mut lagging = Lagging::of(None, true);
        (0..20).for_each(|tenth| lagging.push(scan(tenth, 0.0)));
        assert!(lagging.pop().is_none(), "a lag may yet show");
        lagging.end();
        assert_eq!(std::iter::from_fn(|| lagging.pop()).count(), 20);
        assert_eq!(lagging.timing, Timing::default());
    }
}
