//! Plays a recording of ROS 2 as a robot would: its messages go out as they were recorded, in their order and at their pace, with reliable
//! delivery; what is static stays for who comes late. For trying `mapwright live`, beside `mapwright map` of the same recording.
//!
//! ```sh
//! mapwright live -o out --set loops.jobs=inline &
//! cargo run --release -p mapwright-dds --features cyclone --example play -- LOG.mcap 20
//! kill -INT %1
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, clippy::panic, reason = "an example says what it does")]

use mapwright_bags::{Encoding, Recording};
use mapwright_dds::{Configuration, Dds};
use mapwright_live::wire::{Delivery, Publisher, Topic, Wire};
use std::collections::BTreeMap;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Whoever hears has found a topic by then.
const FOUND: Duration = Duration::from_secs(3);

fn main() {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let [path, rate] = &names[..] else { panic!("expected a recording, and how many times as fast it is played") };
    let rate: f64 = rate.parse().expect("a number");
    let mut recording = Recording::open(Path::new(path)).expect("a recording");
    let configuration = Configuration::from_environment().expect("an environment that can be");
    let mut dds = Dds::join(&configuration, "/", "player").expect("a network");
    let mut topics: BTreeMap<String, (Box<dyn Publisher>, u64)> = BTreeMap::new();
    for connection in recording.connections().iter().filter(|connection| connection.encoding == Encoding::Cdr) {
        let kind: &'static str = Box::leak(connection.type_name.to_string().into_boxed_str());
        let is_static = connection.topic.ends_with("_static");
        let delivery = if is_static { Delivery::Latched { depth: 100 } } else { Delivery::Reliable { depth: 2000 } };
        let publisher = dds.advertise(&Topic::new(&connection.topic, kind, delivery)).expect("a topic");
        topics.insert(connection.topic.to_string(), (publisher, 0));
    }
    sleep(FOUND);
    let (begun, mut first, mut late) = (Instant::now(), None, Duration::ZERO);
    while let Some(message) = recording.next_message().expect("a message") {
        let Some((publisher, sent)) = topics.get_mut(&*message.connection.topic) else { continue };
        let since_s = message.log_stamp.secs_since(*first.get_or_insert(message.log_stamp));
        let due = Duration::from_secs_f64((since_s / rate).max(0.0));
        sleep(due.saturating_sub(begun.elapsed()));
        late = late.max(begun.elapsed().saturating_sub(due));
        publisher.publish(message.data).expect("sent");
        *sent += 1;
    }
    sleep(FOUND);
    let sent: Vec<String> = topics.iter().map(|(topic, (_, sent))| format!("{topic} {sent}")).collect();
    println!("{}; late by {:.2} s at most", sent.join(", "), late.as_secs_f64());
}
