//! Checks of the house. `cargo xtask arrows` checks the arrows between crates, circles within them, their effects, all
//! licences, and that the names in documents are in the code.

#![allow(clippy::print_stdout, clippy::print_stderr)] // a command for developers, not part of the library

mod arrows;
mod circles;
mod effects;
mod licences;
mod metadata;
mod names;
mod source;

use metadata::Metadata;
use std::path::Path;
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    if arguments != ["arrows"] {
        eprintln!("usage: cargo xtask arrows");
        return ExitCode::from(2);
    }
    match check_house() {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(complaints) => {
            for complaint in &complaints {
                eprintln!("error: {complaint}");
            }
            ExitCode::FAILURE
        }
    }
}

/// All complaints, or one line that says what was checked.
fn check_house() -> Result<String, Vec<String>> {
    let metadata = read_metadata().map_err(|e| vec![e])?;
    let architecture_file = metadata.workspace_root.join("ARCHITECTURE.md");
    let architecture = read(&architecture_file).map_err(|e| vec![e])?;
    let table =
        arrows::Table::parse(&architecture).map_err(|e| vec![format!("{}: {e}", architecture_file.display())])?;
    let mut complaints = arrows::check(&table, &metadata);
    complaints.extend(circles::check(&metadata).map_err(|e| vec![e])?);
    complaints.extend(effects::check(&metadata).map_err(|e| vec![e])?);
    complaints.extend(licences::check(&metadata));
    complaints.extend(names::check(&metadata.workspace_root).map_err(|e| vec![e])?);
    if complaints.is_empty() {
        Ok(format!(
            "arrows, circles, effects, licences and names: {} crates and {} packages in order",
            metadata.crates().count(),
            metadata.packages.len()
        ))
    } else {
        Err(complaints)
    }
}

fn read_metadata() -> Result<Metadata, String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--all-features"])
        .output()
        .map_err(|e| format!("cargo metadata: {e}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr)));
    }
    Metadata::parse(&output.stdout)
}

fn read(file: &Path) -> Result<String, String> {
    std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))
}
