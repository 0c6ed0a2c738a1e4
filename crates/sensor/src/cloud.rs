//! Readings of sensors in space, as they arrive: clouds of points and images of depth.

use mapwright_geom::{Pose3, Stamp, stored};
use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

/// A sensor whose mount is put right by up to so much is the same, radians.
const SAME_WAY_RAD: f64 = FRAC_PI_4;
/// Where a stereo camera's range is uncertain by this share of itself, it sees no farther.
const STEREO_SIGMA_SHARE: f64 = 1.0 / 16.0;

/// How a sensor in space looks at the world. Shared by all that it takes.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceSensor {
    /// Name for reports, such as a topic or a folder.
    pub name: String,
    /// Points nearer than this are no returns, metres.
    pub range_min_m: f64,
    /// Points at or beyond this are no returns, metres.
    pub range_max_m: f64,
    /// Pose of the sensor on the robot.
    pub robot_from_sensor: Pose3,
    /// Standard deviation of a range of `r` metres: `range_sigma_m + range_sigma_per_m * r^2`, metres
    pub range_sigma_m: f64,
    /// and 1/m. Depth from disparity grows worse with the square of the distance; a lidar does not.
    pub range_sigma_per_m: f64,
}

impl SpaceSensor {
    /// Where it is, in the robot's frame, metres.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 3] {
        self.robot_from_sensor.translation.into()
    }

    /// A spinning lidar in the robot's origin: 0.5 to 120 m, 2 cm.
    #[must_use]
    pub fn lidar(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            range_min_m: 0.5,
            range_max_m: 120.0,
            robot_from_sensor: Pose3::default(),
            range_sigma_m: 0.02,
            range_sigma_per_m: 0.0,
        }
    }

    /// A depth camera in the robot's origin, its optical axis along z: 0.2 to 6 m; noise after Khoshelham and Elberink 2012,
    /// "Accuracy and resolution of Kinect depth data", eq. 10: 1.43 mm at 1 m.
    #[must_use]
    pub fn depth_camera(name: &str) -> Self {
        Self {
            range_min_m: 0.2,
            range_max_m: 6.0,
            range_sigma_m: 0.001,
            range_sigma_per_m: 0.00143,
            ..Self::lidar(name)
        }
    }

    /// A stereo camera in the robot's origin, its optical axis along z, by focal length times baseline in pixels and metres and the
    /// standard deviation of a disparity in pixels: `sigma_z = z^2 sigma_d / (f b)`. It sees from `nearest_m` to where that is as large as a
    /// sixteenth of the range, the side of the voxels in which a scene so far away is drawn: beyond, no surface is told from the next.
    #[must_use]
    pub fn stereo_camera(name: &str, focal_baseline_px_m: f64, sigma_px: f64, nearest_m: f64) -> Self {
        let range_sigma_per_m = sigma_px / focal_baseline_px_m;
        Self {
            range_min_m: nearest_m,
            range_max_m: STEREO_SIGMA_SHARE / range_sigma_per_m,
            range_sigma_m: 0.0,
            range_sigma_per_m,
            ..Self::lidar(name)
        }
    }

    /// Standard deviation of a range, metres.
    #[must_use]
    pub fn sigma_m(&self, range_m: f64) -> f64 {
        self.range_sigma_m + self.range_sigma_per_m * range_m * range_m
    }

    /// Whether clouds of both are one stream, of one sensor: they have one name and look the same way; or they sit in one place and look the
    /// same way, as where two recordings have a sensor under two names.
    #[must_use]
    pub fn is_one_with(&self, other: &Self) -> bool {
        let turned_rad = self.robot_from_sensor.rotation.angle_to(&other.robot_from_sensor.rotation);
        let is_alike = self.name == other.name && turned_rad <= SAME_WAY_RAD;
        is_alike || self.robot_from_sensor == other.robot_from_sensor
    }

    /// Whether it can be mapped with.
    ///
    /// # Errors
    /// What is wrong, in words: numbers that are not finite or below zero, a place farther than 1 km from the robot.
    pub fn check(&self) -> Result<(), &'static str> {
        let sizes = [self.range_min_m, self.range_sigma_m, self.range_sigma_per_m];
        if !sizes.iter().all(|size| size.is_finite() && *size >= 0.0) || self.range_max_m.is_nan() {
            return Err("the sensor's ranges or their noise are not numbers or below zero");
        }
        if !(self.robot_from_sensor.is_finite() && self.robot_from_sensor.translation.norm() <= 1000.0) {
            return Err("the sensor's place on the robot is not finite or farther than 1 km");
        }
        Ok(())
    }
}

stored!(SpaceSensor { name, range_min_m, range_max_m, robot_from_sensor, range_sigma_m, range_sigma_per_m });

/// One sweep of a lidar, or one image of a depth camera, as points.
#[derive(Debug, Clone, PartialEq)]
pub struct Cloud {
    /// When its first point was taken, or the image.
    pub stamp: Stamp,
    /// What took it.
    pub sensor: Arc<SpaceSensor>,
    /// Points in the sensor's frame, metres; any component not finite where there was no return.
    pub points_m: Vec<[f32; 3]>,
    /// When each was taken after the stamp, seconds; empty where that is not known.
    pub times_s: Vec<f32>,
    /// Red, green and blue of each; empty where there are none.
    pub colours: Vec<[u8; 3]>,
    /// How bright each came back, in units of the device; empty where it does not say.
    pub intensities: Vec<f32>,
    /// Standard deviation of each along its ray, metres; empty where the sensor's own ([`SpaceSensor::sigma_m`]) is all that is known.
    pub sigmas_m: Vec<f32>,
    /// The wheels' pose of the robot at the stamp, if it came with the cloud.
    pub odom_from_robot: Option<Pose3>,
}

/// A pinhole camera with the distortion of Brown and Conrady ("plumb bob").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinholeCamera {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// The optical axis in the image, pixels.
    pub centre_px: [f64; 2],
    /// `k1 k2 p1 p2 k3`; zeros where the image is rectified.
    pub distortion: [f64; 5],
}

/// An image of depth.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    /// When it was taken.
    pub stamp: Stamp,
    /// By what.
    pub camera: Arc<PinholeCamera>,
    /// Depth along the optical axis, row by row from the top left, metres; not finite or not above zero where there is none.
    pub depth_m: Vec<f32>,
    /// Red, green and blue of each pixel; empty where there are none.
    pub colours: Vec<[u8; 3]>,
}

/// Images of the same shape differ by so much at most, for they have whole pixels.
const ASPECT_SHARE: f64 = 0.01;
/// No lens is mounted so far off its chip, of the image's size.
const OFF_AXIS_SHARE: f64 = 0.25;
/// What explains both coordinates of an optical axis: a lens is a few hundredths of the image off.
const SAME_SIZE_SHARE: f64 = 0.1;
/// Undistorting takes so many rounds of the fixed-point iteration.
const UNDISTORT_ROUNDS: usize = 8;

impl PinholeCamera {
    /// Whether images can be made into points with it.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn check(&self) -> Result<(), &'static str> {
        let finite = self.centre_px.iter().chain(&self.distortion).all(|v| v.is_finite());
        if !self.focal_px.iter().all(|focal| focal.is_finite() && *focal > 0.0) || !finite {
            return Err("the camera's focal lengths are not above zero or its other numbers are not finite");
        }
        Ok(())
    }

    /// The same camera where its images are of another size; none where they are of another shape, and show another part.
    #[must_use]
    pub fn of_size(&self, [width, height]: [u32; 2]) -> Option<Self> {
        let scale = [f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height)];
        let is_like =
            (scale[0] / scale[1] - 1.0).abs() <= ASPECT_SHARE && scale.iter().all(|s| s.is_finite() && *s > 0.0);
        is_like.then(|| Self { width, height, ..self.scaled(scale) })
    }

    fn scaled(&self, scale: [f64; 2]) -> Self {
        // a pixel's middle is at whole numbers
        let centre = |k: usize| (self.centre_px[k] + 0.5) * scale[k] - 0.5;
        let focal_px = [0, 1].map(|k| self.focal_px[k] * scale[k]);
        Self { focal_px, centre_px: [centre(0), centre(1)], ..*self }
    }

    /// What is odd about it, in words: an optical axis far from the middle of the image, as where its numbers are those of another
    /// size; and the camera that it would be then, if one size explains both of its coordinates.
    #[must_use]
    pub fn off_axis(&self) -> Option<(String, Option<Self>)> {
        let size = [f64::from(self.width), f64::from(self.height)];
        let share = [0, 1].map(|k| (self.centre_px[k] + 0.5) / size[k]);
        if share.iter().all(|share| (share - 0.5).abs() <= OFF_AXIS_SHARE) {
            return None;
        }
        let ([x, y], [width, height]) = (self.centre_px, size);
        let words =
            format!("the optical axis is at the edge of the image ({x:.1}, {y:.1} of {width} x {height} pixels)");
        let scale = share.map(|share| 0.5 / share);
        let is_one_size =
            scale.iter().all(|s| s.is_finite() && *s > 0.0) && (scale[0] / scale[1] - 1.0).abs() < SAME_SIZE_SHARE;
        Some((words, is_one_size.then(|| self.scaled([scale[0]; 2]))))
    }

    /// The directions of all pixels at a depth of one, `(x, y)` of `(x, y, 1)`, row by row.
    #[must_use]
    pub fn directions(&self) -> Vec<[f32; 2]> {
        let pixels = (0..self.height).flat_map(|v| (0..self.width).map(move |u| [f64::from(u), f64::from(v)]));
        pixels.map(|pixel| self.direction(pixel).map(|v| v as f32)).collect()
    }

    fn direction(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let [x0, y0] = [0, 1].map(|k| (pixel[k] - self.centre_px[k]) / self.focal_px[k]);
        let [mut x, mut y] = [x0, y0];
        if self.distortion != [0.0; 5] {
            for _ in 0..UNDISTORT_ROUNDS {
                let r2 = x * x + y * y;
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let [dx, dy] = [2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y];
                [x, y] = [(x0 - dx) / radial, (y0 - dy) / radial];
            }
        }
        [x, y]
    }
}

/// Beside a step in depth of more than this share per pixel a pixel shows neither side: an edge of an object, or a surface seen
/// at less than some six degrees.
const EDGE_SHARE: f32 = 0.03;

impl DepthImage {
    /// Its pixels as points of a cloud; what lies on edges of objects is no point, for there a pixel sees both sides.
    ///
    /// # Errors
    /// An image of another size than the camera's.
    pub fn to_cloud(&self, sensor: &Arc<SpaceSensor>, directions: &[[f32; 2]]) -> Result<Cloud, &'static str> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let pixels = width * height;
        let colours = self.colours.len();
        if self.depth_m.len() != pixels || directions.len() != pixels || (colours != 0 && colours != pixels) {
            return Err("the image has another size than its camera");
        }
        let is_edge = |at: usize| {
            let (u, depth) = (at % width, self.depth_m[at]);
            let beside = [(u > 0, at.wrapping_sub(1)), (u + 1 < width, at + 1)];
            let above = [(at >= width, at.wrapping_sub(width)), (at + width < pixels, at + width)];
            let steps = beside.into_iter().chain(above).filter(|(is_there, _)| *is_there);
            let mut steps = steps.map(|(_, other)| self.depth_m[other]).filter(|other| *other > 0.0);
            steps.any(|other| (other - depth).abs() > EDGE_SHARE * depth)
        };
        let point = |at: usize| {
            let depth = self.depth_m[at];
            if !(depth > 0.0 && depth.is_finite()) || is_edge(at) {
                return [f32::NAN; 3];
            }
            [directions[at][0] * depth, directions[at][1] * depth, depth]
        };
        Ok(Cloud {
            stamp: self.stamp,
            sensor: Arc::clone(sensor),
            points_m: (0..pixels).map(point).collect(),
            times_s: Vec::new(),
            colours: self.colours.clone(),
            intensities: Vec::new(),
            sigmas_m: Vec::new(),
            odom_from_robot: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> PinholeCamera {
        PinholeCamera {
            width: 8,
            height: 6,
            focal_px: [10.0, 10.0],
            centre_px: [4.0, 3.0],
            distortion: [0.1, -0.02, 0.001, 0.002, 0.0],
        }
    }

    #[test]
    fn a_camera_of_another_size_is_scaled_where_its_shape_is_the_same() {
        let camera =
            PinholeCamera { width: 320, height: 240, focal_px: [262.0; 2], centre_px: [159.5, 119.5], ..camera() };
        let half = camera.of_size([160, 120]).unwrap();
        assert_eq!((half.width, half.focal_px, half.centre_px), (160, [131.0; 2], [79.5, 59.5]));
        assert!(camera.of_size([160, 100]).is_none() && camera.of_size([0, 0]).is_none());
        assert!(camera.off_axis().is_none() && half.off_axis().is_none());
    }

    #[test]
    fn an_optical_axis_at_the_edge_is_odd() {
        let camera =
            PinholeCamera { width: 160, height: 120, focal_px: [262.0; 2], centre_px: [159.5, 119.5], ..camera() };
        let (words, likely) = camera.off_axis().unwrap();
        assert!(words.contains("at the edge of the image (159.5, 119.5 of 160 x 120 pixels)"), "{words}");
        assert_eq!(likely.map(|likely| (likely.focal_px, likely.centre_px)), Some(([131.0; 2], [79.5, 59.5])));
        let zero = PinholeCamera { centre_px: [0.0, 60.0], ..camera };
        assert!(zero.off_axis().unwrap().1.is_none());
    }

    #[test]
    fn a_distorted_pixel_is_traced_back() {
        let [k1, k2, p1, p2, _] = camera().distortion;
        for [x, y] in [[0.3, -0.2], [-0.35, 0.1], [0.0, 0.0]] {
            let r2: f64 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * k2);
            let seen_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
            let seen_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
            let found = camera().direction([10.0 * seen_x + 4.0, 10.0 * seen_y + 3.0]);
            assert!((found[0] - x).abs() < 1e-6 && (found[1] - y).abs() < 1e-6, "{found:?}, not {x} {y}");
        }
    }

    #[test]
    fn edges_and_what_is_no_depth_are_no_points() {
        let camera = Arc::new(PinholeCamera { distortion: [0.0; 5], ..camera() });
        let mut depth_m = vec![2.0_f32; 48];
        depth_m[9] = 0.0;
        depth_m[10] = f32::NAN;
        (0..6).for_each(|row| depth_m[8 * row + 6] = 3.0);
        let image = DepthImage { stamp: Stamp(0), camera: Arc::clone(&camera), depth_m, colours: Vec::new() };
        let sensor = Arc::new(SpaceSensor::depth_camera("depth"));
        let cloud = image.to_cloud(&sensor, &camera.directions()).unwrap();
        let is_point = |at: usize| cloud.points_m[at][2].is_finite();
        assert!(is_point(0) && is_point(11) && !is_point(9) && !is_point(10));
        assert!(!is_point(5) && !is_point(6) && !is_point(7), "both sides of an edge");
        assert_eq!(cloud.points_m[0], [-0.8, -0.6, 2.0]);
        let small = DepthImage { depth_m: vec![1.0; 3], ..image };
        assert!(small.to_cloud(&sensor, &camera.directions()).is_err());
    }
}
