//! Logs held whole in memory, and what of them lies in gaps.

use crate::events::{Log, name_of};
use crate::failure::Failure;
use crate::reading::Reading;
use crate::terminal::count;
use mapwright::LaserScan;
use mapwright_formats::LogEvent;
use mapwright_logs::{Choice, Input};
use mapwright_sim::{Event, EventTime, Gap, in_gaps};
use std::path::Path;

/// A log's scans and odometry readings in arrival order.
pub(crate) struct Recorded {
    pub(crate) events: Vec<Event<LaserScan>>,
    /// Readings of a gyroscope that it had besides: CARMEN logs, to which gaps are written, have no place for them.
    pub(crate) turn_rates: u64,
    pub(crate) reading: Reading,
}

impl Recorded {
    /// Reads what was found at a path.
    pub(crate) fn read(input: Input, path: &Path) -> Result<Self, Failure> {
        let as_stamped = Choice { odometry_as_stamped: true, ..Choice::default() };
        let mut log = Log::of(vec![(name_of(path), input)], &[path.to_owned()], &as_stamped, &mut |_, _| true)?;
        let (mut events, mut turn_rates) = (Vec::new(), 0);
        while let Some(event) = log.next_event()? {
            match event {
                LogEvent::Scan(scan) => events.push(Event::Scan(scan.clone())),
                LogEvent::Odometry(odometry) => events.push(Event::Odometry(*odometry)),
                _ => turn_rates += 1,
            }
        }
        Ok(Self { events, turn_rates, reading: log.finish()? })
    }
}

/// Which of a log's events lie in gaps, and how many.
pub(crate) struct Missing {
    /// One for each event.
    pub(crate) events: Vec<bool>,
    pub(crate) scans: u64,
    pub(crate) readings: u64,
}

impl Missing {
    /// Of events at these times.
    pub(crate) fn of(name: &str, times: &[EventTime], gaps: &[Gap]) -> Result<Self, Failure> {
        let events = in_gaps(times, gaps).map_err(|error| Failure::Log(format!("{name}: {error}")))?;
        let missing =
            |is_scan| times.iter().zip(&events).filter(move |(time, missing)| **missing && time.is_scan == is_scan);
        let [scans, readings] = [true, false].map(|is_scan| missing(is_scan).count() as u64);
        Ok(Self { events, scans, readings })
    }

    /// What was taken out, in words.
    pub(crate) fn words(&self, gaps: usize) -> String {
        let (scans, readings) = (count(self.scans, "scan"), count(self.readings, "odometry reading"));
        format!("{scans} and {readings} taken out in {}", count(gaps as u64, "gap"))
    }
}
