//! Messages that were forged, cut, spliced, replayed or made of random bytes, and what signing and verifying a keyframe's record takes:
//!
//! ```sh
//! cargo run --release -p mapwright-fleet --example any_bytes [MESSAGES]
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, reason = "an example prints what it measures")]

use mapwright::Stamp;
use mapwright_fleet::{Kind, Node, NodeSettings, Roster, Secret};
use mapwright_sim::Rng;
use std::time::Instant;

/// Bytes of a keyframe's record, and so many of them are timed.
const KEYFRAME_BYTES: usize = 440;
const TIMED: u32 = 5000;

fn node(name: &str, of: &[&str]) -> Node {
    let secret = |name: &str| Secret::from_bytes(&[name.as_bytes()[0]; 32]);
    let roster = Roster::new(of.iter().map(|name| ((*name).to_owned(), secret(name).public()))).expect("a team");
    Node::new(NodeSettings::default(), roster, name, secret(name), 0).expect("a member")
}

fn main() {
    let messages: u64 = std::env::args().nth(1).map_or(1_000_000, |text| text.parse().expect("a number"));
    let (mut speaker, mut listener) = (node("a", &["a", "b"]), node("b", &["a", "b"]));
    let mut said = Vec::new();
    let begin = Instant::now();
    for k in 0..TIMED {
        let mut payload = vec![0; KEYFRAME_BYTES];
        payload[..4].copy_from_slice(&k.to_le_bytes());
        assert!(speaker.publish(Kind::Entries, payload));
    }
    let signing_us = begin.elapsed().as_secs_f64() * 1e6 / f64::from(TIMED);
    said.extend(speaker.poll(Stamp(0)).into_iter().map(|out| out.bytes));
    let begin = Instant::now();
    said.iter().for_each(|bytes| listener.receive(Stamp(1), bytes));
    let verifying_us = begin.elapsed().as_secs_f64() * 1e6 / f64::from(TIMED);
    println!(
        "a record of {KEYFRAME_BYTES} bytes: signed and packed into a message in {signing_us:.0} us, read and verified in {verifying_us:.0} us"
    );

    let (mut rng, mut victim) = (Rng::new(1), node("b", &["a", "b"]));
    // It holds half of it, so that what it knows, what comes next and what comes too early are tried.
    said.iter().take(said.len() / 2).for_each(|bytes| victim.receive(Stamp(1), bytes));
    let held = |node: &Node| node.chains().values().map(|chain| chain.bytes()).sum::<usize>();
    let (before, begin) = (held(&victim), Instant::now());
    for _ in 0..messages {
        let mut bytes = said[rng.below(said.len())].clone();
        match rng.below(4) {
            0 => bytes.truncate(rng.below(bytes.len())),
            1 => {
                let other = &said[rng.below(said.len())];
                let cut = rng.below(bytes.len().min(other.len()));
                bytes.truncate(cut);
                bytes.extend_from_slice(&other[cut..]);
                bytes[cut] ^= 1 + rng.below(255) as u8;
            }
            2 => {
                for _ in 0..1 + rng.below(8) {
                    let at = rng.below(bytes.len());
                    bytes[at] ^= 1 + rng.below(255) as u8;
                }
            }
            _ => {
                let random = (5 + rng.below(600)) as u64;
                bytes.truncate(5);
                bytes.extend((0..random).map(|_| rng.below(256) as u8));
            }
        }
        victim.receive(Stamp(2), &bytes);
    }
    let refused: u64 = victim.refused().map(|(_, _, times)| times).sum();
    println!(
        "{messages} messages in {:.0} s: {refused} refused, {} too early, {} bytes taken",
        begin.elapsed().as_secs_f64(),
        victim.early(),
        held(&victim) - before
    );
    for (why, of, times) in victim.refused() {
        println!("  {times} {}{}", why.words(), of.map(|name| format!(" ({name})")).unwrap_or_default());
    }
}
