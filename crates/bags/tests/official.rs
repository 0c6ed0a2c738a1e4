//! The same as the official readers in Python see, message by message: of the given bags, and of what the writers here
//! write. `scripts/check_bags.py` asks them; Python with the wheels `rosbags` and `mcap` is `MAPWRIGHT_PYTHON`, or else
//! `python3`.
#![allow(clippy::explicit_write, clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

mod common;

use common::Seen;
use mapwright_bags::{Bag1Compression, Container, DamageKind, McapCompression, ReadReport};
use serde_json::Value;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// Python with the wheels, or a remark that the test is skipped.
fn python(test: &str) -> Option<String> {
    let python = std::env::var("MAPWRIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let works = Command::new(&python).args(["-c", "import rosbags, mcap, lz4, zstandard"]).output();
    if works.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let _ = writeln!(std::io::stderr(), "{test}: skipped: no Python with rosbags and mcap ({python})");
    None
}

/// What an official reader says of a recording.
fn ask(python: &str, reader: &str, path: &Path) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/check_bags.py");
    let output = Command::new(python).arg(script).arg(reader).arg(path).output().unwrap();
    assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice::<Value>(&output.stdout).unwrap()[0].take()
}

/// `a/b` as `a/msg/b`, the only form in which rosbags says it.
fn long_type(name: &str) -> String {
    if name.matches('/').count() == 1 { name.replace('/', "/msg/") } else { name.to_owned() }
}

fn official_messages(answer: &Value) -> Vec<Seen> {
    let connections = answer["connections"].as_array().unwrap();
    let of = |message: &Value| {
        let connection = &connections[message[0].as_u64().unwrap() as usize];
        Seen {
            topic: connection["topic"].as_str().unwrap().to_owned(),
            type_name: long_type(connection["type"].as_str().unwrap()),
            stamp: message[1].as_i64().unwrap(),
            length: message[2].as_u64().unwrap() as usize,
            crc: message[3].as_u64().unwrap() as u32,
        }
    };
    answer["messages"].as_array().unwrap().iter().map(of).collect()
}

/// Compares a recording with an official reader; that orders by stamp where `sorts`.
fn compare(python: &str, reader: &str, path: &Path, sorts: bool) -> ReadReport {
    let answer = ask(python, reader, path);
    let (mut messages, report, connections) = common::read_path(path).unwrap();
    for message in &mut messages {
        message.type_name = long_type(&message.type_name);
    }
    if sorts {
        messages.sort_by_key(|message| message.stamp);
    }
    let official = official_messages(&answer);
    let differs = messages.iter().zip(&official).position(|(a, b)| a != b);
    let shown = differs.map(|place| (place, &messages[place], &official[place]));
    assert!(differs.is_none(), "{}: {shown:?}", path.display());
    assert_eq!(messages.len(), official.len(), "{}", path.display());
    for theirs in answer["connections"].as_array().unwrap() {
        let same = |c: &&mapwright_bags::Connection| {
            let md5sum = c.metadata.get("md5sum").or(c.metadata.get("type_description_hash")).map_or("", |s| s);
            let definition = c.definition.as_ref().map_or("", |definition| &*definition.text);
            theirs["topic"] == *c.topic
                && theirs["type"].as_str() == Some(&long_type(&c.type_name))
                && (theirs["md5sum"] == md5sum || md5sum.is_empty() || reader == "mcap")
                && theirs["definition"].as_str().unwrap().trim() == definition.trim()
        };
        assert!(connections.iter().any(|c| same(&c)), "{}: {theirs}", path.display());
    }
    report
}

#[test]
fn every_message_of_every_given_bag_is_the_same() {
    let test = "every_message_of_every_given_bag_is_the_same";
    let (Some(python), Some(folder)) = (python(test), common::given(test)) else { return };
    let bags = [
        ("rosbags", "scan_tools/laser_scan_matcher_demo.bag", 0),
        ("rosbags", "plotjuggler/tilt_laser.bag", 0),
        ("rosbags", "evo/ROS_example.bag", 0),
        ("rosbags", "derived_intel/intel_180s.bag", 4509),
        ("rosbags", "plotjuggler/rosbag2_test", 4695),
        ("rosbags", "evo/tf_example", 518),
        ("rosbags", "derived_intel/intel_180s_db3", 4509),
        ("rosbags", "derived_intel/intel_180s_mcap", 4509),
        ("mcap", "evo/nav2_turtlebot.mcap", 0),
        ("mcap", "derived_intel/intel_180s_mcap/intel_180s_mcap.mcap", 4509),
    ];
    for (reader, path, count) in bags {
        let report = compare(&python, reader, &folder.join(path), reader == "rosbags");
        println!("{path}: {} messages in {:?}", report.messages, report.container);
        assert!(!report.has_losses() && report.messages > 0, "{path}: {:?}", report.damages);
        assert!(count == 0 || report.messages == count, "{path}");
        let irregular = report.damages.contains_key(&DamageKind::Irregular);
        assert_eq!(irregular, path.starts_with("scan_tools"), "{path}: {:?}", report.damages);
    }
}

#[test]
fn a_folder_and_the_files_in_it_agree() {
    let test = "a_folder_and_the_files_in_it_agree";
    let Some(folder) = common::given(test) else { return };
    let derived = folder.join("derived_intel");
    let (of_bag, _, _) = common::read_path(&derived.join("intel_180s.bag")).unwrap();
    let stamps = |messages: &[Seen]| messages.iter().map(|m| (m.topic.clone(), m.stamp)).collect::<Vec<_>>();
    for (name, file, container) in
        [("intel_180s_db3", "db3", Container::Sqlite), ("intel_180s_mcap", "mcap", Container::Mcap)]
    {
        let (of_folder, report, _) = common::read_path(&derived.join(name)).unwrap();
        let (of_file, _, _) = common::read_path(&derived.join(name).join(format!("{name}.{file}"))).unwrap();
        assert_eq!(report.container, Some(container));
        assert_eq!(of_folder, of_file);
        assert_eq!(stamps(&of_folder), stamps(&of_bag));
    }
}

#[test]
fn what_is_written_reads_the_same_with_the_official_readers() {
    let test = "what_is_written_reads_the_same_with_the_official_readers";
    let Some(python) = python(test) else { return };
    let (made, folder) = (common::messages(300), common::folder("written"));
    for (name, compression) in
        [("none", Bag1Compression::None), ("lz4", Bag1Compression::Lz4), ("bz2", Bag1Compression::Bz2)]
    {
        let path = folder.join(name).with_extension("bag");
        std::fs::write(&path, common::bag1(&made, compression)).unwrap();
        let report = compare(&python, "rosbags", &path, false);
        assert_eq!((report.messages, report.chunks.contains_key(name)), (300, true));
    }
    for (name, compression) in [("none", McapCompression::None), ("zstd", McapCompression::Zstd)] {
        let path = folder.join(name).with_extension("mcap");
        std::fs::write(&path, common::mcap(&made, compression)).unwrap();
        let report = compare(&python, "mcap", &path, false);
        assert_eq!((report.messages, report.indexed), (300, Some(true)));
        let answer = ask(&python, "mcap", &path);
        assert_eq!((answer["counted"].as_u64(), answer["profile"].as_str()), (Some(300), Some("ros2")));
        compare(&python, "rosbags", &folder_with_metadata(&folder, name, &path), false);
    }
}

/// rosbags wants a folder with `metadata.yaml` around an MCAP file.
fn folder_with_metadata(folder: &Path, name: &str, file: &Path) -> std::path::PathBuf {
    let folder = folder.join(format!("folder_{name}"));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(file, folder.join("part_0.mcap")).unwrap();
    let topics: String = common::TOPICS
        .iter()
        .map(|(topic, name)| {
            format!(
                "    - topic_metadata: {{name: {topic}, type: some_msgs/msg/{name}, serialization_format: cdr, \
                 offered_qos_profiles: ''}}\n      message_count: 100\n"
            )
        })
        .collect();
    let text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths: [part_0.mcap]\n  \
         duration: {{nanoseconds: 1}}\n  starting_time: {{nanoseconds_since_epoch: 1}}\n  message_count: 300\n  \
         compression_format: ''\n  compression_mode: ''\n  topics_with_message_count:\n{topics}"
    );
    std::fs::write(folder.join("metadata.yaml"), text).unwrap();
    folder
}

/// The messages that `check_bags.py write` makes up.
fn made_in_python() -> Vec<Seen> {
    let data = |number: u32| {
        let mut data = vec![0, 1, 0, 0];
        data.extend_from_slice(&number.to_le_bytes());
        data.extend((0..number * 3).map(|k| ((number * k) % 251) as u8));
        data
    };
    let seen = |number: u32| Seen {
        topic: if number % 2 == 1 { "/odd" } else { "/even" }.to_owned(),
        type_name: "std_msgs/msg/String".to_owned(),
        stamp: 1_600_000_000_000_000_000 + i64::from(number) * 1_000_000,
        length: data(number).len(),
        crc: crc32fast::hash(&data(number)),
    };
    (0..400).map(seen).collect()
}

#[test]
fn what_the_official_writers_compress_comes_back() {
    let test = "what_the_official_writers_compress_comes_back";
    let Some(python) = python(test) else { return };
    let folder = common::folder("official");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/check_bags.py");
    assert!(Command::new(&python).arg(script).arg("write").arg(&folder).status().unwrap().success());
    let mut names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.sort();
    assert_eq!(names.len(), 9);
    for path in names {
        let (mut messages, report, connections) = common::read_path(&path).unwrap();
        for message in &mut messages {
            message.type_name = long_type(&message.type_name);
        }
        assert!(messages == made_in_python(), "{}: {}", path.display(), messages.len());
        assert!(report.damages.is_empty(), "{}: {:?}", path.display(), report.damages);
        assert!(connections.iter().all(|c| c.definition.is_some()) || report.container == Some(Container::Sqlite));
    }
}
