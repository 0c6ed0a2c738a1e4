//! Any bytes as a ROS 1 bag: no panic, no endless loop, no memory beyond what the bytes hold and unpack to.
//! `ASAN_OPTIONS=detect_odr_violation=0 cargo +nightly fuzz run bag1 -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_bags::Bag1Reader;
use std::io::Cursor;

fuzz_target!(|bytes: &[u8]| {
    let magic = b"#ROSBAG V2.0\n";
    let content = if bytes.starts_with(magic) { bytes.to_vec() } else { [magic, bytes].concat() };
    let Ok(mut reader) = Bag1Reader::open(Cursor::new(&content)) else { return };
    let mut messages = 0;
    while let Some(message) = reader.next_message().expect("a slice does not fail") {
        assert!(message.offset_bytes <= content.len() as u64);
        messages += 1;
    }
    assert_eq!(reader.report().messages, messages);
});
