//! Bad input in space: counted and survived, or refused with its place.

use crate::support::{assert_code, assert_refused, folder, json, run, text};
use std::fs;
use std::path::Path;
use std::process::Output;

/// Frames in the layout of KITTI, each of these points.
fn kitti(folder: &Path, numbers: &[u32], points_m: &[[f32; 3]]) {
    let bytes: Vec<u8> = points_m.iter().flat_map(|&[x, y, z]| [x, y, z, 0.5]).flat_map(f32::to_le_bytes).collect();
    fs::create_dir_all(folder.join("velodyne")).unwrap();
    numbers.iter().for_each(|k| fs::write(folder.join(format!("velodyne/{k:06}.bin")), &bytes).unwrap());
}

fn plane() -> Vec<[f32; 3]> {
    (0..900).map(|k| [3.0 + 0.1 * (k % 30) as f32, 0.1 * (k / 30) as f32, -1.0]).collect()
}

fn map(recording: &Path, more: &[&str]) -> Output {
    let out = out(recording);
    run(&[&["map", recording.to_str().unwrap(), "-o", out.to_str().unwrap()], more].concat())
}

fn out(recording: &Path) -> std::path::PathBuf {
    recording.with_file_name(format!("{}_out", recording.file_name().unwrap().to_string_lossy()))
}

#[test]
fn clouds_with_nothing_to_map_are_refused_and_thin_ones_are_mapped() {
    let folder = folder("bad_clouds");
    let line: Vec<[f32; 3]> = (0..500).map(|k| [1.0 + 0.1 * k as f32, 0.0, 0.0]).collect();
    let nothing: [(&str, Vec<[f32; 3]>); 4] = [
        ("empty", Vec::new()),
        ("nan", vec![[f32::NAN; 3]; 500]),
        ("one", vec![[3.0, 1.0, 0.5]]),
        ("near", vec![[0.01, 0.0, 0.0]; 500]),
    ];
    for (name, points_m) in nothing {
        kitti(&folder.join(name), &[0, 1, 2], &points_m);
        assert_refused(&map(&folder.join(name), &[]), 1, &[name, "at least 100 returns", "found none in 3 clouds"]);
    }
    for (name, points_m) in [("plane", plane()), ("line", line)] {
        kitti(&folder.join(name), &[0, 1, 2], &points_m);
        assert_code(&map(&folder.join(name), &[]), 0);
        let report = json(&out(&folder.join(name)).join("report.json"));
        assert_eq!((&report["clouds"], &report["losses"]), (&3.into(), &serde_json::json!([])), "{report}");
        // The first begins the map; what a plane or a line leaves open is the prediction's.
        let counted = ["tracking", "degraded", "lost"].map(|status| report["status"][status].as_u64());
        assert_eq!(counted, [Some(1), Some(2), Some(0)], "{report}");
        assert_eq!(report["status"]["runs"][1]["scans"], 2, "{report}");
    }
}

#[test]
fn clouds_in_another_unit_say_so_and_near_ones_are_mapped() {
    let folder = folder("cloud_units");
    let scaled = |name: &str, unit: f32| {
        // a floor and two walls all around
        let points =
            plane().into_iter().flat_map(|[x, y, z]| [[x, y, z], [-x, 3.0, 0.1 + y], [x - 4.0, -3.0, 0.1 + y]]);
        let points: Vec<u8> = points.flatten().flat_map(|v| (v * unit).to_le_bytes()).collect();
        fs::create_dir_all(folder.join(name)).unwrap();
        let bytes = [header("pcd", 2700).into_bytes(), points].concat();
        (0..3).for_each(|k| fs::write(folder.join(name).join(format!("{k}.pcd")), &bytes).unwrap());
        folder.join(name)
    };
    let said = |output: &Output| text(&output.stdout) + &text(&output.stderr);
    let mm = map(&scaled("mm", 1000.0), &[]);
    assert_code(&mm, 0);
    assert!(said(&mm).contains("taken for millimetres; `--range-unit 1` takes them for metres"), "{mm:?}");
    let info = run(&["info", folder.join("mm").to_str().unwrap()]);
    assert!(said(&info).contains("taken for millimetres"), "{info:?}");
    let refused = map(&folder.join("mm"), &["--range-unit", "1"]);
    assert_refused(&refused, 1, &["there is nothing to map; points at ", "millimetres? `--range-unit 0.001`"]);
    let near = map(&scaled("near", 0.04), &[]);
    assert_code(&near, 0);
    assert!(said(&near).contains("all nearer than the 0.5 m"), "{near:?}");
    let as_asked = map(&folder.join("near"), &["--range-unit", "25"]);
    assert_code(&as_asked, 0);
    assert!(!said(&as_asked).contains("all nearer"), "{as_asked:?}");
}

#[test]
fn depth_without_a_camera_or_colour_says_what_was_used() {
    let folder = folder("numbered_depth").join("room");
    fs::create_dir_all(folder.join("depth")).unwrap();
    (0..3).for_each(|k| fs::write(folder.join(format!("depth/{k:06}.png")), depth()).unwrap());
    assert_refused(&map(&folder, &[]), 1, &["the camera's focal lengths and centre", "give --intrinsics FX,FY,CX,CY"]);
    let given = map(&folder, &["--intrinsics", "30,30,15.5,11.5", "--depth-scale", "6553.5"]);
    assert_code(&given, 0);
    let said = text(&given.stdout);
    assert!(said.contains("6553.5 is a metre of depth, as asked for") && !said.contains("1000 is a metre"), "{said}");
    assert!(said.contains("the camera is 30,30,15.5,11.5, as asked for") && !said.contains("lost "), "{said}");
    let aside = map(&folder, &["--intrinsics", "60,60,31.5,23.5"]);
    assert_code(&aside, 0);
    let verdict = text(&aside.stdout).lines().next().unwrap().to_owned();
    let expected = ["check", "the optical axis is at the edge of the image", "`--intrinsics 30,30,15.5,11.5`"];
    expected.iter().for_each(|what| assert!(verdict.contains(what), "expected {what:?}, found {verdict}"));
}

#[test]
fn missing_frames_and_times_that_run_backwards_are_said() {
    let folder = folder("bad_frames");
    let (missing, back) = (folder.join("missing"), folder.join("back"));
    kitti(&missing, &[0, 1, 5, 6], &plane());
    let output = map(&missing, &[]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("missing frame: 1, first velodyne/000005.bin"), "{output:?}");
    kitti(&back, &[0, 1, 2, 3], &plane());
    fs::write(back.join("times.txt"), "0\n0.3\n0.2\n0.1\n").unwrap();
    let output = map(&back, &[]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("stamp runs backwards: 2, first velodyne/000002.bin"), "{output:?}");
}

/// The header of so many points.
fn header(ending: &str, promised: u64) -> String {
    match ending {
        "pcd" => format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {promised}\nHEIGHT 1\n\
             VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {promised}\nDATA binary\n"
        ),
        _ => format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {promised}\nproperty float x\nproperty float y\n\
             property float z\nend_header\n"
        ),
    }
}

/// The same points, whole or not, under headers that promise so many.
fn with_header(ending: &str, promised: u64) -> Vec<u8> {
    let points = plane().into_iter().flatten().flat_map(f32::to_le_bytes);
    header(ending, promised).into_bytes().into_iter().chain(points).collect()
}

#[test]
fn files_that_end_early_and_headers_that_promise_terabytes_give_what_they_hold() {
    let folder = folder("bad_headers");
    for ending in ["pcd", "ply"] {
        for (name, promised, cut) in [("cut", 900, 7), ("tera", 1_000_000_000_000, 0), ("most", 1 << 63, 0)] {
            let recording = folder.join(format!("{ending}_{name}"));
            fs::create_dir_all(&recording).unwrap();
            let bytes = with_header(ending, promised);
            (0..2)
                .for_each(|k| fs::write(recording.join(format!("{k}.{ending}")), &bytes[..bytes.len() - cut]).unwrap());
            let output = map(&recording, &[]);
            assert_code(&output, 3);
            let report = json(&out(&recording).join("report.json"));
            let losses = report["losses"].to_string();
            assert!(losses.contains(&format!("0.{ending}, byte ")), "{losses}");
            let returns = report["points"]["returns"].as_u64().unwrap();
            assert!((2 * 899..=2 * 900).contains(&returns), "{returns} of {ending} {name}");
        }
        let recording = folder.join(format!("{ending}_head"));
        fs::create_dir_all(&recording).unwrap();
        fs::write(recording.join(format!("0.{ending}")), &with_header(ending, 900)[..40]).unwrap();
        assert_refused(&map(&recording, &[]), 1, &["none of 1 frame", &format!("0.{ending}, byte "), "header"]);
    }
    kitti(&folder.join("bin"), &[0, 1], &plane());
    let file = folder.join("bin/velodyne/000001.bin");
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() - 5]).unwrap();
    let output = map(&folder.join("bin"), &[]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("velodyne/000001.bin, byte 14384"), "{output:?}");
    let mut capture: Vec<u8> = [0xa1b2_c3d4_u32, 0x0004_0002, 0, 0, 65535, 1].map(u32::to_le_bytes).concat();
    capture.extend([1, 0, u32::MAX, u32::MAX].map(u32::to_le_bytes).concat());
    let path = folder.join("cut.pcap");
    fs::write(&path, capture).unwrap();
    assert_refused(&map(&path, &[]), 1, &["cut.pcap, byte 0", "Velodyne"]);
}

#[test]
fn lidars_own_recordings_are_named_with_what_they_lack_or_what_converts_them() {
    let folder = folder("bad_lidars");
    let osf = [&[48, 0, 0, 0, 16, 0, 0, 0][..], b"OSF!", &[0; 60]].concat();
    for (name, bytes, says) in [
        ("drive.osf", osf, "ouster-cli source drive.osf save drive.osf.pcap"),
        ("drive.lvx", b"livox_tech\0\0\0\0\0\0\x01\x01\0\0".to_vec(), "lvx_to_rosbag.launch lvx_file_path:=drive.lvx"),
    ] {
        let path = folder.join(name);
        fs::write(&path, bytes).unwrap();
        let says = says.replace("drive.", &format!("{}/drive.", folder.display()));
        assert_refused(&map(&path, &[]), 1, &[&says]);
    }
    let mut capture: Vec<u8> = [0xa1b2_c3d4_u32, 0x0004_0002, 0, 0, 65535, 101].map(u32::to_le_bytes).concat();
    capture.extend([1, 0, 6492, 6492].map(u32::to_le_bytes).concat());
    capture.extend([0x45, 0, 25, 92, 0, 0, 0, 0, 64, 17, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2, 29, 78, 29, 78, 25, 72, 0, 0]);
    capture.resize(capture.len() + 6464, 0);
    let path = folder.join("ouster.pcap");
    fs::write(&path, &capture).unwrap();
    assert_refused(
        &map(&path, &[]),
        1,
        &["ouster.pcap, byte 0", "beside it as ouster.json (`curl http://SENSOR/api/v1"],
    );
    fs::write(folder.join("ouster.json"), r#"{"beam_altitude_angles": 1, "beam_azimuth_angles": 2}"#).unwrap();
    assert_refused(&map(&path, &[]), 1, &["ouster.json, byte 0", "found none"]);
}

const SIZE: [u32; 2] = [32, 24];

/// A floor that falls away from the camera, as an image of whatever kind.
fn image(size: [u32; 2], kind: png::ColorType, depth: png::BitDepth) -> Vec<u8> {
    let channels = kind.samples();
    let row = |y: u32| (0..size[0]).flat_map(move |x| vec![(1500 + 20 * x + 10 * y) as u16; channels]);
    let values = (0..size[1]).flat_map(row);
    let data: Vec<u8> = match depth {
        png::BitDepth::Sixteen => values.flat_map(u16::to_be_bytes).collect(),
        _ => values.map(|value| value as u8).collect(),
    };
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, size[0], size[1]);
    encoder.set_color(kind);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
    file
}

fn depth() -> Vec<u8> {
    image(SIZE, png::ColorType::Grayscale, png::BitDepth::Sixteen)
}

/// Five images in the layout of 7-Scenes, with what the camera is.
fn seven_scenes(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    (0..5).for_each(|k| fs::write(folder.join(format!("frame-{k:06}.depth.png")), depth()).unwrap());
    let colour = image(SIZE, png::ColorType::Rgb, png::BitDepth::Eight);
    (0..5).for_each(|k| fs::write(folder.join(format!("frame-{k:06}.color.png")), &colour).unwrap());
    fs::write(folder.join("camera-intrinsics.txt"), "30 0 15.5\n0 30 11.5\n0 0 1\n").unwrap();
}

/// A header of 16,383 by 16,383 pixels over the bytes of a small image.
fn of_gigabytes() -> Vec<u8> {
    let mut bytes = depth();
    bytes[16..24].copy_from_slice(&[0, 0, 0x3f, 0xff, 0, 0, 0x3f, 0xff]);
    let mut crc = flate2::Crc::new();
    crc.update(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.sum().to_be_bytes());
    bytes
}

#[test]
fn images_of_depth_of_another_kind_are_left_out_with_their_file_or_refused_where_all_are() {
    use png::{BitDepth, ColorType};
    let folder = folder("bad_depth");
    let not_grey = |found: &str| format!("byte 24: expected depth as greyscale of 16 bits, found {found}");
    let whole = depth();
    let kinds = [
        (
            "size",
            image([16, 24], ColorType::Grayscale, BitDepth::Sixteen),
            "byte 16: expected 32 x 24 pixels".to_owned(),
        ),
        ("grey8", image(SIZE, ColorType::Grayscale, BitDepth::Eight), not_grey("Grayscale of 8 bits")),
        ("rgb8", image(SIZE, ColorType::Rgb, BitDepth::Eight), not_grey("Rgb of 8 bits")),
        ("rgb16", image(SIZE, ColorType::Rgb, BitDepth::Sixteen), not_grey("Rgb of 16 bits")),
        ("alpha", image(SIZE, ColorType::GrayscaleAlpha, BitDepth::Sixteen), not_grey("GrayscaleAlpha of 16 bits")),
        ("cut", whole[..whole.len() - 40].to_vec(), "byte 33: expected an image of 1536 bytes".to_owned()),
        ("empty", Vec::new(), "byte 0: expected a PNG image".to_owned()),
        ("giga", of_gigabytes(), "byte 16: expected a size that the file can hold, found 16383 x 16383".to_owned()),
    ];
    for (name, bytes, told) in kinds {
        let recording = folder.join(name);
        seven_scenes(&recording);
        fs::write(recording.join("frame-000002.depth.png"), &bytes).unwrap();
        let output = map(&recording, &[]);
        assert_code(&output, 3);
        let lost = format!("lost     unreadable frame: 1, first frame-000002.depth.png, {told}");
        assert!(text(&output.stdout).contains(&lost), "expected {lost:?}, found {output:?}");
        assert_eq!(json(&out(&recording).join("report.json"))["clouds"], 4);
        if name == "size" {
            continue; // All of that size are a recording of that size.
        }
        (0..5).for_each(|k| fs::write(recording.join(format!("frame-{k:06}.depth.png")), &bytes).unwrap());
        let refused = format!("none of 5 frames could be read; the first: frame-000000.depth.png, {told}");
        assert_refused(&map(&recording, &[]), 1, &[name, &refused]);
    }
}

#[test]
fn a_camera_that_nothing_says_is_asked_for_with_the_file_that_should_have() {
    let folder = folder("bad_camera");
    let (scenes, open3d) = (folder.join("scenes"), folder.join("open3d"));
    let asked = "give --intrinsics FX,FY,CX,CY";
    seven_scenes(&scenes);
    assert_code(&map(&scenes, &[]), 0);
    for matrix in ["30 0 15.5\n0 x 11.5\n", "0 0 15.5\n0 30 11.5\n0 0 1\n", ""] {
        fs::write(scenes.join("camera-intrinsics.txt"), matrix).unwrap();
        let told = "camera-intrinsics.txt, byte 0: expected a camera's matrix of 3 x 3, found";
        assert_refused(&map(&scenes, &[]), 1, &[told, asked]);
    }
    fs::remove_file(scenes.join("camera-intrinsics.txt")).unwrap();
    assert_refused(&map(&scenes, &[]), 1, &["the folder does not say the camera's focal lengths and centre", asked]);
    assert_code(&map(&scenes, &["--intrinsics", "30,30,15.5,11.5"]), 0);
    assert_refused(&map(&scenes, &["--intrinsics", "30,30,15.5"]), 2, &["--intrinsics", "four numbers"]);
    assert_refused(&map(&scenes, &["--intrinsics", "0,30,15.5,11.5"]), 1, &["--intrinsics FX,FY,CX,CY", "above zero"]);
    let scale = ["--intrinsics", "30,30,15.5,11.5", "--depth-scale", "0"];
    assert_refused(&map(&scenes, &scale), 1, &["--depth-scale S", "above zero, found 0"]);

    fs::create_dir_all(open3d.join("depth")).unwrap();
    (0..3).for_each(|k| fs::write(open3d.join(format!("depth/{k:06}.png")), depth()).unwrap());
    for (camera, found) in [
        (r#"{"width":32,"height":24}"#, "found no intrinsic_matrix"),
        (r#"{"width":640,"height":480,"intrinsic_matrix":[30,0,0,0,30,0,15.5,11.5,1]}"#, "found width `640`"),
        (r#"{"intrinsic_matrix":[30,0,0]}"#, "found intrinsic_matrix `[30,0,0]`"),
        (r#"{"intrinsic_"#, "found `{\"intrinsic_`"),
    ] {
        fs::write(open3d.join("camera_primesense.json"), camera).unwrap();
        let told = "camera_primesense.json, byte 0: expected an intrinsic_matrix of a camera of 32 x 24";
        assert_refused(&map(&open3d, &[]), 1, &[told, found, asked]);
    }
}
