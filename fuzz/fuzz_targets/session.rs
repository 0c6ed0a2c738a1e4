//! Any bytes as a session's log, whole or damaged: no panic, no memory beyond what they hold, and what is read is written and
//! read again the same. `cargo +nightly fuzz run session -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_record::{LogError, Session};
use std::sync::LazyLock;

/// A session of 60 scans, as version 1 wrote it.
const OLD: &[u8] = include_bytes!("../../crates/record/tests/fixtures/v1.mapwright");

/// The same as it is written today.
static WHOLE: LazyLock<Vec<u8>> =
    LazyLock::new(|| Session::read(OLD).map(|(session, _)| session.encode()).unwrap_or_default());

fuzz_target!(|bytes: &[u8]| {
    let _ = reads_back(bytes);
    let _ = reads_back(&entries(bytes));
    let _ = reads_back(&sealed_version_1(bytes));
    let _ = reads_back(&damaged(bytes));
});

/// What was read is the same after writing and reading it again.
fn reads_back(bytes: &[u8]) -> Result<(), LogError> {
    let (session, _) = Session::read(bytes)?;
    let encoded = session.encode();
    let (again, report) = Session::read(&encoded)?;
    assert!(report.is_whole());
    // to the bit, which `==` is not where evidence is not a number
    assert_eq!(again.encode(), encoded);
    Ok(())
}

/// Entries with right checksums around payloads that may be anything: kind, length, payload, and so on.
fn entries(mut bytes: &[u8]) -> Vec<u8> {
    let mut log = b"mapwright session\n\x02\0".to_vec();
    while let [kind, length, rest @ ..] = bytes {
        let (payload, rest) = rest.split_at(rest.len().min(usize::from(*length)));
        let mut entry = vec![kind % 16, 1];
        entry.extend((payload.len() as u32).to_le_bytes());
        entry.extend(payload);
        entry.extend(crc32fast::hash(&entry).to_le_bytes());
        log.extend(entry);
        bytes = rest;
    }
    log
}

/// Past the first line of version 1 and with the right checksum, so that what is between is reached.
fn sealed_version_1(bytes: &[u8]) -> Vec<u8> {
    let mut sealed = [b"mapwright session\n\x01\0".as_slice(), bytes].concat();
    sealed.extend(crc32fast::hash(&sealed).to_le_bytes());
    sealed
}

/// A valid log with some of its bytes changed: where and into what, three bytes each, and the rest appended.
fn damaged(bytes: &[u8]) -> Vec<u8> {
    let mut log = WHOLE.clone();
    let (changes, rest) = bytes.split_at(bytes.len().min(12));
    for change in changes.chunks_exact(3) {
        let at = usize::from(u16::from_le_bytes([change[0], change[1]])) % log.len();
        log[at] ^= change[2];
    }
    log.extend(rest);
    log
}
