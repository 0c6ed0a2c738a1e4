#![allow(clippy::unwrap_used, reason = "tests may")]

use super::*;
use crate::keyframe::{EdgeKind, KeyframeId};
use mapwright_geom::Cov3;
use mapwright_sensor::{LaserModel, Sweep};
use proptest::prelude::*;
use std::sync::Arc;

fn session(keyframes: u32) -> Session {
    let [near, far] = [180, 31].map(|beams| Arc::new(LaserModel::half_circle("front", beams)));
    let id = |seq| KeyframeId { robot: 7 << 90, session: 2, seq };
    let pose = |k: u32| Pose2::new(0.1 * f64::from(k), -0.3, 0.01 * f64::from(k));
    let keyframe = |k: u32| {
        let laser = if k.is_multiple_of(3) { &far } else { &near };
        let codes = (0..20 + k as u16).map(|beam| beam.wrapping_mul(4099)).collect();
        let sweep = Sweep {
            laser: Arc::clone(laser),
            codes,
            step_m: 0.002,
            twist_per_s: [0.0; 3],
            scatters: k.is_multiple_of(2),
        };
        Keyframe { id: id(k), stamp: Stamp(i64::from(k) - 3), scan: u64::from(2 * k), sweep }
    };
    let edge = |k: u32| Edge {
        from: id(k),
        to: id(k + 1),
        kind: [EdgeKind::Odometry, EdgeKind::Match, EdgeKind::Closure][k as usize % 3],
        from_from_to: pose(1),
        information: Cov3::new(4.0, 0.5, 0.25, 0.5, 3.0, -1.0, 0.25, -1.0, 9.0),
    };
    let scan =
        |k: u32| SessionScan { stamp: Stamp(i64::from(k)), map_from_robot: pose(k), odom_from_robot: pose(k + 9) };
    Session {
        settings: "{\"a\": 1}".to_owned(),
        scans: (0..2 * keyframes).map(scan).collect(),
        keyframes: (0..keyframes).map(keyframe).collect(),
        map_from_keyframe: (0..keyframes).map(pose).collect(),
        edges: (0..keyframes.saturating_sub(1)).map(edge).collect(),
    }
}

#[test]
fn a_session_reads_back_to_the_bit() {
    for keyframes in [0, 1, 7] {
        let session = session(keyframes);
        let bytes = session.encode();
        assert_eq!(Session::decode(&bytes).unwrap(), session);
        assert_eq!(Session::decode(&bytes).unwrap().encode(), bytes);
    }
    let lasers: Vec<_> = Session::decode(&session(7).encode()).unwrap().keyframes;
    assert!(Arc::ptr_eq(&lasers[0].sweep.laser, &lasers[3].sweep.laser), "keyframes share their lasers");
}

#[test]
fn an_edge_to_nowhere_is_left_out() {
    let mut session = session(3);
    session.edges[0].to.session = 99;
    assert_eq!(Session::decode(&session.encode()).unwrap().edges, session.edges[1..]);
}

#[test]
fn every_cut_and_every_flip_is_told() {
    let bytes = session(4).encode();
    for length in 0..bytes.len() {
        assert!(Session::decode(&bytes[..length]).is_err(), "{length}");
    }
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(Session::decode(&damaged).is_err(), "{at}");
    }
    assert!(Session::decode(&[&bytes[..], b"more"].concat()).is_err());
}

#[test]
fn errors_name_the_byte_what_was_expected_and_what_was_found() {
    let bytes = session(2).encode();
    let error = |bytes: &[u8]| Session::decode(bytes).unwrap_err().to_string();
    assert_eq!(error(b"P5 3 3"), "byte 0: expected a session of mapwright, found something else");
    let newer = [&bytes[..18], &[9, 0], &bytes[20..]].concat();
    assert_eq!(error(&newer), "byte 18: expected version 1 of the session's encoding, found 9");
    assert_eq!(error(&bytes[..30]), "byte 24: expected the settings, found the end of the file after 2 bytes");
    let many = [&bytes[..32], &u32::MAX.to_le_bytes(), &bytes[36..]].concat();
    assert!(error(&many).starts_with("byte 32: expected the lasers, found the end of the file after "));
}

proptest! {
    #[test]
    fn any_bytes_are_a_session_or_an_error(tail in prop::collection::vec(any::<u8>(), 0..400), keep in 0_usize..900) {
        let bytes = session(2).encode();
        let mut mixed = bytes[..keep.clamp(20, bytes.len())].to_vec();
        mixed.extend(tail);
        let _ = Session::decode(&mixed);
        let sealed = [&mixed[..], &crc32fast::hash(&mixed).to_le_bytes()].concat();
        if let Ok(read) = Session::decode(&sealed) {
            prop_assert_eq!(Session::decode(&read.encode()).ok(), Some(read));
        }
    }
}
