//! Real recordings: what is read fits together by the poses that came with them.

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
        points.filter(|p| p.iter().all(|v| v.is_finite()) && (2.0..40.0).contains(&p.norm())).collect()
    };
    let mut cells: HashMap<[i64; 3], Vec<Vector3<f64>>> = HashMap::new();
    good(a).into_iter().for_each(|p| cells.entry(place(&p)).or_default().push(p));
    let mut distances: Vec<f64> = good(b)
        .into_iter()
        .step_by(23)
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

#[test]
fn combos() {
    let Some(disk) = given("rgbd_open3d5") else { return };
    for f in ["trajectory.log", "odometry.log"] {
        for c in ["camera.json", "camera_primesense.json"] {
            let (log, cam) = (disk.read(f).unwrap(), disk.read(c).unwrap());
            let memory = Memory { behind: Some(&disk), ..Memory::default() }
                .with("trajectory.log", log)
                .with("camera.json", cam);
            let recording = opened(&memory);
            let o = CameraOptions::default();
            let im = images(&recording, &o, 5);
            let camera = recording.camera(&o).unwrap().unwrap();
            for k in 1..5 {
                let a_from_b = pose_at(&recording, 0, im[0].stamp).between(pose_at(&recording, 0, im[k].stamp));
                println!(
                    "{f} {c} {k} {:.4} {:.4} inv {:.4} moved {:.3} {:.3}",
                    depth_apart_m(&camera, &im[0], &im[k], a_from_b),
                    depth_apart_m(&camera, &im[0], &im[k], Pose3::identity()),
                    depth_apart_m(&camera, &im[0], &im[k], a_from_b.inverse()),
                    a_from_b.translation.norm(),
                    a_from_b.rotation.angle()
                );
            }
        }
    }
    let disk = given("rgbd_tum_fr1desk9").unwrap();
    for i in [[517.3, 516.5, 318.6, 255.3], [525.0, 525.0, 319.5, 239.5]] {
        let o = CameraOptions { intrinsics: Some(i), depth_scale: None };
        let all: Vec<f64> =
            [[0, 4], [0, 8], [1, 5], [2, 7], [3, 8], [4, 8]].iter().map(|p| fit_of_images(&disk, &o, *p)[0]).collect();
        println!("tum {i:?} {all:.4?}");
    }
    let disk = given("3d_os0_hall").unwrap();
    let recording = opened(&disk);
    let clouds = all(&recording);
    for k in (10..84).step_by(9) {
        for r in 0..2 {
            let [a, b] = [k, k + 1].map(|k| pose_at(&recording, r, clouds[k].stamp));
            println!(
                "os0 {r} {k} turned {:.3} {:.4} still {:.4} inv {:.4}",
                a.between(b).rotation.angle(),
                apart_m(&clouds[k], &clouds[k + 1], a.between(b)),
                apart_m(&clouds[k], &clouds[k + 1], Pose3::identity()),
                apart_m(&clouds[k], &clouds[k + 1], b.between(a))
            );
        }
    }
    let _ = (Kind::Tum, NoteKind::Truncated, ReferenceFrame::Sensor);
}
