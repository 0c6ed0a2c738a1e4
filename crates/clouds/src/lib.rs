//! Recordings of lidars, depth cameras and stereo cameras: folders and files in, clouds of points out.
//!
//! | kind | what is there |
//! |---|---|
//! | KITTI odometry | `velodyne/000000.bin` or `.bin.zst` (float32 `x y z intensity`), `times.txt`, `poses*.txt`, `calib.txt` |
//! | PCD, PLY | one file or a folder of them: ascii, binary, compressed; colours and times of points |
//! | TUM RGB-D | `depth.txt`, `rgb.txt`, `groundtruth.txt` |
//! | 7-Scenes | `frame-000000.depth.png`, `.color.jpg`, `.pose.txt`, `camera-intrinsics.txt` |
//! | Open3D | `depth0.png`, `color0.jpg`, `camera.json`, `trajectory.log` |
//! | KITTI, a pair of cameras | `image_0/000000.png`, `image_1/000000.png` (or 2 and 3), `calib.txt`, `times.txt`, `poses*.txt` |
//! | EuRoC | `mav0/cam0/data/*.png`, `mav0/cam1/data/*.png`, `sensor.yaml` and `data.csv` of each, `state_groundtruth_estimate0` |
//! | Middlebury | `im0.png`, `im1.png`, `calib.txt`; or two numbered images |
//! | packets | a capture (pcap, pcapng) of a Velodyne (VLP-16, Puck LITE and Hi-Res, HDL-32E, VLP-32C), a Hesai PandarXT-32, or an Ouster with its metadata (`.json`) beside it |
//!
//! The crate opens no files: whoever may do so implements [`Folder`]. [`recognise`] looks at what is there and says what it
//! is, what was taken for granted, and which poses came with it; [`Recording::clouds`] reads a frame when it is asked for.
//!
//! ```
//! use mapwright_clouds::{CameraOptions, Folder, recognise};
//!
//! struct OneFile(&'static [u8]);
//!
//! impl Folder for OneFile {
//!     fn names(&self) -> Vec<String> {
//!         vec!["corner.ply".to_owned()]
//!     }
//!     fn read(&self, _: &str) -> std::io::Result<Vec<u8>> {
//!         Ok(self.0.to_vec())
//!     }
//! }
//!
//! let file = OneFile(b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
//!     property float z\nend_header\n1 2 3\n4 5 6\n");
//! let recording = recognise(&file)?.ok_or("no recording")?;
//! assert_eq!(recording.kind().to_string(), "clouds as PCD or PLY files");
//! let mut clouds = recording.clouds(&CameraOptions::default())?;
//! while let Some(cloud) = clouds.next_cloud()? {
//!     assert_eq!(cloud.points_m, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
//! }
//! assert!(!clouds.notes().has_losses());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Damage ends nothing: a frame that cannot be read is left out, one that is torn gives the points before, and [`Notes`] count
//! both with file and byte. No length that a file claims is believed beyond what the file can hold.

mod bins;
mod camera;
mod distances;
mod error;
mod folder;
mod image;
mod layouts;
mod notes;
mod packets;
mod pcd;
mod plan;
mod ply;
mod pnm;
mod points;
mod poses;
mod recording;
mod scalar;
mod stereo;
mod stereo_source;
mod text;

pub use bins::read_bin;
pub use camera::{BASELINE_KEY, CameraOptions, DEPTH_SCALE_KEY, INTRINSICS_KEY, off_axis_words};
pub use distances::{Distances, RANGE_UNIT_KEY, UnitOf, Units};
pub use error::CloudError;
pub use folder::Folder;
pub use image::{CameraImage, read_camera_image, read_png16};
pub use notes::{Note, NoteKind, Noted, Notes};
pub use packets::lidar::{Lidar, OUSTER_METADATA, PacketDecoder};
pub use packets::ouster::{OUSTER_IMU_BYTES, OusterInfo, ouster_imu, ouster_numbers};
pub use packets::sweep::{Place, Sweep};
pub use pcd::read_pcd;
pub use plan::Kind;
pub use ply::read_ply;
pub use points::Points;
pub use poses::{Reference, ReferenceFrame};
pub use recording::{Clouds, Recording, recognise};
pub use stereo::{StereoDepth, StereoPairPlan, is_turned_words};
