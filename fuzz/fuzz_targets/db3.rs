//! Any bytes as a database: no panic, no endless loop. SQLite defines a name twice, which the sanitizer must be told.
//! `ASAN_OPTIONS=detect_odr_violation=0 cargo +nightly fuzz run db3 -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_bags::Recording;

fuzz_target!(|bytes: &[u8]| {
    let path = std::env::temp_dir().join(format!("mapwright-fuzz-{}.db3", std::process::id()));
    std::fs::write(&path, bytes).expect("a file can be written");
    let Ok(mut recording) = Recording::open(&path) else { return };
    while recording.next_message().is_ok_and(|message| message.is_some()) {}
});
