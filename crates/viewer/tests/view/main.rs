//! The view as those who look have it.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    missing_docs,
    unreachable_pub,
    reason = "tests"
)]

mod browser;
#[path = "../../examples/watch/client.rs"]
mod client;
mod http;
mod page;
mod replay;
#[path = "../../examples/watch/rooms.rs"]
mod rooms;

use client::{Client, records};
use mapwright_geom::Pose2;
use mapwright_viewer::{Pen, Settings, Viewer};
use rooms::Rooms;
use std::time::{Duration, Instant};

const PEN: Pen = Pen { resolution_m: 0.05, free_range_m: 6.0, passes_per_hit: 5 };
/// A busy machine takes its time.
const PATIENCE: Duration = Duration::from_secs(60);

fn viewer() -> Viewer {
    Viewer::start(Settings::default(), PEN).unwrap()
}

/// A robot that drives through some rooms.
fn pose(number: u32) -> Pose2 {
    let way_m = f64::from(number) * 0.4;
    Pose2::new(5.0 + way_m % 30.0, 5.0 + 10.0 * (way_m / 30.0).floor(), 0.0)
}

/// Drives on until something holds.
fn drive_until(viewer: &mut Viewer, rooms: &mut Rooms, mut holds: impl FnMut(&Viewer) -> bool) {
    let begun = Instant::now();
    while !holds(viewer) {
        let at = pose(rooms.session.keyframes().len() as u32 % 300);
        let update = rooms.keyframe(at, at);
        viewer.show(&update, &rooms.session);
        std::thread::sleep(Duration::from_millis(20));
        assert!(begun.elapsed() < PATIENCE, "waited in vain");
    }
}

/// Drives on, and reads what a page is told until something of it holds.
fn read_until(viewer: &mut Viewer, rooms: &mut Rooms, client: &mut Client, mut holds: impl FnMut(u32, &[u8]) -> bool) {
    drive_until(viewer, rooms, |_| {
        let message = client.next(Duration::from_millis(50));
        message.is_some_and(|message| records(&message).any(|(kind, bytes)| holds(kind, bytes)))
    });
}
