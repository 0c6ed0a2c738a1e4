//! What robots hold in the end, whatever the radio does to their messages, and what is refused.
#![allow(clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

mod support;

use mapwright::Stamp;
use mapwright_fleet::{ChainId, Kind, Node, Outgoing, Refusal};
use mapwright_sim::Rng;
use support::{at, node, radio, secret};

/// Sends what robots have to say to all who are in reach, and hands over what has arrived.
fn exchange(
    nodes: &mut [Option<Node>],
    air: &mut mapwright_sim::Radio,
    now: Stamp,
    is_in_reach: impl Fn(usize, usize) -> bool,
) {
    for from in 0..nodes.len() {
        let Some(node) = &mut nodes[from] else { continue };
        for Outgoing { to, bytes } in node.poll(now) {
            for other in (0..nodes.len()).filter(|other| *other != from) {
                if to.is_none_or(|to| usize::from(to) == other) {
                    air.send(now, other, &bytes, is_in_reach(from, other));
                }
            }
        }
    }
    for arrival in air.receive(now) {
        if let Some(node) = &mut nodes[arrival.to] {
            node.receive(now, &arrival.bytes);
        }
    }
}

/// What a node holds, as one value.
fn held(node: &Node) -> Vec<(ChainId, u32, Vec<u8>)> {
    let chains = node.chains().iter().filter(|(_, chain)| chain.next() > 0);
    chains
        .map(|(id, chain)| (*id, chain.next(), chain.records().iter().flat_map(|r| r.payload.to_vec()).collect()))
        .collect()
}

#[test]
fn all_who_live_end_with_the_same_records() {
    for seed in 0..100 {
        let mut rng = Rng::new(seed);
        let count = 2 + rng.below(5);
        let loss = 0.9 * (seed as f64 / 99.0);
        let mut air = radio(seed, loss);
        let mut nodes: Vec<Option<Node>> = (0..count).map(|k| Some(node(count, k, 0))).collect();
        let dies = (count > 2).then(|| (rng.below(count), 50 + rng.below(100) as i64));
        // For a while the first ones hear the others no more.
        let (split, from, until) = (1 + rng.below(count - 1), rng.below(150) as i64, 150 + rng.below(200) as i64);
        let mut said = 0;
        let mut tick = 0;
        loop {
            tick += 1;
            if let Some((who, when)) = dies
                && tick == when
            {
                nodes[who] = None;
            }
            for node in nodes.iter_mut().flatten().filter(|_| tick < 200) {
                if rng.chance(0.1) {
                    said += 1;
                    assert!(node.publish(Kind::Entries, vec![rng.below(256) as u8; 40 + rng.below(400)]));
                }
            }
            let is_split = (from..until).contains(&tick);
            exchange(&mut nodes, &mut air, at(tick), |a, b| !is_split || (a < split) == (b < split));
            let alive: Vec<&Node> = nodes.iter().flatten().collect();
            let is_agreed = tick > until.max(200) && alive.windows(2).all(|pair| held(pair[0]) == held(pair[1]));
            if is_agreed {
                break;
            }
            assert!(tick < 6000, "seed {seed}: loss {loss:.2}, not agreed after {tick} ticks");
        }
        assert!(said > 0);
        for node in nodes.iter().flatten() {
            let leader = node.leader(at(tick));
            let first = nodes.iter().position(Option::is_some).map(|rank| rank as u16);
            assert!(loss > 0.5 || leader == first, "seed {seed}: {leader:?}, not {first:?}");
            assert_eq!(node.equivocators().count(), 0);
            let is_late = |(why, ..): (Refusal, Option<&str>, u64)| why == Refusal::Replayed;
            assert!(node.refused().all(is_late), "seed {seed}: {:?}", node.refused().collect::<Vec<_>>());
        }
    }
}

#[test]
fn who_tells_two_things_is_found_out_by_all() {
    let (mut a, mut b, mut liar) = (node(3, 0, 0), node(3, 1, 0), node(3, 2, 0));
    let mut twin = liar.clone();
    assert!(liar.publish(Kind::Entries, vec![1; 10]) && twin.publish(Kind::Entries, vec![2; 10]));
    liar.poll(at(1)).iter().for_each(|out| a.receive(at(1), &out.bytes));
    twin.poll(at(1)).iter().for_each(|out| b.receive(at(1), &out.bytes));
    assert_eq!(a.equivocators().count() + b.equivocators().count(), 0);
    // What the other one was told reaches a: both are signed by one robot for one place.
    let mut later = node(3, 2, 0);
    assert!(later.publish(Kind::Entries, vec![2; 10]));
    later.poll(at(3)).iter().for_each(|out| a.receive(at(3), &out.bytes));
    assert_eq!(a.equivocators().map(|(rank, _)| rank).collect::<Vec<_>>(), [2]);
    // The proof convinces b, and nothing more is taken of the liar.
    a.poll(at(3)).iter().for_each(|out| b.receive(at(3), &out.bytes));
    assert_eq!(b.equivocators().map(|(rank, _)| rank).collect::<Vec<_>>(), [2]);
    assert!(liar.publish(Kind::Entries, vec![3; 10]));
    liar.poll(at(4)).iter().for_each(|out| b.receive(at(4), &out.bytes));
    assert!(b.refused().any(|(why, of, _)| why == Refusal::Equivocator && of == Some("robot 2")));
}

#[test]
fn what_is_forged_cut_or_foreign_is_refused_and_counted() {
    let (mut a, mut b) = (node(2, 0, 0), node(2, 1, 0));
    assert!(b.publish(Kind::Entries, vec![5; 300]));
    let messages: Vec<Vec<u8>> = b.poll(at(1)).into_iter().map(|out| out.bytes).collect();
    let mut refused = 0;
    for message in &messages {
        for end in 0..message.len() {
            a.receive(at(1), &message[..end]);
        }
        for bit in 0..message.len() * 8 {
            let mut flipped = message.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            a.receive(at(1), &flipped);
        }
        refused += message.len();
    }
    let counted: u64 = a.refused().map(|(_, _, times)| times).sum();
    assert!(counted as usize > refused, "{counted} of {refused}");
    assert_eq!(a.chains().values().map(|chain| chain.records().len()).sum::<usize>(), 0);
    assert!(!a.is_alive(1, at(1)));
    let other = [&b"MWF\x09"[..], &messages[0][4..]].concat();
    a.receive(at(1), &other);
    assert!(a.refused().any(|(why, of, _)| why == Refusal::OtherVersion && of.is_none()));
    // The whole ones are taken all the same.
    messages.iter().for_each(|message| a.receive(at(2), message));
    assert_eq!(a.chains()[&b.me()].next(), 1);
    assert!(a.is_alive(1, at(2)));
    // A stranger's secret, a secret of another robot's.
    assert!(Node::new(Default::default(), support::roster(2), "robot 1", secret(0), 0).is_none());
    assert!(Node::new(Default::default(), support::roster(2), "robot 9", secret(9), 0).is_none());
}

#[test]
fn a_robot_that_comes_late_gets_all_from_anyone_who_holds_it() {
    let mut nodes = vec![Some(node(3, 0, 0)), Some(node(3, 1, 0)), None];
    let mut air = radio(3, 0.0);
    for k in 0..300_u32 {
        assert!(nodes[0].as_mut().expect("there").publish(Kind::Entries, k.to_le_bytes().to_vec()));
    }
    (0..40).for_each(|tick| exchange(&mut nodes, &mut air, at(tick), |_, _| true));
    // The one who said it is gone; the other one has it.
    (nodes[0], nodes[2]) = (None, Some(node(3, 2, 0)));
    (40..120).for_each(|tick| exchange(&mut nodes, &mut air, at(tick), |_, _| true));
    let late = nodes[2].as_ref().expect("there");
    assert_eq!(late.chains()[&ChainId { rank: 0, session: 0 }].next(), 300);
    assert_eq!(late.leader(at(120)), Some(1));
}
