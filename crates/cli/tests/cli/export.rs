//! `mapwright export` and `convert`.

use crate::real_logs::shared_data;
use crate::support::{assert_code, assert_refused, folder, run, small_log, small_log_in, text};
use mapwright_exports::EventWriter;
use mapwright_formats::LogEvent;
use mapwright_geom::Stamp;
use mapwright_logs::{Choice, Drive, Input};
use mapwright_sensor::{LaserModel, LaserScan, TurnRate};
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn mapped(log: &str, out: &Path) {
    assert_code(&run(&["map", log, "-o", out.to_str().unwrap(), "--quiet"]), 0);
}

fn export(out: &Path, to: &str) {
    assert_code(&run(&["export", out.to_str().unwrap(), "--to", to]), 0);
}

fn convert(from: &Path, to: &Path) {
    assert_code(&run(&["convert", from.to_str().unwrap(), to.to_str().unwrap()]), 0);
}

#[test]
fn results_become_what_other_tools_read() {
    let folder = folder("export");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    mapped(&log, &out);
    ["tum", "kitti", "csv", "mcap", "pgm", "worldfile"].iter().for_each(|to| export(&out, to));
    let read = |name: &str| fs::read(out.join(name)).unwrap();
    assert!(read("export.tum") == read("trajectory.tum"), "the session has the final trajectory");
    assert!(read("export.pgm") == read("map.pgm"), "the map drawn anew is the one that was written");
    let poses = text(&read("trajectory.tum")).lines().count();
    let (kitti, csv) = (text(&read("export.kitti")), text(&read("export.csv")));
    assert_eq!((kitti.lines().count(), csv.lines().count()), (poses, poses + 1));
    assert!(kitti.lines().all(|line| line.split(' ').count() == 12));
    assert!(read("export.mcap").starts_with(b"\x89MCAP0\r\n"));
    assert!(read("map_plain.png").starts_with(b"\x89PNG") && text(&read("map_plain.pgw")).lines().count() == 6);
    let elsewhere = folder.join("elsewhere.csv");
    let args = ["export", out.to_str().unwrap(), "--to", "csv", "-o", elsewhere.to_str().unwrap()];
    assert_code(&run(&args), 0);
    assert!(fs::read(elsewhere).unwrap() == read("export.csv"));
    assert!(!fs::read_dir(&out).unwrap().any(|entry| entry.unwrap().file_name().to_string_lossy().ends_with(".part")));
}

#[test]
fn what_cannot_be_exported_or_converted_is_told() {
    let folder = folder("export_refused");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let to = |what: &str| run(&["export", out.to_str().unwrap(), "--to", what]);
    fs::create_dir_all(&out).unwrap();
    assert_refused(&to("tum"), 1, &["session.mapwright", "mapwright map"]);
    fs::write(out.join("session.mapwright"), b"P5 2 2").unwrap();
    assert_refused(&to("mcap"), 1, &["session.mapwright", "byte 0: expected a session of mapwright"]);
    assert_refused(&run(&["convert", &log, "log.txt"]), 2, &[".clf, .log, .bag or .mcap"]);
    let missing = folder.join("missing.clf");
    let target = folder.join("never.mcap");
    assert_refused(&run(&["convert", missing.to_str().unwrap(), target.to_str().unwrap()]), 1, &["missing.clf"]);
    assert!(!target.exists());
}

/// Maps a log by way of MCAP, of a bag and of CARMEN made of the MCAP: all the same, and the same as the log itself where
/// its laser's angles are whole thousandths of a degree, for messages have them in single precision.
fn round_trip(folder: &Path, log: &Path, angles_are_whole: bool) {
    let [mcap, bag, back] = ["log.mcap", "log.bag", "back.clf"].map(|name| folder.join(name));
    convert(log, &mcap);
    convert(log, &bag);
    convert(&mcap, &back);
    let trajectory = |log: &Path| {
        let out = folder.join(format!("out_{}", log.file_name().unwrap().to_string_lossy()));
        mapped(log.to_str().unwrap(), &out);
        poses(&out.join("trajectory.tum"))
    };
    let expected = trajectory(if angles_are_whole { log } else { &mcap });
    for log in [&mcap, &bag, &back] {
        let found = trajectory(log);
        assert_eq!(found.len(), expected.len(), "{}", log.display());
        for (a, b) in found.iter().zip(&expected) {
            assert_eq!(a.0, b.0, "{}: stamps are the same to the nanosecond", log.display());
            let off = a.1.iter().zip(&b.1).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "{}: {off} m at {}", log.display(), a.0);
        }
    }
    assert_eq!(scan_lines(&back), scan_lines(log), "the same stamps and ranges");
    let known = stamps(&back, &["ODOM", "FLASER", "ROBOTLASER1"]);
    let lost: Vec<_> = stamps(log, &["ODOM"]).into_iter().filter(|stamp| !known.contains(stamp)).collect();
    assert!(lost.is_empty(), "readings of the wheels that did not come back: {lost:?}");
}

/// The stamps of lines that carry odometry, in microseconds.
fn stamps(log: &Path, tags: &[&str]) -> Vec<i64> {
    let text = String::from_utf8_lossy(&fs::read(log).unwrap()).into_owned();
    let lines = text.lines().filter(|line| tags.iter().any(|tag| line.split(' ').next() == Some(tag)));
    let stamp = |line: &str| line.split_whitespace().rev().nth(2).unwrap().parse::<f64>().unwrap();
    lines.map(|line| (1e6 * stamp(line)).round() as i64).collect()
}

/// Stamps as written, and where the robot was.
fn poses(trajectory: &Path) -> Vec<(String, Vec<f64>)> {
    let text = fs::read_to_string(trajectory).unwrap();
    let row = |line: &str| {
        let (stamp, rest) = line.split_once(' ').unwrap();
        (stamp.to_owned(), rest.split(' ').take(2).map(|word| word.parse().unwrap()).collect())
    };
    text.lines().map(row).collect()
}

/// Stamp and ranges of each scan.
fn scan_lines(log: &Path) -> Vec<(f64, Vec<f32>)> {
    let text = String::from_utf8_lossy(&fs::read(log).unwrap()).into_owned();
    let row = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let first = match *words.first()? {
            "FLASER" => 1,
            "ROBOTLASER1" => 8,
            _ => return None,
        };
        let beams: usize = words[first].parse().unwrap();
        let ranges = words[first + 1..=first + beams].iter().map(|word| word.parse().unwrap()).collect();
        Some((words[words.len() - 3].parse().unwrap(), ranges))
    };
    text.lines().filter_map(row).collect()
}

#[test]
fn a_converted_log_is_the_same_log() {
    let folder = folder("convert");
    let log = small_log_in(&folder);
    assert!(small_log().len() > 1000);
    round_trip(&folder, Path::new(&log), false);
}

/// Up to so many seconds after the first event.
fn beginning(log: &Path, seconds: f64, short: &Path) {
    let file = bzip2::read::MultiBzDecoder::new(fs::File::open(log).unwrap());
    let mut out = fs::File::create(short).unwrap();
    let mut begin = None;
    for line in BufReader::new(file).split(b'\n') {
        let line = line.unwrap();
        let words = text(&line);
        let words: Vec<&str> = words.split_whitespace().collect();
        if matches!(words.first(), Some(&("ODOM" | "FLASER"))) {
            let stamp: f64 = words[words.len() - 3].parse().unwrap();
            if stamp - *begin.get_or_insert(stamp) > seconds {
                return;
            }
        }
        out.write_all(&[&line[..], b"\n"].concat()).unwrap();
    }
}

#[test]
fn three_minutes_of_intel_convert_and_map_to_the_same() {
    let Some(log): Option<PathBuf> = shared_data("2d_benchmark/intel.clf.bz2") else { return };
    let folder = folder("convert_intel");
    let short = folder.join("intel.clf");
    beginning(&log, 180.0, &short);
    assert!(scan_lines(&short).len() > 900);
    round_trip(&folder, &short, true);
}

/// The turn rates that a recording gives to a mapper.
fn turn_rates(path: &Path) -> Vec<TurnRate> {
    let input = vec![("log".to_owned(), Input::Recording(path.to_owned()))];
    let mut drive = Drive::open(input, &Choice::default()).unwrap();
    let mut rates = Vec::new();
    while let Some(event) = drive.next_event().unwrap() {
        if let LogEvent::TurnRate(rate) = event {
            rates.push(*rate);
        }
    }
    rates
}

#[test]
fn turn_rates_go_from_recording_to_recording_and_are_said_to_be_left_out_of_others() {
    let folder = folder("convert_turn_rates");
    let path = |name: &str| folder.join(name);
    let mut writer = EventWriter::mcap(fs::File::create(path("a.mcap")).unwrap()).unwrap();
    let at = |ms: i64| Stamp(1_600_000_000_000_000_000 + ms * 1_000_000);
    let laser = Arc::new(LaserModel { beam_period_s: 0.0005, ..LaserModel::half_circle("front", 100) });
    let mut made = Vec::new();
    for k in 0..60 {
        let rate = TurnRate { stamp: at(10 * k), rad_per_s: 0.01 * k as f64 };
        writer.write(LogEvent::TurnRate(&rate)).unwrap();
        made.push(rate);
        if k % 10 == 9 {
            let stamp = at(10 * k - 60);
            let scan = LaserScan { stamp, laser: Arc::clone(&laser), ranges_m: vec![3.0; 100], odom_from_robot: None };
            writer.write(LogEvent::Scan(&scan)).unwrap();
        }
    }
    writer.finish().unwrap();
    convert(&path("a.mcap"), &path("b.bag"));
    convert(&path("b.bag"), &path("c.mcap"));
    for name in ["a.mcap", "b.bag", "c.mcap"] {
        let read = turn_rates(&path(name));
        assert!(read.len() > 50 && made.starts_with(&read), "{name}: {} of {}", read.len(), made.len());
    }
    let told = run(&["convert", path("c.mcap").to_str().unwrap(), path("d.clf").to_str().unwrap()]);
    assert!(text(&told.stdout).contains("turn rates have no place in CARMEN logs"), "{}", text(&told.stdout));
}
