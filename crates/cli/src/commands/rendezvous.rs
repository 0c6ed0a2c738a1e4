//! `mapwright rendezvous`

mod archive;
mod data;
mod score;
mod words;

use crate::args::RendezvousArgs;
use crate::failure::{Failure, Outcome};
use crate::output::write_whole;
use crate::terminal::{say, say_json};
use data::{DataSet, Robot};
use mapwright_rendezvous::{Encounter, Kind, Noise, OdometryNoise, PairResult, RobotId, Settings, Sighting, meet};
use score::Scores;
use std::io::Write;

/// What came of the sightings of one pair.
struct Pair {
    robots: [RobotId; 2],
    result: PairResult,
}

/// What came of all.
struct Meetings {
    pairs: Vec<Pair>,
    /// Sightings of barcodes that nobody has.
    unknown_barcodes: usize,
    /// Sightings of robots that see themselves.
    of_itself: usize,
}

pub(super) fn run(args: &RendezvousArgs) -> Result<Outcome, Failure> {
    let set = data::read(&args.data)?;
    let meetings = meet_all(&set, args);
    let scores = Scores::of(&set, &meetings);
    if let Some(path) = &args.output {
        write_whole(path, |writer| write_csv(writer, &meetings).map_err(|cause| Failure::write(path, cause)))?;
    }
    if args.voice.json {
        say_json(&words::to_json(args, &set, &meetings, &scores))?;
    } else if !args.voice.quiet {
        say(&words::to_words(args, &set, &meetings, &scores))?;
    }
    Ok(Outcome::of_losses(&set.losses))
}

fn meet_all(set: &DataSet, args: &RendezvousArgs) -> Meetings {
    let (sightings, unknown_barcodes, of_itself) = sightings(set, args);
    let odometry = OdometryNoise::default().scaled(args.odometry_noise);
    let settings =
        Settings { mutual_s: args.within, noise: Noise { odometry, ..Noise::default() }, ..Settings::default() };
    let pairs = pairs(&set.robots);
    let meet = |[one, two]: [&Robot; 2]| Pair {
        robots: [one.id, two.id],
        result: meet([one.id, two.id], &sightings, [&one.wheels, &two.wheels], &settings),
    };
    let pairs = pairs.into_iter().map(meet).collect();
    Meetings { pairs, unknown_barcodes, of_itself }
}

fn pairs(robots: &[Robot]) -> Vec<[&Robot; 2]> {
    let after = |place: usize| robots[place + 1..].iter();
    robots.iter().enumerate().flat_map(|(place, one)| after(place).map(move |two| [one, two])).collect()
}

/// Sightings of robots by robots; how many barcodes nobody has; how many robots saw themselves.
fn sightings(set: &DataSet, args: &RendezvousArgs) -> (Vec<Sighting>, usize, usize) {
    let (mut sightings, mut unknown, mut of_itself) = (Vec::new(), 0, 0);
    let is_robot = |subject: u32| set.robots.iter().any(|robot| robot.id == subject);
    for robot in &set.robots {
        for seen in &robot.seen {
            match set.subjects.get(&seen.barcode) {
                None => unknown += 1,
                Some(subject) if *subject == robot.id => of_itself += 1,
                Some(subject) if is_robot(*subject) => sightings.push(Sighting {
                    observer: robot.id,
                    observed: Some(*subject),
                    stamp: seen.stamp,
                    range_m: Some(seen.range_m),
                    bearing_rad: Some(seen.bearing_rad),
                    range_sigma_m: args.range_sigma,
                    bearing_sigma_rad: args.bearing_sigma,
                }),
                Some(_) => {}
            }
        }
    }
    (sightings, unknown, of_itself)
}

impl Meetings {
    fn encounters(&self) -> impl Iterator<Item = &Encounter> {
        self.pairs.iter().flat_map(|pair| &pair.result.encounters)
    }
}

/// A kind of encounters in a word.
fn kind_word(kind: Kind) -> &'static str {
    match kind {
        Kind::Mutual => "mutual",
        Kind::Gathered => "gathered",
    }
}

fn write_csv(writer: &mut impl Write, meetings: &Meetings) -> std::io::Result<()> {
    writeln!(writer, "stamp_s,a,b,x_m,y_m,heading_rad,xx,xy,xt,yy,yt,tt,kind,sightings,group,join")?;
    for e in meetings.encounters() {
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
