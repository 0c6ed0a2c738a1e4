//! What the view costs on a grid of 2000 x 2000 cells of 5 cm, ten keyframes of 1440 beams a second.

#[path = "client.rs"]
#[allow(dead_code, reason = "tests use more of it")]
mod client;
#[path = "rooms.rs"]
#[allow(dead_code, reason = "tests use more of it")]
mod rooms;

use client::Client;
use mapwright_geom::Pose2;
use mapwright_viewer::{Pen, Settings, Viewer, ViewerError};
use rooms::Rooms;
use std::fs;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const PEN: Pen = Pen { resolution_m: 0.05, free_range_m: 6.0, passes_per_hit: 5 };
const SIDE_M: f64 = 100.0;
const UPDATES: usize = 200;
const PACE: Duration = Duration::from_millis(100);

/// Maps the whole grid, then lets somebody watch.
pub(crate) fn measure() -> Result<(), ViewerError> {
    let mut viewer = Viewer::start(Settings::default(), PEN)?;
    let mut rooms = Rooms::new(1440);
    let mut unwatched = Vec::new();
    for k in 0..2500 {
        let at = Pose2::new(f64::from(k % 50) * 2.0 + 1.1, f64::from(k / 50) * 2.0 + 1.1, 0.3 * f64::from(k));
        let update = rooms.keyframe(at, at);
        let begun = Instant::now();
        viewer.show(&update, &rooms.session);
        unwatched.push(begun.elapsed());
    }
    println!(
        "grid of {0:.0} x {0:.0} cells, {1} keyframes of 1440 beams",
        SIDE_M / PEN.resolution_m,
        rooms.session.keyframes().len()
    );
    tell("show, nobody watches", &mut unwatched);
    let (bytes, is_over) = (AtomicU64::new(0), AtomicBool::new(false));
    let address = viewer.address();
    let mut watched = Vec::new();
    thread::scope(|scope| {
        let watching = scope.spawn(|| watch(address, &bytes, &is_over));
        // Until all is drawn, and then at its pace.
        let mut number = 0;
        drive(&mut viewer, &mut rooms, &mut number, 150, &mut watched);
        tell("show while somebody comes", &mut watched);
        watched.clear();
        let before = (cpu(), Instant::now(), bytes.load(Ordering::Relaxed));
        drive(&mut viewer, &mut rooms, &mut number, UPDATES, &mut watched);
        let elapsed = before.1.elapsed();
        println!(
            "view's thread: {:.2} % of a core, {:.0} kB/s to one page",
            share(before.0, elapsed),
            (bytes.load(Ordering::Relaxed) - before.2) as f64 / 1e3 / elapsed.as_secs_f64()
        );
        tell("show, watched", &mut watched);
        let update = rooms.correct(|_, pose| Pose2::new(pose.x + 0.2, pose.y, pose.theta));
        let before = (cpu(), Instant::now());
        viewer.show(&update, &rooms.session);
        drive(&mut viewer, &mut rooms, &mut number, 100, &mut watched);
        println!(
            "view's thread in the 10 s after a correction of all: {:.2} % of a core",
            share(before.0, before.1.elapsed())
        );
        is_over.store(true, Ordering::Relaxed);
        watching.join().expect("it has watched");
    });
    let before = (cpu(), Instant::now());
    thread::sleep(Duration::from_secs(3));
    println!("view's thread, nobody watches: {:.3} % of a core", share(before.0, before.1.elapsed()));
    Ok(())
}

/// Ten keyframes a second, each some way on.
fn drive(viewer: &mut Viewer, rooms: &mut Rooms, number: &mut usize, count: usize, took: &mut Vec<Duration>) {
    for _ in 0..count {
        let round = Instant::now();
        let way_m = *number as f64 * 0.1;
        let at = Pose2::new(5.0 + way_m % 90.0, 5.0 + (way_m / 90.0).floor() * ROW_M, 0.01 * *number as f64);
        let update = rooms.keyframe(at, at);
        let begun = Instant::now();
        viewer.show(&update, &rooms.session);
        took.push(begun.elapsed());
        *number += 1;
        thread::sleep(PACE.saturating_sub(round.elapsed()));
    }
}

const ROW_M: f64 = 10.0;

fn watch(address: std::net::SocketAddr, bytes: &AtomicU64, is_over: &AtomicBool) {
    let joined = Instant::now();
    let mut client = Client::connect(address, "").expect("it listens");
    let mut tiles = std::collections::BTreeSet::new();
    let (mut first, mut messages, mut all) = (None, 0, None);
    while !is_over.load(Ordering::Relaxed) {
        let Some(message) = client.next(Duration::from_millis(300)) else { continue };
        bytes.fetch_add(message.len() as u64, Ordering::Relaxed);
        messages += 1;
        let before = tiles.len();
        tiles.extend(client::records(&message).filter(|(kind, _)| *kind == 2).map(|(_, bytes)| bytes[..8].to_vec()));
        if tiles.len() > before {
            first.get_or_insert(joined.elapsed());
            all = Some(joined.elapsed());
        }
    }
    let seconds = |time: Option<Duration>| time.map_or(f64::NAN, |time| time.as_secs_f64());
    println!(
        "who came late: first picture after {:.2} s, the last new tile of {} after {:.2} s, {messages} messages",
        seconds(first),
        tiles.len(),
        seconds(all)
    );
}

/// Time that the view's thread has computed, as the kernel counts it.
fn cpu() -> Duration {
    let tasks = fs::read_dir("/proc/self/task").expect("Linux");
    let of_view = tasks
        .flatten()
        .find(|task| fs::read_to_string(task.path().join("comm")).is_ok_and(|name| name.trim() == "view"));
    let text = fs::read_to_string(of_view.expect("it runs").path().join("schedstat")).expect("Linux");
    Duration::from_nanos(text.split_whitespace().next().and_then(|word| word.parse().ok()).expect("nanoseconds"))
}

fn share(before: Duration, elapsed: Duration) -> f64 {
    100.0 * (cpu() - before).as_secs_f64() / elapsed.as_secs_f64()
}

fn tell(what: &str, took: &mut [Duration]) {
    took.sort_unstable();
    let micros = |share: f64| took[((took.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e6;
    println!("{what}, microseconds: median {:.1}, p99 {:.1}, at most {:.1}", micros(0.5), micros(0.99), micros(1.0));
}
