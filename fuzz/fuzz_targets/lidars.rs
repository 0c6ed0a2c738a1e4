//! Any bytes of lidars on a cable, in pieces of any size: no panic, every byte accounted for, and scans that can be mapped.
//! `cargo +nightly fuzz run lidars -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_geom::{Pose2, Stamp};
use mapwright_lidars::{Fan, Ld06, Lidar, Rplidar, ScanMode, Udp};

/// How far a request is answered before anything comes: an RPLIDAR that is asked to scan by any of its kinds of scans.
fn rplidar(mode: ScanMode, kind: u8) -> Lidar {
    let (mut lidar, mut now) = (Rplidar::of(mode), Stamp(0));
    let length = match kind {
        0x81 => 5,
        0x84 => 132,
        _ => 84,
    };
    let answers: [&[u8]; 4] = [
        &[0xA5, 0x5A, 20, 0, 0, 0, 4, 0x18, 29, 1, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        &[0xA5, 0x5A, 3, 0, 0, 0, 6, 0, 0, 0],
        &[0xA5, 0x5A, 4, 0, 0, 0, 0x15, 0xF4, 1, 0xFA, 0],
        &[0xA5, 0x5A, length, 0, 0, 0x40, kind],
    ];
    while lidar.next_request(now).is_some() {}
    for answer in answers {
        now.0 += 200_000_000;
        while lidar.next_request(now).is_some() {}
        lidar.receive(answer, now);
    }
    Lidar::Rplidar(Box::new(lidar))
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    let mut lidar = match first % 8 {
        0 => Lidar::Ld06(Box::new(Ld06::new())),
        1 => rplidar(ScanMode::Standard, 0x81),
        2 => rplidar(ScanMode::Express, 0x82),
        3 => rplidar(ScanMode::Express, 0x84),
        4 => rplidar(ScanMode::Express, 0x85),
        5 => Lidar::Udp(Box::new(Udp::new())),
        _ => Lidar::Rplidar(Box::new(Rplidar::new())),
    };
    let mut fan = Fan::new("fuzzed", Pose2::IDENTITY, [0.02, 12.0]);
    let mut now = Stamp(2_000_000_000);
    for piece in bytes.chunks(usize::from(first / 8) * 40 + 1) {
        now.0 += 10_000_000 * i64::from(piece[0]);
        while lidar.next_request(now).is_some() {}
        lidar.receive(piece, now);
        while let Some(revolution) = lidar.next_scan() {
            let scan = fan.scan(&revolution);
            assert!(scan.laser.check(scan.ranges_m.len()).is_ok());
            assert!(revolution.beams.iter().all(|beam| beam.range_m >= 0.0 && beam.bearing_rad.abs() <= 3.2));
        }
    }
    lidar.restart();
    assert_eq!(lidar.counts().bytes_received, lidar.counts().bytes_used + lidar.counts().bytes_skipped);
});
