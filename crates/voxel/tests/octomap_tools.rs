//! What OctoMap's own tools make of our files. Passed over where they are not installed (`apt-get install octomap-tools`).
#![allow(clippy::unwrap_used, clippy::print_stderr)]

use mapwright_geom::Pose3;
use mapwright_voxel::{Change, Leaves, Occupancy, OccupancySettings, Octree};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A room of 12 x 8 x 3 m with a pillar, seen from two places.
fn room() -> Occupancy {
    let mut occupancy = Occupancy::new(OccupancySettings { resolution_m: 0.1, max_range_m: 30.0 });
    for place_m in [[0.03, 0.02, 0.01], [2.5, -1.0, 0.2]] {
        let pose = Pose3::from_quaternion(place_m, [0.0, 0.0, 0.1, 1.0]).unwrap();
        let inverse = pose.inverse();
        let points = directions().filter_map(|direction| {
            let end = nalgebra::Vector3::from(place_m) + direction * range_m(place_m, direction)?;
            let seen = inverse.transform(end);
            Some([seen.x as f32, seen.y as f32, seen.z as f32])
        });
        occupancy.draw(points, [0.0; 3], pose, Change::Add);
    }
    occupancy
}

fn directions() -> impl Iterator<Item = nalgebra::Vector3<f64>> {
    (0..300).flat_map(|a| {
        (-40..40).map(move |e| {
            let (azimuth, height) = (f64::from(a) * 0.021, f64::from(e) * 0.018);
            nalgebra::Vector3::new(azimuth.cos() * height.cos(), azimuth.sin() * height.cos(), height.sin())
        })
    })
}

/// To the walls, none through the door.
fn range_m(from: [f64; 3], direction: nalgebra::Vector3<f64>) -> Option<f64> {
    let walls = [[-6.05, 6.05], [-4.05, 4.05], [-1.05, 2.05]];
    let to_wall = |k: usize| (walls[k][usize::from(direction[k] > 0.0)] - from[k]) / direction[k];
    let range = to_wall(0).min(to_wall(1)).min(to_wall(2));
    (range.is_finite() && direction.y.abs() > 0.02).then_some(range)
}

/// Runs a tool; none where there is none.
fn run(tool: &str, arguments: &[&Path]) -> Option<String> {
    let output = Command::new(tool).args(arguments).output();
    let Ok(output) = output else {
        eprintln!("skipped: {tool} is not installed (apt-get install octomap-tools)");
        return None;
    };
    assert!(output.status.success(), "{tool}: {}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn write(tree: &Octree, folder: &Path) -> [PathBuf; 2] {
    let [bt, ot] = ["ours.bt", "ours.ot"].map(|name| folder.join(name));
    tree.write_bt(&mut File::create(&bt).unwrap()).unwrap();
    tree.write_ot(&mut File::create(&ot).unwrap()).unwrap();
    [bt, ot]
}

#[test]
fn octomap_reads_what_we_write_and_writes_the_same() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("octomap_tools");
    fs::create_dir_all(&folder).unwrap();
    let full = Octree::of(&room(), Leaves::LogOdds);
    let simple = Octree::of(&room(), Leaves::MostLikely);
    let [bt, ot] = write(&full, &folder);
    let occupied = simple.leaves().filter(|leaf| leaf.is_occupied()).count();
    assert!(occupied > 20_000, "{occupied}");

    let Some(told) = run("bt2vrml", &[&bt]) else { return };
    assert!(told.contains(&format!("Finished writing {occupied} voxels")), "{occupied}: {told}");

    // From its binary file OctoMap makes the full one that we would have written, and from our full one our binary one.
    let [from_bt, from_ot] = ["theirs.ot", "theirs.bt"].map(|name| folder.join(name));
    run("convert_octree", &[&bt, &from_bt]).unwrap();
    run("convert_octree", &[&ot, &from_ot]).unwrap();
    assert!(Octree::read_ot(&mut File::open(&from_bt).unwrap()).unwrap() == simple);
    assert!(Octree::read_bt(&mut File::open(&from_ot).unwrap()).unwrap() == simple);

    let told = run("compare_octrees", &[&ot, &ot]).unwrap();
    assert!(told.contains("KL") || told.contains("Difference"), "{told}");
}
