//! Middlebury's sets of 2014 and later: Scharstein et al., "High-resolution stereo datasets with subpixel-accurate ground truth", GCPR 2014.

use super::{keyed, missing, numbers, side, wrong};
use crate::camera::StereoCamera;
use crate::error::StereoError;

const FILE: &str = "Middlebury's calib.txt";

/// A pair, and how far disparities go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MiddleburyPair {
    /// The pair; its baseline is in millimetres in the file.
    pub camera: StereoCamera,
    /// Disparities to look at (`ndisp`), where the file says it.
    pub disparities: Option<u32>,
}

impl MiddleburyPair {
    /// Reads a file's text.
    ///
    /// # Errors
    /// [`StereoError::File`] where a line is missing or is not what it should be, [`StereoError::Calibration`] where the numbers are
    /// none of a pair.
    pub fn parse(text: &str) -> Result<Self, StereoError> {
        let (mut left, mut right, mut parallax) = (None, None, None);
        let (mut baseline, mut width, mut height, mut disparities) = (None, None, None, None);
        for (line, key, value) in keyed(text, '=') {
            let one = || numbers::<1>(value).map(|[n]| n).ok_or_else(|| wrong(FILE, line, "a number", value));
            let whole = || side(one()?).ok_or_else(|| wrong(FILE, line, "a number of pixels", value));
            match key {
                "cam0" => left = Some(matrix(line, value)?),
                "cam1" => right = Some(matrix(line, value)?),
                "doffs" => parallax = Some(one()?),
                "baseline" => baseline = Some(one()?),
                "width" => width = Some(whole()?),
                "height" => height = Some(whole()?),
                "ndisp" => disparities = Some(whole()?),
                _ => {}
            }
        }
        let needed = |name: &str| missing(FILE, format!("a line `{name}=`"));
        let [fx, fy, cx, cy] = left.ok_or_else(|| needed("cam0"))?;
        let camera = StereoCamera {
            width: width.ok_or_else(|| needed("width"))?,
            height: height.ok_or_else(|| needed("height"))?,
            fx,
            fy,
            cx,
            cx_right: match (parallax, right) {
                (Some(parallax), _) => cx + parallax,
                (None, Some([_, _, cx_right, _])) => cx_right,
                (None, None) => return Err(needed("doffs")),
            },
            cy,
            baseline_m: 1e-3 * baseline.ok_or_else(|| needed("baseline"))?,
        };
        camera.check()?;
        Ok(Self { camera, disparities })
    }
}

/// `[fx 0 cx; 0 fy cy; 0 0 1]`, as `fx fy cx cy`.
fn matrix(line: usize, text: &str) -> Result<[f64; 4], StereoError> {
    let inner = text.strip_prefix('[').and_then(|text| text.strip_suffix(']')).map(|text| text.replace(';', " "));
    match inner.as_deref().and_then(numbers) {
        Some([fx, _, cx, _, fy, cy, _, _, _]) => Ok([fx, fy, cx, cy]),
        None => Err(wrong(FILE, line, "a matrix `[f 0 cx; 0 f cy; 0 0 1]`", text)),
    }
}

#[cfg(test)]
pub(super) const PIANO: &str = "\
cam0=[2826.171 0 1292.2; 0 2826.171 965.806; 0 0 1]
cam1=[2826.171 0 1415.97; 0 2826.171 965.806; 0 0 1]
doffs=123.77
baseline=178.089
width=2796
height=1980
ndisp=260
isint=0
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_piano() {
        let MiddleburyPair { camera, disparities } = MiddleburyPair::parse(PIANO).unwrap();
        assert_eq!(disparities, Some(260));
        assert!((camera.cx_right - 1415.97).abs() < 1e-9);
        assert!((camera.depth_m(100.0).unwrap() - 2826.171 * 0.178_089 / 223.77).abs() < 1e-9);
        let other = PIANO.replace("doffs=123.77\n", "");
        assert!((MiddleburyPair::parse(&other).unwrap().camera.cx_right - 1415.97).abs() < 1e-9);
    }

    #[test]
    fn what_is_none() {
        let told = |from: &str, to: &str| MiddleburyPair::parse(&PIANO.replace(from, to)).unwrap_err().to_string();
        assert!(told("cam0=[2826.171 0 ", "cam0=[0 0 ").contains("focal length fx"));
        assert_eq!(
            told("cam0=[2826.171", "cam0=[nan"),
            "Middlebury's calib.txt, line 1: expected a matrix `[f 0 cx; 0 f cy; 0 0 1]`, found `[nan 0 1292.2; 0 2826.171 965.806; 0 0 1]`"
        );
        assert!(told("baseline=178.089", "").contains("a line `baseline=`"));
        assert!(told("width=2796", "width=27.5").contains("line 5: expected a number of pixels, found `27.5`"));
        assert!(told("178.089", "-178").contains("swapped"));
    }
}
