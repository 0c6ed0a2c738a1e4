//! Small folders of two cameras of every kind, and what is wrong with them.

#![allow(clippy::unwrap_used, reason = "tests say what they expect by unwrapping it")]

mod common;

use common::given;
use common::memory::Memory;
use mapwright_clouds::{CameraOptions, CloudError, Kind, NoteKind, recognise};
use mapwright_sensor::Cloud;
use proptest::prelude::*;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 80;
/// 100 px * 0.2 m / 8 px.
const DEPTH_M: f32 = 2.5;

/// A number that looks random, by its place.
fn value(x: u32, y: u32) -> u8 {
    let mixed = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2c1b_3c6d);
    (mixed >> 13) as u8
}

/// A wall that the right camera sees `shift` pixels further left, so many rows lower.
fn wall(shift: u32, lower: u32) -> Vec<u8> {
    let pixels: Vec<u8> = (0..WIDTH * HEIGHT).map(|k| value(k % WIDTH + shift, 50 + k / WIDTH - lower)).collect();
    png(&pixels, [WIDTH, HEIGHT], png::ColorType::Grayscale)
}

fn png(pixels: &[u8], [width, height]: [u32; 2], kind: png::ColorType) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(kind);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    file
}

const CALIB: &str = "P0: 100 0 79.5 0 0 100 39.5 0 0 0 1 0\nP1: 100 0 79.5 -20 0 100 39.5 0 0 0 1 0\n";

fn kitti() -> Memory<'static> {
    let poses = "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 0.5\n1 0 0 0 0 1 0 0 0 0 1 1\n";
    let folder =
        Memory::default().with("calib.txt", CALIB).with("times.txt", "0\n0.1\n0.25\n").with("poses.txt", poses);
    (0..3).fold(folder, |folder, k| {
        folder.with(&format!("image_0/00000{k}.png"), wall(0, 0)).with(&format!("image_1/00000{k}.png"), wall(8, 0))
    })
}

fn sensor(x_m: f64) -> String {
    format!(
        "T_BS:\n  cols: 4\n  rows: 4\n  data: [0, 0, 1, 0.1, -1, 0, 0, {}, 0, -1, 0, 0.5, 0, 0, 0, 1]\nresolution: [160, 80]\n\
         camera_model: pinhole\nintrinsics: [100, 100, 79.5, 39.5]\ndistortion_model: radial-tangential\n\
         distortion_coefficients: [0, 0, 0, 0]\n",
        -x_m
    )
}

fn euroc() -> Memory<'static> {
    let list = "#timestamp [ns],filename\n1000000000,1000000000.png\n1050000000,1050000000.png\n";
    let folder =
        [("cam0", 0.0, 0), ("cam1", 0.2, 8)].into_iter().fold(Memory::default(), |folder, (camera, x_m, shift)| {
            let at = |name: &str| format!("mav0/{camera}/{name}");
            folder
                .with(&at("sensor.yaml"), sensor(x_m))
                .with(&at("data.csv"), list)
                .with(&at("data/1000000000.png"), wall(shift, 0))
                .with(&at("data/1050000000.png"), wall(shift, 0))
        });
    let truth = "#timestamp, p, q\n1000000000,1,2,3,1,0,0,0,0,0\n1050000000,1.5,2,3,1,0,0,0,0,0\n";
    folder.with("mav0/state_groundtruth_estimate0/data.csv", truth)
}

#[test]
fn readings_of_imu0_come_with_the_pairs_in_the_bodys_frame() {
    let list = "#timestamp [ns],w,w,w,a,a,a\n1050000000,0,0,0.2,0,0,9.8\n990000000,0.1,0,0,1,0,9.8\nnothing\n1060000000,0,0,0,0,0,9.8\n";
    // its x is the body's z
    let mount = "T_BS:\n  cols: 4\n  rows: 4\n  data: [0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 1]\n";
    let folder = euroc().with("mav0/imu0/data.csv", list).with("mav0/imu0/sensor.yaml", mount);
    let recording = recognise(&folder).unwrap().unwrap();
    assert!(recording.has_readings() && recording.notes().count(NoteKind::BadRow) == 1);
    let mut clouds = recording.clouds(&CameraOptions::default()).unwrap();
    let mut stamps = Vec::new();
    while clouds.next_cloud().unwrap().is_some() {
        let readings = clouds.take_readings();
        for reading in &readings {
            assert!(reading.specific_force_m_per_s2.is_some_and(|force| (force.y - 9.8).abs() < 1e-9));
        }
        if let [first] = readings[..] {
            assert!((first.turn_rate_rad_per_s.z - 0.1).abs() < 1e-9, "{first:?}");
        }
        stamps.push(readings.iter().map(|reading| reading.stamp.0).collect::<Vec<_>>());
    }
    assert_eq!(stamps, [vec![990_000_000], vec![1_050_000_000, 1_060_000_000]]);
    assert!(clouds.decisions().iter().any(|words| words.contains("imu0/data.csv is used: 3 readings")));

    let folder = euroc().with("mav0/imu0/data.csv", list).with("mav0/imu0/sensor.yaml", "T_BS: 5\n");
    let recording = recognise(&folder).unwrap().unwrap();
    assert!(!recording.has_readings());
    let clouds = recording.clouds(&CameraOptions::default()).unwrap();
    assert!(clouds.decisions().iter().any(|words| words.contains("imu0/data.csv is not used")));
}

#[test]
fn raw_recordings_of_kitti_have_dates() {
    let mut folder = Memory::default();
    for k in 0..3 {
        folder = folder
            .with(&format!("image_00/data/000000000{k}.png"), wall(0, 0))
            .with(&format!("image_01/data/000000000{k}.png"), wall(8, 0));
    }
    let dates = "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.067740\n2011-02-30 25:02:26.1\n";
    let folder = folder.with("image_00/timestamps.txt", dates);
    let options = CameraOptions {
        intrinsics: Some([100.0, 100.0, 79.5, 39.5]),
        baseline_m: Some(0.2),
        ..CameraOptions::default()
    };
    let recording = recognise(&folder).unwrap().unwrap();
    let mut clouds = recording.clouds(&options).unwrap();
    let mut stamps = Vec::new();
    while let Some(cloud) = clouds.next_cloud().unwrap() {
        stamps.push(cloud.stamp.0);
    }
    // a row that is no date is as long after the one before as frames are apart
    assert_eq!(stamps, [1_317_042_145_964_389_445, 1_317_042_146_067_740_000, 1_317_042_146_167_740_000]);
    assert!(recording.notes().count(NoteKind::BadRow) > 0);
}

/// A pair that lies beside the axis by two pixels more in the right image: 10 pixels are 8 of parallax.
fn middlebury() -> Memory<'static> {
    let calib = "cam0=[100 0 79.5; 0 100 39.5; 0 0 1]\ncam1=[100 0 77.5; 0 100 39.5; 0 0 1]\ndoffs=-2\nbaseline=200\n\
                 width=160\nheight=80\nndisp=40\n";
    let folder = Memory::default().with("calib.txt", calib);
    folder.with("im0.png", wall(0, 0)).with("im1.png", wall(10, 0))
}

fn clouds_of(folder: &Memory<'_>, options: &CameraOptions) -> Result<(Vec<Cloud>, Vec<String>), CloudError> {
    let recording = recognise(folder)?.unwrap();
    let mut clouds = recording.clouds(options)?;
    let mut all = Vec::new();
    while let Some(cloud) = clouds.next_cloud()? {
        all.push(cloud);
    }
    let mut words = clouds.doubts().to_vec();
    let noted =
        |(kind, noted): (&NoteKind, &mapwright_clouds::Noted)| format!("{kind}: {} {}", noted.count, noted.first[0]);
    words.extend(recording.notes().kinds.iter().map(noted));
    words.extend(clouds.notes().kinds.iter().map(noted));
    Ok((all, words))
}

fn told(folder: &Memory<'_>) -> String {
    clouds_of(folder, &CameraOptions::default()).unwrap_err().to_string()
}

/// Where the wall is seen, far from its edges.
fn assert_wall(cloud: &Cloud) {
    let known: Vec<f32> = cloud.points_m.iter().map(|point| point[2]).filter(|z| z.is_finite()).collect();
    assert!(known.len() > (WIDTH * HEIGHT / 2) as usize, "{}", known.len());
    // at the edge of what the right camera sees a few are off by a pixel or more
    let right = known.iter().filter(|z| (**z - DEPTH_M).abs() < 0.2).count();
    assert!(100 * right > 99 * known.len(), "{right} of {}", known.len());
    assert!(cloud.sigmas_m.len() == cloud.points_m.len() && cloud.sigmas_m.iter().all(|sigma| *sigma >= 0.0));
}

#[test]
fn every_layout_is_recognised_and_read() {
    let kinds = [(kitti(), Kind::KittiStereo, 3), (euroc(), Kind::EurocStereo, 2), (middlebury(), Kind::Middlebury, 1)];
    for (folder, kind, frames) in kinds {
        let recording = recognise(&folder).unwrap().unwrap();
        assert_eq!((recording.kind(), recording.frames()), (kind, frames));
        let (clouds, words) = clouds_of(&folder, &CameraOptions::default()).unwrap();
        assert_eq!(clouds.len(), frames, "{words:?}");
        assert!(words.is_empty(), "{words:?}");
        clouds.iter().for_each(assert_wall);
        let made = recording.clouds(&CameraOptions::default()).unwrap();
        assert!(made.decisions().iter().any(|words| words.contains("baseline 0.2000 m")), "{:?}", made.decisions());
        // the same again: the same bytes
        assert_eq!(format!("{:?}", clouds_of(&folder, &CameraOptions::default()).unwrap().0), format!("{clouds:?}"));
    }
    let recording = kitti();
    let recording = recognise(&recording).unwrap().unwrap();
    assert_eq!(recording.references()[0].poses[2].1.translation.z, 1.0);
    assert_eq!(recording.stamps().unwrap().map(|stamp| stamp.0), [0, 250_000_000]);
    let folder = euroc();
    let recording = recognise(&folder).unwrap().unwrap();
    let sensor = &recording.sensor().robot_from_sensor;
    assert_eq!(sensor.translation, nalgebra::Vector3::new(0.1, 0.0, 0.5));
    // the body is at (1.5, 2, 3), the camera ahead of it and above
    assert!((recording.references()[0].poses[1].1.translation - nalgebra::Vector3::new(1.6, 2.0, 3.5)).norm() < 1e-12);
}

/// The same folder with its grey images as PGM.
fn as_pgm(folder: &Memory<'_>) -> Memory<'static> {
    let renamed = |name: &str| name.replace(".png", ".pgm");
    folder.files.iter().fold(Memory::default(), |made, (name, bytes)| {
        if !name.ends_with(".png") {
            return made.with(name, renamed(&String::from_utf8_lossy(bytes)));
        }
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; (WIDTH * HEIGHT) as usize];
        reader.next_frame(&mut pixels).unwrap();
        let header = format!("P5\n# {name}\n{WIDTH} {HEIGHT}\n255\n");
        made.with(&renamed(name), [header.into_bytes(), pixels].concat())
    })
}

#[test]
fn images_as_pgm_are_read_as_those_of_png() {
    for folder in [kitti(), euroc(), middlebury()] {
        let clouds = clouds_of(&folder, &CameraOptions::default()).unwrap();
        assert_eq!(
            format!("{:?}", clouds_of(&as_pgm(&folder), &CameraOptions::default()).unwrap()),
            format!("{clouds:?}")
        );
    }
    // a numbered pair of which there are two kinds is one pair
    let both = middlebury().with("im0.ppm", *b"P6").with("im1.ppm", *b"P6");
    clouds_of(&both, &CameraOptions::default()).unwrap().0.iter().for_each(assert_wall);
}

#[test]
fn frames_that_one_camera_misses_are_counted_and_said() {
    let mut folder = kitti();
    folder.files.remove("image_1/000001.png");
    folder.files.remove("image_0/000002.png");
    let (clouds, words) = clouds_of(&folder, &CameraOptions::default()).unwrap();
    assert_eq!(clouds.len(), 1);
    assert!(
        words.iter().any(|words| words.contains("no image of the other camera: 2 image_0/000001.png, byte 0")),
        "{words:?}"
    );
    let mut folder = euroc();
    folder.files.remove("mav0/cam1/data/1000000000.png");
    let (clouds, words) = clouds_of(&folder, &CameraOptions::default()).unwrap();
    assert_eq!(clouds.len(), 1);
    assert!(
        words.iter().any(|words| words.contains("an image mav0/cam1/data/1000000000.png, found none")),
        "{words:?}"
    );
    assert!(words.iter().any(|words| words.contains("no image of the other camera: 1")), "{words:?}");
    let mut folder = kitti();
    (0..3).for_each(|k| drop(folder.files.remove(&format!("image_1/00000{k}.png"))));
    folder = folder.with("image_1/7.png", wall(8, 0));
    assert!(told(&folder).contains("there is no image of both cameras"), "{}", told(&folder));
}

#[test]
fn swapped_and_misaligned_pairs_are_said() {
    let mut folder = kitti();
    for k in 0..3 {
        folder = folder
            .with(&format!("image_0/00000{k}.png"), wall(8, 0))
            .with(&format!("image_1/00000{k}.png"), wall(0, 0));
    }
    let error = told(&folder);
    assert!(error.starts_with("image_0/000000.png and image_1/000000.png: "), "{error}");
    assert!(error.contains("left and right are swapped: exchange their names or folders"), "{error}");
    let mut folder = kitti();
    for k in 0..3 {
        folder = folder.with(&format!("image_1/00000{k}.png"), wall(8, 3));
    }
    let (_, words) = clouds_of(&folder, &CameraOptions::default()).unwrap();
    assert!(words[0].contains("3.0 pixels lower") && words[0].contains("rectify them"), "{words:?}");
    let blank = png(&vec![9; (WIDTH * HEIGHT) as usize], [WIDTH, HEIGHT], png::ColorType::Grayscale);
    let mut folder = kitti();
    for k in 0..3 {
        folder = folder.with(&format!("image_1/00000{k}.png"), blank.clone());
    }
    let (clouds, words) = clouds_of(&folder, &CameraOptions::default()).unwrap();
    assert_eq!(clouds.len(), 3);
    assert!(words[0].contains("do both show the same"), "{words:?}");
}

#[test]
fn calibrations_that_are_none_are_told_with_what_to_type() {
    let key = "give --intrinsics FX,FY,CX,CY --baseline M";
    for (calib, found) in [
        (CALIB.replace("P0: 100", "P0: 0").replace("P1: 100", "P1: 0"), "focal length fx"),
        (CALIB.replace("-20", "20"), "are left and right swapped?"),
        (CALIB.replace("P1", "P2"), "a line `P1:`"),
        ("P0: 1 2\n".to_owned(), "line 1: expected 12 numbers"),
    ] {
        let error = told(&kitti().with("calib.txt", calib));
        assert!(error.contains(found) && error.contains(key), "{error}");
    }
    let mut bare = kitti();
    bare.files.remove("calib.txt");
    assert!(told(&bare).contains(key), "{}", told(&bare));
    let asked = CameraOptions {
        intrinsics: Some([100.0, 100.0, 79.5, 39.5]),
        baseline_m: Some(0.2),
        ..CameraOptions::default()
    };
    clouds_of(&bare, &asked).unwrap().0.iter().for_each(assert_wall);
    let wide = CameraOptions { baseline_m: Some(0.4), ..CameraOptions::default() };
    let (clouds, _) = clouds_of(&kitti(), &wide).unwrap();
    assert!((clouds[0].points_m[40 * 160 + 100][2] - 2.0 * DEPTH_M).abs() < 0.3);
    for wrong in [
        CameraOptions { baseline_m: Some(0.0), ..asked },
        CameraOptions { baseline_m: None, ..asked },
        CameraOptions { depth_scale: Some(1000.0), ..asked },
        CameraOptions { intrinsics: Some([0.0, 100.0, 79.5, 39.5]), ..asked },
    ] {
        assert!(clouds_of(&bare, &wrong).is_err(), "{wrong:?}");
    }
    let error = told(&euroc().with("mav0/cam1/sensor.yaml", sensor(-0.2)));
    assert!(error.contains("are left and right swapped?"), "{error}");
    let error = told(&euroc().with("mav0/cam0/sensor.yaml", "x"));
    assert!(error.contains("mav0/cam0/sensor.yaml: EuRoC's sensor.yaml"), "{error}");
    let error = told(&middlebury().with("im0.png", png(&[7; 6], [3, 2], png::ColorType::Grayscale)));
    assert!(error.contains("expected images of 160 x 80 pixels, found 3 x 2"), "{error}");
}

#[test]
fn images_that_are_none_are_left_out_and_said() {
    let torn = wall(8, 0)[..900].to_vec();
    let grey16 = {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 4, 4);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&[0; 32]).unwrap();
        file
    };
    for (bytes, found) in [
        (torn, "expected an image of 12800 bytes"),
        (grey16, "expected 160 x 80 pixels, found 4 x 4 pixels"),
        (b"no image".to_vec(), "expected a PNG, JPEG, PGM or PPM image, found a file that begins with no image"),
        (b"P2 4 4 255 0 0".to_vec(), "byte 0: expected a binary PGM or PPM image (P5 or P6), found P2"),
        (b"P5 160 80 255\n0".to_vec(), "byte 14: expected 12800 bytes of pixels for 160 x 80, found 1"),
        (vec![0xff, 0xd8, 1, 2], "expected a JPEG image"),
    ] {
        let (clouds, words) = clouds_of(&kitti().with("image_1/000001.png", bytes), &CameraOptions::default()).unwrap();
        assert_eq!(clouds.len(), 2);
        assert!(words.iter().any(|words| words.contains("unreadable frame: 1") && words.contains(found)), "{words:?}");
    }
    // in colour on one side: brightness is compared
    let pixels: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(|k| [value(k % WIDTH + 8, 50 + k / WIDTH); 3]).collect();
    let folder = kitti().with("image_1/000001.png", png(&pixels, [WIDTH, HEIGHT], png::ColorType::Rgb));
    let (clouds, words) = clouds_of(&folder, &CameraOptions::default()).unwrap();
    assert!(clouds.len() == 3 && words.is_empty(), "{words:?}");
    clouds.iter().for_each(assert_wall);
}

#[test]
fn numbered_pairs_need_to_be_told_of_their_cameras() {
    let folder =
        Memory::default().with("im2.png", wall(0, 0)).with("im6.png", wall(8, 0)).with("disp2.png", wall(0, 0));
    let error = told(&folder);
    assert!(error.contains("give --intrinsics FX,FY,CX,CY --baseline M"), "{error}");
    let asked = CameraOptions {
        intrinsics: Some([100.0, 100.0, 79.5, 39.5]),
        baseline_m: Some(0.2),
        ..CameraOptions::default()
    };
    clouds_of(&folder, &asked).unwrap().0.iter().for_each(assert_wall);
    let all = (0..9).fold(Memory::default(), |folder, k| folder.with(&format!("im{k}.png"), wall(2 * k, 0)));
    let recording = recognise(&all).unwrap().unwrap();
    let clouds = recording.clouds(&asked).unwrap();
    assert!(clouds.decisions().iter().any(|words| words == "im2.png and im6.png are used, the other 7 images are not"));
    let one = Memory::default().with("im2.png", wall(0, 0));
    assert!(recognise(&one).unwrap().is_none());
}

#[test]
fn middleburys_real_pairs() {
    for name in ["teddy", "venus", "tsukuba"] {
        let Some(folder) = given(&format!("stereo_middlebury/{name}")) else { return };
        let recording = recognise(&folder).unwrap().unwrap();
        assert_eq!(recording.kind(), Kind::Middlebury);
        let asked = CameraOptions {
            intrinsics: Some([615.0, 615.0, 225.0, 187.0]),
            baseline_m: Some(0.16),
            ..CameraOptions::default()
        };
        let mut clouds = recording.clouds(&asked).unwrap();
        assert!(clouds.doubts().is_empty(), "{name}: {:?}", clouds.doubts());
        let cloud = clouds.next_cloud().unwrap().unwrap();
        let known = cloud.points_m.iter().filter(|point| point[2].is_finite()).count();
        assert!(2 * known > cloud.points_m.len(), "{name}: {known}");
        assert!(clouds.next_cloud().unwrap().is_none());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_folders_do_no_harm(which in 0..3_usize, file: prop::sample::Index, at: prop::sample::Index, byte: u8, cut in 0..2000_usize) {
        let mut folder = [kitti(), euroc(), middlebury()].into_iter().nth(which).unwrap();
        let name = folder.files.keys().nth(file.index(folder.files.len())).unwrap().clone();
        let bytes = folder.files.get_mut(&name).unwrap();
        let at = at.index(bytes.len());
        bytes[at] = byte;
        bytes.truncate(bytes.len().saturating_sub(cut.saturating_sub(1000)));
        if let Ok((clouds, _)) = clouds_of(&folder, &CameraOptions::default()) {
            prop_assert!(clouds.iter().all(|cloud| cloud.sigmas_m.len() == cloud.points_m.len()));
        }
    }
}
