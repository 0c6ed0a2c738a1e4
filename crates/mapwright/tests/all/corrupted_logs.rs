//! A thousand corruptions of a log, read and mapped: no panic, poses that are finite, every line accounted for.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]
#![allow(clippy::ptr_arg, reason = "one signature for every way to corrupt lines")]

use crate::support;

use mapwright_formats::{CarmenReader, CarmenWriter, LogEvent, ReadReport, open_log};
use mapwright_geom::FARTHEST_M;
use mapwright_sim::{Drive, DriveSettings, Event, Rng, worlds};
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use support::{in_parallel, mapper};

const CORRUPTIONS: usize = 1000;
/// Lines of a stretch that is corrupted and mapped, about 60 scans.
const LINES: usize = 180;
/// What may stand where a number is expected.
const STRANGE: [&str; 14] =
    ["", "nan", "-inf", "1e300", "-1e300", "1e-320", "-1", "0", "999999", "1e6", "0x10", "--3", "12.3.4", "180 180"];

type Line = Vec<u8>;

/// Ways to corrupt a stretch of lines; `true` where it must cost at least one of them.
type Kind = (&'static str, fn(&mut Vec<Line>, &mut Rng), bool);
const KINDS: [Kind; 10] = [
    ("bits flipped", flip_bits, false),
    ("bytes replaced", replace_bytes, false),
    ("bytes deleted", delete_bytes, false),
    ("numbers replaced", replace_numbers, false),
    ("beam counts changed", change_beam_counts, true),
    ("fields swapped", swap_fields, false),
    ("lines deleted or doubled", delete_or_double_lines, false),
    ("lines in another order", reorder_lines, false),
    ("lines joined", join_lines, true),
    ("cut short", cut_short, true),
];

/// The Intel log where it is at hand (`../shared/data` or `MAPWRIGHT_DATA`), else a drive of five minutes.
fn log() -> Vec<Line> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from);
    let mut log = Vec::new();
    match File::open(root.join("2d_benchmark/intel.clf.bz2")) {
        Ok(file) => drop(open_log(file).expect("a log").read_to_end(&mut log).expect("a sound file")),
        Err(_) => log = simulated(),
    }
    let whole_lines = log.split_inclusive(|&byte| byte == b'\n').map(<[u8]>::to_vec);
    whole_lines.filter(|line| line.starts_with(b"ODOM") || line.windows(5).any(|word| word == b"LASER")).collect()
}

fn simulated() -> Vec<u8> {
    let settings = DriveSettings { seed: 1, duration_s: 300.0, odometry_rate_hz: 10.0, ..DriveSettings::default() };
    let mut writer = CarmenWriter::new(Vec::new());
    for event in Drive::new(worlds::office_floor(1).into(), settings) {
        match event {
            Event::Odometry(odometry) => writer.odometry(&odometry),
            Event::Scan(taken) => writer.scan(&taken.scan),
        }
        .expect("a vector does not fail");
    }
    writer.finish().expect("a vector does not fail")
}

fn some_line<'a>(lines: &'a mut [Line], rng: &mut Rng) -> &'a mut Line {
    let at = rng.below(lines.len());
    &mut lines[at]
}

/// Calls `corrupt` for random bytes of random lines.
fn at_random_bytes(lines: &mut [Line], rng: &mut Rng, corrupt: impl Fn(&mut Line, usize, &mut Rng)) {
    for _ in 0..1 + rng.below(60) {
        let line = some_line(lines, rng);
        if !line.is_empty() {
            let at = rng.below(line.len());
            corrupt(line, at, rng);
        }
    }
}

fn flip_bits(lines: &mut Vec<Line>, rng: &mut Rng) {
    at_random_bytes(lines, rng, |line, at, rng| line[at] ^= 1 << rng.below(8));
}

fn replace_bytes(lines: &mut Vec<Line>, rng: &mut Rng) {
    at_random_bytes(lines, rng, |line, at, rng| line[at] = rng.next_u64() as u8);
}

fn delete_bytes(lines: &mut Vec<Line>, rng: &mut Rng) {
    at_random_bytes(lines, rng, |line, at, rng| {
        let end = (at + 1 + rng.below(40)).min(line.len());
        line.drain(at..end);
    });
}

/// The places of a line's fields.
fn fields(line: &[u8]) -> Vec<Range<usize>> {
    let mut fields = Vec::new();
    let mut start = 0;
    for field in line.split(u8::is_ascii_whitespace) {
        if !field.is_empty() {
            fields.push(start..start + field.len());
        }
        start += field.len() + 1;
    }
    fields
}

fn replace_numbers(lines: &mut Vec<Line>, rng: &mut Rng) {
    for _ in 0..1 + rng.below(60) {
        let line = some_line(lines, rng);
        let fields = fields(line);
        let (field, strange) = (fields[rng.below(fields.len())].clone(), STRANGE[rng.below(STRANGE.len())]);
        line.splice(field, strange.bytes());
        if fields.len() < 2 {
            return;
        }
    }
}

fn change_beam_counts(lines: &mut Vec<Line>, rng: &mut Rng) {
    for line in lines.iter_mut().filter(|line| line.starts_with(b"FLASER")) {
        if rng.chance(0.1) {
            let count = fields(line)[1].clone();
            line.splice(count, rng.below(400).to_string().into_bytes());
        }
    }
    // This one fits no line.
    lines.push(b"FLASER 1000 1.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n".to_vec());
}

fn swap_fields(lines: &mut Vec<Line>, rng: &mut Rng) {
    for _ in 0..1 + rng.below(30) {
        let line = some_line(lines, rng);
        let mut words: Vec<Line> = fields(line).into_iter().map(|field| line[field].to_vec()).collect();
        let (a, b) = (rng.below(words.len()), rng.below(words.len()));
        words.swap(a, b);
        *line = words.join(&b' ');
        line.push(b'\n');
    }
}

fn delete_or_double_lines(lines: &mut Vec<Line>, rng: &mut Rng) {
    for _ in 0..1 + rng.below(60) {
        let at = rng.below(lines.len());
        if lines.len() > 1 && rng.chance(0.5) {
            lines.remove(at);
        } else {
            lines.insert(rng.below(lines.len()), lines[at].clone());
        }
    }
}

fn reorder_lines(lines: &mut Vec<Line>, rng: &mut Rng) {
    for _ in 0..1 + rng.below(60) {
        let (a, b) = (rng.below(lines.len()), rng.below(lines.len()));
        lines.swap(a, b);
    }
}

/// Takes away some lines' ends, so that the next lines hang on them.
fn join_lines(lines: &mut Vec<Line>, rng: &mut Rng) {
    for _ in 0..1 + rng.below(10) {
        let at = rng.below(lines.len() - 1);
        lines[at].pop_if(|byte| *byte == b'\n');
    }
}

/// Ends within a line.
fn cut_short(lines: &mut Vec<Line>, rng: &mut Rng) {
    lines.truncate(2 + rng.below(lines.len() - 2));
    let last = lines.len() - 1;
    let keep = 8 + rng.below(lines[last].len() / 2);
    lines[last].truncate(keep);
}

/// Reads and maps a log; panics where the mapper's promises are broken.
fn read_and_map(log: &[u8]) -> ReadReport {
    let mut reader = CarmenReader::new(log);
    let mut mapper = mapper();
    while let Some(event) = reader.next_event().expect("a slice does not fail") {
        match event {
            LogEvent::Scan(scan) => {
                let pose = mapper.add_scan(scan).map_from_robot;
                assert!(pose.is_finite() && pose.x.abs() <= FARTHEST_M && pose.y.abs() <= FARTHEST_M, "{pose:?}");
            }
            LogEvent::Odometry(odometry) => mapper.add_odometry(odometry),
            _ => {}
        }
    }
    let report = reader.into_report();
    assert_eq!(mapper.trajectory().len() as u64, report.scans);
    assert!(mapper.trajectory().all(|pose| pose.map_from_robot.is_finite()));
    report
}

/// Every line is an event, has a tag that is counted, is dropped and counted, or is empty or a comment.
fn check_every_line_is_accounted_for(log: &[u8], report: &ReadReport) {
    let tagged = report.other_tags.values().sum::<u64>() + report.uncounted_tags;
    let counted = report.scans + report.odometry + tagged + report.dropped_lines();
    let silent = |line: &&[u8]| line.trim_ascii().first().is_none_or(|&byte| byte == b'#');
    let silent = log.split(|&byte| byte == b'\n').filter(silent).count() as u64;
    assert!(counted <= report.lines && report.lines <= counted + silent, "{counted} and {silent} of {}", report.lines);
}

#[test]
fn a_thousand_corruptions_of_a_log_are_survived_and_counted() {
    let log = log();
    let results = in_parallel(CORRUPTIONS, |number| {
        let mut rng = Rng::keyed(2, number as u64);
        let start = rng.below(log.len() - LINES);
        let mut lines = log[start..start + LINES].to_vec();
        let (_, corrupt, _) = KINDS[number % KINDS.len()];
        corrupt(&mut lines, &mut rng);
        let corrupted = lines.concat();
        let report = read_and_map(&corrupted);
        check_every_line_is_accounted_for(&corrupted, &report);
        (report.scans, report.dropped_lines())
    });
    for (kind, (name, _, costs_lines)) in KINDS.iter().enumerate() {
        let of_kind = || results.iter().skip(kind).step_by(KINDS.len());
        let (scans, dropped) = of_kind().fold((0, 0), |sum, &(scans, dropped)| (sum.0 + scans, sum.1 + dropped));
        println!("{name}: {scans} scans mapped, {dropped} lines dropped");
        assert!(scans > 1000 && (!costs_lines || of_kind().all(|&(_, dropped)| dropped > 0)), "{name}");
    }
    let dropped: u64 = results.iter().map(|&(_, dropped)| dropped).sum();
    assert!(dropped > 1000, "{dropped}");
}
