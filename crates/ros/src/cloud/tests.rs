use super::*;
use crate::messages::Header;
use crate::{Channel, Decoder, Encoding, TimeUnit, encode};
use mapwright_geom::Stamp;
use std::borrow::Cow;

fn field(name: &'static str, offset: u32, datatype: u8) -> PointField<'static> {
    PointField { name: Cow::Borrowed(name), offset, datatype, count: 1 }
}

/// 2 x 3 points of 32 bytes in rows of 100: a byte of padding, doubles for x, floats else, in one of both endiannesses.
fn data(big: bool) -> Vec<u8> {
    let mut data = vec![0xEE; 200];
    for index in 0..6_u16 {
        let (row, column) = (usize::from(index) / 3, usize::from(index) % 3);
        let point = &mut data[row * 100 + column * 32..][..32];
        let mut put = |at: usize, bytes: &[u8]| {
            point[at..at + bytes.len()].copy_from_slice(bytes);
            if big {
                point[at..at + bytes.len()].reverse();
            }
        };
        put(1, &f64::from(index).to_le_bytes());
        put(9, &(f32::from(index) + 0.5).to_le_bytes());
        put(13, &(-f32::from(index)).to_le_bytes());
        put(17, &[7 + index as u8]);
        put(18, &(index + 300).to_le_bytes());
        put(20, &(u32::from(index) * 10_000_000).to_le_bytes());
    }
    data
}

fn cloud(data: &[u8], big: bool) -> PointCloud2<'_> {
    let fields = vec![
        field("t", 20, 6),
        field("ring", 18, 4),
        field("intensity", 17, 2),
        field("z", 13, 7),
        field("x", 1, 8),
        field("y", 9, 7),
    ];
    PointCloud2 {
        header: Header::new(Stamp(0), "lidar"),
        height: 2,
        width: 3,
        fields,
        is_bigendian: big,
        point_step: 32,
        row_step: 100,
        data,
        is_dense: true,
    }
}

#[test]
fn points_are_found_in_any_layout_and_endianness() {
    for big in [false, true] {
        let data = data(big);
        for encoding in [Encoding::Ros1, Encoding::Cdr] {
            let bytes = encode(&cloud(&data, big), encoding).unwrap();
            let channel = Channel::new("sensor_msgs/PointCloud2", encoding, None).unwrap();
            let message = Decoder::<PointCloud2<'_>>::new(&channel).unwrap().decode(&bytes).unwrap();
            let points = Cloud::new(&message).unwrap();
            assert_eq!(points.time().unwrap().unit, TimeUnit::Nanoseconds);
            for (index, point) in points.points().enumerate() {
                let i = index as f64;
                assert_eq!(point.position, [i, i + 0.5, -i]);
                assert_eq!((point.intensity, point.ring), (7.0 + i as f32, 300 + index as u32));
                assert!((point.time_s - i * 0.01).abs() < 1e-12);
            }
            assert_eq!(points.points().count(), 6);
            assert_eq!(points.to_points().intensities, [7.0, 8.0, 9.0, 10.0, 11.0, 12.0]);
            assert_eq!(points.positions().nth(5), Some([5.0, 5.5, -5.0]));
            let mut places = Vec::new();
            points.for_each_position(|place| places.push(place));
            assert!(places.into_iter().eq(points.positions()));
        }
    }
}

#[test]
fn a_cloud_that_contradicts_itself_is_refused() {
    let data = data(false);
    let error = |message: PointCloud2<'_>| Cloud::new(&message).unwrap_err().to_string();
    let good = cloud(&data, false);
    assert_eq!(
        error(PointCloud2 { height: 3, ..good.clone() }),
        "the point cloud's data: expected 3 x 3 points of 32 bytes (296 bytes), found 200 bytes"
    );
    assert_eq!(
        error(PointCloud2 { fields: vec![field("x", 0, 7), field("y", 30, 7)], ..good.clone() }),
        "the point cloud's field `y`: expected a place within the 32 bytes of a point, found bytes 30 to 34"
    );
    assert_eq!(
        error(PointCloud2 { fields: vec![field("x", 0, 7), field("h", 4, 7)], ..good.clone() }),
        "the point cloud's fields: expected one named `y`, found `x, h`"
    );
    assert!(error(PointCloud2 { fields: vec![field("x", 0, 9)], ..good.clone() }).contains("datatype"));
    assert!(error(PointCloud2 { point_step: 0, ..good.clone() }).contains("0 bytes"));
    assert!(error(PointCloud2 { width: u32::MAX, height: u32::MAX, ..good }).contains("data"));
}

#[test]
fn an_empty_cloud_has_no_points() {
    let message = PointCloud2 { height: 0, width: 0, data: &[], row_step: 0, ..cloud(&[], false) };
    assert_eq!(Cloud::new(&message).unwrap().points().count(), 0);
}

#[test]
fn plain_floats_are_read_like_any_others() {
    let data = data(false);
    let fields = vec![field("x", 9, 7), field("y", 13, 7), field("z", 9, 7)];
    let message = PointCloud2 { fields, ..cloud(&data, false) };
    let cloud = Cloud::new(&message).unwrap();
    let mut places = Vec::new();
    cloud.for_each_position(|place| places.push(place));
    assert_eq!(places.len(), 6);
    assert!(places.into_iter().eq(cloud.positions()));
}

#[test]
fn points_come_with_times_after_the_first_and_colours() {
    let mut data = Vec::new();
    for (x, time, colour) in [(1.0_f32, -0.1_f32, 0xff10_2030_u32), (f32::NAN, f32::NAN, 0), (2.0, 0.0, 0x0001_0203)] {
        for number in [x, 2.0, 3.0, time] {
            data.extend_from_slice(&number.to_le_bytes());
        }
        data.extend_from_slice(&colour.to_le_bytes());
    }
    let fields = vec![field("x", 0, 7), field("y", 4, 7), field("z", 8, 7), field("time", 12, 7), field("rgb", 16, 7)];
    let message = PointCloud2 { height: 1, width: 3, fields, point_step: 20, row_step: 0, ..cloud(&data, false) };
    let points = Cloud::new(&message).unwrap().to_points();
    assert_eq!((points.points_m[2], points.not_finite), ([2.0, 2.0, 3.0], 1));
    assert!((points.start_s + 0.1).abs() < 1e-6 && (points.times_s[2] - 0.1).abs() < 1e-6);
    assert_eq!(points.colours, [[0x10, 0x20, 0x30], [0; 3], [1, 2, 3]]);
    assert_eq!(points.refused_time, None);

    let mut broken = data.clone();
    broken[12..16].copy_from_slice(&1e20_f32.to_le_bytes());
    let message = PointCloud2 { data: &broken, ..message };
    let points = Cloud::new(&message).unwrap().to_points();
    assert_eq!((points.times_s.len(), points.refused_time.as_deref()), (0, Some("time")));
}

#[test]
fn absolute_times_say_when_a_cloud_begins() {
    let stamp = Stamp::from_secs_f64(1_700_000_000.0);
    let mut data = Vec::new();
    for k in 0..4 {
        (0..3).for_each(|_| data.extend_from_slice(&1.0_f32.to_le_bytes()));
        data.extend_from_slice(&(1_700_000_000.5_f64 + 0.03 * f64::from(k)).to_le_bytes());
    }
    let fields = vec![field("x", 0, 7), field("y", 4, 7), field("z", 8, 7), field("timestamp", 12, 8)];
    let message = PointCloud2 {
        header: Header::new(stamp, "lidar"),
        height: 1,
        width: 4,
        fields,
        point_step: 20,
        row_step: 80,
        ..cloud(&data, false)
    };
    let points = Cloud::new(&message).unwrap().to_points();
    assert!((points.start_s - 0.5).abs() < 1e-6 && (points.times_s[3] - 0.09).abs() < 1e-6, "{points:?}");
}
