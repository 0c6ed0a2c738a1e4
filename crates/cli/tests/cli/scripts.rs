//! The scripts that put faults into logs do what they say.

use crate::support::text;
use std::path::Path;
use std::process::Command;

#[test]
fn scripts_pass_their_own_tests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut python = Command::new("python3");
    python.args(["-B", "-m", "unittest", "discover", "--start-directory", "scripts"]).current_dir(root);
    let Ok(output) = python.output() else {
        eprintln!("tests of scripts: skipped: no python3");
        return;
    };
    let said = text(&output.stderr);
    assert!(output.status.success() && !said.contains("Ran 0 tests"), "{said}");
}
