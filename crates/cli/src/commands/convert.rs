//! `mapwright convert`

use crate::args::{ConvertArgs, LogFormat};
use crate::events::Log;
use crate::failure::{Failure, Outcome};
use crate::output::write_whole;
use crate::report::remarks;
use crate::terminal::{count, say, say_json};
use mapwright_exports::{EventCounts, EventWriter, ExportError};
use mapwright_logs::Choice;
use serde_json::json;
use std::io::{Seek, Write};

pub(super) fn run(args: &ConvertArgs) -> Result<Outcome, Failure> {
    let choice = Choice { odometry_as_stamped: true, ..args.source.choice() };
    let mut log = Log::open_all(std::slice::from_ref(&args.log), &choice, &mut |_, _| true)?.taking_sonars();
    let unwritten = |cause: ExportError| Failure::write_in_words(&args.output, &cause);
    let counts = write_whole(&args.output, |file| match args.format() {
        LogFormat::Carmen => pour(&mut log, EventWriter::carmen(file), unwritten),
        LogFormat::Bag1 => pour(&mut log, EventWriter::bag1(file).map_err(unwritten)?, unwritten),
        LogFormat::Mcap => pour(&mut log, EventWriter::mcap(file).map_err(unwritten)?, unwritten),
    })?;
    let reading = log.finish()?;
    let losses = reading.losses();
    let (scans, readings) = (count(counts.scans, "scan"), count(counts.odometry, "odometry reading"));
    let mut what = format!("{scans}, {readings}");
    if counts.sonars > 0 {
        what += &format!(", {}", count(counts.sonars, "reading") + " of sonars");
    }
    if counts.turn_rates > 0 {
        what += &format!(", {}", count(counts.turn_rates, "turn rate"));
    }
    let mut oddities = reading.oddities();
    if counts.left_out > 0 {
        let what = match args.format() {
            LogFormat::Carmen => "turn rate",
            LogFormat::Bag1 | LogFormat::Mcap => "reading of sonars",
        };
        oddities.push(match args.format() {
            LogFormat::Carmen => format!("{} have no place in CARMEN logs", count(counts.left_out, what)),
            LogFormat::Bag1 | LogFormat::Mcap => {
                format!("{} are not written: a CARMEN log (.clf) has a place for them", count(counts.left_out, what))
            }
        });
    }
    if args.json {
        say_json(&json!({
            "file": args.output, "scans": counts.scans, "odometry": counts.odometry, "turn_rates": counts.turn_rates,
            "left_out": counts.left_out, "lost": losses, "odd": oddities,
        }))?;
        return Ok(Outcome::of_losses(&losses));
    }
    let remarks = remarks(&losses, &oddities);
    say(&format!("{}: {what}\n{remarks}", args.output.display()))?;
    Ok(Outcome::of_losses(&losses))
}

fn pour<W: Write + Seek>(
    log: &mut Log,
    mut writer: EventWriter<W>,
    unwritten: impl Fn(ExportError) -> Failure,
) -> Result<EventCounts, Failure> {
    while let Some(event) = log.next_event()? {
        writer.write(event).map_err(&unwritten)?;
    }
    Ok(writer.finish().map_err(unwritten)?.1)
}
