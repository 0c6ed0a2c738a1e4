//! Any bytes as an MCAP file: no panic, no endless loop, no memory beyond what the bytes hold and unpack to.
//! `ASAN_OPTIONS=detect_odr_violation=0 cargo +nightly fuzz run mcap -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_bags::BagReader;
use std::io::Cursor;

fuzz_target!(|bytes: &[u8]| {
    let magic = b"\x89MCAP0\r\n";
    let content = if bytes.starts_with(magic) { bytes.to_vec() } else { [magic, bytes].concat() };
    let Ok(mut reader) = BagReader::open(Cursor::new(&content)) else { return };
    let mut messages = 0;
    while let Some(message) = reader.next_message().expect("a slice does not fail") {
        assert!(message.offset_bytes <= content.len() as u64);
        messages += 1;
    }
    assert!(reader.report().messages >= messages);
});
