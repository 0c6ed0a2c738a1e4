//! Logs with gaps, and nothing else changed.

use super::create;
use crate::args::PerturbArgs;
use crate::events::{input, name_of};
use crate::failure::{Failure, Outcome};
use crate::reading::{Reading, found_instead};
use crate::recorded::{Missing, Recorded};
use crate::report::remarks;
use crate::terminal::{count, say, say_json};
use mapwright_formats::{CarmenReader, CarmenWriter, FormatError, LogEvent, ReadReport, open_log};
use mapwright_logs::{Input, LogReport};
use mapwright_sim::{Event, EventTime};
use serde_json::json;
use std::io::{Read, Write};

pub(super) fn run(args: &PerturbArgs) -> Result<Outcome, Failure> {
    match input(&args.log)? {
        Input::Carmen(source) => copy_lines(args, source),
        recording => copy_events(args, recording),
    }
}

/// The lines of a CARMEN log, each to the byte, but those of scans and readings in a gap.
fn copy_lines(args: &PerturbArgs, source: Box<dyn Read>) -> Result<Outcome, Failure> {
    let read = |cause| Failure::read(&args.log, cause);
    let (text, tear) = whole(source).map_err(read)?;
    let Lines { times, numbers, mut report } = Lines::of(&text).map_err(read)?;
    report.tear = tear;
    let scans = report.scans;
    let logs = vec![(name_of(&args.log), LogReport::Carmen(Box::new(report)))];
    if scans == 0 {
        return Err(Failure::NoScan { name: name_of(&args.log), found: found_instead(&logs) });
    }
    let missing = Missing::of(&name_of(&args.log), &times, &args.gap)?;
    let mut gone = numbers.iter().zip(&missing.events).filter(|(_, missing)| **missing).map(|(number, _)| *number);
    let mut next_gone = gone.next();
    let failed = |error| Failure::write(&args.output, error);
    let mut out = create(args)?;
    for (number, line) in (1..).zip(text.split_inclusive(|&byte| byte == b'\n')) {
        if next_gone == Some(number) {
            next_gone = gone.next();
        } else {
            out.write_all(line).map_err(failed)?;
        }
    }
    out.flush().map_err(failed)?;
    tell(args, scans - missing.scans, &missing, 0, &Reading { logs, notes: Vec::new() })
}

/// A log's bytes, decompressed, and the tear that ended them early.
fn whole(source: Box<dyn Read>) -> Result<(Vec<u8>, Option<FormatError>), FormatError> {
    let mut text = Vec::new();
    let tear = match open_log(source)?.read_to_end(&mut text) {
        Ok(_) => None,
        Err(error) => Some(error.downcast::<FormatError>()?),
    };
    Ok((text, tear))
}

/// The lines of a CARMEN log that are events.
struct Lines {
    times: Vec<EventTime>,
    /// From 1.
    numbers: Vec<u64>,
    report: ReadReport,
}

impl Lines {
    fn of(text: &[u8]) -> Result<Self, FormatError> {
        let mut reader = CarmenReader::new(text);
        let (mut times, mut numbers) = (Vec::new(), Vec::new());
        loop {
            let time = match reader.next_event()? {
                None => return Ok(Self { times, numbers, report: reader.into_report() }),
                Some(LogEvent::Scan(scan)) => EventTime { stamp: scan.stamp, is_scan: true },
                Some(LogEvent::Odometry(odometry)) => EventTime { stamp: odometry.stamp, is_scan: false },
                Some(_) => continue,
            };
            times.push(time);
            numbers.push(reader.line());
        }
    }
}

/// Scans and readings of a recording, but those in a gap, as a CARMEN log.
fn copy_events(args: &PerturbArgs, recording: Input) -> Result<Outcome, Failure> {
    let log = Recorded::read(recording, &args.log)?;
    let times: Vec<_> = log.events.iter().map(Event::event_time).collect();
    let missing = Missing::of(&name_of(&args.log), &times, &args.gap)?;
    let failed = |cause| Failure::write(&args.output, cause);
    let mut writer = CarmenWriter::new(create(args)?);
    let mut scans = 0;
    for (event, _) in log.events.iter().zip(&missing.events).filter(|(_, missing)| !**missing) {
        match event {
            Event::Odometry(odometry) => writer.odometry(odometry),
            Event::Scan(scan) => writer.scan(scan).inspect(|()| scans += 1),
        }
        .map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    tell(args, scans, &missing, log.turn_rates, &log.reading)
}

fn tell(
    args: &PerturbArgs,
    scans: u64,
    missing: &Missing,
    turn_rates: u64,
    reading: &Reading,
) -> Result<Outcome, Failure> {
    let losses = reading.losses();
    let no_place = (turn_rates > 0).then(|| format!("{} have no place in CARMEN logs", count(turn_rates, "turn rate")));
    if args.json {
        say_json(&json!({ "file": args.output, "scans": scans, "lost": losses, "odd": no_place }))?;
        return Ok(Outcome::of_losses(&losses));
    }
    let remarks = remarks(&losses, no_place.as_slice());
    let taken_out = missing.words(args.gap.len());
    say(&format!("{}: {}; {taken_out}\n{remarks}", args.output.display(), count(scans, "scan")))?;
    Ok(Outcome::of_losses(&losses))
}
