//! Small recordings of every kind, and what is wrong with them.

#![allow(clippy::unwrap_used, reason = "tests say what they expect by unwrapping it")]

mod common;

use common::memory::Memory;
use mapwright_clouds::{
    CameraOptions, CloudError, Folder, Kind, NoteKind, Notes, Recording, ReferenceFrame, recognise,
};
use mapwright_geom::Stamp;
use mapwright_sensor::Cloud;
use nalgebra::Vector3;
use proptest::prelude::*;

fn bin(points: u32) -> Vec<u8> {
    (0..points).flat_map(|k| [k as f32, 1.0, 2.0, 0.5].into_iter().flat_map(f32::to_le_bytes)).collect()
}

fn png(width: u32, height: u32, depth: u16) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let data: Vec<u8> = (0..width * height).flat_map(|_| depth.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
    file
}

fn rgb(width: u32, height: u32) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    let data: Vec<u8> = (0..width * height).flat_map(|_| [1, 2, 3]).collect();
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
    file
}

fn pcd(x: f64, fields: &str, types: &str, row: &str) -> String {
    let sizes = types.replace('F', "8").replace('U', "4");
    format!(
        "FIELDS x y z{fields}\nSIZE 4 4 4{sizes}\nTYPE F F F{types}\nWIDTH 2\nHEIGHT 1\nDATA ascii\n{x} 0 0{row}\n{x} 1 0{row}5\n"
    )
}

const POSE: &str = "1 0 0 3\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";

fn kitti() -> Memory<'static> {
    Memory::default()
        .with("velodyne/000000.bin", bin(3))
        .with("velodyne/000001.bin.zst", zstd::encode_all(bin(4).as_slice(), 3).unwrap())
        .with("velodyne/000002.bin", bin(5))
        .with("times.txt", "0.000000e+00\n1.036224e-01\n2.072448e-01\n")
        .with("calib.txt", "P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 0 -1 0 0 0 0 -1 0 1 0 0 -0.3\n")
        .with("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n1 0 0 0 0 1 0 0 0 0 1 2\n")
}

fn tum() -> Memory<'static> {
    Memory::default()
        .with(
            "depth.txt",
            "# file: 'rgbd_dataset_freiburg1_desk.bag'\n1.00 depth/a.png\n1.03 depth/b.png\n1.02 depth/c.png\n",
        )
        .with("rgb.txt", "0.99 rgb/a.png\n1.10 rgb/b.png\n")
        .with("groundtruth.txt", "# g\n1.0 1 2 3 0 0 0 1\n1.1 1 2 3 0 0 0 0\n")
        .with("depth/a.png", png(8, 6, 5000))
        .with("depth/b.png", png(8, 6, 10000))
        .with("depth/c.png", png(8, 6, 0))
        .with("rgb/a.png", rgb(8, 6))
        .with("rgb/b.png", rgb(8, 6))
}

fn seven_scenes() -> Memory<'static> {
    Memory::default()
        .with("frame-000000.depth.png", png(8, 6, 1500))
        .with("frame-000000.color.png", rgb(8, 6))
        .with("frame-000000.pose.txt", POSE)
        .with("frame-000003.depth.png", png(8, 6, 65535))
        .with("frame-000003.color.jpg", "no image")
        .with("frame-000003.pose.txt", "nan nan nan nan")
        .with("camera-intrinsics.txt", "10 0 4\n0 10 3\n0 0 1\n")
}

fn open3d() -> Memory<'static> {
    Memory::default()
        .with("depth9.png", png(8, 6, 1000))
        .with("depth10.png", png(8, 6, 2000))
        .with("color9.png", rgb(8, 6))
        .with("color10.png", rgb(4, 6))
        .with("camera.json", r#"{"width":8,"height":6,"intrinsic_matrix":[10,0,0,0,10,0,4,3,1]}"#)
        .with("trajectory.log", format!("9 9 10\n{POSE}10 10 11\n{POSE}"))
}

fn files() -> Memory<'static> {
    Memory::default()
        .with("1305031453.5.pcd", pcd(1.0, " timestamp", " F", " 1305031453.5"))
        .with("1305031453.75.pcd", pcd(2.0, " t", " U", " 1000"))
        .with("1305031454.25.pcd", pcd(3.0, " rgb", " U", " 66051"))
}

fn opened(folder: &dyn Folder) -> Recording<'_> {
    recognise(folder).unwrap().unwrap()
}

fn read(recording: &Recording<'_>) -> (Vec<Cloud>, Notes) {
    let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
    let all = std::iter::from_fn(|| clouds.next_cloud().unwrap()).collect();
    (all, clouds.notes().clone())
}

fn stamps(clouds: &[Cloud]) -> Vec<i64> {
    clouds.iter().map(|cloud| cloud.stamp.0).collect()
}

#[test]
fn kitti_has_times_and_poses_of_the_lidar() {
    let folder = kitti();
    let recording = opened(&folder);
    assert_eq!((recording.kind(), recording.frames()), (Kind::Kitti, 3));
    let (clouds, notes) = read(&recording);
    assert_eq!(stamps(&clouds), [0, 103_622_400, 207_244_800]);
    assert_eq!(clouds.iter().map(|cloud| cloud.points_m.len()).collect::<Vec<_>>(), [3, 4, 5]);
    let reference = &recording.references()[0];
    assert_eq!(reference.frame, ReferenceFrame::FromCamera);
    // a metre along the camera's z is a metre along the lidar's x
    assert!((reference.poses[1].1.translation - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-9);
    assert_eq!((notes, recording.notes()), (Notes::default(), &Notes::default()));
}

#[test]
fn kitti_with_holes() {
    let folder = kitti()
        .with("velodyne/000004.bin", bin(2)[..30].to_vec())
        .with("velodyne/000005.bin.zst", *b"\x28\xb5\x2f\xfdxxxxxxxx")
        .with("velodyne/000006.bin", "")
        .with("calib.txt", "P0: 1\n")
        .with("times.txt", "0.2\nx\n0.3\n0.4\n0.5\n0.6\n0.7\n");
    let recording = opened(&folder);
    let count = |kind| recording.notes().count(kind);
    assert_eq!(
        [count(NoteKind::MissingFrame), count(NoteKind::BadRow), count(NoteKind::Unstamped)],
        [1, 1, 1],
        "{:?}",
        recording.notes()
    );
    assert_eq!(recording.references().len(), 0);
    assert_eq!(count(NoteKind::FileNotUsed), 2, "{:?}", recording.notes());
    let (clouds, notes) = read(&recording);
    assert_eq!(clouds.iter().map(|cloud| cloud.points_m.len()).collect::<Vec<_>>(), [3, 4, 5, 1, 0]);
    for kind in [NoteKind::Truncated, NoteKind::UnreadableFrame, NoteKind::EmptyCloud] {
        assert_eq!(notes.count(kind), 1, "{kind}: {notes:?}");
    }
    let note = &notes.kinds[&NoteKind::Truncated].first[0];
    assert_eq!((note.file.as_str(), note.offset_bytes), ("velodyne/000004.bin", 16));
}

#[test]
fn times_may_end_early_and_run_backwards() {
    let folder = kitti().with("times.txt", "5.0\n4.0\n");
    let recording = opened(&folder);
    assert_eq!(recording.notes().count(NoteKind::Unstamped), 1);
    let (clouds, notes) = read(&recording);
    assert_eq!(stamps(&clouds), [5_000_000_000, 4_000_000_000, 4_100_000_000]);
    assert_eq!(notes.count(NoteKind::BackwardStamp), 1);
}

#[test]
fn foreign_bins_are_refused_with_their_place() {
    let folder = Memory::default().with("000000.bin", "this is the text of something else, not points of anything");
    let error = recognise(&folder).unwrap_err().to_string();
    assert!(error.contains("000000.bin, byte 0: expected points as float32"), "{error}");
}

#[test]
fn tum_finds_colours_within_20_ms() {
    let folder = tum();
    let recording = opened(&folder);
    assert_eq!((recording.kind(), recording.frames()), (Kind::Tum, 3));
    assert_eq!(recording.notes().count(NoteKind::MissingColour), 2);
    assert_eq!(recording.notes().count(NoteKind::BadRow), 1, "a quaternion without direction");
    let (clouds, notes) = read(&recording);
    assert_eq!(clouds[0].colours[0], [1, 2, 3]);
    assert_eq!(clouds[1].colours.len(), 0);
    assert!((clouds[1].points_m[9][2] - 2.0).abs() < 1e-6);
    assert!(clouds[2].points_m.iter().all(|point| point[2].is_nan()));
    assert_eq!(notes.count(NoteKind::BackwardStamp), 1);
}

#[test]
fn a_camera_that_is_not_known_is_asked_for() {
    let folder = tum().with("depth.txt", "# mine\n1.00 depth/a.png\n");
    let recording = opened(&folder);
    let error = recording.clouds(&CameraOptions::default()).unwrap_err().to_string();
    assert_eq!(error, "the folder does not say the camera's focal lengths and centre: give --intrinsics FX,FY,CX,CY");
    let options = CameraOptions {
        intrinsics: Some([10.0, 10.0, 4.0, 3.0]),
        depth_scale: Some(1000.0),
        range_unit_m: None,
        baseline_m: None,
    };
    let cloud = recording.clouds(&options).unwrap().next_cloud().unwrap().unwrap();
    assert!((cloud.points_m[0][0] + 2.0).abs() < 1e-6 && (cloud.points_m[0][2] - 5.0).abs() < 1e-6);
}

/// An image for every name.
fn depths<'a>(names: &[&str], size: [u32; 2]) -> Memory<'a> {
    names.iter().fold(Memory::default(), |folder, name| folder.with(name, png(size[0], size[1], 1500)))
}

const INTRINSICS: CameraOptions =
    CameraOptions { intrinsics: Some([10.0, 10.0, 4.0, 3.0]), depth_scale: None, range_unit_m: None, baseline_m: None };

#[test]
fn one_list_of_both_kinds_of_images_is_read_in_either_order() {
    for (rows, first_ns) in [
        ("0 depth/0.png 0 rgb/0.png\n1 depth/1.png 1 rgb/1.png\n", 0),
        ("2.5 rgb/0.png 2.51 depth/0.png\n2.6 rgb/1.png 2.61 depth/1.png\nodd\n", 2_510_000_000),
    ] {
        let folder = depths(&["depth/0.png", "depth/1.png"], [8, 6]).with("rgb/0.png", rgb(8, 6));
        let folder = folder.with("associations.txt", rows);
        let recording = opened(&folder);
        assert_eq!((recording.kind(), recording.frames()), (Kind::Tum, 2));
        assert!(recording.clouds(&CameraOptions::default()).unwrap_err().to_string().contains("give --intrinsics"));
        let mut clouds = recording.clouds(&INTRINSICS).unwrap();
        let first = clouds.next_cloud().unwrap().unwrap();
        assert_eq!((first.stamp, first.colours[0]), (Stamp(first_ns), [1, 2, 3]));
        assert!((first.points_m[0][2] - 0.3).abs() < 1e-6, "5000 is a metre");
        assert_eq!(recording.notes().count(NoteKind::BadRow), u64::from(first_ns > 0));
    }
}

#[test]
fn a_numbered_folder_of_depth_is_read_by_its_camera_or_by_a_default_that_is_said() {
    let names = ["depth/00000.png", "depth/00001.png"];
    let folder = depths(&names, [8, 6]);
    let recording = opened(&folder);
    assert!(recording.clouds(&CameraOptions::default()).unwrap_err().to_string().contains("give --intrinsics"));
    let clouds = recording.clouds(&CameraOptions { depth_scale: Some(6553.5), ..INTRINSICS }).unwrap();
    let said = clouds.decisions().join("; ");
    assert!(said.contains("the camera is 10,10,4,3, as asked for") && said.contains("6553.5 is a metre"), "{said}");
    assert!(!said.contains("1000 is") && said.contains("no images in colour"), "{said}");
    assert!(clouds.doubts().is_empty() && !recording.notes().has_losses(), "depth alone is mapped");
    let folder = depths(&names, [640, 480]);
    let recording = opened(&folder);
    let clouds = recording.clouds(&CameraOptions::default()).unwrap();
    assert!(clouds.doubts()[0].contains("525,525,319.5,239.5") && clouds.doubts()[0].contains("--intrinsics"));
    let of_lidar = depths(&names, [8, 6]).with("velodyne/000000.bin", bin(3));
    assert_eq!(opened(&of_lidar).kind(), Kind::Kitti);
}

#[test]
fn missing_colours_are_said_and_no_loss() {
    let folder = tum();
    let recording = opened(&folder);
    assert_eq!(recording.notes().count(NoteKind::MissingColour), 2);
    assert!(!NoteKind::MissingColour.loses_data());
}

#[test]
fn sweeps_of_nuscenes_have_five_floats_and_stamps_in_their_names() {
    let five: Vec<u8> =
        (0..300).flat_map(|k| [k as f32 * 0.1, 1.0, 2.0, 9.0, 31.0].into_iter().flat_map(f32::to_le_bytes)).collect();
    let name = |us: u64| format!("n008-2018-08-01__LIDAR_TOP__{us}.pcd.bin");
    let folder = Memory::default().with(&name(1_533_151_603_597_909), five.clone());
    let folder = folder
        .with(&name(1_533_151_603_547_590), five)
        .with(&name(1_533_151_603_500_000), "text of something else, twenty bytes at least");
    let recording = opened(&folder);
    assert_eq!((recording.kind(), recording.frames()), (Kind::NuScenes, 3));
    let (clouds, notes) = read(&recording);
    assert_eq!(stamps(&clouds), [1_533_151_603_547_590_000, 1_533_151_603_597_909_000]);
    assert_eq!((clouds[0].points_m.len(), clouds[0].points_m[2]), (300, [0.2, 1.0, 2.0]));
    assert_eq!(notes.count(NoteKind::UnreadableFrame), 1);
}

#[test]
fn files_in_millimetres_or_with_times_from_0_to_1_are_taken_as_such_and_said() {
    let row = |k: i32| format!("{} {} 200 {}\n", 3000 * (k % 2) - 1500, 40 * k - 4000, f64::from(k) / 199.0);
    let head = "FIELDS x y z time\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH 200\nHEIGHT 1\nDATA ascii\n";
    let cloud = head.to_owned() + &(0..200).map(row).collect::<String>();
    let folder =
        ["a0.pcd", "a1.pcd", "a2.pcd"].iter().fold(Memory::default(), |all, name| all.with(name, cloud.clone()));
    let recording = opened(&folder);
    let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
    let first = clouds.next_cloud().unwrap().unwrap();
    assert_eq!((first.points_m[0], first.times_s.last()), ([-1.5, -4.0, 0.2], Some(&0.1)));
    let said = clouds.decisions().join("; ");
    assert!(said.contains("taken for millimetres") && said.contains("shares of a sweep"), "{said}");
    let asked = CameraOptions { range_unit_m: Some(0.01), ..CameraOptions::default() };
    let first = recording.clouds(&asked).unwrap().next_cloud().unwrap().unwrap();
    assert_eq!(first.points_m[0], [-15.0, -40.0, 2.0]);
}

#[test]
fn seven_scenes_has_poses_and_holes() {
    let folder = seven_scenes();
    let recording = opened(&folder);
    assert_eq!((recording.kind(), recording.frames()), (Kind::SevenScenes, 2));
    assert_eq!(recording.references()[0].poses.len(), 1);
    assert_eq!(recording.notes().count(NoteKind::MissingFrame), 1);
    let (clouds, notes) = read(&recording);
    assert_eq!(stamps(&clouds), [0, 100_000_000]);
    assert_eq!((clouds[0].colours.len(), clouds[1].colours.len()), (48, 0));
    assert_eq!(notes.count(NoteKind::UnreadableColour), 1);
}

#[test]
fn several_sequences_are_named() {
    let folder = Memory::default()
        .with("seq-01/frame-000000.depth.png", png(8, 6, 1))
        .with("seq-02/frame-000000.depth.png", png(8, 6, 1));
    let error = recognise(&folder).unwrap_err();
    assert!(matches!(error, CloudError::Several { .. }));
    assert!(error.to_string().contains("seq-01, seq-02"), "{error}");
}

#[test]
fn open3d_sorts_as_people_count() {
    let folder = open3d();
    let recording = opened(&folder);
    assert_eq!((recording.kind(), recording.frames()), (Kind::Open3d, 2));
    let (clouds, notes) = read(&recording);
    assert_eq!(stamps(&clouds), [300_000_000, 333_333_333]);
    assert!((clouds[0].points_m[0][2] - 1.0).abs() < 1e-6);
    assert_eq!(notes.count(NoteKind::UnreadableColour), 1);
    assert_eq!(recording.references()[0].poses[1].0, Stamp(333_333_333));
}

#[test]
fn depth_of_another_kind_is_left_out() {
    let folder = open3d().with("depth10.png", png(4, 6, 1)).with("depth11.png", rgb(8, 6)).with("depth12.png", "");
    let (clouds, notes) = read(&opened(&folder));
    assert_eq!((clouds.len(), notes.count(NoteKind::UnreadableFrame)), (1, 3));
    let found: Vec<String> = notes.kinds[&NoteKind::UnreadableFrame].first.iter().map(ToString::to_string).collect();
    assert_eq!(found[0], "depth10.png, byte 16: expected 8 x 6 pixels, found 4 x 6 pixels");
    assert!(found[1].contains("expected depth as greyscale of 16 bits, found Rgb of 8 bits"), "{found:?}");
}

#[test]
fn pcd_files_bear_stamps_and_times() {
    let folder = files();
    let recording = opened(&folder);
    assert_eq!((recording.kind(), recording.frames()), (Kind::Files, 3));
    let (clouds, _) = read(&recording);
    assert_eq!(stamps(&clouds), [1_305_031_453_500_000_000, 1_305_031_453_750_000_000, 1_305_031_454_250_000_000]);
    assert!((clouds[0].times_s[1] - 0.05).abs() < 1e-3 || clouds[0].times_s.is_empty());
    assert_eq!(clouds[1].times_s, [1e-6, 10_005e-9]);
    assert_eq!(clouds[2].colours[0], [1, 2, 3]);
}

#[test]
fn files_without_stamps_take_those_of_their_points() {
    let row = |x: f64, t: &str| pcd(x, " timestamp", " F", t);
    let folder =
        Memory::default().with("b/a10.pcd", row(2.0, " 1305031460.2")).with("b/a9.pcd", row(1.0, " 1305031459.2"));
    let (clouds, _) = read(&opened(&folder));
    assert_eq!(clouds[0].points_m[0][0], 1.0);
    assert!((clouds[0].stamp.as_secs_f64() - 1_305_031_459.2).abs() < 1e-6);
    assert!((clouds[0].times_s[1] - 0.05).abs() < 1e-6);
    let mut files = Memory::default().with("a1.ply", "ply\n").with("a2.ply", pcd(1.0, "", "", ""));
    let (clouds, notes) = read(&opened(&files));
    assert_eq!((stamps(&clouds), notes.count(NoteKind::UnreadableFrame)), (vec![100_000_000], 1));
    files.files.remove("a2.ply");
    let recording = opened(&files);
    let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
    assert!(matches!(clouds.next_cloud(), Err(CloudError::NoFrames { frames: 1, .. })));
}

#[test]
fn what_is_no_recording_is_none() {
    for folder in [Memory::default(), Memory::default().with("a.txt", "hello"), Memory::default().with("x", "")] {
        assert!(recognise(&folder).unwrap().is_none());
    }
    let single = Memory::default().with("map.dat", pcd(1.0, "", "", ""));
    assert_eq!(read(&opened(&single)).0.len(), 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever is torn, changed, missing or put in, all that can be read is read, and nothing panics.
    #[test]
    fn any_damage(
        kind in 0..5_usize,
        file: prop::sample::Index,
        damage in 0..5_usize,
        at: prop::sample::Index,
        bytes in prop::collection::vec(any::<u8>(), 1..40),
    ) {
        let mut folder = [kitti, tum, seven_scenes, open3d, files][kind]();
        let names: Vec<String> = folder.files.keys().cloned().collect();
        let name = file.get(&names);
        let mut content = folder.files.remove(name).unwrap();
        let at = at.index(content.len().max(1)).min(content.len());
        match damage {
            0 => content.truncate(at),
            1 => content.splice(at..(at + bytes.len()).min(content.len()), bytes).for_each(drop),
            2 => content.splice(at..at, bytes).for_each(drop),
            3 => content = bytes,
            _ => {}
        }
        if damage < 4 {
            folder.files.insert(name.clone(), content);
        }
        let options = CameraOptions { intrinsics: Some([10.0, 10.0, 4.0, 3.0]), depth_scale: None, range_unit_m: None, baseline_m: None };
        if let Ok(Some(recording)) = recognise(&folder) {
            let mut clouds = recording.clouds(&options).unwrap();
            let mut count = 0;
            while let Ok(Some(cloud)) = clouds.next_cloud() {
                prop_assert!(cloud.times_s.is_empty() || cloud.times_s.len() == cloud.points_m.len());
                prop_assert!(cloud.colours.is_empty() || cloud.colours.len() == cloud.points_m.len());
                count += 1;
            }
            prop_assert!(count <= recording.frames());
        }
    }

    #[test]
    fn any_file_alone(bytes: Vec<u8>, ending in 0..8_usize) {
        let name = ["x", "0.bin", "0.bin.zst", "a.pcd", "a.ply", "a.pcap", "depth0.png", "depth.txt"][ending];
        let folder = Memory::default().with(name, bytes);
        if let Ok(Some(recording)) = recognise(&folder)
            && let Ok(mut clouds) = recording.clouds(&CameraOptions::default())
        {
            while let Ok(Some(_)) = clouds.next_cloud() {}
        }
    }
}

#[test]
fn clouds_of_another_kind_beside_those_that_are_read_are_said() {
    let mixed = kitti().with("a.pcd", pcd(1.0, "", "", "")).with("more/b.ply", "ply\n").with("notes.md", "none");
    let (recording, alone) = (opened(&mixed), kitti());
    assert_eq!(read(&recording).0.len(), read(&opened(&alone)).0.len());
    assert_eq!(opened(&alone).notes().count(NoteKind::OtherClouds), 0);
    assert_eq!(recording.notes().count(NoteKind::OtherClouds), 2);
    assert!(!NoteKind::OtherClouds.loses_data(), "what an earlier run wrote there is no loss");
}
