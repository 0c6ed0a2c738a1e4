//! What the protocol alone costs, without any mapping: bytes and time for each keyframe, by how many robots there are. The figures of
//! docs/fleet.md.
//!
//! ```sh
//! cargo run --release -p mapwright-fleet --example many_robots
//! ```

#![allow(clippy::print_stdout, reason = "an example prints what it measures")]

use mapwright_fleet::{Kind, Node, NodeSettings, Roster, RosterError, Secret};
use mapwright_geom::Stamp;
use mapwright_sim::{Radio, RadioSettings};
use std::time::Instant;

/// A record of four keyframes of 440 bytes every three seconds, as on the intel log.
const RECORD_BYTES: usize = 4 * 440;
const KEYFRAMES: f64 = 4.0;
const EVERY_TICKS: usize = 30;
const DRIVE_TICKS: usize = 150;

fn main() -> Result<(), RosterError> {
    println!("robots  loss  all agree   sent a keyframe   of it beats   received by each   time of each");
    println!("              s           bytes             bytes         kB/s               us a keyframe of all");
    for robots in [2, 4, 8, 16] {
        for loss in [0.0, 0.3] {
            run(robots, loss)?;
        }
    }
    Ok(())
}

fn run(count: usize, loss: f64) -> Result<(), RosterError> {
    let secret = |k: usize| Secret::from_bytes(&[k as u8 + 1; 32]);
    let roster = Roster::new((0..count).map(|k| (format!("robot {k}"), secret(k).public())))?;
    let node = |k: usize| Node::new(NodeSettings::default(), roster.clone(), &format!("robot {k}"), secret(k), 0);
    let mut nodes: Vec<Node> = (0..count).filter_map(node).collect();
    let mut air = Radio::new(RadioSettings { loss, doubled: 0.0, delay_s: [0.005, 0.2], seed: 1 });
    let (mut sent, mut beats, mut received, mut said) = (0, 0, 0, 0);
    let mut spent_s = 0.0;
    for tick in 0..100_000 {
        let now = Stamp(tick as i64 * 100_000_000);
        for (k, node) in nodes.iter_mut().enumerate() {
            if tick < DRIVE_TICKS && (tick + k) % EVERY_TICKS == 0 {
                node.publish(Kind::Entries, (0..RECORD_BYTES).map(|at| (at * 31 + tick) as u8).collect());
                said += 1;
            }
        }
        let begin = Instant::now();
        let out: Vec<_> = nodes
            .iter_mut()
            .enumerate()
            .flat_map(|(k, node)| node.poll(now).into_iter().map(move |out| (k, out)))
            .collect();
        spent_s += begin.elapsed().as_secs_f64();
        for (from, out) in out {
            // A broadcast is sent once, however many hear it.
            sent += out.bytes.len();
            beats += if out.bytes.len() < RECORD_BYTES && out.to.is_none() { out.bytes.len() } else { 0 };
            for to in (0..count).filter(|to| *to != from && out.to.is_none_or(|wanted| usize::from(wanted) == *to)) {
                air.send(now, to, &out.bytes, true);
            }
        }
        let arrivals = air.receive(now);
        let begin = Instant::now();
        for arrival in arrivals {
            received += arrival.bytes.len();
            nodes[arrival.to].receive(now, &arrival.bytes);
        }
        spent_s += begin.elapsed().as_secs_f64();
        let held = |node: &Node| node.chains().values().map(|chain| chain.next() as usize).sum::<usize>();
        if tick >= DRIVE_TICKS && nodes.iter().all(|node| held(node) == said) {
            let seconds = tick as f64 / 10.0;
            let keyframes = said as f64 * KEYFRAMES;
            println!(
                "{count:6}  {:3.0} %  {:9.1}   {:15.0}   {:11.0}   {:16.1}   {:20.1}",
                100.0 * loss,
                seconds - DRIVE_TICKS as f64 / 10.0,
                sent as f64 / keyframes,
                beats as f64 / keyframes,
                received as f64 / count as f64 / seconds / 1e3,
                1e6 * spent_s / count as f64 / keyframes,
            );
            return Ok(());
        }
    }
    println!("{count:6}  {:3.0} %  never", 100.0 * loss);
    Ok(())
}
