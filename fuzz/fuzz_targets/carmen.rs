//! Any bytes as a CARMEN log: no panic, and what comes out can be written and reads back the same.
//! `cargo +nightly fuzz run carmen -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_formats::{CarmenReader, CarmenWriter, FormatError, LogEvent, open_log};

/// Writes the log's events anew; those that cannot be written (as a laser of absurd geometry) are left out.
fn rewritten(log: &[u8]) -> Result<(Vec<u8>, usize), FormatError> {
    let mut reader = CarmenReader::new(open_log(log)?);
    let mut writer = CarmenWriter::new(Vec::new());
    let mut written = 0;
    while let Some(event) = reader.next_event()? {
        let result = match event {
            LogEvent::Scan(scan) => writer.scan(scan),
            LogEvent::Odometry(odometry) => writer.odometry(odometry),
            LogEvent::Sonar(reading) => writer.sonar(reading),
            _ => continue,
        };
        written += usize::from(result.is_ok());
    }
    Ok((writer.finish()?, written))
}

fuzz_target!(|log: &[u8]| {
    let (once, written) = rewritten(log).expect("a slice does not fail");
    let (twice, written_again) = rewritten(&once).expect("a slice does not fail");
    assert_eq!(written, written_again);
    assert!(once == twice, "{}\n---\n{}", String::from_utf8_lossy(&once), String::from_utf8_lossy(&twice));
});
