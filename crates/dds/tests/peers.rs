//! Beside other programs: another process of this crate, and a client of rclpy (Fast DDS) where there is one.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests may")]

use mapwright_dds::{Configuration, Dds, Range};
use mapwright_live::wire::{Delivery, Topic, Wire};
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

const KIND: &str = "std_msgs/msg/String";

/// The example `echo`, which Cargo builds with the tests.
fn echo(domain: u16, range: &str, [heard, told]: [&str; 2]) -> Child {
    let tests = std::env::current_exe().unwrap();
    let target: PathBuf = tests.parent().unwrap().parent().unwrap().join("examples");
    let mut child = Command::new(target.join("echo"))
        .args([heard, told, KIND])
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", range)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line, "ready\n");
    child
}

fn text(length: usize) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend((length as u32 + 1).to_le_bytes());
    bytes.extend(std::iter::repeat_n(b'x', length).chain([0]));
    bytes
}

fn until<T>(patience: Duration, mut what: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = what() {
            return found;
        }
        assert!(begun.elapsed() < patience, "not within {patience:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn next(heard: &Receiver<Vec<u8>>) -> Vec<u8> {
    heard.recv_timeout(Duration::from_secs(20)).unwrap()
}

/// What is told comes back as it was, small and large; who comes late gets the newest that is kept; who has gone is missed.
#[test]
fn messages_go_there_and_back() {
    let configuration = Configuration { domain: 141, range: Range::Localhost, ..Configuration::default() };
    let mut dds = Dds::join(&configuration, "/", "peer").unwrap();
    let (sender, heard) = channel();
    let hear = Box::new(move |bytes: &[u8]| sender.send(bytes.to_vec()).unwrap());
    dds.subscribe(&Topic::new("/out", KIND, Delivery::Latched { depth: 1 }), hear).unwrap();
    let publisher = dds.advertise(&Topic::new("/in", KIND, Delivery::Reliable { depth: 10 })).unwrap();
    let mut child = echo(141, "LOCALHOST", ["/in", "/out"]);
    until(Duration::from_secs(20), || (publisher.listeners() > 0).then_some(()));
    for length in [0, 1, 1000, 100_000, 3_000_000] {
        publisher.publish(&text(length)).unwrap();
        let back = next(&heard);
        assert!(back.starts_with(&text(length)), "{length}: {} bytes", back.len());
    }
    let (sender, late) = channel();
    let hear = Box::new(move |bytes: &[u8]| sender.send(bytes.to_vec()).unwrap());
    dds.subscribe(&Topic::new("/out", KIND, Delivery::Latched { depth: 1 }), hear).unwrap();
    assert!(next(&late).len() > 3_000_000, "the last one is kept for who comes late");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Names that cannot be are refused with a reason.
#[test]
fn names_that_cannot_be_are_refused() {
    let configuration = Configuration { domain: 142, range: Range::Localhost, ..Configuration::default() };
    assert!(Dds::join(&configuration, "/", "no name").is_err());
    let mut dds = Dds::join(&configuration, "/", "names").unwrap();
    let refused = |dds: &mut Dds, name, kind| {
        dds.advertise(&Topic::new(name, kind, Delivery::Reliable { depth: 1 })).map(|_| ()).unwrap_err().to_string()
    };
    assert_eq!(refused(&mut dds, "scan", KIND), "topic scan of type std_msgs/msg/String: no topic can be called so");
    assert_eq!(refused(&mut dds, "/scan", "String"), "topic /scan of type String: no such type");
}

/// A client of rclpy hears, tells, is answered at length and at once, and sees the node once: in the network, and on this machine alone.
#[test]
fn rclpy_hears_tells_and_is_answered() {
    let Ok(python) = std::env::var("MAPWRIGHT_ROS_PYTHON") else {
        eprintln!("rclpy_hears_tells_and_is_answered: skipped: no MAPWRIGHT_ROS_PYTHON with rclpy");
        return;
    };
    for (domain, range) in [(143, "SUBNET"), (144, "LOCALHOST")] {
        let mut child = echo(domain, range, ["/in", "/out"]);
        let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/peer.py");
        let output = Command::new(&python)
            .arg(script)
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", range)
            .output()
            .unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        let expected = "20 of 20 messages, 20 of 20 answers, 2000000 characters, 4 of 4 soon, seen once";
        assert_eq!(said.lines().last(), Some(expected), "{range}: {said}");
    }
}
