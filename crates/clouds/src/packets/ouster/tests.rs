use super::*;
use proptest::prelude::*;

/// A sensor of 16 beams and 64 columns, all beams level, the first a quarter of a turn to the right of the column.
fn metadata(profile: &str) -> String {
    let level = [0.0; 16];
    let mut right = level;
    right[0] = 90.0;
    serde_json::json!({
        "prod_line": "OS-1-16",
        "beam_altitude_angles": level,
        "beam_azimuth_angles": right,
        "lidar_origin_to_beam_origin_mm": 20.0,
        "lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36, 0, 0, 0, 1],
        "imu_to_sensor_transform": [0, -1, 0, 5, 1, 0, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1],
        "data_format": {
            "columns_per_frame": 64, "columns_per_packet": 16, "pixels_per_column": 16, "udp_profile_lidar": profile,
        },
    })
    .to_string()
}

fn info(profile: &str) -> Arc<OusterInfo> {
    Arc::new(OusterInfo::parse(&metadata(profile)).unwrap())
}

/// The packet of a revolution's number whose first column is so far; every beam reads so many millimetres.
fn packet(info: &OusterInfo, number: u16, first: u16, range_mm: u32) -> Vec<u8> {
    let [before, behind, head, end] = info.profile.frame_bytes();
    let mut packet = vec![0; before];
    if before > 0 {
        packet[..4].copy_from_slice(&[POINTS.to_le_bytes(), number.to_le_bytes()].concat());
    }
    for column in first..first + 16 {
        let begin = packet.len();
        packet.extend((5_000_000_000 + 1_000_000 * (64 * u64::from(number) + u64::from(column))).to_le_bytes());
        packet.extend(column.to_le_bytes());
        packet.extend(if before > 0 { 1_u16 } else { number }.to_le_bytes());
        packet.resize(begin + head, 0);
        for _ in 0..16 {
            let mut reading = vec![0; info.profile.reading_bytes()];
            match info.profile {
                Profile::LowRate | Profile::LowRateDual => {
                    reading[..2].copy_from_slice(&((range_mm / 8) as u16 | 0x8000).to_le_bytes());
                }
                _ => reading[..4].copy_from_slice(&(range_mm | 0xf800_0000).to_le_bytes()),
            }
            packet.extend(reading);
        }
        packet.extend(vec![0xff; end]);
    }
    packet.extend(vec![0; behind]);
    assert_eq!(packet.len(), info.packet_bytes());
    packet
}

fn sweeps(info: &Arc<OusterInfo>, packets: &[Vec<u8>]) -> (Vec<Sweep>, Notes) {
    let (mut notes, mut decoder) = (Notes::default(), Decoder::new(info, false));
    for (at, packet) in packets.iter().enumerate() {
        decoder.add(Place { file: "a", at }, Stamp(16_000_000 * at as i64), packet, &mut notes);
    }
    decoder.cut("a", &mut notes);
    (std::iter::from_fn(|| decoder.pop()).collect(), notes)
}

const PROFILES: [&str; 5] =
    ["LEGACY", "RNG19_RFL8_SIG16_NIR16", "RNG19_RFL8_SIG16_NIR16_DUAL", "RNG15_RFL8_NIR8", "RNG15_RFL8_NIR8_DUAL"];

#[test]
fn revolutions_of_all_profiles_are_clouds_with_times() {
    for profile in PROFILES {
        let info = info(profile);
        let packets: Vec<_> = (0..6).map(|k| packet(&info, k / 4, 16 * (k % 4), 2024)).collect();
        let (found, notes) = sweeps(&info, &packets);
        assert_eq!(found.iter().map(|s| s.points_m.len()).collect::<Vec<_>>(), [1024, 512], "{profile}");
        assert_eq!((notes.count(NoteKind::PartialRevolution), notes.count(NoteKind::BadPacket)), (1, 0));
        assert_eq!((found[0].stamp, found[1].stamp), (Stamp(0), Stamp(64_000_000)));
        assert!((found[0].times_s[16] - 0.001).abs() < 1e-9);
        // column 0: the beam looks along the lidar's x, which is the sensor's -x; the first one to its left, so that y is above zero
        let near = |point: [f32; 3], expected: [f32; 3]| point.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(near(found[0].points_m[1], [-2.024, 0.0, 0.036]), "{profile} {:?}", found[0].points_m[1]);
        assert!(near(found[0].points_m[0], [-0.02, 2.004, 0.036]), "{profile} {:?}", found[0].points_m[0]);
        // a quarter of a turn later it looks to the lidar's right
        assert!(near(found[0].points_m[16 * 16 + 1], [0.0, 2.024, 0.036]), "{profile}");
    }
}

#[test]
fn both_returns_are_points_where_they_differ() {
    let info = info(PROFILES[2]);
    let mut packet = packet(&info, 0, 0, 1000);
    let reading = 32 + 12;
    packet[reading + 4..reading + 8].copy_from_slice(&1000_u32.to_le_bytes());
    packet[reading + 20..reading + 24].copy_from_slice(&3000_u32.to_le_bytes());
    assert_eq!(sweeps(&info, &[packet]).0[0].points_m.len(), 257);
}

#[test]
fn reflectivities_of_all_profiles_are_intensities() {
    for (profile, bytes) in PROFILES.into_iter().zip([&[4][..], &[4], &[3, 7], &[2], &[2, 6]]) {
        let info = info(profile);
        let mut packet = packet(&info, 0, 0, 1000);
        let [before, _, head, _] = info.profile.frame_bytes();
        let reading = before + head;
        bytes.iter().zip([200, 100]).for_each(|(at, brightness)| packet[reading + at] = brightness);
        if let Some(second) = bytes.get(1).map(|_| reading + 4) {
            packet[second..second + 2].copy_from_slice(&800_u16.to_le_bytes());
        }
        let (found, _) = sweeps(&info, &[packet]);
        assert_eq!(found[0].intensities.len(), found[0].points_m.len(), "{profile}");
        assert_eq!(found[0].intensities[..bytes.len()], [200.0, 100.0][..bytes.len()], "{profile}");
    }
}

#[test]
fn what_is_not_valid_is_left_out() {
    let info = info("LEGACY");
    let mut bad = packet(&info, 0, 0, 1000);
    let end = info.column_bytes();
    bad[end - 1] = 0;
    let far = info.columns_per_frame as u16;
    bad[end + 8..end + 10].copy_from_slice(&far.to_le_bytes());
    let (found, notes) = sweeps(&info, &[bad, vec![0; 7]]);
    assert_eq!((found[0].points_m.len(), notes.count(NoteKind::BadPacket)), (14 * 16, 1));
}

#[test]
fn packets_in_another_order_are_one_cloud_or_noted() {
    let info = info(PROFILES[3]);
    let at = |number, column| packet(&info, number, column, 2000);
    let (found, notes) = sweeps(&info, &[at(0, 16), at(0, 0), at(0, 32), at(0, 48), at(1, 0), at(0, 16), at(1, 16)]);
    assert_eq!(found.iter().map(|sweep| sweep.points_m.len()).collect::<Vec<_>>(), [1024, 512]);
    assert!(found[0].stamp.0.abs_diff(-16_000_000) < 10 && (found[0].times_s[0] - 0.016).abs() < 1e-6);
    assert_eq!((found[0].times_s[256], notes.count(NoteKind::BadPacket)), (0.0, 1));
    // the same number a second later is another revolution
    let mut late = at(0, 16);
    for column in 0..16 {
        let time = 32 + column * info.column_bytes();
        late[time..time + 8].copy_from_slice(&(5_900_000_000 + 1_000_000 * column as u64).to_le_bytes());
    }
    assert_eq!(sweeps(&info, &[at(0, 0), late]).0.len(), 2);
}

#[test]
fn a_sensor_that_looks_one_way_has_whole_clouds_of_fewer_columns() {
    let seen = |window: &str| {
        let text = metadata("LEGACY")
            .replace("\"columns_per_packet\"", &format!("\"column_window\":{window},\"columns_per_packet\""));
        OusterInfo::parse(&text).unwrap().columns_seen
    };
    assert_eq!(["[0,63]", "[10,19]", "[60,3]", "[0,64]", "[1]"].map(seen), [64, 10, 8, 64, 64]);
}

#[test]
fn inertial_packets_are_readings_in_the_sensors_frame() {
    let info = info("LEGACY");
    let mut decoder = Decoder::new(&info, false);
    let mut bytes = [1_u64, 2, 5_010_000_000].map(u64::to_le_bytes).concat();
    bytes.extend([1.0_f32, 0.0, 0.0, 180.0, 0.0, 0.0].map(f32::to_le_bytes).concat());
    assert_eq!(decoder.reading(&bytes), None, "no clock yet");
    decoder.add(Place { file: "a", at: 0 }, Stamp(0), &packet(&info, 0, 0, 1000), &mut Notes::default());
    let reading = decoder.reading(&bytes).unwrap();
    assert_eq!(reading.stamp, Stamp(10_000_000));
    // the imu's x is the sensor's y
    assert!((reading.turn_rate_rad_per_s - Vector3::y() * std::f64::consts::PI).norm() < 1e-9);
    assert!((reading.specific_force_m_per_s2.unwrap() - Vector3::y() * STANDARD_GRAVITY_M_PER_S2).norm() < 1e-9);
    assert_eq!(decoder.reading(&bytes[1..]), None);
}

#[test]
fn metadata_that_cannot_be_are_refused_in_words() {
    for (from, to, says) in [
        ("{", "", "JSON"),
        ("beam_azimuth_angles", "x", "`beam_azimuth_angles`"),
        ("\"pixels_per_column\":16", "\"pixels_per_column\":17", "found 16 and 16 of 17"),
        ("\"columns_per_frame\":64", "\"columns_per_frame\":0", "0 in a revolution"),
        ("\"columns_per_frame\":64,", "", "`columns_per_frame`"),
        ("LEGACY", "FIVE_WORD_PIXEL", "found FIVE_WORD_PIXEL: `ouster-cli"),
        ("[-1,0,0,0,0,-1", "[-1,0,0,0,0,-2", "rigid transform"),
    ] {
        let error = OusterInfo::parse(&metadata("LEGACY").replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(says), "{says}: {error}");
    }
}

proptest! {
    #[test]
    fn any_bytes(profile in 0..5_usize, changes in prop::collection::vec((0..5000_usize, any::<u8>()), 0..40), cut in 0..100_usize, bytes: Vec<u8>) {
        let info = info(PROFILES[profile]);
        let mut packets: Vec<_> = (0..5).map(|k| packet(&info, k / 4, 16 * (k % 4), 2000)).collect();
        for (at, byte) in changes {
            let packet = &mut packets[at % 5];
            let length = packet.len();
            packet[at % length] = byte;
        }
        let length = packets[0].len();
        packets[0].truncate(length - cut % 2);
        let (found, _) = sweeps(&info, &packets);
        prop_assert!(found.iter().all(|sweep| sweep.points_m.len() == sweep.times_s.len()));
        prop_assert!(is_like(&bytes) || Decoder::new(&info, false).reading(&bytes).is_none());
    }

    #[test]
    fn any_metadata(text: String, changes in prop::collection::vec((0..900_usize, any::<char>()), 0..5)) {
        let _ = OusterInfo::parse(&text);
        let mut json: Vec<char> = metadata("LEGACY").chars().collect();
        let length = json.len();
        changes.into_iter().for_each(|(at, letter)| json[at % length] = letter);
        if let Ok(info) = OusterInfo::parse(&json.into_iter().collect::<String>()) {
            let info = Arc::new(info);
            sweeps(&info, &[vec![0xff; info.packet_bytes()]]);
        }
    }
}
