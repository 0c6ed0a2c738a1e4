//! An RPLIDAR that is simulated: what it is asked, what it answers, and what is lost on the way.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests may")]

mod support;

use mapwright_geom::Stamp;
use mapwright_lidars::{Revolution, Rplidar, ScanMode};
use support::{Device, Talk, capsule, dense, express, nodes, points, ultra};

/// What comes out where a device that scans sends these packets, one each 8 ms.
fn scanned(mode: ScanMode, device: Device, packets: &[Vec<u8>]) -> (Vec<Revolution>, Talk) {
    let mut talk = Talk::new(Rplidar::of(mode), device);
    talk.begin(400);
    assert!(talk.device.is_scanning, "{:02x?}", talk.device.heard);
    for packet in packets {
        talk.now.0 += 8_000_000;
        let now = talk.now;
        talk.lidar.receive(packet, now);
    }
    (talk.revolutions(), talk)
}

#[test]
fn it_is_asked_step_by_step() {
    let (all, talk) = scanned(ScanMode::Express, Device::of(0x82), &express(60, 12.5, 63));
    assert_eq!(talk.device.heard, [0x25, 0x50, 0x52, 0x59, 0xF0, 0x82]);
    assert_eq!(talk.dtr, Some(false));
    let info = talk.lidar.info().unwrap();
    assert_eq!((info.name(), info.firmware, talk.lidar.problem()), ("RPLIDAR A1", [1, 29], None));
    assert_eq!(all.len(), 3, "{}", talk.lidar.counts());
    let counts = talk.lidar.counts();
    assert_eq!((counts.packets, counts.bytes_skipped, counts.lost), (60, 0, 0));
    for revolution in &all {
        // 400 readings of 250 us, of which the time from capsule to capsule says nothing
        assert!((revolution.duration_s - 0.1).abs() < 0.002, "{}", revolution.duration_s);
        // corrections of up to 8 degrees tremble about zero
        assert!((385..=415).contains(&revolution.beams.len()));
    }
}

#[test]
fn its_typical_mode_is_used_where_it_is_known() {
    let typical = Device { typical: Some((2, 0x84, 16_000)), kind: 0x84, model: 0x31, ..Device::of(0x84) };
    let (all, talk) = scanned(ScanMode::Typical, typical, &ultra(40, 8.3));
    assert_eq!(talk.device.heard, [0x25, 0x50, 0x52, 0x59, 0xF0, 0x84, 0x84, 0x84, 0x82]);
    assert_eq!(all.len(), 3);
    let unknown = Device { typical: Some((3, 0x86, 8_000)), kind: 0x86, model: 0x81, ..Device::of(0x86) };
    let (all, talk) = scanned(ScanMode::Typical, unknown, &express(60, 12.5, 63));
    assert_eq!(talk.device.heard, [0x25, 0x50, 0x52, 0x59, 0xA8, 0x84, 0x84, 0x82]);
    assert_eq!(all.len(), 3);
}

#[test]
fn an_old_one_scans_as_it_can() {
    let old = Device { knows_sample_times: false, knows_express: false, ..Device::of(0x81) };
    let (all, talk) = scanned(ScanMode::Typical, old, &nodes(1500, 360));
    assert_eq!(talk.device.heard, [0x25, 0x50, 0x52, 0x59, 0xF0, 0x84, 0x82, 0x20]);
    assert_eq!((all.len(), talk.lidar.counts().timeouts), (3, 3));
}

#[test]
fn one_that_protects_itself_is_reset() {
    let mut talk = Talk::new(Rplidar::new(), Device { health: vec![2, 2, 0], ..Device::of(0x82) });
    (0..10).for_each(|_| talk.pass(50));
    assert!(talk.lidar.problem().unwrap().contains("protection stop, code 0x8001"), "{:?}", talk.lidar.problem());
    talk.begin(200);
    assert!(talk.device.is_scanning);
    assert_eq!((talk.lidar.counts().resets, talk.lidar.problem()), (2, None));
}

#[test]
fn one_that_warns_scans_and_is_heard() {
    let (all, talk) =
        scanned(ScanMode::Express, Device { health: vec![1], ..Device::of(0x82) }, &express(60, 12.5, 63));
    assert_eq!(all.len(), 3);
    assert!(talk.lidar.problem().unwrap().contains("warns of itself (code 0x8001)"));
}

#[test]
fn silence_is_said_and_tried_again() {
    let mut lidar = Rplidar::new();
    let mut now = Stamp(0);
    for _ in 0..100 {
        now.0 += 100_000_000;
        while lidar.next_request(now).is_some() {}
        lidar.receive(b"not an RPLIDAR", now);
    }
    assert!(lidar.problem().unwrap().contains("no answer within 1 s"));
    assert!(lidar.counts().timeouts >= 5);
}

#[test]
fn a_cable_that_is_put_back_is_scanned_on() {
    let (first, mut talk) = scanned(ScanMode::Express, Device::of(0x82), &express(60, 12.5, 63));
    // nothing comes any more for three seconds
    talk.device.is_scanning = false;
    (0..60).for_each(|_| talk.pass(50));
    assert_eq!((talk.lidar.counts().restarts, talk.device.is_scanning), (1, true));
    for packet in &express(60, 12.5, 63) {
        talk.now.0 += 8_000_000;
        let now = talk.now;
        talk.lidar.receive(packet, now);
    }
    assert_eq!(points(&talk.revolutions()), points(&first));
}

#[test]
fn standard_nodes_are_what_was_sent() {
    let (all, talk) = scanned(ScanMode::Standard, Device::of(0x81), &nodes(2000, 360));
    assert_eq!(all.len(), 4);
    for revolution in &all {
        assert_eq!(revolution.beams.len(), 360);
        assert!(revolution.beams.iter().any(|beam| beam.range_m == 0.0));
        assert!((revolution.duration_s - 0.18).abs() < 1e-9, "{}", revolution.duration_s);
    }
    assert_eq!(talk.lidar.counts().bytes_skipped, 0);
    // the node of 10 degrees to the right
    let beam = all[0].beams[10];
    assert!((beam.bearing_rad + 10_f64.to_radians()).abs() < 1e-12 && beam.range_m > 2.0);
}

#[test]
fn nodes_are_found_again_after_damage() {
    let sent = nodes(2000, 360);
    let mut spoilt = sent.clone();
    spoilt[700].truncate(3);
    spoilt[1200] = vec![0xFF; 7];
    let (all, talk) = scanned(ScanMode::Standard, Device::of(0x81), &spoilt);
    let (whole, _) = scanned(ScanMode::Standard, Device::of(0x81), &sent);
    let counts = talk.lidar.counts();
    assert!((1985..=1998).contains(&counts.packets), "{counts}");
    assert_eq!(counts.bad_checksums, 2);
    assert_eq!(all.len(), whole.len());
    let (all, whole) = (points(&all), points(&whole));
    assert!(all.iter().all(|point| whole.contains(point)), "no reading is made up");
}

/// Which of the capsules sent are to be left out or spoilt, and which capsules' readings must then be missing.
#[test]
fn lost_and_damaged_capsules_leave_exact_gaps() {
    for (mode, kind, sent, readings) in [
        (ScanMode::Express, 0x82, express(200, 12.5, 63), 32),
        (ScanMode::Typical, 0x85, dense(200, 12.5), 40),
        (ScanMode::Typical, 0x84, ultra(200, 8.3), 96),
    ] {
        let device = || Device { typical: Some((1, kind, 16_000)), ..Device::of(kind) };
        let (whole, talk) = scanned(mode, device(), &sent);
        assert_eq!(talk.lidar.counts().unplaced, 0);
        let mut spoilt = sent.clone();
        spoilt[60][20] ^= 0x10;
        spoilt[140].drain(30..41);
        // lost: the 90th, and the 120th and 121st
        [121, 120, 90].into_iter().for_each(|lost| drop(spoilt.remove(lost)));
        let (all, talk) = scanned(mode, device(), &spoilt);
        let counts = talk.lidar.counts();
        assert_eq!((counts.bad_checksums, counts.lost, counts.unplaced), (2, 3, 4), "{kind:#x}: {counts}");
        assert_eq!(counts.packets, 195);
        let (all, whole) = (points(&all), points(&whole));
        // gone: two for each damaged one, and the one before and all of those that were lost
        assert_eq!(whole.len() - all.len(), (2 + 2 + 2 + 3) * readings, "{kind:#x}");
        let mut rest = whole.iter();
        assert!(all.iter().all(|point| rest.any(|other| other == point)), "{kind:#x}: nothing else has changed");
    }
}

#[test]
fn a_motor_that_starts_is_no_loss() {
    let starts = (0..120_u32).map(|number| number * number * 4 % (360 * 64));
    let packets: Vec<_> = starts.enumerate().map(|(number, start)| capsule(start, number == 0, &[0; 80])).collect();
    let (all, talk) = scanned(ScanMode::Express, Device::of(0x82), &packets);
    assert!(!all.is_empty());
    assert_eq!((talk.lidar.counts().lost, talk.lidar.counts().unplaced), (0, 0));
}
