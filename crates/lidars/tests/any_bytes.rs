//! Any bytes in any pieces: the same revolutions as in one piece, no panic, and every byte accounted for.
#![allow(clippy::unwrap_used, reason = "tests may")]

mod support;

use mapwright_geom::Stamp;
use mapwright_lidars::{Counts, Ld06, Lidar, Revolution, Rplidar, ScanMode, Udp};
use proptest::prelude::*;
use support::{Device, Talk};

const RECORDED: &[u8] = include_bytes!("data/ld06-3.bin");

/// Real bytes with damage: bytes that change, are lost or come in addition.
fn damaged(bytes: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let edits = proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>(), 0..3_u8), 0..20);
    edits.prop_map(move |edits| {
        let mut bytes = bytes.clone();
        for (at, byte, how) in edits {
            let at = at.index(bytes.len());
            match how {
                0 => bytes[at] = byte,
                1 => drop(bytes.remove(at)),
                _ => bytes.insert(at, byte),
            }
        }
        bytes
    })
}

fn pieces() -> impl Strategy<Value = Vec<usize>> {
    proptest::collection::vec(1..200_usize, 1..30)
}

fn in_pieces(bytes: &[u8], sizes: &[usize], mut take: impl FnMut(&[u8])) {
    let (mut rest, mut sizes) = (bytes, sizes.iter().cycle());
    while !rest.is_empty() {
        let (piece, later) = rest.split_at((*sizes.next().unwrap()).min(rest.len()));
        take(piece);
        rest = later;
    }
}

fn ld06(bytes: &[u8], sizes: &[usize]) -> (Vec<Revolution>, Counts) {
    let mut lidar = Ld06::new();
    in_pieces(bytes, sizes, |piece| lidar.receive(piece, Stamp(7)));
    let all = std::iter::from_fn(|| lidar.next_scan()).collect();
    let waiting = lidar.counts().bytes_received - lidar.counts().bytes_used - lidar.counts().bytes_skipped;
    assert!(waiting < 47);
    (all, *lidar.counts())
}

fn rplidar(kind: u8, bytes: &[u8], sizes: &[usize]) -> (Vec<Revolution>, Counts) {
    let mode = if kind == 0x81 { ScanMode::Standard } else { ScanMode::Typical };
    let mut talk = Talk::new(Rplidar::of(mode), Device { typical: Some((1, kind, 30_000)), ..Device::of(kind) });
    talk.begin(100);
    let now = talk.now;
    in_pieces(bytes, sizes, |piece| talk.lidar.receive(piece, now));
    let counts = *talk.lidar.counts();
    assert!(counts.bytes_received - counts.bytes_used - counts.bytes_skipped < 140, "{counts:?}");
    talk.lidar.restart();
    let after = *talk.lidar.counts();
    assert_eq!(after.bytes_received, after.bytes_used + after.bytes_skipped);
    (talk.revolutions(), counts)
}

fn of_kind(kind: u8) -> Vec<u8> {
    match kind {
        0x81 => support::nodes(900, 360),
        0x82 => support::express(40, 12.5, 63),
        0x84 => support::ultra(30, 8.3),
        _ => support::dense(40, 12.5),
    }
    .concat()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn ld06_in_any_pieces(bytes in damaged(RECORDED[..9000].to_vec()), sizes in pieces()) {
        prop_assert_eq!(ld06(&bytes, &sizes), ld06(&bytes, &[usize::MAX]));
    }

    #[test]
    fn ld06_of_any_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..400), sizes in pieces()) {
        prop_assert_eq!(ld06(&bytes, &sizes), ld06(&bytes, &[usize::MAX]));
    }

    #[test]
    fn rplidar_in_any_pieces(
        (kind, bytes) in (0x81..=0x85_u8).prop_filter("no such answer", |kind| *kind != 0x83)
            .prop_flat_map(|kind| (Just(kind), damaged(of_kind(kind)))),
        sizes in pieces(),
    ) {
        let (all, counts) = rplidar(kind, &bytes, &sizes);
        prop_assert_eq!((all, counts), rplidar(kind, &bytes, &[usize::MAX]));
        prop_assert!(counts.packets > 10);
    }

    #[test]
    fn rplidar_of_any_bytes(kind in 0x81..=0x82_u8, bytes in proptest::collection::vec(any::<u8>(), 0..600), sizes in pieces()) {
        prop_assert_eq!(rplidar(kind, &bytes, &sizes), rplidar(kind, &bytes, &[usize::MAX]));
    }

    #[test]
    fn an_rplidar_that_answers_anything(
        answers in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..40), 0..40),
        steps_ms in proptest::collection::vec(1..3000_i64, 1..20),
    ) {
        let (mut lidar, mut now, mut steps) = (Rplidar::new(), Stamp(0), steps_ms.iter().cycle());
        for answer in answers {
            now.0 += steps.next().unwrap() * 1_000_000;
            while lidar.next_request(now).is_some() {}
            lidar.receive(&[&[0xA5, 0x5A][..], &answer].concat(), now);
        }
        lidar.restart();
        prop_assert_eq!(lidar.counts().bytes_received, lidar.counts().bytes_used + lidar.counts().bytes_skipped);
    }

    #[test]
    fn datagrams_of_any_bytes(datagrams in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..1300), 0..10)) {
        let mut lidar = Lidar::Udp(Box::new(Udp::new()));
        datagrams.iter().for_each(|datagram| lidar.receive(datagram, Stamp(0)));
        let counts = lidar.counts();
        prop_assert_eq!(counts.bytes_received, counts.bytes_used + counts.bytes_skipped);
    }
}
