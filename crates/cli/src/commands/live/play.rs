//! A recording, played at its own pace.

use super::clock::Clock;
use super::{Entrance, Lanes};
use crate::args::LiveArgs;
use crate::events::{Interrupt, Log};
use crate::failure::Failure;
use crate::progress::FirstPass;
use crate::reading::Reading as ReadingReport;
use mapwright::Stamp;
use mapwright_formats::LogEvent;
use mapwright_live::{Heard, Reading};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// What its scans are called.
pub(super) const TOPIC: &str = "scan";
/// Nobody sleeps longer than this without looking whether it is over.
const NAP: Duration = Duration::from_millis(100);
/// A gap in the recording is waited for no longer.
const GAP: Duration = Duration::from_secs(5);

/// Plays a recording through the door; where its clock jumps ahead or back nobody waits for it.
pub(super) fn play(
    path: &Path,
    args: &LiveArgs,
    (door, lanes): (&Entrance, &Lanes),
    clock: &Clock,
    (held, over): (&AtomicBool, &AtomicBool),
) -> Result<(String, ReadingReport), Failure> {
    let interrupt = Interrupt::of_none();
    let mut first_pass = FirstPass::new(&interrupt, true);
    let watch = &mut |name: &str, messages| first_pass.look(name, messages) && !over.load(Ordering::Acquire);
    let mut log = Log::open_all(&[path.to_owned()], &args.source.choice(), watch)?;
    let mut pace = Pace { rate: args.rate, last: None, due: Instant::now() };
    while let Some(event) = log.next_event()? {
        let (lane, stamp, heard) = match event {
            LogEvent::Scan(scan) => {
                let whole = Heard::Whole { topic: TOPIC.to_owned(), scan: Box::new(scan.clone()) };
                (lanes.of_scan(TOPIC), scan.stamp, whole)
            }
            LogEvent::Odometry(odometry) => {
                (lanes.others(), odometry.stamp, Heard::Reading(Reading::Odometry(*odometry)))
            }
            LogEvent::TurnRate(rate) => (lanes.others(), rate.stamp, Heard::Reading(Reading::Turning(*rate))),
            _ => continue,
        };
        if !pace.wait_for(stamp, held, over) {
            break;
        }
        door.put(lane, (clock.arrived(), heard));
    }
    let name = log.name();
    Ok((name, log.finish()?))
}

struct Pace {
    rate: f64,
    last: Option<Stamp>,
    due: Instant,
}

impl Pace {
    /// Waits until an event of a stamp is due, and while somebody who watches holds it; false where it is over meanwhile.
    fn wait_for(&mut self, stamp: Stamp, held: &AtomicBool, over: &AtomicBool) -> bool {
        let elapsed_s = self.last.replace(stamp).map_or(0.0, |last| stamp.secs_since(last)).max(0.0);
        self.due += Duration::from_secs_f64(elapsed_s / self.rate).min(GAP);
        loop {
            if held.load(Ordering::Acquire) {
                self.due = Instant::now() + NAP;
            }
            let left = self.due.saturating_duration_since(Instant::now());
            if over.load(Ordering::Acquire) || left.is_zero() {
                return !over.load(Ordering::Acquire);
            }
            thread::sleep(left.min(NAP));
        }
    }
}
