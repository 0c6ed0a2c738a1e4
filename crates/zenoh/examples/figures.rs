//! How long messages take to another process of this machine: a kept message of 4 and of 40 MB to who comes late, a new one to who is there, and scans of 1440
//! beams at 40 Hz.
//!
//! ```sh
//! cargo run --release -p mapwright-zenoh --example figures
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, clippy::panic, reason = "an example says what it does")]

use mapwright_live::wire::{Delivery, Publisher, Topic, Wire};
use mapwright_zenoh::{Configuration, Zenoh};
use std::io::{BufRead, BufReader, Read};
use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

const MAP: &str = "nav_msgs/msg/OccupancyGrid";
const SCAN: &str = "sensor_msgs/msg/LaserScan";
const KEPT: Delivery = Delivery::Latched { depth: 1 };
/// 1440 ranges and as many intensities, and a head.
const SCAN_BYTES: usize = 4 + 48 + 2 * 1440 * 4;
const PATIENCE: Duration = Duration::from_secs(30);

fn now_us() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    since.as_micros() as u64
}

/// Bytes as long as a message, with the time at which they were sent.
fn stamped(bytes: usize) -> Vec<u8> {
    let mut message = vec![0; bytes];
    message[1] = 1;
    message[4..12].copy_from_slice(&now_us().to_le_bytes());
    message
}

fn age_ms(message: &[u8]) -> f64 {
    let sent = message.get(4..12).and_then(|bytes| bytes.try_into().ok()).map_or(0, u64::from_le_bytes);
    (now_us() - sent) as f64 / 1e3
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match &words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => measure(),
        ["late", port] => come_late(port),
        ["hear", topic, kind, port] => hear(topic, Box::leak((*kind).to_owned().into_boxed_str()), port),
        _ => panic!("expected no argument"),
    }
}

fn join(port: &str, name: &str) -> Zenoh {
    let overrides = vec![("connect/endpoints".to_owned(), format!("[\"tcp/localhost:{port}\"]"))];
    Zenoh::join(&Configuration { overrides, ..Configuration::default() }, "/", name).expect("a network")
}

fn child(words: &[&str]) -> Child {
    let own = std::env::current_exe().expect("a name");
    Command::new(own).args(words).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("a process")
}

/// Prints how long after it was asked for a kept message came.
fn come_late(port: &str) {
    let mut wire = join(port, "late");
    let (sender, heard) = channel();
    let begun = Instant::now();
    let hear = Box::new(move |bytes: &[u8]| {
        let _ = sender.send(bytes.len());
    });
    wire.subscribe(&Topic::new("/map", MAP, KEPT), hear).expect("a topic");
    let bytes = heard.recv_timeout(PATIENCE).expect("a message");
    println!("{} {bytes}", begun.elapsed().as_secs_f64() * 1e3);
    // It is sent twice: once to who asks, once because this publisher is new to who asks.
    sleep(Duration::from_secs(2));
}

/// Prints how old messages are that come, until the standard input ends.
fn hear(topic: &str, kind: &'static str, port: &str) {
    let mut wire = join(port, "hearer");
    let delivery = if kind == MAP { KEPT } else { Delivery::BestEffort { depth: 10 } };
    let hear = Box::new(|bytes: &[u8]| println!("{}", age_ms(bytes)));
    wire.subscribe(&Topic::new(topic, kind, delivery), hear).expect("a topic");
    let _ = std::io::stdin().read(&mut [0]);
}

fn measure() {
    let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port().to_string();
    let mut wire = join(&port, "figures");
    for megabytes in [4, 40] {
        let map = wire.advertise(&Topic::new("/map", MAP, KEPT)).expect("a topic");
        map.publish(&stamped(megabytes << 20)).expect("sent");
        sleep(Duration::from_secs(1));
        let late: Vec<f64> = (0..5).map(|_| first_number(child(&["late", &port]))).collect();
        println!("{megabytes} MB to who comes late: {}", summary(late));
    }
    for (topic, megabytes, count) in [("/new4", 4, 5), ("/new40", 40, 5)] {
        let map = wire.advertise(&Topic::new(topic, MAP, KEPT)).expect("a topic");
        let ages = told(&*map, [topic, MAP, &port], (megabytes << 20, count), Duration::from_secs(1));
        println!("{megabytes} MB to who is there: {}", summary(ages));
    }
    let scans = wire.advertise(&Topic::new("/scan", SCAN, Delivery::BestEffort { depth: 10 })).expect("a topic");
    let ages = told(&*scans, ["/scan", SCAN, &port], (SCAN_BYTES, 1000), Duration::from_millis(25));
    println!("1000 scans of {SCAN_BYTES} bytes at 40 Hz: {} heard, {}", ages.len(), summary(ages));
}

fn first_number(mut child: Child) -> f64 {
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().expect("its output")).read_line(&mut line).expect("a line");
    let _ = child.wait();
    line.split(' ').next().and_then(|word| word.parse().ok()).unwrap_or(f64::INFINITY)
}

/// Ages of messages at another process, ms.
fn told(
    publisher: &dyn Publisher,
    [topic, kind, port]: [&str; 3],
    (bytes, count): (usize, usize),
    every: Duration,
) -> Vec<f64> {
    let mut child = child(&["hear", topic, kind, port]);
    while publisher.listeners() == 0 {
        sleep(Duration::from_millis(10));
    }
    sleep(Duration::from_millis(500));
    for _ in 0..count {
        publisher.publish(&stamped(bytes)).expect("sent");
        sleep(every);
    }
    drop(child.stdin.take());
    let output = child.wait_with_output().expect("its output");
    String::from_utf8_lossy(&output.stdout).lines().filter_map(|line| line.parse().ok()).collect()
}

fn summary(mut ms: Vec<f64>) -> String {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms.get((ms.len() as f64 * share) as usize).or(ms.last()).copied().unwrap_or(f64::NAN);
    format!("median {:.2} ms, p99 {:.2} ms, most {:.2} ms", at(0.5), at(0.99), at(1.0))
}
