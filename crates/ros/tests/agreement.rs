//! Every message of every bag at hand, against the `rosbags` Python package, field by field; and typed messages against
//! values, by name against straight through, and written again against what was read.
//!
//! Needs `pip install rosbags` in the Python that `MAPWRIGHT_PYTHON` names, and the data in `MAPWRIGHT_DATA`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests may")]

mod common;

use common::{Dump, canonical, digest};
use mapwright_ros::messages::*;
use mapwright_ros::{Channel, Decoder, Encoding, encode};
use std::collections::BTreeMap;

#[test]
fn every_message_agrees_with_rosbags_field_by_field() {
    let Some(dump) = common::dump("agreement with rosbags") else { return };
    let mut counts = BTreeMap::new();
    for_each_message(&dump, |channel, topic, message, expected| {
        let record = channel.value(message).unwrap_or_else(|e| panic!("{topic}: {e}"));
        assert_eq!(digest(&record), expected, "{topic}:\n{}", canonical(&record));
        *counts.entry(channel.type_name().to_owned()).or_insert(0) += 1;
    });
    println!("agreement with rosbags: {counts:?}");
    assert!(counts.values().sum::<usize>() > 50_000, "{counts:?}");
}

#[test]
fn typed_messages_agree_with_values_and_are_written_as_they_were() {
    let Some(dump) = common::dump("typed messages of bags") else { return };
    let mut counts = BTreeMap::new();
    for_each_message(&dump, |channel, _, message, _| {
        let known = typed::<LaserScan<'_>>(channel, message)
            || typed::<Odometry<'_>>(channel, message)
            || typed::<TfMessage<'_>>(channel, message)
            || typed::<Imu<'_>>(channel, message)
            || typed::<PoseStamped<'_>>(channel, message)
            || typed::<PoseWithCovarianceStamped<'_>>(channel, message);
        *counts.entry((known, channel.type_name().to_owned())).or_insert(0) += 1;
    });
    println!("typed or not: {counts:?}");
    assert!(counts.iter().filter(|((known, _), _)| *known).map(|(_, count)| count).sum::<usize>() > 50_000);
}

/// Checks a message of a type; false where it is of another one.
fn typed<K: Kind>(channel: &Channel, message: &[u8]) -> bool
where
    for<'m> K::Message<'m>: PartialEq + std::fmt::Debug,
{
    if !K::is(channel.type_name()) {
        return false;
    }
    let mut decoder = Decoder::<K>::new(channel).unwrap();
    assert!(decoder.fit().exact, "{}: {:?}", channel.type_name(), decoder.fit());
    let straight = decoder.decode(message).unwrap();
    let by_name = decoder.decode_by_name(message).unwrap();
    let again = encode(&straight, channel.encoding()).unwrap();
    let name = channel.type_name();
    // byte for byte, but for bytes that carry nothing: numbers that are not are unequal to themselves
    assert!(again == encode(&by_name, channel.encoding()).unwrap(), "{name}");
    let (before, after) = (channel.value(message).unwrap(), channel.value(&again).unwrap());
    assert_eq!(canonical(&before), canonical(&after), "{name}");
    if channel.encoding() == Encoding::Ros1 {
        assert!(again == message, "{name}");
    }
    true
}

fn for_each_message(dump: &Dump, mut check: impl FnMut(&Channel, &str, &[u8], &str)) {
    for (channel, messages) in dump.channels() {
        let built = Channel::new(&channel.type_name, channel.encoding, channel.definition());
        let built = built.unwrap_or_else(|e| panic!("{}: {e}", channel.topic));
        for (message, digest) in messages {
            check(&built, &channel.topic, message, digest);
        }
    }
}
