//! Files that are something else, containers in other wrappings, drives that are not one.

use crate::robot::Robot;
use crate::support::{assert_code, assert_refused, folder, run, small_log, small_log_in, text};
use bzip2::write::BzEncoder;
use flate2::write::GzEncoder;
use mapwright_bags::{Connection, Encoding, McapCompression, McapWriter};
use mapwright_geom::Stamp;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

fn poses(out: &Path) -> String {
    fs::read_to_string(out.join("trajectory.tum")).unwrap()
}

#[test]
fn a_file_that_is_something_else_is_named_with_what_reads_it() {
    let folder = folder("something_else");
    let png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x10\0\0\0\x10\x08\0\0\0\0";
    let rows = b"0.438,5.000,3.625,Slight-Right-Turn\n0.437,5.000,3.620,Move-Forward\n";
    let cases: [(&str, &[u8], &str); 12] = [
        ("a.png", png, "a PNG picture"),
        ("a.jpg", b"\xff\xd8\xff\xe0\0\x10JFIF\0", "a JPEG picture"),
        ("a.ply.txt", b"ply\nformat ascii 1.0\n", "a cloud as PLY"),
        ("a.cloud", b"# .PCD v0.7 - Point Cloud Data file format\n", "a cloud as PCD"),
        ("a.out", b"\x7fELF\x02\x01\x01\0\0\0", "a program (ELF)"),
        ("a.mcap", b"version https://git-lfs.github.com/spec/v1\noid sha256:b9\nsize 990\n", "git lfs pull"),
        ("a.g2o", b"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n", "mapwright optimize"),
        ("a.tum", b"# a trajectory\n1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n", "mapwright eval"),
        ("a.kitti", b"1 0 0 0 0 1 0 0 0 0 1 0\n", "mapwright eval"),
        ("a.pbstream", b"\xdb\x01\xf5\x5b\x7b\x1f\x1d\x7b\x10\0\0\0\0\0\0\0", "pbstream"),
        ("a.bag", b"#ROSRECORD V1.2\nop=\x03\n", "a ROS 1 bag of version 2.0"),
        (
            "a.csv",
            rows,
            "3 numbers and a word in each line, such as `Slight-Right-Turn`, without a header, stamps or poses",
        ),
    ];
    let mut packed = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(png).unwrap();
    let packed = packed.finish().unwrap();
    let out = folder.join("out");
    for (name, bytes, says) in cases.into_iter().chain([("b.png.gz", &packed[..], "a PNG picture")]) {
        let path = folder.join(name).display().to_string();
        fs::write(&path, bytes).unwrap();
        for output in [run(&["map", &path, "-o", out.to_str().unwrap()]), run(&["info", &path])] {
            assert_refused(&output, 1, &[name, says]);
            let said = text(&output.stderr);
            assert!(said.chars().all(|c| c == '\n' || !c.is_control() && c != '\u{fffd}'), "{said:?}");
            assert!(!said.contains("\\u{"), "{said}");
        }
        assert!(!out.exists());
    }
}

/// Where no folder is named the results go to one that has the log's name.
#[test]
fn results_go_to_a_folder_named_after_the_log() {
    let folder = folder("default_folder");
    fs::write(folder.join("a.b.clf.gz"), small_log()).unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_mapwright"))
        .args(["map", "a.b.clf.gz"])
        .current_dir(&folder)
        .output()
        .unwrap();
    assert_code(&output, 0);
    assert!(folder.join("mapwright-a.b/map.png").is_file(), "{output:?}");
}

/// What was exported of the results before is of another map.
#[test]
fn exports_of_earlier_results_go_with_these() {
    let folder = folder("outdated_exports");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    let map = || run(&["map", &log, "-o", out.to_str().unwrap()]);
    assert_code(&map(), 0);
    for to in ["tum", "kitti", "worldfile"] {
        let output = run(&["export", out.to_str().unwrap(), "--to", to, "--json"]);
        assert_code(&output, 0);
        let made: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        for file in made["files"].as_array().unwrap() {
            assert!(Path::new(file.as_str().unwrap()).is_file(), "{made}");
        }
    }
    fs::write(out.join("mine.tum"), "").unwrap();
    let output = map();
    assert_code(&output, 0);
    let gone = ["export.tum", "export.kitti", "export.times", "map_plain.png", "map_plain.pgw"];
    assert!(text(&output.stdout).contains(&gone.join(" ")), "{output:?}");
    assert!(gone.iter().all(|name| !out.join(name).exists()) && out.join("mine.tum").exists());
}

/// The file that is written is scored against the trajectory that it was made of, with its stamps and without.
#[test]
fn what_export_writes_for_kitti_is_read_by_eval() {
    let folder = folder("kitti_again");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    assert_code(&run(&["map", &log, "-o", out.to_str().unwrap(), "--quiet"]), 0);
    assert_code(&run(&["export", out.to_str().unwrap(), "--to", "kitti"]), 0);
    let path = |name: &str| out.join(name).display().to_string();
    let (kitti, truth, times) = (path("export.kitti"), path("trajectory.tum"), path("export.times"));
    let plain = ["eval", kitti.as_str(), "--reference", truth.as_str()];
    for output in [run(&plain), run(&[&plain[..], &["--times", times.as_str()]].concat())] {
        assert_code(&output, 0);
        assert!(text(&output.stdout).contains("rmse 0.0000 m"), "{output:?}");
    }
}

/// Stamps that are a little late match few poses, and that is said.
#[test]
fn eval_says_how_many_poses_matched_and_warns_below_half() {
    let folder = folder("few_matches");
    let rows = |shift: &dyn Fn(usize) -> f64| -> String {
        (0..100).map(|k| format!("{:.3} {k} {} 0 0 0 0 1\n", k as f64 + shift(k), k % 7)).collect()
    };
    let write = |name: &str, rows: String| {
        fs::write(folder.join(name), rows).unwrap();
        folder.join(name).display().to_string()
    };
    let truth = write("truth.tum", rows(&|_| 0.0));
    let late = write("late.tum", rows(&|k| if k % 10 == 0 { 0.0 } else { 0.02 }));
    let most = write("most.tum", rows(&|k| if k % 10 == 0 { 0.02 } else { 0.0 }));
    let output = run(&["eval", &late, "--reference", &truth]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("10 of 100 poses have a reference within 0.01 s"), "{output:?}");
    let json = run(&["eval", &late, "--reference", &truth, "--json"]);
    assert_code(&json, 3);
    let value: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&value[0]["matched"]["pairs"], &value[0]["matched"]["of"]), (&10.into(), &100.into()));
    let output = run(&["eval", &most, "--reference", &truth]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("90 of 100 poses have a reference"), "{output:?}");
}

/// Edges of TORO without information have the identity.
#[test]
fn edges_without_information_have_the_identity_and_that_is_said() {
    let folder = folder("no_information");
    let write = |name: &str, edges: [&str; 2]| {
        let vertices: String = (0..3).map(|k| format!("VERTEX3 {k} {k} 0 0 0 0 0\n")).collect();
        fs::write(folder.join(name), vertices + &edges.join("\n") + "\n").unwrap();
        folder.join(name).display().to_string()
    };
    let whole = |from: u32| {
        let row = |r: usize| (r..6).map(|c| if r == c { "1 " } else { "0 " }).collect::<String>();
        format!("EDGE3 {from} {} 1.1 0 0 0 0 0 {}", from + 1, (0..6).map(row).collect::<String>())
    };
    let out = |name: &str| folder.join(name).display().to_string();
    let (without, with) = (write("a.graph", ["EDGE3 0 1 1.1 0 0 0 0 0", "EDGE3 1 2 1.1 0 0 0 0 0"]), {
        write("b.graph", [&whole(0), &whole(1)])
    });
    let output = run(&["optimize", &without, "-o", &out("a.g2o")]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("2 edges without information: the identity taken"), "{output:?}");
    assert_code(&run(&["optimize", &with, "-o", &out("b.g2o")]), 0);
    assert_eq!(fs::read(out("a.g2o")).unwrap(), fs::read(out("b.g2o")).unwrap());
    let mixed = write("c.graph", [&whole(0), "EDGE3 1 2 1.1 0 0 0 0 0"]);
    assert_refused(&run(&["optimize", &mixed, "-o", &out("c.g2o")]), 1, &["line 5", "information matrix"]);
    let mixed = write("d.graph", ["EDGE3 0 1 1.1 0 0 0 0 0", &whole(1)]);
    assert_refused(&run(&["optimize", &mixed, "-o", &out("d.g2o")]), 1, &["line 5", "no information, as in"]);
}

#[test]
fn commands_name_what_they_do_not_read() {
    let folder = folder("not_read");
    let log = small_log_in(&folder);
    let (graph, rows) = (folder.join("a.g2o").display().to_string(), folder.join("a.tum").display().to_string());
    fs::write(&graph, "VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n").unwrap();
    fs::write(&rows, "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    assert_refused(&run(&["explain", &log]), 1, &["expected a folder of results", "a CARMEN log", "mapwright map"]);
    assert_refused(&run(&["eval", &graph, "--reference", &rows]), 1, &["a pose graph", "mapwright optimize"]);
    assert_refused(&run(&["optimize", &rows, "-o", &graph]), 1, &["expected a pose graph", "found a trajectory"]);
    assert_refused(&run(&["optimize", &log, "-o", &graph]), 1, &["expected a pose graph", "a CARMEN log"]);
    let directory = folder.display().to_string();
    assert_refused(&run(&["info", &directory]), 1, &["found a directory", "small.clf"]);
}

#[test]
fn recordings_compressed_as_a_whole_are_read() {
    let folder = folder("packed");
    let plain = Robot { to_s: 8.0, ..Robot::default() }.record(&folder.join("plain.mcap"));
    let bytes = fs::read(&plain).unwrap();
    let mut gzip = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(&bytes).unwrap();
    let gzip = gzip.finish().unwrap();
    let mut bzip2 = BzEncoder::new(Vec::new(), bzip2::Compression::fast());
    bzip2.write_all(&bytes).unwrap();
    let map = |name: &str, bytes: &[u8]| {
        let (log, out) = (folder.join(name), folder.join(format!("{name}_out")));
        fs::write(&log, bytes).unwrap();
        (run(&["map", log.to_str().unwrap(), "-o", out.to_str().unwrap()]), out)
    };
    let (output, out) = map("plain.mcap", &bytes);
    assert_code(&output, 0);
    for (name, bytes) in [("a.mcap.gz", &gzip), ("b.mcap.bz2", &bzip2.finish().unwrap())] {
        let (output, packed) = map(name, bytes);
        assert_code(&output, 0);
        assert_eq!(poses(&packed), poses(&out));
    }
    // its only chunk is cut
    let (output, _) = map("cut.mcap.gz", &gzip[..gzip.len() / 2]);
    assert_refused(&output, 1, &["the recording is damaged: truncated", "gzip to the end"]);
}

#[test]
fn mcap_files_put_one_behind_the_other_are_read_whole() {
    let folder = folder("one_behind_the_other");
    let first = Robot { to_s: 6.0, ..Robot::default() }.record(&folder.join("first.mcap"));
    let second = Robot { from_s: 6.01, to_s: 12.0, ..Robot::default() }.record(&folder.join("second.mcap"));
    let both = folder.join("both.mcap");
    fs::write(&both, [fs::read(&first).unwrap(), fs::read(&second).unwrap()].concat()).unwrap();
    let (one, row) = (folder.join("one"), folder.join("row"));
    let output = run(&["map", both.to_str().unwrap(), "-o", one.to_str().unwrap()]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("another MCAP file, read as well"), "{output:?}");
    assert_code(&run(&["map", &first, &second, "-o", row.to_str().unwrap()]), 0);
    assert_eq!(poses(&one).lines().count(), poses(&row).lines().count());
}

#[test]
fn channels_without_schemas_are_said_to_have_none() {
    let folder = folder("no_schema");
    let path = folder.join("none.mcap");
    let mut writer = McapWriter::new(File::create(&path).unwrap(), McapCompression::None).unwrap();
    let id = writer.add_connection(&Connection::new("/scan", "", Encoding::Cdr)).unwrap();
    for k in 0..5 {
        writer.write(id, Stamp(k), Stamp(k), &[0, 1, 0, 0, 1, 2, 3, 4]).unwrap();
    }
    writer.finish().unwrap();
    let out = folder.join("out");
    let output = run(&["map", path.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_refused(&output, 1, &["/scan", "no schema", "types of their messages are unknown"]);
}

#[test]
fn where_nothing_is_left_of_a_damaged_recording_that_is_said() {
    let folder = folder("only_chunk");
    let path = folder.join("one.mcap");
    let mut writer = McapWriter::new(File::create(&path).unwrap(), McapCompression::Zstd).unwrap();
    let connection = Connection::new("/scan", "sensor_msgs/msg/LaserScan", Encoding::Cdr);
    let id = writer.add_connection(&connection).unwrap();
    for k in 0..50 {
        writer.write(id, Stamp(k), Stamp(k), &[0, 1, 0, 0, 1, 2, 3, 4, k as u8, 7, 8, 9]).unwrap();
    }
    writer.finish().unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let zstd = [0x28, 0xb5, 0x2f, 0xfd];
    let chunk = bytes.windows(4).position(|window| window == zstd).unwrap();
    bytes[chunk + 4..chunk + 24].fill(0xA5);
    fs::write(&path, bytes).unwrap();
    let out = folder.join("out");
    let output = run(&["map", path.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_refused(&output, 1, &["/scan: no messages", "the recording is damaged", "chunk", "byte "]);
}

#[test]
fn a_byte_order_mark_is_no_part_of_a_log() {
    let folder = folder("bom");
    let log = [b"\xef\xbb\xbf", small_log()].concat();
    let (path, out) = (folder.join("bom.clf"), folder.join("out"));
    fs::write(&path, log).unwrap();
    assert_code(&run(&["map", path.to_str().unwrap(), "-o", out.to_str().unwrap()]), 0);
}

#[test]
fn drives_that_cannot_follow_each_other_are_not_put_in_a_row() {
    let folder = folder("two_drives");
    let log = small_log_in(&folder);
    let line = |line: &str| -> String {
        // ... stamp host stamp
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let at = words.len() - 3;
        if words[0] == "ROBOTLASER1" || words[0] == "ODOM" {
            words[at] = (words[at].parse::<f64>().unwrap() + 85_000.0 * 3600.0).to_string();
        }
        words.join(" ")
    };
    let text = String::from_utf8(small_log().to_vec()).unwrap();
    let other = folder.join("later.clf").display().to_string();
    fs::write(&other, text.lines().map(line).collect::<Vec<_>>().join("\n") + "\n").unwrap();
    let out = folder.join("out").display().to_string();
    let says = ["later.clf cannot follow", "85,000 h after that ends", "mapwright merge"];
    assert_refused(&run(&["map", &log, &other, "-o", &out]), 1, &says);
    assert_refused(&run(&["map", &other, &log, "-o", &out]), 1, &["h before that ends", "mapwright merge"]);
    assert!(!Path::new(&out).exists());
}
