//! `mapwright rendezvous`

mod archive;
mod data;
mod score;
mod words;

use crate::args::RendezvousArgs;
use crate::failure::{Failure, Outcome};
use crate::output::write_whole;
use crate::terminal::{say, say_json};
use data::DataSet;
use mapwright_rendezvous::{Encounter, Kind, Meetings, Noise, OdometryNoise, Settings, Sighting, meet_all};
use score::Scores;
use std::io::Write;

/// What came of all.
struct Outcomes {
    meetings: Meetings,
    /// Sightings of barcodes that nobody has.
    unknown_barcodes: usize,
}

pub(super) fn run(args: &RendezvousArgs) -> Result<Outcome, Failure> {
    let set = data::read(&args.data)?;
    let outcomes = meet_robots(&set, args);
    let scores = Scores::of(&set, &outcomes);
    if let Some(path) = &args.output {
        write_whole(path, |writer| write_csv(writer, &outcomes).map_err(|cause| Failure::write(path, cause)))?;
    }
    if args.voice.json {
        say_json(&words::to_json(args, &set, &outcomes, &scores))?;
    } else if !args.voice.quiet {
        say(&words::to_words(args, &set, &outcomes, &scores))?;
    }
    Ok(Outcome::of_losses(&set.losses))
}

fn meet_robots(set: &DataSet, args: &RendezvousArgs) -> Outcomes {
    let (sightings, unknown_barcodes) = sightings(set, args);
    let odometry = OdometryNoise::default().scaled(args.odometry_noise);
    let noise = Noise { odometry, ..Noise::default() };
    let settings = Settings { mutual_s: args.within, noise, ..Settings::default() };
    let robots: Vec<_> = set.robots.iter().map(|robot| (robot.id, &robot.wheels)).collect();
    Outcomes { meetings: meet_all(&robots, &sightings, &settings), unknown_barcodes }
}

/// Sightings of robots by robots, and how many there are of barcodes that nobody has.
fn sightings(set: &DataSet, args: &RendezvousArgs) -> (Vec<Sighting>, usize) {
    let (mut sightings, mut unknown) = (Vec::new(), 0);
    let is_robot = |subject: u32| set.robots.iter().any(|robot| robot.id == subject);
    for robot in &set.robots {
        for seen in &robot.seen {
            match set.subjects.get(&seen.barcode) {
                None => unknown += 1,
                Some(subject) if is_robot(*subject) => sightings.push(Sighting {
                    observer: robot.id,
                    observed: Some(*subject),
                    stamp: seen.stamp,
                    range_m: Some(seen.range_m),
                    bearing_rad: Some(seen.bearing_rad),
                    range_sigma_m: args.range_sigma,
                    bearing_sigma_rad: args.bearing_sigma,
                }),
                Some(_) => {} // a landmark
            }
        }
    }
    (sightings, unknown)
}

impl Outcomes {
    fn encounters(&self) -> impl Iterator<Item = &Encounter> {
        self.meetings.pairs.iter().flat_map(|(_, result)| &result.encounters)
    }
}

/// A kind of encounters in a word.
fn kind_word(kind: Kind) -> &'static str {
    match kind {
        Kind::Mutual => "mutual",
        Kind::Gathered => "gathered",
    }
}

fn write_csv(writer: &mut impl Write, outcomes: &Outcomes) -> std::io::Result<()> {
    writeln!(writer, "stamp_s,a,b,x_m,y_m,heading_rad,xx,xy,xt,yy,yt,tt,kind,sightings,group,join")?;
    for e in outcomes.encounters() {
        let (seconds, nanos) = (e.stamp.0.div_euclid(1_000_000_000), e.stamp.0.rem_euclid(1_000_000_000));
        let pose = e.a_from_b;
        write!(writer, "{seconds}.{nanos:09},{},{},{:.6},{:.6},{:.6}", e.a, e.b, pose.x, pose.y, pose.theta)?;
        for (row, column) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
            write!(writer, ",{:.6e}", e.covariance[(row, column)])?;
        }
        writeln!(writer, ",{},{},{},{}", kind_word(e.kind), e.sightings, e.group, u8::from(e.is_join))?;
    }
    Ok(())
}
