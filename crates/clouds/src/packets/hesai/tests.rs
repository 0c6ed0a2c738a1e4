use super::*;
use proptest::prelude::*;

/// A packet whose firings turn by 0.2 degrees each; every laser sees the given distances, of both returns.
fn packet(first: u32, distances: [u16; 2], returns: u8, us: u32) -> Vec<u8> {
    let mut packet = vec![0xee, 0xff, 6, 1, 0, 0, 32, 8, 1, 4, returns, 1];
    for block in 0..8_u32 {
        let place = block / u32::from(returns);
        packet.extend((((first + 20 * place) % TURN) as u16).to_le_bytes());
        let distance = distances[block as usize % 2].to_le_bytes();
        (0..32).for_each(|_| packet.extend([distance[0], distance[1], 9, 0]));
    }
    packet.extend([0; 10]);
    packet.extend([0x37, 0, 0, 123, 1, 11, 1, 27, 57]);
    packet.extend(us.to_le_bytes());
    packet.extend([0x42, 0, 0, 0, 0]);
    packet
}

fn sweeps(packets: &[Vec<u8>]) -> (Vec<Sweep>, Notes) {
    let (mut notes, mut decoder) = (Notes::default(), Decoder::new(false));
    for (at, packet) in packets.iter().enumerate() {
        decoder.add(Place { file: "a", at }, Stamp(400_000 * at as i64), packet, &mut notes);
    }
    decoder.revolutions.cut("a", &mut notes);
    (std::iter::from_fn(|| decoder.pop()).collect(), notes)
}

#[test]
fn a_revolution_is_a_cloud() {
    let packets: Vec<_> = (0..300).map(|k| packet(160 * k, [500; 2], 1, 400 * k)).collect();
    let (found, notes) = sweeps(&packets);
    assert_eq!(found.iter().map(|sweep| sweep.points_m.len()).collect::<Vec<_>>(), [57_600, 19_200]);
    assert_eq!((notes.count(NoteKind::PartialRevolution), notes.count(NoteKind::MissingPackets)), (1, 0));
    // 2 m along y, 15 degrees up
    let [x, y, z] = found[0].points_m[0].map(f64::from);
    let up = 15_f64.to_radians();
    assert!(x.abs() < 1e-3 && (y - 2.0 * up.cos()).abs() < 1e-6 && (z - 2.0 * up.sin()).abs() < 1e-6, "{x} {y} {z}");
    // a quarter of a turn to the right is x; the last laser looks down by 16
    let last = found[0].points_m[450 * 32 + 31].map(f64::from);
    assert!((last[0] - 2.0 * 16_f64.to_radians().cos()).abs() < 1e-4 && last[2] < -0.55, "{last:?}");
    assert!((found[0].times_s[32] - found[0].times_s[0] - 50e-6).abs() < 1e-9);
    assert_eq!(found[0].intensities, [9.0; 57_600]);
}

#[test]
fn both_returns_are_points_where_they_differ() {
    assert_eq!(sweeps(&[packet(0, [500, 500], 2, 0)]).0[0].points_m.len(), 128);
    assert_eq!(sweeps(&[packet(0, [500, 600], 2, 0)]).0[0].points_m.len(), 256);
    assert_eq!(sweeps(&[packet(0, [0, 600], 2, 0)]).0[0].points_m.len(), 128);
}

#[test]
fn the_date_is_that_of_the_calendar() {
    let payload: [u8; PAYLOAD_BYTES] = packet(0, [1; 2], 1, 0).try_into().unwrap();
    assert_eq!(seconds(&payload), 1_673_400_477); // 2023-01-11 01:27:57
    let mut leap = payload;
    leap[TAIL + 13..TAIL + 16].copy_from_slice(&[100, 2, 29]);
    assert_eq!(seconds(&leap), 951_787_677); // 2000-02-29
}

#[test]
fn other_models_are_told() {
    let head = |bytes: &[u8]| Head::of(bytes);
    let mut other = packet(0, [1; 2], 1, 0);
    assert!(head(&other).unwrap().is_xt32());
    other[7] = 6;
    assert!(!head(&other).unwrap().is_xt32());
    assert_eq!(head(&other).unwrap().to_string(), "protocol 6.1, 32 lasers in 6 blocks");
    assert_eq!(head(&other[..20]), None);
}

proptest! {
    #[test]
    fn any_bytes(changes in prop::collection::vec((0..5400_usize, any::<u8>()), 0..40), cut in 0..1200_usize, bytes: Vec<u8>) {
        let mut packets: Vec<_> = (0..5).map(|k| packet(9000 * k, [500, 7], 2, 400 * k)).collect();
        for (at, byte) in changes {
            packets[at % 5][at / 5] = byte;
        }
        packets[1].truncate(cut);
        packets.push(bytes);
        let (found, _) = sweeps(&packets);
        prop_assert!(found.iter().all(|sweep| sweep.points_m.len() == sweep.times_s.len()));
    }
}
