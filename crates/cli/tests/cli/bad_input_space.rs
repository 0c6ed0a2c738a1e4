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
    }
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

/// The same points, whole or not, under headers that promise so many.
fn with_header(ending: &str, promised: u64) -> Vec<u8> {
    let header = match ending {
        "pcd" => format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {promised}\nHEIGHT 1\n\
             VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {promised}\nDATA binary\n"
        ),
        _ => format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {promised}\nproperty float x\nproperty float y\n\
             property float z\nend_header\n"
        ),
    };
    let points = plane().into_iter().flatten().flat_map(f32::to_le_bytes);
    header.into_bytes().into_iter().chain(points).collect()
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
