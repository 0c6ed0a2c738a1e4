//! The same readings as others read from the same RPLIDAR: a simulated one on a pseudo-terminal, read once by `judge_rplidar.py` and once by the lidar
//! here through `serial2`. Python with the packages `rplidar-roboticia` and `pyrplidar` is `MAPWRIGHT_PYTHON`, or else `python3`.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, clippy::explicit_write)] // tests unwrap what they expect and say what they skip

mod support;

use mapwright_geom::Stamp;
use mapwright_lidars::{Counts, Request, Revolution, Rplidar, ScanMode};
use serial2::SerialPort;
use std::io::{ErrorKind, Write as _};
use std::os::fd::AsRawFd as _;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use support::{Device, dense, express, nodes, points, ultra};

/// Python with a package, or a remark that the test is skipped.
fn python(package: &str, test: &str) -> Option<String> {
    let python = std::env::var("MAPWRIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let works = Command::new(&python).args(["-c", &format!("import serial, {package}")]).output();
    if works.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let _ = writeln!(std::io::stderr(), "{test}: skipped: no Python with {package} ({python})");
    None
}

/// A device at the far end of a line, until it is told to end: it answers, and sends its packets once it is asked to scan.
fn serve(mut line: SerialPort, mut device: Device, packets: &[Vec<u8>], ends: &AtomicBool) {
    line.set_read_timeout(Duration::from_millis(5)).unwrap();
    let (mut pending, mut sent) = (Vec::new(), 0);
    while !ends.load(Ordering::Relaxed) {
        let mut bytes = [0; 256];
        match line.read(&mut bytes) {
            Ok(count) => pending.extend_from_slice(&bytes[..count]),
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            // nobody has the near end open
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
        while let Some(length) = request_bytes(&pending) {
            let answer = device.answer(&pending.drain(..length).collect::<Vec<_>>());
            let _ = line.write_all(&answer);
        }
        if device.is_scanning && sent < packets.len() {
            let some = &packets[sent..(sent + 8).min(packets.len())];
            let _ = line.write_all(&some.concat());
            sent += some.len();
        }
    }
}

fn request_bytes(pending: &[u8]) -> Option<usize> {
    let command = *pending.get(1)?;
    let length = if command & 0x80 == 0 { 2 } else { 4 + usize::from(*pending.get(2)?) };
    (pending.len() >= length).then_some(length)
}

/// Runs something with the path of a port that a device is at.
fn with_device<T>(device: Device, packets: &[Vec<u8>], run: impl FnOnce(&SerialPort, &str) -> T) -> T {
    let (far, mut near) = SerialPort::pair().unwrap();
    near.set_read_timeout(Duration::from_millis(5)).unwrap();
    let path = std::fs::read_link(format!("/proc/self/fd/{}", near.as_raw_fd())).unwrap();
    let ends = Arc::new(AtomicBool::new(false));
    std::thread::scope(|scope| {
        let told = Arc::clone(&ends);
        scope.spawn(move || serve(far, device, packets, &told));
        let result = run(&near, path.to_str().unwrap());
        ends.store(true, Ordering::Relaxed);
        result
    })
}

/// What the lidar here makes of a line: all that comes until nothing does for a second.
fn ours(mode: ScanMode, line: &SerialPort) -> (Vec<Revolution>, Counts) {
    let (mut lidar, mut all, began) = (Rplidar::of(mode), Vec::new(), Instant::now());
    let (mut heard, mut bytes) = (Instant::now(), [0; 777]);
    while heard.elapsed() < Duration::from_secs(1) {
        let now = Stamp(began.elapsed().as_nanos() as i64);
        while let Some(request) = lidar.next_request(now) {
            match request {
                Request::Bytes(bytes) => line.write_all(&bytes).unwrap(),
                // a pseudo-terminal has none
                Request::Dtr(on) => drop(line.set_dtr(on)),
            }
        }
        if let Ok(count) = line.read(&mut bytes) {
            lidar.receive(&bytes[..count], Stamp(began.elapsed().as_nanos() as i64));
            heard = Instant::now();
        }
        all.extend(std::iter::from_fn(|| lidar.next_scan()));
    }
    (all, *lidar.counts())
}

/// A judge's reading.
#[derive(Debug, Clone, Copy)]
struct Judged {
    is_new: bool,
    deg: f64,
    mm: f64,
    righted_deg: f64,
    /// From reading to reading of its capsule.
    step_deg: f64,
}

fn judged(python: &str, judge: &str, mode: &str, path: &str) -> Vec<Judged> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/judge_rplidar.py");
    let output = Command::new(python).args([script, judge, mode, path]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let line = |line: &str| {
        let numbers: Vec<f64> = line.split(' ').map(|number| number.parse().unwrap()).collect();
        Judged {
            is_new: numbers[0] == 1.0,
            deg: numbers[2],
            mm: numbers[3],
            righted_deg: numbers[4],
            step_deg: numbers[5],
        }
    };
    text.lines().map(line).collect()
}

/// Both, of devices that send the same.
fn both(
    (python, judge, mode): (&str, &str, &str),
    device: impl Fn() -> Device,
    packets: &[Vec<u8>],
) -> (Vec<Judged>, Vec<Revolution>, Counts) {
    let asked = match mode {
        "standard" => ScanMode::Standard,
        "express" => ScanMode::Express,
        _ => ScanMode::Typical,
    };
    let (mine, counts) = with_device(device(), packets, |line, _| ours(asked, line));
    let theirs = with_device(device(), packets, |_, path| judged(python, judge, mode, path));
    (theirs, mine, counts)
}

/// All readings of whole revolutions stand in theirs, in a row and without one left out; says how many.
fn in_a_row(mine: &[(f64, f64)], theirs: &[(f64, f64)], words: &str) {
    let first = theirs.windows(2).position(|pair| pair == &mine[..2]).unwrap();
    for (number, (one, other)) in mine.iter().zip(&theirs[first..]).enumerate() {
        assert_eq!(one, other, "{words}: reading {number} of {}", mine.len());
    }
    assert!(theirs.len() >= first + mine.len());
    println!("{words}: {} of {} readings in whole revolutions, all equal", mine.len(), theirs.len());
}

fn righted(theirs: &[Judged]) -> Vec<(f64, f64)> {
    theirs.iter().map(|one| (one.righted_deg, one.mm)).collect()
}

#[test]
fn standard_nodes_are_roboticia_s() {
    let Some(python) = python("rplidar", "standard_nodes_are_roboticia_s") else { return };
    let mut packets = nodes(4000, 360);
    // nodes that are lost as a whole
    (0..40).for_each(|number| drop(packets.remove(3500 - 73 * number)));
    let (theirs, mine, counts) = both((&python, "roboticia", "standard"), || Device::of(0x81), &packets);
    // the last node waits for the next one, which says that it is one
    assert_eq!((theirs.len(), counts.packets), (3960, 3959));
    in_a_row(&points(&mine), &righted(&theirs), "standard, 40 nodes lost");
    let begins = theirs.iter().enumerate().filter(|(_, one)| one.is_new).map(|(number, _)| number);
    let begins: Vec<_> = begins.collect();
    // theirs begins with the first reading as well
    let lengths: Vec<_> = begins.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let my_lengths: Vec<_> = mine.iter().map(|revolution| revolution.beams.len()).collect();
    assert!(lengths.ends_with(&my_lengths), "{lengths:?} {my_lengths:?}");
}

#[test]
fn express_capsules_are_roboticia_s() {
    let Some(python) = python("rplidar", "express_capsules_are_roboticia_s") else { return };
    for most_q3 in [31, 63] {
        let packets = express(300, 12.5, most_q3);
        let (theirs, mine, counts) = both((&python, "roboticia", "express"), || Device::of(0x82), &packets);
        assert_eq!((theirs.len(), counts.packets, counts.bytes_skipped), (32 * 299, 300, 0));
        in_a_row(
            &points(&mine),
            &righted(&theirs),
            &format!("express, corrected by up to {} deg", most_q3 as f64 / 8.0),
        );
        if most_q3 == 31 {
            // as it says: one step ahead, and nothing else
            let ahead_deg = |one: &Judged| (one.deg - one.righted_deg).rem_euclid(360.0);
            assert!(theirs.iter().all(|one| ahead_deg(one) == one.step_deg));
        }
    }
}

#[test]
fn express_capsules_that_are_lost_or_damaged_are_roboticia_s() {
    let Some(python) = python("rplidar", "express_capsules_that_are_lost_or_damaged_are_roboticia_s") else { return };
    let mut packets = express(300, 12.5, 63);
    for damaged in [40, 133, 222] {
        packets[damaged][50] ^= 0x08;
    }
    let lost = [271, 211, 210, 150, 90, 60];
    lost.into_iter().for_each(|lost| drop(packets.remove(lost)));
    let (theirs, mine, counts) = both((&python, "roboticia", "express"), || Device::of(0x82), &packets);
    assert_eq!((counts.packets, counts.bad_checksums, counts.lost), (291, 3, 6));
    // theirs spreads the readings of a capsule over those that were lost behind it; here they are left out
    let kept: Vec<_> = theirs.iter().filter(|one| one.step_deg < 1.4).copied().collect();
    assert_eq!((theirs.len() - kept.len()) / 32, 5);
    in_a_row(&points(&mine), &righted(&kept), "express, 6 capsules lost and 3 damaged");
}

#[test]
fn all_kinds_of_scans_are_pyrplidar_s() {
    let Some(python) = python("pyrplidar", "all_kinds_of_scans_are_pyrplidar_s") else { return };
    for (mode, kind, packets, readings) in [
        ("standard", 0x81, nodes(4000, 360), 1),
        ("express", 0x82, express(300, 12.5, 63), 32),
        ("ultra", 0x84, ultra(150, 8.3), 96),
        ("dense", 0x85, dense(300, 12.5), 40),
    ] {
        let device = || Device { typical: Some((1, kind, 16_000)), ..Device::of(kind) };
        let (theirs, mine, counts) = both((&python, "pyrplidar", mode), device, &packets);
        let (all, ahead) = (packets.len(), usize::from(readings > 1));
        assert_eq!((theirs.len(), counts.packets), (readings * (all - ahead), (all + ahead - 1) as u64));
        // its angles are 64ths of a degree, rounded down twice on the way, and its steps 65,536ths
        let mine = points(&mine);
        let first = theirs
            .windows(3)
            .position(|three| three.iter().zip(&mine).all(|(one, other)| is_near(*one, *other)))
            .unwrap();
        let differs = theirs[first..].iter().zip(&mine).find(|(one, other)| !is_near(**one, **other));
        assert!(differs.is_none(), "{mode}: {differs:?}");
        println!("{mode}: {} of {} readings equal to pyrplidar's, angles to 0.034 deg", mine.len(), theirs.len());
    }
}

fn is_near(one: Judged, (deg, mm): (f64, f64)) -> bool {
    let off_deg = (one.deg - deg + 180.0).rem_euclid(360.0) - 180.0;
    one.mm == mm && off_deg.abs() <= 0.034
}
