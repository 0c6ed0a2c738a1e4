//! Finished maps: joined where they are of one building, refused where not, and files that are no maps.

use crate::support::{assert_code, assert_refused, folder, run, text};
use mapwright_formats::{GridImage, UNKNOWN, read_map_image, read_map_yaml, write_map_yaml, write_pgm};
use mapwright_geom::Pose2;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Rooms and doors: low and high corners, metres.
struct Building {
    rooms: &'static [[f64; 4]],
    doors: &'static [[f64; 4]],
}

const OURS: Building = Building {
    rooms: &[
        [0.0, 0.0, 14.0, 2.0],
        [0.0, 2.0, 4.0, 6.0],
        [4.0, 2.0, 9.5, 5.0],
        [9.5, 2.0, 14.0, 7.5],
        [1.0, -3.5, 5.0, 0.0],
        [7.0, -5.0, 9.0, 0.0],
        [12.0, 7.5, 13.0, 8.5],
    ],
    doors: &[
        [1.0, 1.8, 2.0, 2.2],
        [6.0, 1.8, 7.0, 2.2],
        [11.0, 1.8, 12.0, 2.2],
        [3.0, -0.2, 4.0, 0.2],
        [7.5, -0.2, 8.3, 0.2],
        [12.2, 7.3, 12.8, 7.7],
    ],
};

const OTHER: Building = Building {
    rooms: &[
        [0.0, 0.0, 3.0, 11.0],
        [3.0, 0.0, 6.5, 4.5],
        [3.0, 4.5, 10.0, 7.0],
        [-2.5, 8.0, 0.0, 11.0],
        [-6.0, 1.0, 0.0, 3.5],
    ],
    doors: &[[2.8, 1.0, 3.2, 2.0], [2.8, 5.0, 3.2, 6.0], [-0.2, 9.0, 0.2, 10.0], [-0.2, 2.0, 0.2, 3.0]],
};

impl Building {
    fn cell(&self, [x, y]: [f64; 2]) -> u8 {
        let inside =
            |r: &[f64; 4], rim: f64| (r[0] - rim..r[2] + rim).contains(&x) && (r[1] - rim..r[3] + rim).contains(&y);
        let rim = |r: &&[f64; 4]| inside(r, 0.05) && !inside(r, -0.05);
        match () {
            () if self.doors.iter().any(|door| inside(door, 0.0)) => 0,
            () if self.rooms.iter().any(|room| rim(&room)) => 100,
            () if self.rooms.iter().any(|room| inside(room, 0.0)) => 0,
            () => UNKNOWN,
        }
    }

    /// A map of what lies between two x, in a frame of its own whose corner is at a pose of the building.
    fn map(&self, between: std::ops::Range<f64>, building_from_map: Pose2, resolution_m: f64) -> GridImage {
        let side = (32.0 / resolution_m) as usize;
        let cell = |at: usize| {
            let centre = [at % side, at / side].map(|cells| (cells as f64 + 0.5) * resolution_m);
            let place = building_from_map.transform(centre);
            if between.contains(&place[0]) { self.cell(place) } else { UNKNOWN }
        };
        let cells = (0..side * side).map(cell).collect();
        GridImage { width: side, height: side, resolution_m, world_from_map: Pose2::new(-4.0, 2.5, 0.0), cells }
    }
}

/// Where the corner of the second robot's map lies in the building, and of the first's.
const FIRST: Pose2 = Pose2 { x: -10.0, y: -12.0, theta: 0.0 };
const SECOND: Pose2 = Pose2 { x: 22.0, y: 20.0, theta: 2.9 };

fn written(folder: &Path, name: &str, map: &GridImage) -> String {
    let (yaml, pgm) = (folder.join(format!("{name}.yaml")), format!("{name}.pgm"));
    write_pgm(map, File::create(folder.join(&pgm)).unwrap()).unwrap();
    write_map_yaml(map, &pgm, File::create(&yaml).unwrap()).unwrap();
    yaml.to_str().unwrap().to_owned()
}

fn out(folder: &Path, name: &str) -> (PathBuf, String) {
    let path = folder.join(name);
    (path.clone(), path.to_str().unwrap().to_owned())
}

#[test]
fn two_maps_of_one_building_become_one() {
    let folder = folder("merge-maps");
    let a = written(&folder, "a", &OURS.map(-1.0..10.0, FIRST, 0.05));
    let b = written(&folder, "b", &OURS.map(3.0..15.0, SECOND, 0.04));
    let (joined, path) = out(&folder, "joined");
    let output = run(&["merge-maps", &a, &b, "-o", &path, "--json"]);
    assert_code(&output, 0);
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let [x, y, theta] = [0, 1, 2].map(|k| number(&said["a_from_b"][k]));
    let corner = Pose2::new(-4.0, 2.5, 0.0);
    let truth = corner * FIRST.inverse() * SECOND * corner.inverse();
    let error = truth.between(Pose2::new(x, y, theta));
    let off_m = (0..2).map(|k| number(&said["overlap_middle_b"][k])).collect::<Vec<_>>();
    let off_m = {
        let [one, other] = [truth, Pose2::new(x, y, theta)].map(|pose| pose.transform([off_m[0], off_m[1]]));
        (one[0] - other[0]).hypot(one[1] - other[1])
    };
    assert!(off_m < 0.03 && error.theta.abs() < 0.3_f64.to_radians(), "{off_m} {error:?}");
    // The joined map is one that can be read, in the first one's frame, and has the rooms that only one of them had.
    let yaml = joined.with_extension("yaml");
    let about = read_map_yaml(File::open(&yaml).unwrap()).unwrap();
    let image = BufReader::new(File::open(joined.with_extension("pgm")).unwrap());
    let map = read_map_image(&about, image).unwrap();
    assert!(fs::read_to_string(&yaml).unwrap().contains("image: joined.pgm") && map.resolution_m == 0.05);
    let at = |[x, y]: [f64; 2]| {
        let place = (map.world_from_map.inverse() * corner * FIRST.inverse()).transform([x, y]);
        let [u, v] = place.map(|m| (m / map.resolution_m) as usize);
        map.cells[v * map.width + u]
    };
    assert_eq!([[1.0, 4.0], [6.0, 1.0], [12.5, 5.0], [-2.0, 1.0]].map(at), [0, 0, 0, UNKNOWN]);
    assert!(joined.with_extension("png").exists());
    // In words, and of the same map twice; the same bytes every time.
    let first = fs::read(joined.with_extension("pgm")).unwrap();
    let output = run(&["merge-maps", &a, &b, "-o", &path]);
    assert_code(&output, 0);
    let words = text(&output.stdout);
    for says in ["decided  joined", "support", "rival", "misfit", "written"] {
        assert!(words.contains(says), "{says}: {words}");
    }
    assert_eq!(fs::read(joined.with_extension("pgm")).unwrap(), first);
    let twice = text(&run(&["merge-maps", &a, &a, "-o", &path]).stdout);
    assert!(twice.contains("x 0.000 m, y 0.000 m, heading 0.00 deg"), "{twice}");
    assert_refused(&run(&["merge-maps", &a, &b, "-o", &a]), 2, &["which is an input"]);
}

#[test]
fn maps_of_two_buildings_are_refused_with_the_reason() {
    let folder = folder("merge-maps-apart");
    let ours = written(&folder, "ours", &OURS.map(-1.0..15.0, FIRST, 0.05));
    let other = written(&folder, "other", &OTHER.map(-9.0..15.0, SECOND, 0.05));
    let hall = Building { rooms: &[[0.0, 0.0, 9.0, 5.0]], doors: &[] };
    let hall = written(&folder, "hall", &hall.map(-1.0..15.0, FIRST, 0.05));
    let (joined, path) = out(&folder, "joined");
    let refused = run(&["merge-maps", &ours, &other, "-o", &path]);
    assert_refused(&refused, 1, &["are not joined: expected", "found"]);
    assert!(text(&refused.stdout).contains("not joined"));
    let ambiguous = ["hall.yaml are not joined: expected one pose that fits best, found another one"];
    assert_refused(&run(&["merge-maps", &hall, &hall, "-o", &path]), 1, &ambiguous);
    assert!(!joined.with_extension("pgm").exists());
}

#[test]
fn files_that_are_no_maps_are_named_with_what_was_expected() {
    let folder = folder("merge-maps-wrong");
    let good = written(&folder, "good", &OURS.map(-1.0..10.0, FIRST, 0.05));
    let (_, path) = out(&folder, "joined");
    let wrong = |name: &str, yaml: &str, says: &[&str]| {
        let (file, wrong) = out(&folder, name);
        fs::write(file, yaml).unwrap();
        assert_refused(&run(&["merge-maps", &good, &wrong, "-o", &path]), 1, says);
    };
    let whole =
        "image: good.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n";
    let with = |from: &str, to: &str| whole.replace(from, to);
    wrong("zero.yaml", &with("0.05", "0"), &["zero.yaml", "resolution is 0, expected"]);
    wrong("nan.yaml", &with("[0, 0, 0]", "[.nan, 0, 0]"), &["nan.yaml", "origin x is NaN, expected"]);
    wrong("gone.yaml", &with("good.pgm", "gone.pgm"), &["cannot open", "gone.pgm"]);
    wrong("log.yaml", "FLASER 1 2 3\n", &["log.yaml", "expected"]);
    wrong("itself.yaml", &with("good.pgm", "itself.yaml"), &["expected a PGM or PNG image"]);
    fs::write(folder.join("huge.pgm"), "P5 20000 20000 255\n").unwrap();
    wrong(
        "huge.yaml",
        &with("good.pgm", "huge.pgm"),
        &["huge.pgm", "expected from 1 to 100000000 cells, found 20000 x 20000"],
    );
    fs::write(folder.join("cut.pgm"), "P5 200 200 255\nabc").unwrap();
    wrong("cut.yaml", &with("good.pgm", "cut.pgm"), &["cut.pgm", "expected 40000 bytes of pixels"]);
    let of_one = |value: u8| [b"P5 20 20 255\n".as_slice(), &[value; 400]].concat();
    fs::write(folder.join("unknown.pgm"), of_one(205)).unwrap();
    wrong("unknown.yaml", &with("good.pgm", "unknown.pgm").replace("0.25", "0.196"), &["nothing but unknown cells"]);
    fs::write(folder.join("free.pgm"), of_one(254)).unwrap();
    wrong("free.yaml", &with("good.pgm", "free.pgm"), &["free.yaml: expected walls, found nothing but free cells"]);
    let image = folder.join("good.pgm").to_str().unwrap().to_owned();
    assert_refused(&run(&["merge-maps", &image, &good, "-o", &path]), 1, &["good.pgm", "expected", "PGM picture"]);
    assert_refused(&run(&["merge-maps", "nowhere.yaml", &good, "-o", &path]), 1, &["cannot open nowhere.yaml"]);
}
