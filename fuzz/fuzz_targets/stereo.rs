//! Any text as a calibration of two cameras, and as that beside their images: no panic, and a pair that is found can be used.
//! `cargo +nightly fuzz run stereo fuzz/seeds/stereo -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_clouds::{CameraOptions, Folder, StereoDepth, StereoPairPlan, read_camera_image, recognise};
use mapwright_stereo::{EurocCamera, EurocImu, KittiCameras, KittiProjections, MiddleburyPair};
use std::io;

/// The smallest image that is matched: 4 x 2 pixels of one grey value, as PNG.
const IMAGE: &[u8] = include_bytes!("../seeds/stereo/grey.png");

/// A folder of pairs whose calibration is any text.
struct Pair<'a> {
    names: &'static [&'static str],
    calibration: &'a [u8],
}

impl Folder for Pair<'_> {
    fn names(&self) -> Vec<String> {
        self.names.iter().map(|name| (*name).to_owned()).collect()
    }

    fn read(&self, name: &str) -> io::Result<Vec<u8>> {
        Ok(if name.ends_with(".png") { IMAGE.to_vec() } else { self.calibration.to_vec() })
    }
}

const FOLDERS: [&[&str]; 4] = [
    &["image_0/0.png", "image_1/0.png", "calib.txt", "times.txt"],
    &["image_00/data/0.png", "image_01/data/0.png", "calib_cam_to_cam.txt", "image_00/timestamps.txt"],
    &["cam0/data/1000000000.png", "cam1/data/1000000000.png", "cam0/sensor.yaml", "cam1/sensor.yaml", "imu0/data.csv"],
    &["im0.png", "im1.png", "calib.txt", "readme.txt"],
];

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(found) = KittiProjections::parse(&text) {
        let _ = (found.pair(0, 1, [4, 2]), found.pair(2, 3, [4, 2]), found.offset_m(2));
    }
    if let Ok(found) = KittiCameras::parse(&text) {
        let _ = found.rectified(0, 1);
        if let Ok(raw) = found.raw(0, 1) {
            // room is made for a table of the camera's pixels: as few as can be said of it here
            if u64::from(raw.left.width) * u64::from(raw.left.height) < 1 << 20 {
                let _ = StereoDepth::new(&StereoPairPlan::AsTaken(Box::new(raw)), None);
            }
        }
    }
    let _ = (MiddleburyPair::parse(&text), EurocImu::parse(&text));
    if let Ok(camera) = EurocCamera::parse(&text) {
        let _ = EurocCamera::pair(&camera, &camera);
    }
    let _ = read_camera_image("any", bytes, None, 1 << 16);
    for names in FOLDERS {
        let folder = Pair { names, calibration: bytes };
        let Ok(Some(recording)) = recognise(&folder) else { continue };
        let Ok(mut clouds) = recording.clouds(&CameraOptions::default()) else { continue };
        while let Ok(Some(cloud)) = clouds.next_cloud() {
            assert_eq!(cloud.sigmas_m.len(), cloud.points_m.len());
            let _ = clouds.take_readings();
        }
    }
});
