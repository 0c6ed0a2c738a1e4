//! Bytes that an LD06 has sent: recordings of the crate `ld06` (see `data/README.md`). What is expected was computed by `check_ld06.py`, a decoder of
//! its own.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests may")]

use mapwright_geom::{Pose2, Stamp};
use mapwright_lidars::{Counts, Fan, Ld06, Revolution};

fn decoded(bytes: &[u8]) -> (Vec<Revolution>, Counts) {
    let mut lidar = Ld06::new();
    let mut revolutions = Vec::new();
    // 23,040 bytes a second, read every 16 ms
    for (number, piece) in bytes.chunks(369).enumerate() {
        lidar.receive(piece, Stamp(1_000_000_000 + 16_000_000 * number as i64));
        revolutions.extend(std::iter::from_fn(|| lidar.next_scan()));
    }
    (revolutions, *lidar.counts())
}

/// Sums over the beams of whole revolutions: how many, hundredths of a degree clockwise in 11ths, millimetres, intensities.
fn sums(revolutions: &[Revolution]) -> [u64; 4] {
    let mut sums = [0; 4];
    for beam in revolutions.iter().flat_map(|revolution| &revolution.beams) {
        let deg = (-beam.bearing_rad.to_degrees()).rem_euclid(360.0);
        let all =
            [1, (deg * 1100.0).round() as u64 % 396_000, (beam.range_m * 1000.0).round() as u64, beam.intensity.into()];
        sums.iter_mut().zip(all).for_each(|(sum, one)| *sum += one);
    }
    sums
}

fn check(bytes: &[u8], packets: u64, revolutions: usize, expected: [u64; 4]) -> Vec<Revolution> {
    let (all, counts) = decoded(bytes);
    println!("{counts}; {} bytes of {}", counts.bytes_used, bytes.len());
    assert_eq!((counts.packets, all.len()), (packets, revolutions), "{counts:?}");
    assert_eq!(counts.bytes_received, bytes.len() as u64);
    assert_eq!(counts.bytes_used, 47 * packets);
    assert_eq!(sums(&all), expected);
    all
}

const FIRST: &[u8] = include_bytes!("data/ld06-2.bin");
const SECOND: &[u8] = include_bytes!("data/ld06-3.bin");

#[test]
fn all_good_packets_of_the_longer_recording() {
    let all = check(FIRST, 8441, 221, [100_457, 19_895_855_510, 220_316_712, 22_370_316]);
    assert_eq!(decoded(FIRST).1.lost, 11_600, "the recording has been put together of three");
    for revolution in &all {
        assert!((0.095..0.105).contains(&revolution.duration_s), "{}", revolution.duration_s);
        assert!((400..=460).contains(&revolution.beams.len()), "{}", revolution.beams.len());
    }
}

#[test]
fn all_good_packets_of_the_shorter_recording() {
    check(SECOND, 863, 22, [9998, 1_979_180_088, 21_913_836, 2_228_391]);
}

#[test]
fn a_recording_that_a_terminal_has_spoilt_has_nothing() {
    let (all, counts) = decoded(include_bytes!("data/ld06-bad.bin"));
    assert_eq!((all.len(), counts.packets, counts.implausible), (0, 0, 1));
    assert_eq!(counts.bytes_used, 0);
}

#[test]
fn another_lidar_is_said() {
    let mut lidar = Ld06::new();
    lidar.receive(&[0x55; 5000], Stamp(0));
    assert!(lidar.problem().unwrap().contains("another speed of the line"));
    lidar.receive(FIRST, Stamp(0));
    assert_eq!(lidar.problem(), None);
}

#[test]
fn fans_keep_what_was_read() {
    let (all, _) = decoded(FIRST);
    let mut fan = Fan::new("ld06", Pose2::IDENTITY, [0.02, 12.0]);
    let (mut readings, mut kept, mut worst_rad, mut lasers) = (0, 0, 0.0_f64, 1);
    let mut last = None;
    assert_eq!(decoded(FIRST).1.lost, 11_600, "the recording has been put together of three");
    for revolution in &all {
        let scan = fan.scan(revolution);
        scan.laser.check(scan.ranges_m.len()).unwrap();
        lasers += usize::from(last.is_some_and(|last| !std::sync::Arc::ptr_eq(&last, &scan.laser)));
        last = Some(scan.laser.clone());
        readings += revolution.beams.len();
        kept += scan.ranges_m.iter().filter(|range| !range.is_nan()).count();
        let step = 0.5 * scan.laser.angle_step_rad.abs();
        worst_rad = worst_rad.max(step);
    }
    println!(
        "{readings} readings, {kept} in fans, bearings off by {:.3} deg at most, {lasers} lasers",
        worst_rad.to_degrees()
    );
    assert_eq!(readings as u64, kept as u64 + fan.crowded_out());
    assert!(fan.crowded_out() * 200 < readings as u64, "{}", fan.crowded_out());
    assert!(worst_rad < 0.11_f64.to_radians());
}

#[test]
fn a_pulled_cable_costs_what_was_on_it() {
    let mut lidar = Ld06::new();
    let mut revolutions = 0;
    let halves = [&SECOND[..20_000], &SECOND[23_111..]];
    for (number, half) in halves.into_iter().enumerate() {
        if number > 0 {
            lidar.restart();
        }
        lidar.receive(half, Stamp(5_000_000_000 * number as i64));
        revolutions += std::iter::from_fn(|| lidar.next_scan()).count();
    }
    let counts = lidar.counts();
    assert_eq!((counts.restarts, counts.lost), (1, 0));
    assert_eq!(counts.bytes_used + counts.bytes_skipped + 19, counts.bytes_received);
    assert!(revolutions >= 18, "{revolutions}: {counts}");
}
