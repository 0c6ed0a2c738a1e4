//! Whatever the bytes: no panic, and an answer.
#![allow(clippy::explicit_write, clippy::unwrap_used, reason = "tests may")]

use mapwright_logs::{Choice, Drive, Input};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

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
