//! Pairs of images: folders as cameras write them, rendered by the simulator, and the simulated drive itself.

use crate::support::{assert_code, assert_refused, folder, json, run, text};
use mapwright_geom::Pose3;
use mapwright_sim::space::{SpaceDrive, SpaceDriveSettings, TrueStereoPair, worlds};
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// A few seconds of the simulated building, 5 pairs a second.
fn pairs() -> (SpaceDrive, Vec<TrueStereoPair>) {
    let settings = SpaceDriveSettings { seed: 3, duration_s: 4.0, ..SpaceDriveSettings::default() };
    let drive = SpaceDrive::new(worlds::two_storey(3).into(), settings);
    let pairs = (0..).map_while(|k| drive.stereo_pair(6 * k)).collect();
    (drive, pairs)
}

fn write_png(path: &Path, pixels: &[u8]) {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 320, 240);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, file).unwrap();
}

fn rows(pose: &Pose3) -> [[f64; 4]; 3] {
    let (m, t) = (pose.rotation.to_rotation_matrix(), pose.translation);
    [0, 1, 2].map(|k| [m[(k, 0)], m[(k, 1)], m[(k, 2)], t[k]])
}

fn numbers(rows: &[[f64; 4]], between: &str) -> String {
    rows.iter().flatten().map(ToString::to_string).collect::<Vec<_>>().join(between)
}

/// As KITTI's odometry benchmark has it, with the true poses of the left camera.
fn kitti(at: &Path, drive: &SpaceDrive, pairs: &[TrueStereoPair]) -> String {
    let stereo = drive.stereo_camera();
    let ([f, _], [cx, cy]) = (stereo.camera.focal_px, stereo.camera.centre_px);
    let (mut times, mut poses) = (String::new(), String::new());
    let p = |shift: f64| format!("{f} 0 {cx} {shift} 0 {f} {cy} 0 0 0 1 0");
    for (k, pair) in pairs.iter().enumerate() {
        write_png(&at.join(format!("image_0/{k:06}.png")), &pair.left);
        write_png(&at.join(format!("image_1/{k:06}.png")), &pair.right);
        writeln!(times, "{:e}", pair.stamp.as_secs_f64()).unwrap();
        writeln!(poses, "{}", numbers(&rows(&(pair.world_from_robot * stereo.robot_from_left)), " ")).unwrap();
    }
    fs::write(at.join("calib.txt"), format!("P0: {}\nP1: {}\n", p(0.0), p(-f * stereo.baseline_m))).unwrap();
    fs::write(at.join("times.txt"), times).unwrap();
    fs::write(at.join("poses.txt"), poses).unwrap();
    at.display().to_string()
}

/// As EuRoC has it, with the true poses of the robot.
fn euroc(at: &Path, drive: &SpaceDrive, pairs: &[TrueStereoPair]) -> String {
    let stereo = drive.stereo_camera();
    let ([f, _], [cx, cy]) = (stereo.camera.focal_px, stereo.camera.centre_px);
    let beside = Pose3 { translation: [stereo.baseline_m, 0.0, 0.0].into(), ..Pose3::identity() };
    for (camera, robot_from_camera) in [("cam0", stereo.robot_from_left), ("cam1", stereo.robot_from_left * beside)] {
        let folder = at.join("mav0").join(camera);
        let mut list = "#timestamp [ns],filename\n".to_owned();
        for pair in pairs {
            let name = format!("{}.png", pair.stamp.0);
            let pixels = if camera == "cam0" { &pair.left } else { &pair.right };
            write_png(&folder.join("data").join(&name), pixels);
            writeln!(list, "{},{name}", pair.stamp.0).unwrap();
        }
        fs::write(folder.join("data.csv"), list).unwrap();
        let sensor = format!(
            "T_BS:\n  cols: 4\n  rows: 4\n  data: [{}, 0, 0, 0, 1]\nresolution: [320, 240]\ncamera_model: pinhole\n\
             intrinsics: [{f}, {f}, {cx}, {cy}]\ndistortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n",
            numbers(&rows(&robot_from_camera), ", ")
        );
        fs::write(folder.join("sensor.yaml"), sensor).unwrap();
    }
    let mut truth = "#timestamp, p_x, p_y, p_z, q_w, q_x, q_y, q_z\n".to_owned();
    for TrueStereoPair { stamp, world_from_robot, .. } in pairs {
        let (t, q) = (world_from_robot.translation, world_from_robot.rotation);
        writeln!(truth, "{},{},{},{},{},{},{},{}", stamp.0, t.x, t.y, t.z, q.w, q.i, q.j, q.k).unwrap();
    }
    let of_truth = at.join("mav0/state_groundtruth_estimate0");
    fs::create_dir_all(&of_truth).unwrap();
    fs::write(of_truth.join("data.csv"), truth).unwrap();
    at.display().to_string()
}

#[test]
fn folders_of_two_cameras_are_mapped_and_compared_with_their_poses() {
    let folder = folder("stereo_folders");
    let (drive, pairs) = pairs();
    let recordings = [kitti(&folder.join("kitti"), &drive, &pairs), euroc(&folder.join("euroc"), &drive, &pairs)];
    for (recording, layout) in recordings.iter().zip(["KITTI", "EuRoC"]) {
        let info = run(&["info", recording]);
        assert_code(&info, 0);
        let said = text(&info.stdout);
        assert!(said.contains(&format!("a stereo camera in the layout of {layout}, 20 frames")), "{said}");
        assert!(said.contains("focal length 240.0 pixels, baseline 0.1200 m"), "{said}");
        let map = |name: &str, threads: &str| {
            let out = folder.join(format!("{layout}-{name}"));
            assert_code(&run(&["map", recording, "-o", out.to_str().unwrap(), "--threads", threads]), 0);
            out
        };
        let out = map("one", "1");
        let report = json(&out.join("report.json"));
        // 0.14 m of way from pair to pair
        let [off_m, off_deg] = ["rpe_median_m", "rpe_median_deg"].map(|key| report["reference"][key].as_f64().unwrap());
        assert!(off_m < 0.06 && off_deg < 0.5, "{layout}: {off_m} m, {off_deg} deg from pair to pair");
        assert_eq!(report["clouds"], 20);
        let two = map("two", "2");
        for file in ["session.mapwright", "trajectory.tum", "map.ply"] {
            assert!(fs::read(out.join(file)).unwrap() == fs::read(two.join(file)).unwrap(), "{layout}: {file}");
        }
    }
    let torn = folder.join("kitti/image_1/000004.png");
    let bytes = fs::read(&torn).unwrap();
    fs::write(&torn, &bytes[..bytes.len() / 2]).unwrap();
    fs::remove_file(folder.join("kitti/image_0/000007.png")).unwrap();
    let said = ["1", "2"].map(|threads| {
        let out = folder.join(format!("damaged-{threads}"));
        let output = run(&["map", &recordings[0], "-o", out.to_str().unwrap(), "--threads", threads]);
        assert_code(&output, 3);
        let said = text(&output.stdout);
        assert!(said.contains("no image of the other camera: 1") && said.contains("unreadable frame: 1"), "{said}");
        fs::read(out.join("report.json")).unwrap()
    });
    assert!(said[0] == said[1]);
}

#[test]
fn swapped_folders_are_refused_with_what_to_do() {
    let folder = folder("stereo_swapped");
    let (drive, pairs) = pairs();
    let recording = kitti(&folder.join("kitti"), &drive, &pairs[..4]);
    for (from, to) in [("image_0", "x"), ("image_1", "image_0"), ("x", "image_1")] {
        fs::rename(Path::new(&recording).join(from), Path::new(&recording).join(to)).unwrap();
    }
    let output = run(&["map", &recording, "-o", folder.join("out").to_str().unwrap()]);
    assert_refused(&output, 1, &["left and right are swapped", "exchange their names or folders"]);
}

#[test]
fn the_demo_maps_by_two_cameras_and_knows_its_error() {
    let folder = folder("demo_stereo");
    for sensor in ["--stereo", "--depth"] {
        let out = folder.join(&sensor[2..]);
        let output = run(&["demo", sensor, "--seed", "2", "--seconds", "5", "-o", out.to_str().unwrap()]);
        assert_code(&output, 0);
        let report = json(&out.join("report.json"));
        let ate_m = report["against_truth"]["ate_rmse_m"].as_f64().unwrap();
        assert!(ate_m < 0.1, "{sensor}: {ate_m} m");
    }
    assert_code(&run(&["demo", "--stereo", "--depth", "-o", folder.to_str().unwrap()]), 2);
}
