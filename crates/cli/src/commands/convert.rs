//! `mapwright convert`

use crate::args::{ConvertArgs, LogFormat};
use crate::failure::{Failure, Outcome};
use crate::output::write_whole;
use crate::report::{read_losses, read_oddities, remarks};
use crate::terminal::{count, say};
use mapwright_exports::{EventCounts, EventWriter, ExportError};
use mapwright_logs::{Choice, Drive, Input, LogError, LogReport};
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::Path;

/// What a recording's file begins with: ROS 1 bag, MCAP, SQLite.
const RECORDINGS: [&[u8]; 3] = [b"#ROSBAG V", b"\x89MCAP0", b"SQLite format 3\0"];

pub(super) fn run(args: &ConvertArgs) -> Result<Outcome, Failure> {
    let name = args.log.display().to_string();
    let choice = Choice { topics: args.topic.clone(), frame: args.frame.clone(), ..Choice::default() };
    let mut drive = Drive::open(vec![(name, input(&args.log)?)], &choice)?;
    let mut counts = EventCounts::default();
    write_whole(&args.output, |file| {
        counts = match args.format() {
            LogFormat::Carmen => pour(&mut drive, EventWriter::carmen(file)),
            LogFormat::Bag1 => pour(&mut drive, EventWriter::bag1(file)?),
            LogFormat::Mcap => pour(&mut drive, EventWriter::mcap(file)?),
        }?;
        Ok::<(), ConvertError>(())
    })?;
    let (losses, oddities) = told(drive.into_reports());
    let (scans, readings) = (count(counts.scans, "scan"), count(counts.odometry, "odometry reading"));
    say(&format!("{}: {scans}, {readings}\n{}", args.output.display(), remarks(&losses, &oddities)))?;
    Ok(Outcome::of_losses(&losses))
}

/// A recording, or else a CARMEN log.
fn input(path: &Path) -> Result<Input, Failure> {
    if path == Path::new("-") {
        return Ok(Input::Carmen(Box::new(std::io::stdin())));
    }
    if path.is_dir() {
        return Ok(Input::Recording(path.to_owned()));
    }
    let mut file = File::open(path).map_err(|error| Failure::open(path, error))?;
    let mut first = Vec::new();
    let read = Read::by_ref(&mut file).take(16).read_to_end(&mut first).and_then(|_| file.rewind());
    read.map_err(|error| Failure::open(path, error))?;
    let is_recording = RECORDINGS.iter().any(|magic| first.starts_with(magic));
    Ok(if is_recording { Input::Recording(path.to_owned()) } else { Input::Carmen(Box::new(file)) })
}

/// Reading or writing failed.
#[derive(Debug, thiserror::Error)]
enum ConvertError {
    #[error(transparent)]
    Read(#[from] LogError),
    #[error(transparent)]
    Write(#[from] ExportError),
}

fn pour<W: Write + Seek>(drive: &mut Drive, mut writer: EventWriter<W>) -> Result<EventCounts, ConvertError> {
    while let Some(event) = drive.next_event()? {
        writer.write(event)?;
    }
    Ok(writer.finish()?.1)
}

/// What was lost and what is odd, in words.
fn told(reports: Vec<(String, LogReport)>) -> (Vec<String>, Vec<String>) {
    let (mut losses, mut oddities) = (Vec::new(), Vec::new());
    for (_, report) in reports {
        match report {
            LogReport::Carmen(read) => {
                losses.extend(read_losses(&read));
                oddities.extend(read_oddities(&read));
            }
            LogReport::Recording(read) => {
                let stream = &read.stream;
                for (refused, what) in [(&stream.undecodable, "undecodable"), (&stream.unusable, "unusable")] {
                    let first = refused.first.as_deref().unwrap_or_default();
                    if refused.count > 0 {
                        losses.push(format!("{} {what}, first {first}", count(refused.count, "message")));
                    }
                }
                if stream.without_odometry.count > 0 {
                    let scans = count(stream.without_odometry.count, "scan");
                    oddities.push(format!("{scans} without odometry near enough"));
                }
            }
            _ => {}
        }
    }
    (losses, oddities)
}
