//! What `mapwright --version` says besides the version: the commit, where git or `MAPWRIGHT_COMMIT` (a build without git, as of
//! the container image) knows it, and the features.
#![allow(clippy::print_stdout, reason = "that is how cargo is told")]

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Each commit and each checkout writes a line there.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={log}");
    }
    println!("cargo::rerun-if-env-changed=MAPWRIGHT_COMMIT");
    let told = || env::var("MAPWRIGHT_COMMIT").ok().filter(|commit| !commit.is_empty());
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).or_else(told).map(|commit| format!("commit {commit}"));
    let sqlite = if env::var_os("CARGO_FEATURE_SQLITE").is_some() { "with sqlite" } else { "without sqlite" };
    let net = if env::var_os("CARGO_FEATURE_NET").is_some() { "with net" } else { "without net" };
    let dds = if env::var_os("CARGO_FEATURE_DDS").is_some() { "with ROS 2" } else { "without ROS 2" };
    let zenoh =
        if env::var_os("CARGO_FEATURE_ZENOH").is_some() { "with ROS 2 over Zenoh" } else { "without ROS 2 over Zenoh" };
    let view = if env::var_os("CARGO_FEATURE_VIEW").is_some() { "with view" } else { "without view" };
    let words: Vec<String> = commit.into_iter().chain([net, dds, zenoh, view, sqlite].map(str::to_owned)).collect();
    println!("cargo::rustc-env=MAPWRIGHT_BUILD={}", words.join(", "));
}

/// What git says; none without git or outside of a repository.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    Some(text).filter(|text| !text.is_empty())
}
