//! Points by pairs of images.

use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud, SpaceSensor};
use mapwright_stereo::{
    Calibration, DisparityMap, GreyImage, Matcher, MatcherSettings, Pairing, Rectifier, Side, StereoCamera, StereoError,
};
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// Without anything said, an eighth of the width is looked at, as OpenCV's examples do.
const WIDTH_SHARE: u32 = 8;
/// Costs are computed so many disparities at once: what is asked for is rounded up to that, for nothing.
const AT_ONCE: u32 = 32;
/// Standard deviation of a disparity where nothing else is known, pixels: what those that are right are off by on Middlebury's real pairs
/// (0.21 to 0.26, decision 45).
const SIGMA_PX: f64 = 0.25;
/// As of images of depth: beside a step of more than this share a pixel shows both sides of an edge;
const EDGE_SHARE: f32 = 0.03;
/// and the step is more than noise makes, in standard deviations of the two.
const EDGE_SIGMAS: f32 = 3.0;

/// What is known of a pair of cameras.
#[derive(Debug, Clone, PartialEq)]
pub enum StereoPairPlan {
    /// Images are rectified.
    Rectified(StereoCamera),
    /// Images are as they were taken, and are rectified first.
    AsTaken(Box<Calibration>),
}

impl StereoPairPlan {
    /// Pixels of either image, across and down.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        match self {
            Self::Rectified(camera) => [camera.width, camera.height],
            Self::AsTaken(calibration) => [calibration.left.width, calibration.left.height],
        }
    }
}

/// Makes points of pairs of images; keeps its memory from one pair to the next.
#[derive(Debug)]
pub struct StereoDepth {
    rectifier: Option<Box<Rectifier>>,
    camera: StereoCamera,
    disparities: u32,
    /// From the rectified frame to that of the left camera as it is.
    left_from_rectified: Matrix3<f64>,
    matcher: Matcher,
    rectified: [GreyImage; 2],
    map: DisparityMap,
}

impl StereoDepth {
    /// For a pair of cameras; `disparities` are looked at, or as many as an eighth of the width, rounded up to whole 32.
    ///
    /// # Errors
    /// [`StereoError`] where the numbers are none of a pair, or the disparities do not fit it.
    pub fn new(plan: &StereoPairPlan, disparities: Option<u32>) -> Result<Self, StereoError> {
        let (rectifier, camera) = match plan {
            StereoPairPlan::Rectified(camera) => {
                camera.check()?;
                (None, *camera)
            }
            StereoPairPlan::AsTaken(calibration) => {
                let rectifier = Rectifier::new(calibration)?;
                let camera = rectifier.camera();
                (Some(Box::new(rectifier)), camera)
            }
        };
        let asked = disparities.unwrap_or(camera.width / WIDTH_SHARE).max(2);
        let whole = asked.div_ceil(AT_ONCE).saturating_mul(AT_ONCE);
        // a narrow image may have no room for more than was asked
        let disparities = if whole < camera.width { whole } else { asked };
        let matcher = Matcher::new(MatcherSettings { disparities: Some(disparities), ..MatcherSettings::default() })?;
        let turn =
            rectifier.as_ref().map_or_else(Matrix3::identity, |r| r.rectified_from_left().transpose().into_inner());
        Ok(Self {
            rectifier,
            camera,
            disparities,
            left_from_rectified: turn,
            matcher,
            rectified: Default::default(),
            map: DisparityMap::default(),
        })
    }

    /// The pair after rectification.
    #[must_use]
    pub fn camera(&self) -> StereoCamera {
        self.camera
    }

    /// How it looks at the world, in the left camera's optical frame: its noise by baseline, focal length and a disparity's usual standard
    /// deviation, 0.25 pixels; its nearest by how many disparities are looked at.
    #[must_use]
    pub fn sensor(&self, name: &str) -> SpaceSensor {
        let StereoCamera { fx, baseline_m, .. } = self.camera;
        let nearest_m = self.camera.depth_m(f64::from(self.disparities)).unwrap_or(0.0);
        SpaceSensor::stereo_camera(name, fx * baseline_m, SIGMA_PX, nearest_m)
    }

    /// The pair in words.
    #[must_use]
    pub fn words(&self) -> String {
        let StereoCamera { width, height, fx, baseline_m, .. } = self.camera;
        let nearest_m = self.camera.depth_m(f64::from(self.disparities)).unwrap_or(0.0);
        let how = if self.rectifier.is_some() { ", images are rectified here" } else { "" };
        format!(
            "stereo: {width} x {height} pixels, focal length {fx:.1} pixels, baseline {baseline_m:.4} m{how}; {} disparities are looked at, \
             so that things count from {nearest_m:.2} m on",
            self.disparities
        )
    }

    /// What two images say of whether they are a pair.
    ///
    /// # Errors
    /// [`StereoError::Size`] where an image has another size than the camera.
    pub fn pairing(&mut self, left: &GreyImage, right: &GreyImage) -> Result<Pairing, StereoError> {
        let infinity_px = self.camera.cx - self.camera.cx_right;
        let [left, right] = self.both(left, right)?;
        Pairing::of(left, right, infinity_px)
    }

    /// The points of all pixels of the left image, row by row, in the frame of the left camera: NaN where nothing is known. Each has its
    /// standard deviation. `colours` are those of the left image as it is, of a rectified pair; or none.
    ///
    /// # Errors
    /// [`StereoError::Size`] where an image has another size than the camera.
    pub fn cloud(
        &mut self,
        (left, right): (&GreyImage, &GreyImage),
        (stamp, sensor): (Stamp, &Arc<SpaceSensor>),
        colours: Vec<[u8; 3]>,
    ) -> Result<Cloud, StereoError> {
        self.both(left, right)?;
        let (rectified, map) = (&self.rectified, &mut self.map);
        let [left, right] = if self.rectifier.is_some() { rectified.each_ref() } else { [left, right] };
        self.matcher.match_pair(left, right, map)?;
        let count = left.pixels().len();
        let colours = if self.rectifier.is_some() { shades(left) } else { colours };
        let mut cloud = Cloud {
            stamp,
            sensor: Arc::clone(sensor),
            points_m: vec![[f32::NAN; 3]; count],
            times_s: Vec::new(),
            colours: if colours.len() == count { colours } else { Vec::new() },
            intensities: Vec::new(),
            sigmas_m: vec![0.0; count],
            odom_from_robot: None,
        };
        for point in map.points(&self.camera) {
            let [x, y] = point.pixel;
            if is_edge(map, x, y) {
                continue;
            }
            let at = y as usize * map.width() as usize + x as usize;
            let place = self.left_from_rectified * Vector3::from(point.point_m.map(f64::from));
            cloud.points_m[at] = [place.x as f32, place.y as f32, place.z as f32];
            cloud.sigmas_m[at] = point.sigma_m;
        }
        Ok(cloud)
    }

    /// Both images, rectified.
    fn both<'a>(&'a mut self, left: &'a GreyImage, right: &'a GreyImage) -> Result<[&'a GreyImage; 2], StereoError> {
        let expected = [self.camera.width, self.camera.height];
        for (what, image) in [("left image", left), ("right image", right)] {
            if image.size() != expected {
                return Err(StereoError::Size { what, expected, found: image.size() });
            }
        }
        let Some(rectifier) = &self.rectifier else { return Ok([left, right]) };
        let [to_left, to_right] = &mut self.rectified;
        rectifier.rectify(left, Side::Left, to_left)?;
        rectifier.rectify(right, Side::Right, to_right)?;
        Ok(self.rectified.each_ref())
    }
}

/// What speaks against a pair, in words, with what to do.
#[must_use]
pub fn is_turned_words(name: &str, pairing: &Pairing) -> String {
    let what = if pairing.is_swapped() {
        "exchange them"
    } else if pairing.is_misaligned() {
        "give the calibration of the images as they were taken, or rectify them"
    } else {
        "are both of the same moment, and is there anything to see?"
    };
    format!("{name}: {}: {what}", pairing.words().join("; "))
}

/// Grey values as colours: as they are where they fit a byte, else the upper byte of the brightest and all others with it.
fn shades(image: &GreyImage) -> Vec<[u8; 3]> {
    let brightest = image.pixels().iter().copied().max().unwrap_or(0);
    let down = 8_u32.saturating_sub(brightest.leading_zeros());
    image.pixels().iter().map(|value| [(value >> down) as u8; 3]).collect()
}

/// Whether a pixel lies beside a step in disparity that is no noise.
fn is_edge(map: &DisparityMap, x: u32, y: u32) -> bool {
    let Some((disparity, sigma)) = map.at(x, y) else { return true };
    let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
    beside.into_iter().filter_map(|(x, y)| map.at(x, y)).any(|(other, of_other)| {
        let noise = EDGE_SIGMAS * sigma.hypot(of_other);
        (other - disparity).abs() > EDGE_SHARE * disparity.max(other) + noise
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    fn plan() -> StereoPairPlan {
        let (width, height, cx, cy) = (160, 80, 79.5, 39.5);
        let (fx, fy) = (100.0, 100.0);
        StereoPairPlan::Rectified(StereoCamera { width, height, fx, fy, cx, cx_right: cx, cy, baseline_m: 0.2 })
    }

    /// A number that looks random, by its place.
    fn value(x: u32, y: u32) -> u8 {
        let mixed = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
        let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2c1b_3c6d);
        (mixed >> 13) as u8
    }

    /// A texture that the right camera sees `shift` pixels further left.
    fn image(shift: u32) -> GreyImage {
        GreyImage::new(160, 80, (0..160 * 80).map(|k| u16::from(value(k % 160 + shift, k / 160))).collect()).unwrap()
    }

    #[test]
    fn points_lie_where_the_disparity_says_with_their_uncertainty() {
        let mut depth = StereoDepth::new(&plan(), None).unwrap();
        let sensor = Arc::new(depth.sensor("stereo"));
        // 20 px m over 32 disparities
        assert!((sensor.range_min_m - 0.625).abs() < 1e-9 && (sensor.range_sigma_per_m - 0.25 / 20.0).abs() < 1e-12);
        assert!((sensor.range_max_m - 5.0).abs() < 1e-9);
        let colours = vec![[1, 2, 3]; 160 * 80];
        let cloud = depth.cloud((&image(0), &image(8)), (Stamp(7), &sensor), colours).unwrap();
        assert_eq!([cloud.points_m.len(), cloud.sigmas_m.len(), cloud.colours.len()], [160 * 80; 3]);
        let [x, y, z] = cloud.points_m[40 * 160 + 100];
        assert!(
            (z - 2.5).abs() < 0.1 && (x - 20.5 * 0.025).abs() < 0.05 && (y - 0.5 * 0.025).abs() < 0.05,
            "{x} {y} {z}"
        );
        let sigma_m = cloud.sigmas_m[40 * 160 + 100];
        assert!((0.02..0.2).contains(&sigma_m), "{sigma_m}");
        // what the right camera does not see
        assert!(cloud.points_m[40 * 160 + 2][2].is_nan());
        assert!(!depth.pairing(&image(8), &image(0)).unwrap().words().is_empty());
    }

    #[test]
    fn images_of_another_size_are_refused() {
        let mut depth = StereoDepth::new(&plan(), None).unwrap();
        let small = GreyImage::new(20, 10, vec![0; 200]).unwrap();
        let error = depth.pairing(&image(0), &small).unwrap_err().to_string();
        assert_eq!(error, "right image: expected 160 x 80 pixels, found 20 x 10");
    }
}
