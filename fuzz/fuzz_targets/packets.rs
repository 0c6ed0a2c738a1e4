//! Any bytes as packets of a Velodyne, a Hesai and an Ouster, and as what an Ouster says of itself: no panic, and no more points than the
//! packets have readings. `cargo +nightly fuzz run packets fuzz/seeds/packets -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_clouds::{Lidar, Notes, OusterInfo, PacketDecoder, Place};
use mapwright_geom::Stamp;
use std::sync::Arc;

/// 16 beams, 64 columns a revolution.
const METADATA: &str = r#"{"beam_altitude_angles":[15,13,11,9,7,5,3,1,-1,-3,-5,-7,-9,-11,-13,-15],
    "beam_azimuth_angles":[4,3,2,1,4,3,2,1,4,3,2,1,4,3,2,1],"prod_line":"OS-1-16",
    "data_format":{"columns_per_frame":64,"columns_per_packet":16,"pixels_per_column":16,"udp_profile_lidar":"PROFILE"}}"#;
const PROFILES: [&str; 5] = [
    "LEGACY",
    "RNG19_RFL8_SIG16_NIR16",
    "RNG19_RFL8_SIG16_NIR16_DUAL",
    "RNG15_RFL8_NIR8",
    "RNG15_RFL8_NIR8_DUAL",
];

fn decode(lidar: Lidar, info: Option<&Arc<OusterInfo>>, packet_bytes: usize, bytes: &[u8]) {
    let Ok(mut decoder) = PacketDecoder::new(lidar, info) else { return };
    let mut notes = Notes::default();
    for (number, packet) in bytes.chunks(packet_bytes.max(1)).enumerate() {
        decoder.add(Place { file: "fuzz", at: number }, Stamp(1_000_000 * number as i64), packet, &mut notes);
        let _ = decoder.reading(packet);
    }
    decoder.finish("fuzz", &mut notes);
    let mut points = 0;
    while let Some(sweep) = decoder.next_sweep() {
        assert_eq!(sweep.points_m.len(), sweep.times_s.len());
        points += sweep.points_m.len();
    }
    assert!(points <= bytes.len());
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    match usize::from(*first) % 8 {
        6 => {
            if let Some(lidar) = Lidar::of(bytes.get(..1206).unwrap_or(bytes), None) {
                decode(lidar, None, 1206, bytes);
            }
            if let Some(lidar) = Lidar::of(bytes.get(..1080).unwrap_or(bytes), None) {
                decode(lidar, None, 1080, bytes);
            }
        }
        7 => {
            if let Ok(info) = OusterInfo::parse(&String::from_utf8_lossy(bytes)) {
                let (info, length) = (Arc::new(info), 1 << 16);
                let packet = vec![0xff; info.packet_bytes().min(length)];
                decode(Lidar::ouster(info.packet_bytes()), Some(&info), packet.len(), &packet);
            }
        }
        profile => {
            let Ok(info) = OusterInfo::parse(&METADATA.replace("PROFILE", PROFILES[profile % 5])) else { return };
            let info = Arc::new(info);
            decode(Lidar::ouster(info.packet_bytes()), Some(&info), info.packet_bytes(), bytes);
        }
    }
});
