//! Whatever the bytes: no panic, and an answer.
#![allow(clippy::explicit_write, clippy::panic, clippy::unwrap_used, reason = "tests may")]

use mapwright_logs::{Choice, Drive, Input};
use std::fs;
use std::io::{self, Read, Write as _};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// `../shared/data` beside the workspace, or `MAPWRIGHT_DATA`.
fn sample() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from);
    let path = root.join("ros_bags/scan_tools/laser_scan_matcher_demo.bag");
    if !path.exists() {
        #[allow(clippy::print_stderr, reason = "a skipped test is to be seen")]
        {
            let _ = writeln!(std::io::stderr(), "hostile: skipped: no data ({})", path.display());
        }
        return None;
    }
    Some(path)
}

#[test]
fn flipped_bytes_cost_messages_and_nothing_else() {
    let Some(sample) = sample() else { return };
    let whole = fs::read(sample).unwrap();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("flipped.bag");
    let mut state = 7_u64;
    for round in 0..60 {
        let mut bytes = whole[..200_000 + 10_000 * round].to_vec();
        for _ in 0..40 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = 4200 + (state >> 20) as usize % (bytes.len() - 4200);
            bytes[at] ^= 1 << (state >> 61);
        }
        fs::write(&path, &bytes).unwrap();
        let input = Input::Recording(path.clone());
        let Ok(mut drive) = Drive::open(vec![("flipped".to_owned(), input)], &Choice::default()) else { continue };
        while drive.next_event().unwrap().is_some() {}
        assert!(drive.into_reports().len() == 1);
    }
}

/// A file that fails behind these bytes.
struct Failing<'a>(&'a [u8]);

impl Read for Failing<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        match self.0.read(out)? {
            0 => Err(io::Error::other("the disk is gone")),
            got => Ok(got),
        }
    }
}

#[test]
fn what_was_read_before_a_file_fails_is_handed_out_first() {
    static LOG: OnceLock<String> = OnceLock::new();
    let line = |k: u32| format!("FLASER 3 1 2 3 {0} 0 0 {0} 0 0 {1} h {1}\n", 0.1 * f64::from(k), 0.2 * f64::from(k));
    let log = LOG.get_or_init(|| (0..50).map(line).collect());
    let input = Input::Carmen(Box::new(Failing(log.as_bytes())));
    let mut drive = Drive::open(vec![("failing".to_owned(), input)], &Choice::default()).unwrap();
    let mut scans = 0;
    let failed = loop {
        match drive.next_event() {
            Ok(Some(_)) => scans += 1,
            Ok(None) => panic!("an end after {scans} scans"),
            Err(failed) => break failed.to_string(),
        }
    };
    assert!(scans == 50 && failed.contains("the disk is gone"), "{scans} scans, {failed}");
}
