//! A drive in space: clouds and images on the way, with the truth beside them.

use super::depth::{DepthCamera, DepthSettings};
use super::imu::{self, ImuSettings};
use super::lidar::{Lidar, LidarSettings};
use super::path::Path;
use super::settings::SpaceDriveSettings;
use super::site::SpaceSite;
use super::stereo::{StereoPair, StereoSettings};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::{Cloud, DepthImage, ImuReading};
use std::sync::Arc;

/// A cloud and where it was really taken.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueCloud {
    /// The cloud, with times and odometry. The robot moves while it is taken: each point is in the sensor's frame of its own time.
    pub cloud: Cloud,
    /// True pose of the robot at the cloud's stamp.
    pub world_from_robot: Pose3,
}

/// An image of depth and where it was really taken.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueDepthImage {
    /// The image.
    pub image: DepthImage,
    /// Odometry's pose of the robot at the image's stamp.
    pub odom_from_robot: Pose3,
    /// True pose of the robot at the image's stamp.
    pub world_from_robot: Pose3,
}

/// Two images of a stereo camera and where they were really taken.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueStereoPair {
    /// When both were taken.
    pub stamp: Stamp,
    /// Grey values of the left image, row by row.
    pub left: Vec<u8>,
    /// Those of the right one.
    pub right: Vec<u8>,
    /// Odometry's pose of the robot at the stamp.
    pub odom_from_robot: Pose3,
    /// True pose of the robot at the stamp.
    pub world_from_robot: Pose3,
}

/// A drive through a site. Stamps begin at zero. The way is simulated at 50 Hz, whatever the rates of the sensors, and clouds
/// are made when they are asked for, each a function of its number.
#[derive(Debug, Clone)]
pub struct SpaceDrive {
    site: Arc<SpaceSite>,
    path: Path,
    lidar: Lidar,
    camera: DepthCamera,
    stereo: StereoPair,
    imu: ImuSettings,
    seed: u64,
}

impl SpaceDrive {
    /// Drives the whole way. A site without two waypoints gives a drive without clouds.
    #[must_use]
    pub fn new(site: Arc<SpaceSite>, mut settings: SpaceDriveSettings) -> Self {
        settings.lidar.rate_hz = settings.lidar.rate_hz.clamp(0.1, 1000.0);
        settings.depth.rate_hz = settings.depth.rate_hz.clamp(0.1, 1000.0);
        settings.stereo.rate_hz = settings.stereo.rate_hz.clamp(0.1, 1000.0);
        let path = Path::new(&site, &settings);
        let (lidar, camera) = (Lidar::new(settings.lidar), DepthCamera::new(settings.depth));
        let stereo = StereoPair::new(settings.stereo);
        Self { site, path, lidar, camera, stereo, imu: settings.imu, seed: settings.seed }
    }

    /// Where it leads.
    #[must_use]
    pub fn site(&self) -> &SpaceSite {
        &self.site
    }

    /// Its lidar.
    #[must_use]
    pub fn lidar(&self) -> &LidarSettings {
        self.lidar.settings()
    }

    /// Its depth camera.
    #[must_use]
    pub fn depth_camera(&self) -> &DepthSettings {
        self.camera.settings()
    }

    /// Its stereo camera.
    #[must_use]
    pub fn stereo_camera(&self) -> &StereoSettings {
        self.stereo.settings()
    }

    /// How long it takes, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.path.duration_s()
    }

    /// True pose of the robot; `None` before and after the drive.
    #[must_use]
    pub fn world_from_robot(&self, at: Stamp) -> Option<Pose3> {
        Some(self.path.at(at.0)?.world_from_robot)
    }

    /// Odometry's pose of the robot; `None` before and after the drive.
    #[must_use]
    pub fn odom_from_robot(&self, at: Stamp) -> Option<Pose3> {
        Some(self.path.at(at.0)?.odom_from_robot)
    }

    /// A turn of the lidar by its number; `None` where it would not end within the drive.
    #[must_use]
    pub fn cloud(&self, number: u64) -> Option<TrueCloud> {
        let settings = self.lidar.settings();
        let stamp_ns = crate::drive::stamp_ns(number, settings.rate_hz);
        let at_ns = |after_s: f64| stamp_ns + (after_s * 1e9).round() as i64;
        let here = self.path.at(stamp_ns)?;
        self.path.at(at_ns(1.0 / settings.rate_hz))?;
        let world_from_robot_at =
            |after_s: f64| self.path.at(at_ns(after_s)).map_or(here.world_from_robot, |at| at.world_from_robot);
        let seed = self.seed ^ 0x006c_6964_6172;
        let points_m = self.lidar.turn(&self.site.world, world_from_robot_at, seed, number);
        let beams = settings.elevations_rad.len();
        let times =
            (0..settings.columns).flat_map(|column| std::iter::repeat_n(self.lidar.column_s(column) as f32, beams));
        let cloud = Cloud {
            stamp: Stamp(stamp_ns),
            sensor: Arc::clone(&settings.sensor),
            points_m,
            times_s: times.collect(),
            colours: Vec::new(),
            intensities: Vec::new(),
            sigmas_m: Vec::new(),
            odom_from_robot: Some(here.odom_from_robot),
        };
        Some(TrueCloud { cloud, world_from_robot: here.world_from_robot })
    }

    /// All turns of the lidar in order.
    pub fn clouds(&self) -> impl Iterator<Item = TrueCloud> {
        (0..).map_while(|number| self.cloud(number))
    }

    /// A reading of the inertial sensor by its number; `None` after the drive.
    #[must_use]
    pub fn imu_reading(&self, number: u64) -> Option<ImuReading> {
        let world_from_robot_at = |at_ns: i64| Some(self.path.at(at_ns)?.world_from_robot);
        imu::reading(world_from_robot_at, &self.imu, self.seed ^ 0x0069_6e65_7274, number)
    }

    /// All readings of the inertial sensor in order.
    pub fn imu_readings(&self) -> impl Iterator<Item = ImuReading> {
        (0..).map_while(|number| self.imu_reading(number))
    }

    /// An image of the depth camera by its number; `None` after the drive.
    #[must_use]
    pub fn depth_image(&self, number: u64) -> Option<TrueDepthImage> {
        let settings = self.camera.settings();
        let stamp = Stamp(crate::drive::stamp_ns(number, settings.rate_hz));
        let here = self.path.at(stamp.0)?;
        let seed = self.seed ^ 0x0064_6570_7468;
        let depth_m = self.camera.image(&self.site.world, here.world_from_robot, seed, number);
        let image = DepthImage { stamp, camera: Arc::clone(&settings.camera), depth_m, colours: Vec::new() };
        Some(TrueDepthImage { image, odom_from_robot: here.odom_from_robot, world_from_robot: here.world_from_robot })
    }

    /// A pair of the stereo camera by its number; `None` after the drive. The pattern of surfaces is the same in all pairs of a drive.
    #[must_use]
    pub fn stereo_pair(&self, number: u64) -> Option<TrueStereoPair> {
        let stamp = Stamp(crate::drive::stamp_ns(number, self.stereo.settings().rate_hz));
        let here = self.path.at(stamp.0)?;
        let seeds = (self.seed ^ 0x7465_7874, self.seed ^ 0x0073_7465_7265);
        let [left, right] = self.stereo.images(&self.site.world, here.world_from_robot, seeds, number);
        let (odom_from_robot, world_from_robot) = (here.odom_from_robot, here.world_from_robot);
        Some(TrueStereoPair { stamp, left, right, odom_from_robot, world_from_robot })
    }

    /// All pairs of the stereo camera in order.
    pub fn stereo_pairs(&self) -> impl Iterator<Item = TrueStereoPair> {
        (0..).map_while(|number| self.stereo_pair(number))
    }

    /// All images of the depth camera in order.
    pub fn depth_images(&self) -> impl Iterator<Item = TrueDepthImage> {
        (0..).map_while(|number| self.depth_image(number))
    }
}
