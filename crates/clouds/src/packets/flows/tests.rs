//! Captures of a Velodyne, and what of its clouds.

use super::*;
use crate::packets::sweep::TURN;
use crate::packets::window::in_memory::File;
use proptest::prelude::*;

const FLAG: [u8; 2] = [0xff, 0xee];
/// Both the strongest and the last return.
const DUAL: u8 = 0x39;
const HOUR_US: i64 = 3_600_000_000;

/// A packet whose blocks turn by 0.4 degrees each; every laser sees the given distances in turn.
fn payload(first: u32, distances: [u16; 2], sensor_us: u32, mode: u8, product: u8) -> Vec<u8> {
    let mut payload = Vec::new();
    for block in 0..12_u32 {
        let place = if mode == DUAL { block / 2 } else { block };
        payload.extend(FLAG);
        payload.extend((((first + 40 * place) % TURN) as u16).to_le_bytes());
        let distance = distances[block as usize % 2];
        (0..32).for_each(|_| payload.extend([distance as u8, (distance >> 8) as u8, 9]));
    }
    payload.extend(sensor_us.to_le_bytes());
    payload.extend([mode, product]);
    payload
}

fn capture(payloads: &[Vec<u8>], us_apart: u32) -> Vec<u8> {
    let mut file: Vec<u8> =
        [0xa1b2_c3d4_u32, 0x0004_0002, 0, 0, 65_535, 1].into_iter().flat_map(u32::to_le_bytes).collect();
    for (at, payload) in payloads.iter().enumerate() {
        let mut packet = vec![0; 12];
        packet.extend([8, 0, 0x45, 0, 0, 0, 0, 0, 0, 0, 64, 17, 0, 0, 192, 168, 1, 201, 255, 255, 255, 255]);
        packet.extend([0x09, 0x40, 0x09, 0x40]);
        packet.extend((payload.len() as u16 + 8).to_be_bytes());
        packet.extend([0, 0]);
        packet.extend(payload);
        let time_us = at as u32 * us_apart;
        let head = [100 + time_us / 1_000_000, time_us % 1_000_000, packet.len() as u32, packet.len() as u32];
        file.extend(head.into_iter().flat_map(u32::to_le_bytes));
        file.extend(packet);
    }
    file
}

fn surveyed(bytes: &[u8]) -> Option<Survey> {
    let file = File(bytes);
    survey(&mut Window::open(&file, "a.pcap"), Capture::begin(bytes)?, None).unwrap()
}

fn sweeps(bytes: &[u8]) -> (Vec<Sweep>, Notes) {
    let mut notes = Notes::default();
    let Some(survey) = surveyed(bytes) else { return (Vec::new(), notes) };
    let file = File(bytes);
    let window = Window::open(&file, "a.pcap");
    let Ok(mut sweeps) = Sweeps::new(window, Capture::begin(bytes).unwrap(), &survey) else {
        return (Vec::new(), notes);
    };
    let all: Vec<Sweep> = std::iter::from_fn(|| sweeps.next(&mut notes)).collect();
    assert_eq!(all.len(), survey.sweeps);
    assert!(all.iter().all(|sweep| sweep.points_m.len() == sweep.times_s.len()));
    (all, notes)
}

/// A VLP-16 of 4.8 degrees a packet: 75 of them are a turn.
fn turning(packets: u32) -> Vec<Vec<u8>> {
    (0..packets).map(|at| payload(480 * at, [500; 2], 3_599_990_000 + 1327 * at, 0x37, 0x22)).collect()
}

#[test]
fn a_revolution_is_a_cloud_and_the_hour_may_end() {
    let mut payloads = turning(160);
    for (at, payload) in payloads.iter_mut().enumerate() {
        let us = ((3_599_990_000 + 1327 * at as i64) % HOUR_US) as u32;
        payload[1200..1204].copy_from_slice(&us.to_le_bytes());
    }
    let (sweeps, notes) = sweeps(&capture(&payloads, 1327));
    assert_eq!(sweeps.iter().map(|sweep| sweep.points_m.len()).collect::<Vec<_>>(), [28_800, 28_800, 3840]);
    assert_eq!((notes.count(NoteKind::PartialRevolution), notes.count(NoteKind::ClockJump)), (1, 0));
    assert_eq!(sweeps[1].stamp.secs_since(sweeps[0].stamp), 75.0 * 1327e-6);
    let first = &sweeps[0];
    assert_eq!(first.times_s[..2], [0.0, 2.304e-6]);
    assert!((first.times_s[28_799] - (74.0 * 1327e-6 + 11.0 * 110.592e-6 + 55.296e-6 + 15.0 * 2.304e-6)).abs() < 1e-7);
    // the same of all says nothing
    assert!(first.intensities.is_empty());
    // laser 0 looks down by 15 degrees and starts 11.2 mm above the origin
    let [x, y, z] = first.points_m[0].map(f64::from);
    let angle = 15_f64.to_radians();
    assert!((x - angle.cos()).abs() < 1e-6 && y.abs() < 1e-6 && (z + angle.sin() - 0.0112).abs() < 1e-6);
    // a quarter of a turn to the right
    let at = first.points_m.iter().max_by(|a, b| b[1].total_cmp(&a[1])).unwrap();
    assert!(at[1] < -0.999);
}

#[test]
fn reflectivities_are_intensities() {
    let mut bright = payload(0, [500; 2], 0, 0x37, 0x22);
    bright[6] = 200;
    let (found, _) = sweeps(&capture(&[bright], 0));
    assert_eq!((found[0].intensities.len(), found[0].intensities[0]), (384, 200.0));
}

#[test]
fn silence_and_jumping_clocks_end_a_cloud() {
    let mut payloads = turning(40);
    payloads.drain(10..15);
    let mut late = payloads.clone();
    late[20..].iter_mut().for_each(|payload| payload[1200..1204].copy_from_slice(&5_u32.to_le_bytes()));
    let (_, notes) = sweeps(&capture(&payloads, 1327));
    assert_eq!((notes.count(NoteKind::MissingPackets), notes.count(NoteKind::ClockJump)), (1, 0));
    let (found, notes) = sweeps(&capture(&late, 1327));
    assert_eq!((found.len(), notes.count(NoteKind::ClockJump)), (2, 1));
}

#[test]
fn both_returns_are_points_unless_they_are_the_same() {
    for (distances, points) in [([500, 600], 384), ([500, 500], 192), ([0, 500], 192)] {
        let (found, _) = sweeps(&capture(&[payload(0, distances, 0, DUAL, 0x22)], 0));
        assert_eq!(found[0].points_m.len(), points, "{distances:?}");
    }
    let (found, _) = sweeps(&capture(&[payload(0, [500; 2], 0, 0x37, 0x21)], 0));
    let angles: Vec<f32> = found[0].points_m[..32].iter().map(|p| p[2].asin().to_degrees()).collect();
    assert!((angles[0] + 30.67).abs() < 0.01 && (angles[1] + 9.33).abs() < 0.01 && (angles[31] - 10.67).abs() < 0.01);
}

/// Laser 0 of a VLP-32C looks down by 25 degrees and 1.4 to the left, a Puck Hi-Res's down by 10; units are 4 and 2 mm.
#[test]
fn further_models_have_their_angles() {
    let first = |product| {
        let (found, _) = sweeps(&capture(&[payload(0, [500; 2], 0, 0x37, product)], 0));
        assert_eq!(found[0].points_m.len(), 384);
        (found[0].points_m[0].map(f64::from), found[0].times_s.clone())
    };
    let ([x, y, z], times_s) = first(0x28);
    let (down, left) = (25_f64.to_radians(), 1.4_f64.to_radians());
    let expected = [2.0 * down.cos() * left.cos(), 2.0 * down.cos() * left.sin(), -2.0 * down.sin()];
    assert!([x, y, z].iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6), "{x} {y} {z}");
    assert_eq!(times_s[..4], [0.0, 0.0, 2.304e-6, 2.304e-6]);
    let ([x, _, z], _) = first(0x24);
    assert!((x - 10_f64.to_radians().cos()).abs() < 1e-6 && (z + 10_f64.to_radians().sin() - 0.0074).abs() < 1e-6);
}

#[test]
fn other_models_are_named_and_a_bad_block_is_left_out() {
    let file = capture(&[payload(0, [500; 2], 0, 0x37, 0xa1)], 0);
    assert!(surveyed(&file).unwrap().sender.2.name(None).unwrap_err().contains("product 0xa1"));
    let mut bad = payload(0, [500; 2], 0, 0x37, 0x22);
    bad[100] = 0;
    bad[202..204].copy_from_slice(&40_000_u16.to_le_bytes());
    let (found, notes) = sweeps(&capture(&[bad], 0));
    assert_eq!((found[0].points_m.len(), notes.count(NoteKind::BadPacket)), (320, 2));
}

proptest! {
    #[test]
    fn any_bytes(at in prop::collection::vec(0..6400_usize, 0..20), bytes: [u8; 20], cut in 0..3000_usize, dual: bool) {
        let mode = if dual { DUAL } else { 0x38 };
        let payloads: Vec<_> = (0..5).map(|k| payload(480 * k, [500, 7], 1327 * k, mode, 0x22)).collect();
        let mut file = capture(&payloads, 1327);
        let length = file.len();
        at.iter().zip(bytes).for_each(|(at, byte)| file[at % length] = byte);
        file.truncate(length - cut);
        sweeps(&file);
    }
}
