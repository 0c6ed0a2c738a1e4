//! Robots of one team, and the air between them.
#![allow(dead_code, reason = "each test uses some of it")]

use mapwright::Stamp;
use mapwright_fleet::{Node, NodeSettings, Roster, Secret};
use mapwright_sim::{Radio, RadioSettings};

pub(crate) fn secret(k: usize) -> Secret {
    let mut bytes = [7; 32];
    bytes[0] = k as u8;
    Secret::from_bytes(&bytes)
}

pub(crate) fn name(k: usize) -> String {
    format!("robot {k}")
}

pub(crate) fn roster(count: usize) -> Roster {
    Roster::new((0..count).map(|k| (name(k), secret(k).public()))).expect("a team")
}

pub(crate) fn node(count: usize, k: usize, session: u32) -> Node {
    Node::new(NodeSettings::default(), roster(count), &name(k), secret(k), session).expect("a member")
}

pub(crate) fn at(tick: i64) -> Stamp {
    Stamp(tick * 100_000_000)
}

pub(crate) fn radio(seed: u64, loss: f64) -> Radio {
    Radio::new(RadioSettings { loss, doubled: 0.1, delay_s: [0.005, 0.5], seed })
}
