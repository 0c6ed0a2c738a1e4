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
