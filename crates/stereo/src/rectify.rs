//! Images of two cameras as two cameras side by side would have seen them.
//!
//! Fusiello, Trucco and Verri, "A compact algorithm for rectification of stereo pairs", Machine Vision and Applications
//! 12, 2000: both cameras are turned about their centres, so that rows run along the baseline. The direction ahead is the mean of both
//! cameras', as in Bouguet's toolbox, so that neither image is turned further than it must be.

use crate::calibration::{Calibration, Lens};
use crate::camera::StereoCamera;
use crate::error::StereoError;
use crate::image::GreyImage;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// A rectified image shows at least a quarter as wide an angle as the camera sees, or the cameras have too little in common.
const ZOOM_MOST: f64 = 4.0;
/// Places along each edge of an image where it is asked what the camera sees there.
const EDGE_PLACES: u32 = 32;
/// Bits of the fraction of a pixel in a table.
const FRACTION: u32 = 8;

/// One of both cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// Tables that say for each pixel of a rectified image where the camera saw it.
#[derive(Debug, Clone)]
pub struct Rectifier {
    camera: StereoCamera,
    rectified_from_left: Rotation3<f64>,
    tables: [Vec<Tap>; 2],
}

/// Where a value is taken from: the first of four pixels, and how far it is to the others, in parts of `1 << FRACTION`.
#[derive(Debug, Clone, Copy)]
struct Tap {
    at: u32,
    across: u16,
    down: u16,
}

impl Rectifier {
    /// Computes the tables. The rectified images have the size of the given ones and show only what both cameras see of each row, without
    /// empty edges; a point at infinity has disparity 0.
    ///
    /// # Errors
    /// [`StereoError::Calibration`] or [`StereoError::Size`] where the numbers cannot be those of a pair.
    pub fn new(calibration: &Calibration) -> Result<Self, StereoError> {
        calibration.check()?;
        let lenses = [calibration.left, calibration.right];
        let turns = turns(calibration)?;
        let [width, height] = [lenses[0].width, lenses[0].height];
        let seen = Seen::by_both(&lenses, &turns)?;
        let [across, down] = [seen.to[0] - seen.from[0], seen.to[1] - seen.from[1]];
        let focal = (f64::from(width - 1) / across).max(f64::from(height - 1) / down);
        let usual = lenses.iter().flat_map(|lens| lens.focal_px).fold(0.0, f64::max);
        if !(across > 0.0 && down > 0.0 && focal < ZOOM_MOST * usual) {
            return Err(too_little(seen));
        }
        let centre = |k: usize, side: u32| 0.5 * f64::from(side - 1) - 0.5 * focal * (seen.from[k] + seen.to[k]);
        let (cx, cy) = (centre(0, width), centre(1, height));
        let baseline_m = calibration.right_camera_m().norm();
        let camera = StereoCamera { width, height, fx: focal, fy: focal, cx, cx_right: cx, cy, baseline_m };
        camera.check()?;
        let tables = [table(&camera, &lenses[0], &turns[0])?, table(&camera, &lenses[1], &turns[1])?];
        Ok(Self { camera, rectified_from_left: turns[0], tables })
    }

    /// The rectified pair.
    #[must_use]
    pub fn camera(&self) -> StereoCamera {
        self.camera
    }

    /// How the left camera is turned: from its optical frame to that of the rectified pair. The origin is the same.
    #[must_use]
    pub fn rectified_from_left(&self) -> Rotation3<f64> {
        self.rectified_from_left
    }

    /// Makes the rectified image of one side, in the memory of the one before.
    ///
    /// # Errors
    /// [`StereoError::Size`] where the image is not of the camera's size.
    pub fn rectify(&self, image: &GreyImage, side: Side, rectified: &mut GreyImage) -> Result<(), StereoError> {
        let (what, table) = match side {
            Side::Left => ("left image", &self.tables[0]),
            Side::Right => ("right image", &self.tables[1]),
        };
        let expected = [self.camera.width, self.camera.height];
        if image.size() != expected {
            return Err(StereoError::Size { what, expected, found: image.size() });
        }
        let (pixels, stride) = (image.pixels(), image.width() as usize);
        for (value, tap) in rectified.resized(expected[0], expected[1]).iter_mut().zip(table) {
            *value = tap.value(pixels, stride);
        }
        Ok(())
    }
}

impl Tap {
    fn value(self, pixels: &[u16], stride: usize) -> u16 {
        const WHOLE: u32 = 1 << FRACTION;
        let at = self.at as usize;
        let (across, down) = (u32::from(self.across), u32::from(self.down));
        let between = |at: usize| u32::from(pixels[at]) * (WHOLE - across) + u32::from(pixels[at + 1]) * across;
        let sum = between(at) * (WHOLE - down) + between(at + stride) * down;
        ((sum + (1 << (2 * FRACTION - 1))) >> (2 * FRACTION)) as u16
    }
}

/// From the frames of the left and of the right camera to the rectified one.
fn turns(calibration: &Calibration) -> Result<[Rotation3<f64>; 2], StereoError> {
    let right_from_left = calibration.right_from_left.rotation.to_rotation_matrix();
    let aside = calibration.right_camera_m().normalize();
    let ahead = Vector3::z() + right_from_left.inverse() * Vector3::z();
    let down = ahead.cross(&aside).normalize();
    let rows = [aside.transpose(), down.transpose(), aside.cross(&down).transpose()];
    let rectified_from_left = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows));
    let turns = [rectified_from_left, rectified_from_left * right_from_left.inverse()];
    // each camera looks at least half ahead, and is not upside down
    let fits = |turn: &Rotation3<f64>| (turn * Vector3::z()).z > 0.5 && (turn * Vector3::x()).x > 0.5;
    if turns.iter().all(fits) {
        return Ok(turns);
    }
    let angles = turns.map(|turn| format!("{:.0} degrees", turn.angle().to_degrees()));
    Err(StereoError::Calibration {
        of: "rotation from the left to the right camera".to_owned(),
        expected: "cameras that look the same way across their baseline, within 60 degrees",
        found: format!("turns by {} and {}", angles[0], angles[1]),
    })
}

/// A rectangle of directions `(a, b, 1)` of the rectified frame.
#[derive(Debug, Clone, Copy)]
struct Seen {
    from: [f64; 2],
    to: [f64; 2],
}

impl Seen {
    /// The largest within what both cameras see.
    fn by_both(lenses: &[Lens; 2], turns: &[Rotation3<f64>; 2]) -> Result<Self, StereoError> {
        let mut seen = Self { from: [f64::NEG_INFINITY; 2], to: [f64::INFINITY; 2] };
        for (lens, turn) in lenses.iter().zip(turns) {
            let last = [f64::from(lens.width - 1), f64::from(lens.height - 1)];
            for place in (0..=EDGE_PLACES).map(|place| f64::from(place) / f64::from(EDGE_PLACES)) {
                for k in [0, 1] {
                    let mut pixel = last.map(|last| last * place);
                    pixel[k] = 0.0;
                    seen.from[k] = seen.from[k].max(direction(lens, turn, pixel)?[k]);
                    pixel[k] = last[k];
                    seen.to[k] = seen.to[k].min(direction(lens, turn, pixel)?[k]);
                }
            }
        }
        Ok(seen)
    }
}

/// The direction of the rectified frame that a camera sees at a pixel.
fn direction(lens: &Lens, turn: &Rotation3<f64>, pixel: [f64; 2]) -> Result<[f64; 2], StereoError> {
    let seen = lens.direction(pixel).filter(|direction| lens.is_straight_at(*direction));
    let Some([a, b]) = seen else {
        return Err(StereoError::Calibration {
            of: "distortion (k1, k2, p1, p2, k3)".to_owned(),
            expected: "one that holds up to the image's edges",
            found: format!("{:?}, which turns back before pixel {:.0}, {:.0}", lens.distortion, pixel[0], pixel[1]),
        });
    };
    let turned = turn * Vector3::new(a, b, 1.0);
    if turned.z > 0.0 {
        return Ok([turned.x / turned.z, turned.y / turned.z]);
    }
    Err(too_little(Seen { from: [f64::NAN; 2], to: [f64::NAN; 2] }))
}

fn too_little(seen: Seen) -> StereoError {
    StereoError::Calibration {
        of: "what both cameras see".to_owned(),
        expected: "at least a quarter of the image across and down",
        found: format!(
            "directions x/z from {:.3} to {:.3}, y/z from {:.3} to {:.3}",
            seen.from[0], seen.to[0], seen.from[1], seen.to[1]
        ),
    }
}

fn table(camera: &StereoCamera, lens: &Lens, turn: &Rotation3<f64>) -> Result<Vec<Tap>, StereoError> {
    let mut table = Vec::with_capacity(camera.width as usize * camera.height as usize);
    let camera_from_rectified = turn.inverse();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let a = (f64::from(x) - camera.cx) / camera.fx;
            let b = (f64::from(y) - camera.cy) / camera.fy;
            let ray = camera_from_rectified * Vector3::new(a, b, 1.0);
            let direction = [ray.x / ray.z, ray.y / ray.z];
            if ray.z <= 0.0 || !lens.is_straight_at(direction) {
                return Err(too_little(Seen { from: direction, to: direction }));
            }
            table.push(tap(lens, lens.project(direction)));
        }
    }
    Ok(table)
}

/// Of a place in the image; one outside by a rounding error is its nearest within.
fn tap(lens: &Lens, [column, row]: [f64; 2]) -> Tap {
    let parts = f64::from(1_u32 << FRACTION);
    let within = |value: f64, side: u32| {
        let fixed = (value.clamp(0.0, f64::from(side - 1)) * parts).round() as u32;
        let whole = (fixed >> FRACTION).min(side - 2);
        (whole, (fixed - (whole << FRACTION)) as u16)
    };
    let ((x, across), (y, down)) = (within(column, lens.width), within(row, lens.height));
    Tap { at: y * lens.width + x, across, down }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pairing;
    use crate::{DisparityMap, Matcher, MatcherSettings};
    use mapwright_geom::Pose3;
    use nalgebra::UnitQuaternion;

    const SIZE: [u32; 2] = [320, 240];

    fn lens(focal: f64, distortion: [f64; 5]) -> Lens {
        let [width, height] = SIZE;
        Lens { width, height, focal_px: [focal, focal + 2.0], centre_px: [155.0, 124.0], distortion }
    }

    /// The right camera is rolled, pitched and turned, and a little above and ahead of where it should be.
    fn tilted() -> Calibration {
        let rotation = UnitQuaternion::from_euler_angles(0.02, -0.03, 0.05);
        let left_from_right = Pose3 { translation: Vector3::new(0.2, -0.01, 0.005), rotation };
        Calibration {
            left: lens(250.0, [-0.2, 0.05, 0.001, -0.0005, 0.0]),
            right: lens(255.0, [-0.22, 0.06, -0.001, 0.0005, 0.0]),
            right_from_left: left_from_right.inverse(),
        }
    }

    fn value(x: i64, y: i64) -> f64 {
        let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
        h = (h ^ h >> 29).wrapping_mul(0x7fb5_d329_728e_a185);
        (h >> 40) as f64 / 16_777_216.0
    }

    /// Values on a lattice of 3 cm, with straight lines between.
    fn texture(x_m: f64, y_m: f64) -> f64 {
        let (u, v) = (x_m / 0.03, y_m / 0.03);
        let (i, j) = (u.floor(), v.floor());
        let (a, b) = (u - i, v - j);
        let at = |di, dj| value(i as i64 + di, j as i64 + dj);
        (at(0, 0) * (1.0 - a) + at(1, 0) * a) * (1.0 - b) + (at(0, 1) * (1.0 - a) + at(1, 1) * a) * b
    }

    /// What a camera sees of a wall 3 m ahead of the left one.
    fn seen(lens: &Lens, camera_from_left: Pose3) -> GreyImage {
        let left_from_camera = camera_from_left.inverse();
        let pixels = (0..SIZE[0] * SIZE[1]).map(|at| {
            let [a, b] = lens.direction([f64::from(at % SIZE[0]), f64::from(at / SIZE[0])]).unwrap();
            let (from, to) = (left_from_camera.translation, left_from_camera.transform(Vector3::new(a, b, 1.0)));
            let at = from + (to - from) * ((3.0 - from.z) / (to.z - from.z));
            (10_000.0 + 40_000.0 * texture(at.x, at.y)) as u16
        });
        GreyImage::new(SIZE[0], SIZE[1], pixels.collect()).unwrap()
    }

    #[test]
    fn rows_of_a_tilted_pair_are_aligned() {
        let calibration = tilted();
        let images =
            [seen(&calibration.left, Pose3::identity()), seen(&calibration.right, calibration.right_from_left)];
        assert!(Pairing::of(&images[0], &images[1], 0.0).unwrap().is_misaligned());
        let rectifier = Rectifier::new(&calibration).unwrap();
        let mut rectified = [GreyImage::default(), GreyImage::default()];
        rectifier.rectify(&images[0], Side::Left, &mut rectified[0]).unwrap();
        rectifier.rectify(&images[1], Side::Right, &mut rectified[1]).unwrap();
        let [left, right] = &rectified;
        let pairing = Pairing::of(left, right, 0.0).unwrap();
        assert!(pairing.matched > 100 && pairing.words().is_empty(), "{pairing:?} {:?}", pairing.words());
        assert!(pairing.lower_px.abs() < 0.05 && pairing.lower_spread_px < 0.1, "{pairing:?}");

        let settings = MatcherSettings { disparities: Some(40), ..MatcherSettings::default() };
        let mut map = DisparityMap::default();
        Matcher::new(settings).unwrap().match_pair(left, right, &mut map).unwrap();
        let left_from_rectified = rectifier.rectified_from_left().inverse();
        let mut count = 0.0;
        let (mut sum, mut squares) = (0.0, 0.0);
        for point in map.points(&rectifier.camera()) {
            let z = (left_from_rectified * Vector3::from(point.point_m.map(f64::from))).z;
            let normalised = (z - 3.0) / f64::from(point.sigma_m);
            (count, sum, squares) = (count + 1.0, sum + (z - 3.0), squares + normalised.powi(2));
        }
        assert!(count > 0.8 * f64::from(SIZE[0] * SIZE[1]), "{count}");
        assert!((sum / count).abs() < 0.01 && f64::sqrt(squares / count) < 1.0, "{} {}", sum / count, squares / count);
    }

    #[test]
    fn a_rectified_pair_stays_as_it_is() {
        let straight = lens(250.0, [0.0; 5]);
        let straight = Lens { focal_px: [250.0; 2], centre_px: [159.5, 119.5], ..straight };
        let mut right_from_left = Pose3::identity();
        right_from_left.translation.x = -0.2;
        let rectifier = Rectifier::new(&Calibration { left: straight, right: straight, right_from_left }).unwrap();
        let camera = rectifier.camera();
        assert!((camera.fx - 250.0).abs() < 1e-9 && (camera.cx - 159.5).abs() < 1e-9, "{camera:?}");
        assert!(
            (camera.baseline_m - 0.2).abs() < 1e-12 && camera.depth_m(10.0).is_some_and(|z| (z - 5.0).abs() < 1e-9)
        );
        let image = seen(&straight, Pose3::identity());
        let mut rectified = GreyImage::default();
        rectifier.rectify(&image, Side::Left, &mut rectified).unwrap();
        assert_eq!(image, rectified);
    }

    #[test]
    fn numbers_that_are_none_of_a_pair() {
        let told = |change: &dyn Fn(&mut Calibration)| {
            let mut calibration = tilted();
            change(&mut calibration);
            Rectifier::new(&calibration).unwrap_err().to_string()
        };
        let swap = |c: &mut Calibration| {
            c.right_from_left = c.right_from_left.inverse();
        };
        assert!(told(&swap).contains("are left and right swapped?"));
        assert_eq!(
            told(&|c| c.left.focal_px[1] = 0.0),
            "focal length fy of the left camera: expected a finite number of pixels above zero, found 0"
        );
        assert!(told(&|c| c.right.distortion[2] = f64::NAN).starts_with("p1 of the right camera"));
        assert!(told(&|c| c.right.centre_px[0] = 1000.0).contains("a place within the image"));
        assert!(told(&|c| c.left.distortion[0] = -3.0).contains("holds up to the image's edges"));
        assert!(told(&|c| c.right.width = 321).contains("expected 320 x 240 pixels, found 321 x 240"));
        assert!(told(&|c| c.left.width = 1).contains("width of the left camera"));
        assert!(told(&|c| c.right_from_left.translation.x = f64::NAN).contains("a finite place"));
        assert!(told(&|c| c.right_from_left.translation *= 0.0).contains("a finite place"));
        assert!(told(&|c| c.right_from_left.translation *= 5000.0).contains("below 100 m"));
        assert!(told(&|c| c.right_from_left.translation = Vector3::new(0.0, -1.0, 0.0)).contains("above, below"));
        let back = |c: &mut Calibration| {
            let turn = UnitQuaternion::from_euler_angles(0.0, 3.0, 0.0);
            c.right_from_left.translation = turn * Vector3::new(-0.2, 0.0, 0.0);
            c.right_from_left.rotation = turn;
        };
        assert!(told(&back).contains("look the same way"), "{}", told(&back));
        let rectifier = Rectifier::new(&tilted()).unwrap();
        let image = GreyImage::new(20, 10, vec![0; 200]).unwrap();
        let error = rectifier.rectify(&image, Side::Right, &mut GreyImage::default()).unwrap_err().to_string();
        assert_eq!(error, "right image: expected 320 x 240 pixels, found 20 x 10");
    }
}
