//! Logs to map, a folder to work in, and the command itself.

use mapwright_formats::CarmenWriter;
use mapwright_geom::Pose2;
use mapwright_sensor::LaserModel;
use mapwright_sim::{Drive, DriveSettings, Event, LaserSettings, worlds};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, OnceLock};

/// Width and height of a PNG, pixels.
pub(crate) fn picture_size(path: &Path) -> [u32; 2] {
    let info = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
    let info = info.info();
    [info.width, info.height]
}

/// All files of a run that must not differ from run to run.
pub(crate) const SAME_BYTES: [&str; 9] = [
    "session.mapwright",
    "trajectory.tum",
    "trajectory_online.tum",
    "graph.g2o",
    "closures.json",
    "map.pgm",
    "map.yaml",
    "map.png",
    "report.json",
];

/// A fresh folder for a test.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mapwright"));
    command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

pub(crate) fn spawn(args: &[&str]) -> Child {
    command(args).spawn().unwrap()
}

/// With files of at most so many KiB: what is longer cannot be written, as on a full disk.
#[cfg(all(unix, feature = "net"))]
pub(crate) fn spawn_with_files_of(kib: u32, args: &[&str]) -> Child {
    // POSIX counts in 512 bytes; who ignores the signal gets an error.
    let limited = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", 2 * kib);
    let mut command = Command::new("sh");
    command.args(["-c", &limited, env!("CARGO_BIN_EXE_mapwright")]).args(args);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

pub(crate) fn run(args: &[&str]) -> Output {
    command(args).stdin(Stdio::null()).output().unwrap()
}

/// Runs with bytes on the standard input.
pub(crate) fn run_with_input(args: &[&str], input: &[u8]) -> Output {
    let mut child = spawn(args);
    let mut stdin = child.stdin.take().unwrap();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let _ = stdin.write_all(input);
        });
        child.wait_with_output().unwrap()
    })
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The exit code, with what was said where it is another.
pub(crate) fn assert_code(output: &Output, code: i32) {
    let said = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{said:?}");
    assert!(!said.1.contains("panicked"), "{said:?}");
}

/// Fails with the code, and says all of these.
pub(crate) fn assert_refused(output: &Output, code: i32, says: &[&str]) {
    assert_code(output, code);
    let said = text(&output.stderr);
    says.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said:?}"));
}

pub(crate) fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Forty seconds of a drive through three rooms, as a CARMEN log.
pub(crate) fn small_log() -> &'static [u8] {
    static LOG: OnceLock<Vec<u8>> = OnceLock::new();
    LOG.get_or_init(|| three_rooms(40.0, Pose2::IDENTITY, Pose2::IDENTITY))
}

/// A drive with the laser at one place, and said to be at another.
pub(crate) fn three_rooms(duration_s: f64, robot_from_laser: Pose2, said: Pose2) -> Vec<u8> {
    let mut laser = LaserSettings::default();
    laser.model = Arc::new(LaserModel { robot_from_laser, ..(*laser.model).clone() });
    let told = Arc::new(LaserModel { robot_from_laser: said, ..(*laser.model).clone() });
    let settings = DriveSettings { laser, duration_s, seed: 5, ..DriveSettings::default() };
    log_of(Drive::new(worlds::three_rooms(5).into(), settings).map(|event| match event {
        Event::Scan(mut scan) => {
            scan.scan.laser = Arc::clone(&told);
            Event::Scan(scan)
        }
        odometry => odometry,
    }))
}

/// A drive as a CARMEN log.
pub(crate) fn log_of(drive: impl Iterator<Item = Event>) -> Vec<u8> {
    let mut writer = CarmenWriter::new(Vec::new());
    for event in drive {
        match event {
            Event::Odometry(odometry) => writer.odometry(&odometry).unwrap(),
            Event::Scan(scan) => writer.scan(&scan.scan).unwrap(),
        }
    }
    writer.finish().unwrap()
}

/// The small log as a file in a folder.
pub(crate) fn small_log_in(folder: &Path) -> String {
    let path = folder.join("small.clf");
    fs::write(&path, small_log()).unwrap();
    path.display().to_string()
}

/// Maps a log into a folder.
pub(crate) fn map(log: &str, out: &Path, more: &[&str]) -> Output {
    run(&[&["map", log, "-o", out.to_str().unwrap()], more].concat())
}

/// Poses of a trajectory: stamp, x, y and the rest of the line as numbers.
pub(crate) fn poses(out: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect()).collect()
}

/// The largest distance between two trajectories' poses of the same scans.
pub(crate) fn apart_m(a: &Path, b: &Path) -> f64 {
    let (a, b) = (poses(a), poses(b));
    assert!(!a.is_empty() && a.len() == b.len(), "{} and {} poses", a.len(), b.len());
    a.iter().zip(&b).map(|(a, b)| (a[1] - b[1]).hypot(a[2] - b[2])).fold(0.0, f64::max)
}
