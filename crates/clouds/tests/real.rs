//! Real recordings: what is read fits together by the poses that came with them.

#![allow(clippy::unwrap_used, reason = "tests say what they expect by unwrapping it")]

mod common;

use common::disk::Disk;
use common::given;
use common::memory::Memory;
use mapwright_clouds::{CameraOptions, Folder, Kind, NoteKind, Recording, ReferenceFrame, recognise};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::{Cloud, DepthImage, PinholeCamera};
use nalgebra::Vector3;
use std::collections::HashMap;

fn opened(folder: &dyn Folder) -> Recording<'_> {
    recognise(folder).unwrap().unwrap()
}

fn all(recording: &Recording<'_>) -> Vec<Cloud> {
    let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
    let all = std::iter::from_fn(|| clouds.next_cloud().unwrap()).collect();
    assert!(!clouds.notes().has_losses(), "{:?}", clouds.notes());
    all
}

/// The pose nearest to a stamp.
fn pose_at(recording: &Recording<'_>, reference: usize, stamp: Stamp) -> Pose3 {
    let poses = &recording.references()[reference].poses;
    let (found, pose) = poses.iter().min_by_key(|(other, _)| other.0.abs_diff(stamp.0)).unwrap();
    assert!(found.secs_since(stamp).abs() < 0.02);
    *pose
}

/// The median distance of points of `b` to the nearest of `a`, of those that have one within a cell of 0.5 m or beside it.
fn apart_m(a: &Cloud, b: &Cloud, a_from_b: Pose3) -> f64 {
    let place = |p: &Vector3<f64>| [0, 1, 2].map(|k| (p[k] * 2.0).floor() as i64);
    let good = |cloud: &Cloud| -> Vec<Vector3<f64>> {
        let points = cloud.points_m.iter().map(|p| Vector3::from(p.map(f64::from)));
        points.filter(|p| p.iter().all(|v| v.is_finite()) && (1.0..40.0).contains(&p.norm())).collect()
    };
    let mut cells: HashMap<[i64; 3], Vec<Vector3<f64>>> = HashMap::new();
    good(a).into_iter().for_each(|p| cells.entry(place(&p)).or_default().push(p));
    let mut distances: Vec<f64> = good(b)
        .into_iter()
        .step_by(11)
        .map(|p| a_from_b.transform(p))
        .filter_map(|p| {
            let [x, y, z] = place(&p);
            let around =
                (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])));
            let near = around.filter_map(|cell| cells.get(&cell)).flatten();
            near.map(|q| (p - q).norm()).min_by(f64::total_cmp)
        })
        .collect();
    assert!(distances.len() > 500);
    distances.sort_by(f64::total_cmp);
    distances[distances.len() / 2]
}

/// The median difference of depth where pixels of `b` fall in `a`.
fn depth_apart_m(camera: &PinholeCamera, a: &DepthImage, b: &DepthImage, a_from_b: Pose3) -> f64 {
    let directions = camera.directions();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut apart: Vec<f64> = (0..width * height)
        .step_by(37)
        .filter(|at| b.depth_m[*at] > 0.3)
        .filter_map(|at| {
            let depth = f64::from(b.depth_m[at]);
            let [x, y] = directions[at].map(f64::from);
            let p = a_from_b.transform(Vector3::new(x * depth, y * depth, depth));
            let u = (p.x / p.z * camera.focal_px[0] + camera.centre_px[0]).round();
            let v = (p.y / p.z * camera.focal_px[1] + camera.centre_px[1]).round();
            let is_inside = u >= 0.0 && v >= 0.0 && (u as usize) < width && (v as usize) < height;
            let there = is_inside.then(|| f64::from(a.depth_m[v as usize * width + u as usize]))?;
            (there > 0.0).then(|| (there - p.z).abs())
        })
        .collect();
    apart.sort_by(f64::total_cmp);
    apart[apart.len() / 2]
}

fn images(recording: &Recording<'_>, options: &CameraOptions, count: usize) -> Vec<DepthImage> {
    let mut clouds = recording.clouds(options).unwrap();
    std::iter::from_fn(|| clouds.next_depth_image().unwrap()).take(count).collect()
}

/// How far images are apart by the reference, and by standing still.
fn fit_of_images(disk: &Disk, options: &CameraOptions, [first, second]: [usize; 2]) -> [f64; 2] {
    let recording = opened(disk);
    let images = images(&recording, options, second + 1);
    let camera = recording.camera(options).unwrap().unwrap();
    let (a, b) = (&images[first], &images[second]);
    let a_from_b = pose_at(&recording, 0, a.stamp).between(pose_at(&recording, 0, b.stamp));
    [a_from_b, Pose3::identity()].map(|a_from_b| depth_apart_m(&camera, a, b, a_from_b))
}

/// How far two clouds are apart by a reference, and by standing still.
fn fit_of_clouds(recording: &Recording<'_>, reference: usize, [a, b]: [&Cloud; 2]) -> [f64; 2] {
    let a_from_b = pose_at(recording, reference, a.stamp).between(pose_at(recording, reference, b.stamp));
    [a_from_b, Pose3::identity()].map(|a_from_b| apart_m(a, b, a_from_b))
}

#[test]
fn os0_hall_fits_together_by_both_its_references() {
    let Some(disk) = given("3d_os0_hall") else { return };
    let recording = opened(&disk);
    assert_eq!((recording.kind(), recording.frames()), (Kind::Kitti, 85));
    assert_eq!(recording.notes().kinds.len(), 0, "{:?}", recording.notes());
    let clouds = all(&recording);
    assert_eq!(clouds.len(), 85);
    assert!(clouds.iter().all(|cloud| (60_000..95_000).contains(&cloud.points_m.len())));
    assert_eq!(clouds[0].stamp, Stamp(1_630_577_758_569_490_000));
    assert_eq!(recording.references().len(), 2);
    for (place, reference) in recording.references().iter().enumerate() {
        assert_eq!((reference.frame, reference.poses.len()), (ReferenceFrame::Sensor, 85));
        let [moved, still] = fit_of_clouds(&recording, place, [&clouds[37], &clouds[38]]);
        assert!(moved < 0.08 && still > 0.3, "{}: {moved} {still}", reference.file);
    }
}

/// Tr of the sequence's calib.txt, of the benchmark's page.
const KITTI00_CALIB: &str = "P0: 7.188560000000e+02 0 0 0 0 0 0 0 0 0 0 0\nTr: 4.276802385584e-04 -9.999672484946e-01 \
    -8.084491683471e-03 -1.198459927713e-02 -7.210626507497e-03 8.081198471645e-03 -9.999413164504e-01 -5.403984729748e-02 \
    9.999738645903e-01 4.859485810390e-04 -7.206933692422e-03 -2.921968648686e-01\n";

#[test]
fn kitti_poses_of_the_camera_become_those_of_the_lidar() {
    let Some(disk) = given("3d_kitti00_pair") else { return };
    assert_eq!(opened(&disk).references()[0].frame, ReferenceFrame::Camera);
    let calibrated = Memory { behind: Some(&disk), ..Memory::default() }.with("calib.txt", KITTI00_CALIB);
    let recording = opened(&calibrated);
    let clouds = all(&recording);
    assert_eq!(recording.references()[0].frame, ReferenceFrame::FromCamera);
    assert_eq!(clouds[1].stamp, Stamp(9_500_000_000));
    let [moved, still] = fit_of_clouds(&recording, 0, [&clouds[0], &clouds[1]]);
    assert!(moved < 0.05 && still > 0.07, "{moved} {still}");
}

#[test]
fn kitti_first_sixteen_have_no_times() {
    let Some(disk) = given("3d_kitti00_first16") else { return };
    let recording = opened(&disk);
    let clouds = all(&recording);
    assert_eq!((clouds.len(), clouds[15].stamp), (16, Stamp(1_500_000_000)));
    let read = recording.clouds(&CameraOptions::default()).unwrap();
    assert!(read.decisions().iter().any(|decision| decision.contains("0.1 s apart")));
}

#[test]
fn ply_pair_fits_together_by_its_true_transform() {
    let Some(disk) = given("3d_pairs/small_gicp") else { return };
    let recording = opened(&disk);
    assert_eq!((recording.kind(), recording.frames()), (Kind::Files, 2));
    let clouds = all(&recording);
    assert_eq!([clouds[0].points_m.len(), clouds[1].points_m.len()], [69_792, 69_088]);
    let text = String::from_utf8(disk.read("T_target_source.txt").unwrap()).unwrap();
    let m: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let rotation = nalgebra::Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let target_from_source = Pose3 {
        translation: Vector3::new(m[3], m[7], m[11]),
        rotation: nalgebra::UnitQuaternion::from_matrix(&rotation),
    };
    let moved = apart_m(&clouds[1], &clouds[0], target_from_source);
    let still = apart_m(&clouds[1], &clouds[0], Pose3::identity());
    assert!(moved < 0.05 && still > 0.06, "{moved} {still}");
}

#[test]
fn depth_images_fit_together_by_their_references() {
    let options = CameraOptions::default();
    for (name, kind, frames, pair, most_m, still_m) in [
        ("rgbd_tum_fr1desk9", Kind::Tum, 9, [0, 8], 0.012, 0.1),
        ("rgbd_7scenes", Kind::SevenScenes, 300, [0, 30], 0.009, 0.04),
        ("rgbd_open3d5", Kind::Open3d, 5, [0, 4], 0.007, 0.035),
    ] {
        let Some(disk) = given(name) else { continue };
        let recording = opened(&disk);
        assert_eq!((recording.kind(), recording.frames()), (kind, frames));
        let [moved, still] = fit_of_images(&disk, &options, pair);
        assert!(moved < most_m && still > still_m, "{name}: {moved} {still}");
        let cloud = recording.clouds(&options).unwrap().next_cloud().unwrap().unwrap();
        assert_eq!((cloud.points_m.len(), cloud.colours.len()), (640 * 480, 640 * 480));
    }
}

#[test]
fn tum_lists_more_images_than_are_there() {
    let Some(disk) = given("rgbd_tum_fr1desk9") else { return };
    let recording = opened(&disk);
    assert_eq!(recording.notes().count(NoteKind::MissingFrame), 586);
    assert_eq!(recording.notes().count(NoteKind::MissingColour), 0);
    assert_eq!(recording.references()[0].poses.len(), 2335);
}

#[test]
fn velodyne_captures_turn_ten_times_a_second() {
    for (name, model, sizes) in [
        ("sample_velodyne_hdl32.pcap", "HDL-32E", &[57_674, 57_669, 31_362][..]),
        ("sample_velodyne_vlp16_gps.pcap", "VLP-16", &[18_566, 18_562, 18_530, 17_828]),
    ] {
        let Some(disk) = given(&format!("lidar_mrpt/{name}")) else { continue };
        let recording = opened(&disk);
        assert_eq!((recording.kind(), recording.frames()), (Kind::Packets, sizes.len()));
        assert_eq!(recording.sensor().name, model);
        let clouds = all(&recording);
        assert_eq!(clouds.iter().map(|cloud| cloud.points_m.len()).collect::<Vec<_>>(), sizes);
        let turn_s = clouds[1].stamp.secs_since(clouds[0].stamp);
        assert!((0.095..0.115).contains(&turn_s), "{turn_s}");
        let last_s = clouds[0].times_s.iter().copied().fold(0.0, f32::max);
        assert!((turn_s - f64::from(last_s)).abs() < 0.002 && clouds[0].times_s[0] < 1e-4);
        // one revolution and the next show the same
        let apart = apart_m(&clouds[0], &clouds[1], Pose3::identity());
        assert!(apart < 0.15, "{name}: {apart}");
    }
}

/// The most points of a cloud in a slab 4 cm thick that stands upright, of those between two heights.
fn in_the_straightest_wall(cloud: &Cloud, heights_m: std::ops::Range<f32>) -> usize {
    let points: Vec<_> = cloud.points_m.iter().filter(|point| heights_m.contains(&point[2])).collect();
    let in_slab = |half_degrees: u32| {
        let (sin, cos) = (f64::from(half_degrees) * 0.5).to_radians().sin_cos();
        let mut slabs = std::collections::BTreeMap::<i64, usize>::new();
        for point in &points {
            let along = cos * f64::from(point[0]) + sin * f64::from(point[1]);
            *slabs.entry((along / 0.04).floor() as i64).or_default() += 1;
        }
        slabs.into_values().max().unwrap_or(0)
    };
    (0..360).map(in_slab).max().unwrap_or(0)
}

/// A capture and its metadata, changed.
struct Changed<'a>(&'a dyn Folder, fn(String) -> String);

impl Folder for Changed<'_> {
    fn names(&self) -> Vec<String> {
        self.0.names().into_iter().filter(|name| name.starts_with("OS-0-128")).collect()
    }

    fn read(&self, name: &str) -> std::io::Result<Vec<u8>> {
        let bytes = self.0.read(name)?;
        let is_metadata = name.ends_with(".json");
        Ok(if is_metadata { self.1(String::from_utf8(bytes).unwrap()).into_bytes() } else { bytes })
    }
}

#[test]
fn an_ousters_walls_are_straight_as_its_metadata_say_and_not_otherwise() {
    let Some(disk) = given("vendor") else { return };
    let cloud = |change| {
        let folder = Changed(&disk, change);
        let recording = recognise(&folder).unwrap().unwrap();
        assert_eq!((recording.kind(), recording.frames(), recording.has_readings()), (Kind::Packets, 1, true));
        let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
        let cloud = clouds.next_cloud().unwrap().unwrap();
        assert!(clouds.next_cloud().unwrap().is_none());
        (cloud, clouds.take_readings())
    };
    let (right, readings) = cloud(|text| text);
    // 1024 columns, 10 Hz
    let last_s = right.times_s.iter().copied().fold(0.0, f32::max);
    assert!((0.098..0.1).contains(&last_s), "{last_s}");
    assert_eq!((readings.len(), right.intensities.len()), (10, right.points_m.len()));
    // reflectivity has 8 bits, and most of a street is dark
    let dark = right.intensities.iter().filter(|intensity| **intensity < 64.0).count();
    assert!(right.intensities.iter().all(|v| (0.0..=255.0).contains(v)) && 2 * dark > right.intensities.len());
    // the car's roof is not level
    let up = readings.iter().map(|reading| reading.specific_force_m_per_s2.unwrap()).sum::<Vector3<f64>>() / 10.0;
    assert!((up.norm() - 9.8).abs() < 0.4 && up.z > 0.98 * up.norm(), "{up}");
    let walls = |cloud: &Cloud| in_the_straightest_wall(cloud, 0.0..8.0);
    let (mirrored, _) = cloud(|text| scaled(&text, "beam_azimuth_angles", -1.0));
    let (level, _) = cloud(|text| scaled(&text, "beam_altitude_angles", 0.9));
    let (right, mirrored, level) = (walls(&right), walls(&mirrored), walls(&level));
    assert!(right > 3 * mirrored && right > level, "{right}, mirrored {mirrored}, more level {level}");
}

/// Metadata with other angles.
fn scaled(text: &str, key: &str, by: f64) -> String {
    let mut json: serde_json::Value = serde_json::from_str(text).unwrap();
    for angle in json[key].as_array_mut().unwrap() {
        *angle = (angle.as_f64().unwrap() * by).into();
    }
    json.to_string()
}

#[test]
fn an_ouster_without_metadata_is_asked_for_them() {
    for name in ["vendor/OS-1-32-G_v2.1.1_1024x10.pcap", "cases/vendor_packets/ouster.pcap"] {
        let Some(disk) = given(name) else { continue };
        let error = recognise(&disk).unwrap_err().to_string();
        assert!(error.contains(".json (`curl http://SENSOR/api/v1/sensor/metadata`"), "{error}");
    }
}
