//! A recording, played at its own pace.

use super::clock::Clock;
use super::work::Played;
use super::{Entrance, Lanes};
use crate::args::LiveArgs;
use crate::events::{Interrupt, Log};
use crate::failure::Failure;
use crate::progress::FirstPass;
use crate::space::{self, Disk, Source};
use mapwright::Stamp;
use mapwright_formats::LogEvent;
use mapwright_live::{Arrived, Heard, Lane, Reading};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// What its scans are called.
pub(super) const TOPIC: &str = "scan";
/// What its clouds are called.
pub(super) const CLOUDS: &str = "cloud";
/// Nobody sleeps longer than this without looking whether it is over.
const NAP: Duration = Duration::from_millis(100);
/// A door that is full is looked at again so soon.
const FULL: Duration = Duration::from_millis(1);
/// A gap in the recording is waited for no longer.
const GAP: Duration = Duration::from_secs(5);

/// Whether the clouds of a recording are mapped, in space.
pub(super) fn is_of_space(path: &Path, args: &LiveArgs) -> Result<bool, Failure> {
    space::is_of_space(path, &args.source)
}

/// Plays a recording through the door; where its clock jumps ahead or back nobody waits for it.
pub(super) fn play(
    path: &Path,
    args: &LiveArgs,
    (door, lanes): (&Entrance, &Lanes),
    clock: &Clock,
    (held, over): (&AtomicBool, &AtomicBool),
) -> Result<(String, Played), Failure> {
    let interrupt = Interrupt::of_none();
    let mut first_pass = FirstPass::new(&interrupt, true);
    let watch = &mut |name: &str, messages| first_pass.look(name, messages) && !over.load(Ordering::Acquire);
    let pace = Pace { rate: args.rate, last: None, due: Instant::now(), held, over };
    if lanes.are_clouds {
        return play_clouds(path, args, (door, lanes), clock, pace, watch);
    }
    let mut log = Log::open_all(&[path.to_owned()], &args.source.choice(), watch)?;
    let mut pace = pace;
    while let Some(event) = log.next_event()? {
        let (lane, is_due, heard) = match event {
            LogEvent::Scan(scan) => {
                let whole = Heard::Whole { topic: TOPIC.to_owned(), scan: Box::new(scan.clone()) };
                (lanes.of_scan(TOPIC), pace.wait_for(scan.stamp), whole)
            }
            LogEvent::Odometry(odometry) => {
                let heard = Heard::Reading(Reading::Odometry(*odometry));
                (lanes.others(), pace.wait_between(odometry.stamp), heard)
            }
            LogEvent::TurnRate(rate) => {
                (lanes.others(), pace.wait_between(rate.stamp), Heard::Reading(Reading::Turning(*rate)))
            }
            _ => continue,
        };
        if !is_due {
            break;
        }
        put(door, lane, (clock.arrived(), heard), args);
    }
    let name = log.name();
    Ok((name, Played::Plane(Box::new(log.finish()?))))
}

/// A robot waits for nobody who maps; what replays a run does, so that nothing of it is overtaken.
fn put(door: &Entrance, lane: Lane, message: (Arrived, Heard), args: &LiveArgs) {
    while args.replay.is_some() && door.is_full(lane) {
        thread::sleep(FULL);
    }
    door.put(lane, message);
}

fn play_clouds(
    path: &Path,
    args: &LiveArgs,
    (door, lanes): (&Entrance, &Lanes),
    clock: &Clock,
    mut pace: Pace<'_>,
    watch: &mut dyn FnMut(&str, u64) -> bool,
) -> Result<(String, Played), Failure> {
    let name = path.display().to_string();
    let disk = Disk::open(path)?;
    let recording = disk.as_ref().map(Disk::recording).transpose()?.flatten();
    let mut source = match &recording {
        Some(recording) => {
            space::check_choice_of_files(&args.source)?;
            Source::files(name.clone(), recording, &args.source)?
        }
        None => space::in_space(path, &args.source, watch)?,
    };
    let mut readings = Vec::new();
    while let Some(cloud) = source.next_cloud(&mut |reading| readings.push(reading))? {
        if !pace.wait_for(cloud.stamp) {
            break;
        }
        for reading in readings.drain(..) {
            put(door, lanes.others(), (clock.arrived(), Heard::Reading(Reading::InSpace(reading))), args);
        }
        let whole = Heard::WholeCloud { topic: CLOUDS.to_owned(), cloud: Box::new(cloud) };
        put(door, lanes.of_scan(CLOUDS), (clock.arrived(), whole), args);
    }
    Ok((name, Played::Space(Box::new(source.read()))))
}

struct Pace<'a> {
    rate: f64,
    last: Option<Stamp>,
    due: Instant,
    /// Somebody who watches holds it.
    held: &'a AtomicBool,
    over: &'a AtomicBool,
}

impl Pace<'_> {
    /// Waits until a scan or a cloud of a stamp is due, by the time since the one before; false where it is over meanwhile.
    fn wait_for(&mut self, stamp: Stamp) -> bool {
        self.due += self.after_last(stamp);
        self.last = Some(stamp);
        self.wait(Duration::ZERO)
    }

    /// The same of a reading between two of them, whose stamps may be any: no other waits for it.
    fn wait_between(&mut self, stamp: Stamp) -> bool {
        self.wait(self.after_last(stamp))
    }

    fn after_last(&self, stamp: Stamp) -> Duration {
        let elapsed_s = self.last.map_or(0.0, |last| stamp.secs_since(last)).max(0.0);
        Duration::from_secs_f64(elapsed_s / self.rate).min(GAP)
    }

    /// Waits until so long after what is due, and while somebody who watches holds it; false where it is over meanwhile.
    fn wait(&mut self, after: Duration) -> bool {
        loop {
            if self.held.load(Ordering::Acquire) {
                self.due = Instant::now() + NAP;
            }
            let left = (self.due + after).saturating_duration_since(Instant::now());
            if self.over.load(Ordering::Acquire) || left.is_zero() {
                return !self.over.load(Ordering::Acquire);
            }
            thread::sleep(left.min(NAP));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_with_stamps_of_another_clock_hold_up_nothing() {
        let [held, over] = [false, false].map(AtomicBool::new);
        let mut pace = Pace { rate: 100.0, last: None, due: Instant::now(), held: &held, over: &over };
        let begun = Instant::now();
        for k in 0..50 {
            let at = |s: f64| Stamp::from_secs_f64(331.0 + 0.1 * f64::from(k) + s);
            assert!(pace.wait_for(at(0.0)) && pace.wait_between(Stamp(0)) && pace.wait_between(at(0.05)));
        }
        assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
        assert!(begun.elapsed() >= Duration::from_millis(49), "{:?}", begun.elapsed());
        over.store(true, Ordering::Release);
        assert!(!pace.wait_for(Stamp::from_secs_f64(1000.0)));
    }
}
