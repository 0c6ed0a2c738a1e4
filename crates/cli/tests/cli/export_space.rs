//! `mapwright export` of sessions of space.

use crate::support::{assert_code, assert_refused, folder, run, small_log_in, text};
use mapwright::{Cloud, Pose3, Settings, SpaceMapper, Stamp};
use mapwright_clouds::{Notes, read_pcd, read_ply};
use mapwright_formats::write_ply;
use mapwright_sensor::SpaceSensor;
use mapwright_voxel::{Octree, State};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// The way to the walls of a room 12 m long, 8 m wide and 3 m high, from 1 m above the floor near its middle.
fn range_m(direction: nalgebra::Vector3<f64>, forward_m: f64) -> f64 {
    let from = [forward_m, 0.0, 0.0];
    let walls = [[-6.0, 6.0], [-4.0, 4.0], [-1.0, 2.0]];
    let to_wall = |k: usize| (walls[k][usize::from(direction[k] > 0.0)] + 0.03 - from[k]) / direction[k];
    (0..3).filter(|&k| direction[k].abs() > 1e-9).map(to_wall).fold(f64::INFINITY, f64::min)
}

/// What a sensor sees from there that looks all around, or ahead along its z axis.
fn cloud(number: i64, is_camera: bool) -> Cloud {
    let forward_m = 0.3 * number as f64;
    let rays =
        (0..360).flat_map(|a| (-30..30).map(move |e| (f64::from(a) * 0.0175 + 0.001, f64::from(e) * 0.025 + 0.002)));
    let directions = rays.map(|(a, e)| nalgebra::Vector3::new(a.cos() * e.cos(), a.sin() * e.cos(), e.sin()));
    let seen: Vec<_> = directions
        .map(|direction| (direction * range_m(direction, forward_m)).map(|v| v as f32))
        .filter(|p| !is_camera || p.x > 1.5 * p.y.abs().max(p.z.abs()))
        .map(|p| if is_camera { [-p.y, -p.z, p.x] } else { [p.x, p.y, p.z] })
        .collect();
    let ahead_m = if is_camera { [0.0, 0.0, forward_m] } else { [forward_m, 0.0, 0.0] };
    Cloud {
        stamp: Stamp(number * 100_000_000),
        sensor: Arc::new(SpaceSensor::lidar("top")),
        colours: vec![[200, 100, 50]; seen.len()],
        intensities: seen.iter().map(|point| if point[2] < -0.9 { 20.0 } else { 80.0 }).collect(),
        points_m: seen,
        times_s: Vec::new(),
        sigmas_m: Vec::new(),
        odom_from_robot: Some(Pose3 { translation: ahead_m.into(), ..Pose3::identity() }),
    }
}

/// Results of three clouds, as far as an export needs them.
fn mapped(out: &Path, is_camera: bool) {
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    (0..3).for_each(|number| drop(mapper.add_cloud(&cloud(number, is_camera))));
    fs::create_dir_all(out).unwrap();
    fs::write(out.join("session.mapwright"), mapper.session().encode()).unwrap();
}

#[test]
fn a_session_of_space_becomes_clouds_an_octree_and_a_floor_plan() {
    let out = folder("export_space").join("out");
    mapped(&out, false);
    for to in ["ply", "pcd", "octomap", "pgm"] {
        assert_code(&run(&["export", out.to_str().unwrap(), "--to", to]), 0);
    }
    let mcap = run(&["export", out.to_str().unwrap(), "--to", "mcap"]);
    assert_code(&mcap, 0);
    assert!(text(&mcap.stdout).contains("points, 3 poses, 0 closures"), "{}", text(&mcap.stdout));
    let read = |name: &str| fs::read(out.join(name)).unwrap();
    let ply = read_ply("export.ply", &read("export.ply"), &mut Notes::default()).unwrap();
    let pcd = read_pcd("export.pcd", &read("export.pcd"), &mut Notes::default()).unwrap();
    assert!(read("export.mcap").starts_with(b"\x89MCAP0"));
    assert!(ply.points_m.len() > 1000 && ply.points_m == pcd.points_m);
    assert!(ply.colours == pcd.colours && ply.colours[0] == [200, 100, 50]);
    assert_eq!((ply.intensities.len(), &ply.intensities), (ply.points_m.len(), &pcd.intensities));
    let on_the_floor =
        ply.points_m.iter().zip(&ply.intensities).filter(|([x, y, z], _)| *z < -0.95 && x.abs() < 5.0 && y.abs() < 3.0);
    assert!(on_the_floor.clone().count() > 100 && on_the_floor.clone().all(|(_, intensity)| *intensity == 20.0));

    let tree = Octree::read_bt(&mut read("export.bt").as_slice()).unwrap();
    let states = [[1.0, 1.0, 0.0], [0.3, 4.05, 0.1], [0.0, 0.0, 9.0]].map(|at_m| tree.state_at(at_m, 16));
    assert_eq!(states[0], State::Free);
    assert_eq!(states[2], State::Unknown);
    assert!(tree.leaves().any(|leaf| leaf.is_occupied()), "{states:?}");

    let pgm = read("export.pgm");
    assert!(pgm.starts_with(b"P5") && pgm.contains(&0) && pgm.contains(&254), "walls and floor");
    assert!(text(&read("export.yaml")).contains("resolution: 0.1"));
}

/// Vertices of a mesh as it is written, and how many triangles there are.
fn mesh(ply: &[u8]) -> (Vec<[f32; 3]>, usize) {
    let end = b"end_header\n";
    let at = ply.windows(end.len()).position(|part| part == end).unwrap() + end.len();
    let head = std::str::from_utf8(&ply[..at]).unwrap();
    let count = |of: &str| head.lines().find_map(|line| line.strip_prefix(of)).unwrap().parse::<usize>().unwrap();
    let row = if head.contains("uchar red") { 27 } else { 24 };
    let (vertices, faces) = ply[at..].split_at(row * count("element vertex "));
    assert_eq!(faces.len(), 13 * count("element face "));
    let vertex = |v: &[u8]| [0, 1, 2].map(|k| f32::from_le_bytes(v[4 * k..4 * k + 4].try_into().unwrap()));
    (vertices.chunks_exact(row).map(vertex).collect(), faces.len() / 13)
}

#[test]
fn a_mesh_lies_on_the_walls_whatever_the_threads() {
    let out = folder("export_space_mesh").join("out");
    mapped(&out, false);
    let file = |name: &str| out.join(name).display().to_string();
    let export = |name: &str, more: &[&str]| {
        let path = file(name);
        run(&[&["export", out.to_str().unwrap(), "--to", "mesh", "-o", &path, "--resolution", "0.1"], more].concat())
    };
    let made = export("room.ply", &[]);
    assert_code(&made, 0);
    assert!(text(&made.stdout).contains("with colours; voxels of 0.1 m"), "{}", text(&made.stdout));
    assert_code(&export("again.ply", &["--threads", "2"]), 0);
    let ply = fs::read(file("room.ply")).unwrap();
    assert!(ply == fs::read(file("again.ply")).unwrap(), "other bytes on two threads");
    let (vertices, triangles) = mesh(&ply);
    assert!(vertices.len() > 10_000 && triangles > 20_000, "{} {triangles}", vertices.len());
    let off_m = |[x, y, z]: &[f32; 3]| {
        let walls = [[-5.97, 6.03], [-3.97, 4.03], [-0.97, 2.03]];
        let to = |k: usize, v: f32| walls[k].iter().map(|wall| (v - wall).abs()).fold(f32::INFINITY, f32::min);
        to(0, *x).min(to(1, *y)).min(to(2, *z))
    };
    let mut off: Vec<f32> = vertices.iter().map(off_m).collect();
    off.sort_by(f32::total_cmp);
    assert!(
        off[off.len() / 2] < 0.005 && off[off.len() * 95 / 100] < 0.1,
        "{} {}",
        off[off.len() / 2],
        off[off.len() * 95 / 100]
    );
    // glTF where nothing is asked for, with voxels by what keyframes keep
    let usual = run(&["export", out.to_str().unwrap(), "--to", "mesh"]);
    assert_code(&usual, 0);
    let glb = fs::read(file("mesh.glb")).unwrap();
    assert!(glb.starts_with(b"glTF\x02\0\0\0") && glb.len() > 100_000, "{}", glb.len());
    assert_refused(&export("room.obj", &[]), 2, &["room.obj", "expected a name that ends in .glb or .ply"]);
    assert_refused(&export("room.ply", &["--map", "3"]), 2, &["expected map 3, found 1 map"]);
    assert_refused(
        &run(&["export", out.to_str().unwrap(), "--to", "ply", "--threads", "2"]),
        1,
        &["--threads is for --to mesh"],
    );
}

#[test]
fn a_map_with_its_mesh_has_the_one_that_export_makes() {
    let folder = folder("map_mesh");
    let (clouds, out) = (folder.join("clouds"), folder.join("out"));
    fs::create_dir_all(&clouds).unwrap();
    for number in 0..3 {
        let Cloud { points_m, colours, .. } = cloud(number, false);
        let mut file = Vec::new();
        write_ply(&points_m, &colours, &[], &mut file).unwrap();
        fs::write(clouds.join(format!("{number}.ply")), file).unwrap();
    }
    let out = out.to_str().unwrap();
    let mapped = |more: &[&str]| {
        let output = run(&[&["map", clouds.to_str().unwrap(), "-o", out], more].concat());
        assert_code(&output, 0);
        text(&output.stdout).to_owned()
    };
    let mesh = folder.join("out/mesh.glb");
    // the second run replaces what the first one made
    assert!(mapped(&["--mesh"]).contains(" mesh.glb"));
    assert!(!mapped(&["--mesh", "--threads", "2"]).contains("are gone"));
    let with_map = fs::read(&mesh).unwrap();
    assert!(with_map.starts_with(b"glTF") && with_map.len() > 100_000, "{}", with_map.len());
    let exported = folder.join("exported.glb");
    assert_code(&run(&["export", out, "--to", "mesh", "-o", exported.to_str().unwrap()]), 0);
    assert!(with_map == fs::read(exported).unwrap(), "other bytes than those of export");
    assert!(mapped(&[]).contains("exports of the results before are gone: mesh.glb"));
    assert!(!mesh.exists());

    let (plane, log) = (folder.join("plane"), small_log_in(&folder));
    let refused = run(&["map", &log, "-o", plane.to_str().unwrap(), "--mesh"]);
    assert_refused(&refused, 2, &["--mesh needs a recording of space, found one of the plane"]);
    assert!(!plane.exists());
}

/// Rows of floats and colours of a PLY file whose vertices have seven floats and a colour.
fn discs(ply: &[u8]) -> Vec<([f32; 7], [u8; 3])> {
    let end = b"end_header\n";
    let data_at = ply.windows(end.len()).position(|part| part == end).unwrap() + end.len();
    let row = |row: &[u8]| {
        let value = |k: usize| f32::from_le_bytes(row[4 * k..4 * k + 4].try_into().unwrap());
        (std::array::from_fn(value), row[28..].try_into().unwrap())
    };
    assert_eq!((ply.len() - data_at) % 31, 0);
    ply[data_at..].chunks_exact(31).map(row).collect()
}

#[test]
fn surfels_lie_on_the_floor_and_face_the_sensor() {
    let out = folder("export_space_surfels").join("out");
    mapped(&out, false);
    let export = |more: &[&str]| run(&[&["export", out.to_str().unwrap(), "--to"], more].concat());
    assert_code(&export(&["ply", "--surfels", "--resolution", "0.5"]), 0);
    let ply = fs::read(out.join("export.ply")).unwrap();
    let seen = read_ply("export.ply", &ply, &mut Notes::default()).unwrap();
    let discs = discs(&ply);
    assert_eq!(seen.points_m.len(), discs.len());
    // The floor 0.97 m below the sensor, away from the walls.
    let floor = discs.iter().filter(|([x, y, z, ..], _)| *z < -0.8 && x.abs() < 5.4 && y.abs() < 3.4);
    let floor: Vec<_> = floor.collect();
    assert!(floor.len() > 100, "{} of {}", floor.len(), discs.len());
    for ([_, _, z, nx, ny, nz, radius_m], colour) in floor {
        assert!((z + 0.97).abs() < 0.01, "the floor at {z} m");
        let tilt_deg = nx.hypot(*ny).atan2(*nz).to_degrees();
        assert!(tilt_deg < 2.0, "a normal {tilt_deg} degrees off");
        assert!((0.02..0.5).contains(radius_m), "{radius_m}");
        assert_eq!(*colour, [200, 100, 50]);
    }
    // All others face the sensor's way through the middle of the room as well.
    for ([x, y, z, nx, ny, nz, _], _) in &discs {
        assert!((nx * (0.3 - x) + ny * -y + nz * -z) > 0.0 || x.abs() < 1.0, "{x} {y} {z}: {nx} {ny} {nz}");
        assert!((nx * nx + ny * ny + nz * nz - 1.0).abs() < 1e-4);
    }
    assert_refused(&export(&["pcd", "--surfels"]), 1, &["--surfels is for --to ply alone"]);
}

#[test]
fn trajectories_are_read_back_as_those_that_the_run_wrote() {
    let out = folder("export_space_trajectories").join("out");
    let demo = ["demo", "--3d", "--seed", "3", "--seconds", "6", "-o", out.to_str().unwrap()];
    assert_code(&run(&demo), 0);
    ["tum", "kitti", "csv"].iter().for_each(|to| assert_code(&run(&["export", out.to_str().unwrap(), "--to", to]), 0));
    let read = |name: &str| text(&fs::read(out.join(name)).unwrap());
    let own = read("trajectory.tum");
    assert!(read("export.tum") == own, "the session has the final trajectory");
    let is_spatial = |line: &str| line.split(' ').skip(3).take(3).all(|word| word.parse::<f64>().unwrap() != 0.0);
    assert!(own.lines().filter(|line| is_spatial(line)).count() > 10, "height, roll and pitch are there to be lost");
    let times: String = own.lines().map(|line| format!("{}\n", line.split(' ').next().unwrap())).collect();
    fs::write(out.join("times.txt"), times).unwrap();
    let csv = read("export.csv");
    let (names, rows) = csv.split_once('\n').unwrap();
    assert!(names.starts_with("stamp_s,x_m,y_m,z_m,qx,qy,qz,qw,odom_x_m,odom_y_m,odom_z_m,odom_qx"), "{names}");
    assert!(rows.lines().all(|row| row.split(',').count() == 15), "{rows}");
    let first = |row: &str| row.split(',').take(8).collect::<Vec<_>>().join(" ") + "\n";
    fs::write(out.join("of_csv.tum"), rows.lines().map(first).collect::<String>()).unwrap();
    let path = |name: &str| out.join(name).display().to_string();
    let (reference, times) = (path("trajectory.tum"), path("times.txt"));
    for name in ["export.tum", "export.kitti", "of_csv.tum"] {
        let trajectory = path(name);
        let eval = ["eval", &trajectory, "--reference", &reference, "--times", &times, "--alignment", "none", "--json"];
        let output = run(&eval);
        assert_code(&output, 0);
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let most = |kind: &str, what: &str| found[0][kind][what]["max"].as_f64().unwrap();
        assert_eq!(found[0]["ate"]["translation_m"]["count"].as_u64(), Some(own.lines().count() as u64), "{found}");
        // What is written is rounded to nanometres.
        let rounded = if name == "export.kitti" { (1e-8, 1e-6) } else { (1e-12, 1e-6) };
        for kind in ["ate", "rpe"] {
            let off = (most(kind, "translation_m"), most(kind, "rotation_deg"));
            assert!(off.0 <= rounded.0 && off.1 <= rounded.1, "{name}, {kind}: {off:?}");
        }
    }
}

#[test]
fn resolution_and_band_are_what_was_asked_for() {
    let out = folder("export_space_asked").join("out");
    mapped(&out, false);
    let export = |more: &[&str]| run(&[&["export", out.to_str().unwrap(), "--to"], more].concat());
    assert_code(&export(&["octomap", "--resolution", "0.5"]), 0);
    let tree = Octree::read_bt(&mut fs::read(out.join("export.bt")).unwrap().as_slice()).unwrap();
    assert!((tree.resolution_m() - 0.5).abs() < 1e-12);
    assert_code(&export(&["pgm", "--band", "-0.8:1.5", "--resolution", "0.25"]), 0);
    assert!(text(&fs::read(out.join("export.yaml")).unwrap()).contains("resolution: 0.25"));
    assert_refused(&export(&["pgm", "--band", "1:0"]), 2, &["two heights"]);
    assert_refused(&export(&["pgm", "--resolution", "0"]), 2, &["0.005 to 10 m"]);
    assert_refused(&export(&["ply", "--band", "0:1"]), 1, &["--band is for --to pgm alone"]);
}

#[test]
fn what_the_other_kind_of_session_cannot_become_is_told() {
    let folder = folder("export_space_refused");
    let (plane, space, camera) = (folder.join("plane"), folder.join("space"), folder.join("camera"));
    assert_code(&run(&["map", &small_log_in(&folder), "-o", plane.to_str().unwrap(), "--quiet"]), 0);
    mapped(&space, false);
    mapped(&camera, true);
    let export = |of: &Path, more: &[&str]| run(&[&["export", of.to_str().unwrap(), "--to"], more].concat());
    for to in ["ply", "pcd", "octomap", "mesh"] {
        assert_refused(
            &export(&plane, &[to]),
            1,
            &[&format!("--to {to} needs a session of space, found one of the plane")],
        );
    }
    assert_refused(
        &export(&space, &["worldfile"]),
        1,
        &["--to worldfile needs a session of the plane, found one of space"],
    );
    assert_refused(&export(&space, &["tum", "--resolution", "0.5"]), 1, &["--resolution is for maps"]);
    assert_refused(&export(&space, &["csv", "--surfels"]), 1, &["--surfels is for --to ply alone"]);
    assert_refused(&export(&plane, &["pgm", "--band", "0:1"]), 1, &["--band needs a session of space"]);
    assert_refused(&export(&plane, &["tum", "--surfels"]), 1, &["--surfels needs a session of space"]);
    assert_refused(&export(&camera, &["pgm"]), 1, &["z axis points upwards"]);
    assert_code(&export(&camera, &["octomap"]), 0);
}
