//! One log cut into parts that robots drive at the same time, starts unknown, into one map:
//!
//! ```sh
//! cargo run --release -p mapwright --example drive_at_once -- intel.clf.bz2 intel.relations PARTS KEYFRAMES
//! ```
//!
//! After so many keyframes each tells what it has mapped since, in turn. Relations across parts are scored, beside the whole log's error on
//! the same ones.
#![allow(clippy::print_stdout, clippy::expect_used, clippy::panic, reason = "an example prints what it measures")]

use mapwright::{Adoption, Entry, Mapper, Pose2, RunId, Session, Settings, Stamp, groups};
use mapwright_eval::{Relation, StampedPose, relation_errors};
use mapwright_formats::{CarmenReader, LogEvent, open_log, read_relations};
use std::fs::File;
use std::time::Instant;

/// The events of a log.
enum Event {
    Scan(mapwright::LaserScan),
    Odometry(mapwright::Odometry),
}

fn events(path: &str) -> Vec<Event> {
    let mut log = CarmenReader::new(open_log(File::open(path).expect("a log")).expect("a log"));
    let mut events = Vec::new();
    while let Some(event) = log.next_event().expect("a sound log") {
        match event {
            LogEvent::Scan(scan) => events.push(Event::Scan(scan.clone())),
            LogEvent::Odometry(odometry) => events.push(Event::Odometry(*odometry)),
            _ => {}
        }
    }
    events
}

/// A robot on its part of the log.
struct Robot<'a> {
    mapper: Mapper,
    adoption: Adoption,
    events: &'a [Event],
    untold: Vec<Entry>,
}

impl Robot<'_> {
    /// Drives until it has so many keyframes more; false at the end.
    fn drive(&mut self, keyframes: usize) -> bool {
        let until = self.mapper.keyframes().len() + keyframes;
        while let Some((event, rest)) = self.events.split_first() {
            self.events = rest;
            match event {
                Event::Scan(scan) => self.untold.extend(self.mapper.add_scan(scan).entries),
                Event::Odometry(odometry) => self.mapper.add_odometry(odometry),
            }
            if self.mapper.keyframes().len() >= until {
                return true;
            }
        }
        false
    }
}

fn poses(own: &Session, map: &Session) -> Vec<StampedPose> {
    let pose = |scan: &mapwright::ScanPose| {
        let map_from_keyframe = map.map_from_keyframe()[map.place(scan.keyframe?)?];
        Some(StampedPose { stamp: scan.stamp, world_from_robot: map_from_keyframe * scan.keyframe_from_robot })
    };
    own.scans().iter().filter_map(pose).collect()
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let [log, relations, parts, keyframes] = &args[1..] else { panic!("LOG RELATIONS PARTS KEYFRAMES") };
    let (parts, keyframes): (usize, usize) = (parts.parse().expect("parts"), keyframes.parse().expect("keyframes"));
    let events = events(log);
    let read = read_relations(std::io::BufReader::new(File::open(relations).expect("relations"))).expect("relations");
    let of_file = |r: mapwright_formats::Relation| {
        let [x, y, _] = r.position_m;
        Relation { from: r.stamp_a, to: r.stamp_b, from_from_to: Pose2::new(x, y, r.roll_pitch_yaw_rad[2]) }
    };
    let relations: Vec<Relation> = read.into_iter().map(of_file).collect();
    let mut whole = Mapper::new(Settings::default()).expect("valid");
    let begin = Instant::now();
    for event in &events {
        match event {
            Event::Scan(scan) => drop(whole.add_scan(scan)),
            Event::Odometry(odometry) => whole.add_odometry(odometry),
        }
    }
    println!("whole: {:.2} s", begin.elapsed().as_secs_f64());
    let each = events.len().div_ceil(parts);
    let mut robots: Vec<Robot<'_>> = events
        .chunks(each)
        .enumerate()
        .map(|(k, events)| {
            let run = RunId::of_robot(&format!("robot {k}"));
            let mapper = Mapper::of_run(Settings::default(), run, Pose2::IDENTITY).expect("valid");
            Robot { mapper, adoption: Adoption::default(), events, untold: Vec::new() }
        })
        .collect();
    let ends: Vec<Stamp> = events
        .chunks(each)
        .map(|part| {
            part.iter()
                .rev()
                .find_map(|event| match event {
                    Event::Scan(scan) => Some(scan.stamp),
                    Event::Odometry(_) => None,
                })
                .expect("scans")
        })
        .collect();
    let mut team = Mapper::of_run(Settings::default(), RunId::of_robot("team"), Pose2::IDENTITY).expect("valid");
    let (mut driven_s, mut adopted_s, mut refused, mut one) = (0.0, 0.0, 0, None);
    loop {
        let mut drives = false;
        for robot in &mut robots {
            let begin = Instant::now();
            drives |= robot.drive(keyframes);
            driven_s += begin.elapsed().as_secs_f64();
            let begin = Instant::now();
            for group in groups(&std::mem::take(&mut robot.untold)) {
                refused += team.adopt(group, &mut robot.adoption).refused;
            }
            adopted_s += begin.elapsed().as_secs_f64();
        }
        let pieces = team.session().pieces().len();
        if pieces == 1 && one.is_none() && team.session().runs().len() > parts {
            one = Some(team.keyframes().len());
        }
        if !drives {
            break;
        }
    }
    let begin = Instant::now();
    team.look_again();
    println!(
        "driven {driven_s:.2} s, adopted {adopted_s:.2} s, looked again {:.2} s, {refused} refused, {} keyframes, one piece after {one:?}, pieces {}",
        begin.elapsed().as_secs_f64(),
        team.keyframes().len(),
        team.session().pieces().len()
    );
    let part = |stamp: Stamp| ends.iter().position(|end| stamp <= *end);
    let across: Vec<Relation> =
        relations.iter().copied().filter(|relation| part(relation.from) != part(relation.to)).collect();
    let whole_poses: Vec<StampedPose> = whole
        .trajectory()
        .map(|pose| StampedPose { stamp: pose.stamp, world_from_robot: pose.map_from_robot })
        .collect();
    let team_poses: Vec<StampedPose> =
        robots.iter().flat_map(|robot| poses(robot.mapper.session(), team.session())).collect();
    for (name, relations) in [("all", &relations), ("across", &across)] {
        let [a, b] = [&whole_poses, &team_poses].map(|poses| {
            let report = relation_errors(poses, relations);
            let mean = |all: &dyn Fn(&mapwright_eval::RelationError) -> f64| {
                report.errors.iter().map(all).sum::<f64>() / report.used as f64
            };
            (report.used, mean(&|error| error.translation_m), mean(&|error| error.rotation_deg))
        });
        println!("{name}: whole {a:.4?}, team {b:.4?}, ratio {:.3}", b.1 / a.1);
    }
}
