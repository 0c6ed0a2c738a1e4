//! Messages of real bags, as `scripts/dump_messages.py` writes them, and their canonical text.
#![allow(
    clippy::explicit_write,
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stderr,
    reason = "helpers of tests"
)]

pub(crate) mod random;

use mapwright_ros::{DefinitionFormat, Encoding, Record, Scalar, Value};
use md5::{Digest, Md5};
use std::fmt::Write;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const BAGS: [&str; 9] = [
    "plotjuggler/tilt_laser.bag",
    "plotjuggler/rosbag2_test",
    "scan_tools/laser_scan_matcher_demo.bag",
    "evo/nav2_turtlebot.mcap",
    "evo/tf_example",
    "evo/ROS_example.bag",
    "derived_intel/intel_180s.bag",
    "derived_intel/intel_180s_db3",
    "derived_intel/intel_180s_mcap",
];

/// What the script wrote.
pub(crate) struct Dump(Vec<u8>);

/// A message and its checksum.
pub(crate) type Dumped<'d> = (&'d [u8], &'d str);

/// A channel of the dump.
pub(crate) struct DumpedChannel {
    pub(crate) type_name: String,
    pub(crate) encoding: Encoding,
    pub(crate) topic: String,
    format: Option<DefinitionFormat>,
    text: String,
}

impl DumpedChannel {
    pub(crate) fn definition(&self) -> Option<(DefinitionFormat, &str)> {
        self.format.map(|format| (format, self.text.as_str()))
    }
}

/// The dump of all bags; none, and a line that says why, where Python, the package or the data is not there.
pub(crate) fn dump(test: &str) -> Option<Dump> {
    static PATH: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match PATH.get_or_init(write_dump) {
        Ok(path) => Some(Dump(std::fs::read(path).unwrap())),
        Err(reason) => {
            let _ = writeln!(std::io::stderr(), "{test}: skipped: {reason}");
            None
        }
    }
}

fn write_dump() -> Result<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let data = std::env::var_os("MAPWRIGHT_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let bags: Vec<_> = BAGS.iter().map(|bag| data.join("ros_bags").join(bag)).collect();
    if let Some(absent) = bags.iter().find(|bag| !bag.exists()) {
        return Err(format!("no data ({})", absent.display()));
    }
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("ros_messages.bin");
    let mut script = script()?;
    let run = script.arg(&out).args(&bags).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    Ok(out)
}

/// The script, or why it cannot run.
pub(crate) fn script() -> Result<Command, String> {
    let python = std::env::var_os("MAPWRIGHT_PYTHON").unwrap_or_else(|| "python3".into());
    let has_rosbags = Command::new(&python).args(["-c", "import rosbags"]).output().is_ok_and(|o| o.status.success());
    if !has_rosbags {
        return Err(format!("{} has no package rosbags", python.display()));
    }
    let mut command = Command::new(python);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/dump_messages.py"));
    Ok(command)
}

/// A checksum as the script writes it.
pub(crate) fn digest(record: &Record<'_>) -> String {
    digits(Md5::digest(canonical(record).as_bytes()).iter())
}

impl Dump {
    /// Each channel with its messages and their checksums, in the order of the file.
    pub(crate) fn channels(&self) -> Vec<(DumpedChannel, Vec<Dumped<'_>>)> {
        let mut channels: Vec<(DumpedChannel, Vec<Dumped<'_>>)> = Vec::new();
        let mut rest = self.0.as_slice();
        while !rest.is_empty() {
            let end = rest.iter().position(|byte| *byte == b'\n').unwrap();
            let words: Vec<_> = std::str::from_utf8(&rest[..end]).unwrap().split(' ').collect();
            let length: usize = words[if words[0] == "C" { 4 } else { 1 }].parse().unwrap();
            let body = &rest[end + 1..end + 1 + length];
            rest = &rest[end + length + 2..];
            match words[0] {
                "C" => channels.push((channel(&words, body), Vec::new())),
                _ => channels.last_mut().unwrap().1.push((body, words[2])),
            }
        }
        channels
    }
}

fn channel(words: &[&str], text: &[u8]) -> DumpedChannel {
    DumpedChannel {
        type_name: words[1].to_owned(),
        encoding: Encoding::from_name(words[2]).unwrap(),
        topic: words[5].to_owned(),
        format: DefinitionFormat::from_name(words[3]),
        text: String::from_utf8(text.to_vec()).unwrap(),
    }
}

/// One line a field; see the script.
pub(crate) fn canonical(record: &Record<'_>) -> String {
    let mut lines = Vec::new();
    fields(record, "", &mut lines);
    lines.join("\n")
}

fn fields(record: &Record<'_>, prefix: &str, lines: &mut Vec<String>) {
    for (name, value) in record.iter() {
        line(value, format!("{prefix}{name}"), lines);
    }
}

fn line(value: &Value<'_>, path: String, lines: &mut Vec<String>) {
    let digits = match value {
        Value::Struct(record) => return fields(record, &format!("{path}."), lines),
        Value::List(values) => {
            let each = |(index, value)| line(value, format!("{path}[{index}]"), lines);
            return values.iter().enumerate().for_each(each);
        }
        Value::Text(text) => text.to_string(),
        Value::Numbers(numbers) => {
            let big_endian = |bytes: &[u8]| match numbers.big_endian {
                true => digits(bytes.iter()),
                false => digits(bytes.iter().rev()),
            };
            let all: String = numbers.bytes.chunks(numbers.primitive.size()).map(big_endian).collect();
            format!("[{}]{all}", numbers.len())
        }
        Value::Bool(v) => number(*v),
        Value::I8(v) => number(*v),
        Value::U8(v) => number(*v),
        Value::I16(v) => number(*v),
        Value::U16(v) => number(*v),
        Value::I32(v) => number(*v),
        Value::U32(v) => number(*v),
        Value::I64(v) => number(*v),
        Value::U64(v) => number(*v),
        Value::F32(v) => number(*v),
        Value::F64(v) => number(*v),
    };
    lines.push(format!("{path}={digits}"));
}

fn number<T: Scalar>(value: T) -> String {
    let mut bytes = Vec::new();
    value.encode(&mut bytes);
    digits(bytes.iter().rev())
}

fn digits<'b>(bytes: impl Iterator<Item = &'b u8>) -> String {
    bytes.fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}
