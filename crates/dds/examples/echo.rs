//! Says what it hears: the messages of one topic are told again on another, and the services `/echo/state` and `/echo/long` (2 MB) answer, until the standard input
//! ends. For trying a network, and for tests beside other programs.
//!
//! ```sh
//! cargo run --release -p mapwright-dds --example echo -- /in /out std_msgs/msg/String
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, clippy::panic, reason = "an example says what it does")]

use mapwright_dds::{Configuration, Dds};
use mapwright_live::wire::{Delivery, Service, Topic, Wire};
use std::io::Read;

fn main() {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let [heard, told, kind] = &names[..] else { panic!("expected a topic to hear, one to tell, and their type") };
    let kind: &'static str = Box::leak(kind.clone().into_boxed_str());
    let configuration = Configuration::from_environment().expect("an environment that can be");
    let mut dds = Dds::join(&configuration, "/", "echo").expect("a network");
    let publisher = dds.advertise(&Topic::new(told, kind, Delivery::Latched { depth: 1 })).expect("a topic");
    let mut count = 0;
    let hear = Box::new(move |bytes: &[u8]| {
        count += 1;
        let sent = publisher.publish(bytes);
        println!("{count}: {} bytes to {} listeners {sent:?}", bytes.len(), publisher.listeners());
    });
    dds.subscribe(&Topic::new(heard, kind, Delivery::Reliable { depth: 100 }), hear).expect("a topic");
    let service = Service { name: "/echo/state".to_owned(), kind: "lifecycle_msgs/srv/GetState" };
    let answer = |request: &[u8]| {
        println!("asked for a state with {} bytes", request.len());
        // the number 3 and the text "active"
        [&[0, 1, 0, 0, 3, 0, 0, 0, 7, 0, 0, 0], &b"active\0"[..]].concat()
    };
    dds.serve(&service, Box::new(answer)).expect("a service");
    let service = Service { name: "/echo/long".to_owned(), kind: "std_srvs/srv/Trigger" };
    // yes, and a text
    let length = 2_000_000_u32;
    let head = [&[0, 1, 0, 0, 1, 0, 0, 0][..], &(length + 1).to_le_bytes()].concat();
    let long = move |_: &[u8]| [&head[..], &vec![b'x'; length as usize], &[0]].concat();
    dds.serve(&service, Box::new(long)).expect("a service");
    println!("ready");
    let _ = std::io::stdin().read(&mut [0]);
}
