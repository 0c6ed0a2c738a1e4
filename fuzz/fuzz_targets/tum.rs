//! Any bytes as a trajectory or relations file: no panic, and a trajectory written anew reads back.
//! `cargo +nightly fuzz run tum -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_formats::{TrajectoryReader, TumWriter, read_relations};

fuzz_target!(|text: &[u8]| {
    let _ = read_relations(text);
    let mut reader = TrajectoryReader::new(text);
    while let Ok(Some(pose)) = reader.next_pose() {
        let mut writer = TumWriter::new(Vec::new());
        if writer.write(&pose).is_err() {
            continue;
        }
        let line = writer.finish().expect("a vector does not fail");
        let again = TrajectoryReader::new(line.as_slice()).next_pose().expect("what is written can be read");
        assert_eq!(again.map(|p| p.stamp), Some(pose.stamp));
    }
});
