use super::*;
use mapwright_ros::Cloud;

/// Two points of x, y, z, a time and an intensity.
fn points() -> Vec<u8> {
    [1.0_f32, 2.0, 3.0, 0.0, 7.0, 4.0, 5.0, 6.0, 0.1, 9.0].map(f32::to_le_bytes).concat()
}

fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    [&[number << 3 | 2, bytes.len() as u8][..], bytes].concat()
}

fn protobuf() -> Vec<u8> {
    let packed = |(place, name): (u8, &str)| {
        let offset = [&[2 << 3 | 5][..], &u32::to_le_bytes(4 * u32::from(place))].concat();
        field(5, &[field(1, name.as_bytes()), offset, vec![3 << 3, 7]].concat())
    };
    let fields = [(0, "x"), (1, "y"), (2, "z"), (3, "time"), (4, "intensity")].map(packed).concat();
    let vector = [&[3 << 3 | 1][..], &9.0_f64.to_le_bytes()].concat();
    let stride = [&[4 << 3 | 5][..], &20_u32.to_le_bytes()].concat();
    [field(1, &[8, 5, 16, 7]), field(2, b"lidar"), field(3, &field(1, &vector)), stride, fields, field(6, &points())]
        .concat()
}

fn json() -> String {
    let fields = [("x", 0), ("y", 4), ("z", 8), ("time", 12), ("intensity", 16)]
        .map(|(name, offset)| serde_json::json!({ "name": name, "offset": offset, "type": 7 }));
    serde_json::json!({
        "timestamp": { "sec": 5, "nsec": 7 },
        "frame_id": "lidar",
        "pose": { "position": { "x": 0, "y": 0, "z": 9 }, "orientation": { "x": 0, "y": 0, "z": 0, "w": 1 } },
        "point_stride": 20,
        "fields": fields,
        "data": STANDARD.encode(points()),
    })
    .to_string()
}

#[test]
fn both_encodings_are_the_same_cloud() {
    let (proto, text) = (protobuf(), json());
    let cloud = Layout::Protobuf.decode(&proto).unwrap();
    assert_eq!(cloud, Layout::Json.decode(text.as_bytes()).unwrap());
    assert_eq!((cloud.stamp, cloud.frame.as_str()), (Stamp(5_000_000_007), "lidar"));
    assert!((cloud.frame_from_points.translation.z - 9.0).abs() < 1e-12);
    let message = cloud.message().unwrap();
    let found = Cloud::new(&message).unwrap().to_points();
    assert_eq!((found.points_m, found.times_s), (vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], vec![0.0, 0.1]));
    assert_eq!(found.intensities, [7.0, 9.0]);
}

#[test]
fn damage_is_refused_or_read_and_never_ends_in_a_panic() {
    let whole = protobuf();
    for at in 0..whole.len() {
        let _ = Layout::Protobuf.decode(&whole[..at]).map(|cloud| cloud.message().map(|m| m.width));
        for byte in [0, 1, 0x7f, 0x80, 0xff] {
            let mut changed = whole.clone();
            changed[at] = byte;
            if let Ok(cloud) = Layout::Protobuf.decode(&changed)
                && let Ok(message) = cloud.message()
                && let Ok(points) = Cloud::new(&message)
            {
                let _ = points.to_points();
            }
        }
    }
    for text in ["", "{}", "[]", "{\"data\":\"?\"}", "{\"data\":\"\",\"point_stride\":0}"] {
        let cloud = Layout::Json.decode(text.as_bytes());
        assert!(cloud.is_err() || cloud.unwrap().message().is_err(), "{text}");
    }
}
