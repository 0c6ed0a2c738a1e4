//! Any bytes as a session: no panic, no memory beyond what they hold, and what is read is written and read again the same.
//! `cargo +nightly fuzz run session -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_record::Session;

fuzz_target!(|bytes: &[u8]| {
    let _ = Session::decode(bytes);
    // past the first line and with the right checksum, so that what is between is reached
    let mut sealed = [b"mapwright session\n\x01\0".as_slice(), bytes].concat();
    sealed.extend(crc32fast::hash(&sealed).to_le_bytes());
    if let Ok(session) = Session::decode(&sealed) {
        assert_eq!(Session::decode(&session.encode()), Ok(session));
    }
});
