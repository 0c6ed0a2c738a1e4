//! Lidars of space: datagrams give the clouds that captures of them give.
#![allow(clippy::unwrap_used, reason = "tests may")]

use mapwright_clouds::{Lidar as Model, Notes, PacketDecoder, Place};
use mapwright_geom::Stamp;
use mapwright_lidars::{Lidar, LidarKind, Udp};

/// A packet of a VLP-16: twelve blocks a step of azimuth apart, hundredths of a degree.
fn velodyne(number: u32) -> Vec<u8> {
    let mut packet = Vec::new();
    for block in 0..12 {
        packet.extend_from_slice(&[0xFF, 0xEE]);
        packet.extend_from_slice(&(((number * 12 + block) * 40 % 36_000) as u16).to_le_bytes());
        for laser in 0..32_u32 {
            packet.extend_from_slice(&((1000 + 40 * laser + block) as u16).to_le_bytes());
            packet.push((laser * 5) as u8);
        }
    }
    packet.extend_from_slice(&(1000 + number * 1327).to_le_bytes());
    packet.extend_from_slice(&[0x37, 0x22]);
    packet
}

fn at(number: u32) -> Stamp {
    Stamp(2_000_000_000 + 1_327_000 * i64::from(number))
}

#[test]
fn datagrams_of_a_velodyne_are_its_captures() {
    let model = Model::of(&velodyne(0), None).unwrap();
    let (mut decoder, mut notes) = (PacketDecoder::new(model, None).unwrap(), Notes::default());
    let mut lidar = Lidar::new(LidarKind::Velodyne);
    let (mut clouds, mut sweeps) = (Vec::new(), Vec::new());
    for number in 0..400 {
        lidar.receive(&velodyne(number), at(number));
        lidar.receive(b"of somebody else", at(number));
        clouds.extend(lidar.next_cloud());
        decoder.add(Place { file: "capture", at: number as usize }, at(number), &velodyne(number), &mut notes);
        sweeps.extend(decoder.next_sweep());
    }
    assert_eq!(clouds.len(), 5);
    for (cloud, sweep) in clouds.iter().zip(&sweeps) {
        assert_eq!((cloud.stamp, &cloud.points_m, &cloud.times_s), (sweep.stamp, &sweep.points_m, &sweep.times_s));
        assert_eq!((cloud.sensor.name.as_str(), cloud.sensor.range_max_m), ("VLP-16", 100.0));
    }
    let counts = lidar.counts();
    assert_eq!((counts.packets, counts.revolutions, counts.bytes_skipped), (400, 5, 16 * 400));
    assert_eq!((counts.bytes_used, lidar.problem()), (1206 * 400, None));
}

#[test]
fn lost_datagrams_and_a_pulled_cable_are_counted() {
    let mut lidar = Udp::new();
    (0..200).filter(|number| *number != 50).for_each(|number| lidar.receive(&velodyne(number), at(number)));
    assert_eq!(lidar.counts().lost, lidar.notes().count(mapwright_clouds::NoteKind::MissingPackets));
    lidar.restart();
    (5000..5200).for_each(|number| lidar.receive(&velodyne(number), at(number)));
    let clouds = std::iter::from_fn(|| lidar.next_cloud()).count();
    assert_eq!((lidar.counts().restarts, lidar.counts().partial_revolutions), (1, 1));
    assert_eq!(clouds as u64, lidar.counts().revolutions);
}

const METADATA: &str = r#"{"beam_altitude_angles":[15,13,11,9,7,5,3,1,-1,-3,-5,-7,-9,-11,-13,-15],
    "beam_azimuth_angles":[4,3,2,1,4,3,2,1,4,3,2,1,4,3,2,1],"prod_line":"OS-1-16",
    "data_format":{"columns_per_frame":64,"columns_per_packet":16,"pixels_per_column":16,"udp_profile_lidar":"LEGACY"}}"#;

#[test]
fn an_ouster_asks_for_its_metadata() {
    let packet = &include_bytes!("../../../fuzz/seeds/packets/ouster_0")[1..];
    let mut lidar = Udp::new();
    lidar.receive(packet, Stamp(0));
    assert!(lidar.problem().unwrap().contains("api/v1/sensor/metadata"), "{:?}", lidar.problem());
    assert_eq!(lidar.counts().bytes_skipped, packet.len() as u64);
    let mut lidar = Udp::ouster(METADATA).unwrap();
    lidar.receive(packet, Stamp(0));
    assert_eq!((lidar.problem(), lidar.counts().packets), (None, 1));
    assert!(Udp::ouster("{}").unwrap_err().to_string().starts_with("metadata of an Ouster: "));
}
