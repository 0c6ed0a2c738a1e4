//! Any bytes as a cloud, an image of depth or a capture: no panic, and no more points than the bytes can hold.
//! `cargo +nightly fuzz run clouds -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_clouds::{CameraOptions, Folder, recognise};
use std::io;

/// The files that the first byte chooses among.
const NAMES: [&str; 8] =
    ["0.bin", "0.bin.zst", "a.pcd", "a.ply", "a.pcap", "depth0.png", "frame-000000.depth.png", "unknown"];

struct OneFile<'a>(&'static str, &'a [u8]);

impl Folder for OneFile<'_> {
    fn names(&self) -> Vec<String> {
        vec![self.0.to_owned()]
    }

    fn read(&self, _: &str) -> io::Result<Vec<u8>> {
        Ok(self.1.to_vec())
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    let file = OneFile(NAMES[usize::from(*first) % NAMES.len()], bytes);
    let options = CameraOptions { intrinsics: Some([500.0, 500.0, 320.0, 240.0]), depth_scale: None, range_unit_m: None, baseline_m: None };
    let Ok(Some(recording)) = recognise(&file) else { return };
    let Ok(mut clouds) = recording.clouds(&options) else { return };
    while let Ok(Some(cloud)) = clouds.next_cloud() {
        assert!(cloud.times_s.is_empty() || cloud.times_s.len() == cloud.points_m.len());
        assert!(cloud.colours.is_empty() || cloud.colours.len() == cloud.points_m.len());
    }
});
