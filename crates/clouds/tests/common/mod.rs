//! What tests of recordings have in common.

#![allow(dead_code, reason = "each test uses a part")]

pub(crate) mod disk;
pub(crate) mod memory;

use disk::Disk;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A folder of the real data (`../shared/data` beside the workspace, or below `MAPWRIGHT_DATA`), or a remark that the test is
/// skipped.
pub(crate) fn given(name: &str) -> Option<Disk> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let path = std::env::var_os("MAPWRIGHT_DATA").map_or_else(beside, PathBuf::from).join(name);
    if path.exists() {
        return Some(Disk::open(&path).unwrap());
    }
    let _ = writeln!(std::io::stderr(), "{name}: skipped: no data ({})", path.display());
    None
}
