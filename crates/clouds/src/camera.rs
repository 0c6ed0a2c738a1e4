//! What is known of a depth camera.

use crate::distances::RANGE_UNIT_KEY;
use crate::error::CloudError;
use crate::notes::{NoteKind, Notes};
use crate::plan::DepthPlan;
use crate::text::{excerpt, rows};
use mapwright_sensor::PinholeCamera;
use std::sync::Arc;

/// What the command line calls [`CameraOptions::intrinsics`].
pub const INTRINSICS_KEY: &str = "--intrinsics FX,FY,CX,CY";
/// What the command line calls [`CameraOptions::baseline_m`].
pub const BASELINE_KEY: &str = "--baseline M";
/// Both of a pair.
pub(crate) const PAIR_KEY: &str = "--intrinsics FX,FY,CX,CY --baseline M";
/// What the command line calls [`CameraOptions::depth_scale`].
pub const DEPTH_SCALE_KEY: &str = "--depth-scale S";

/// What the caller knows of a depth camera, or of clouds; it counts more than what the folder says.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraOptions {
    /// Focal lengths and the optical axis, `fx fy cx cy`, pixels.
    pub intrinsics: Option<[f64; 4]>,
    /// The number that stands for a metre in images of depth.
    pub depth_scale: Option<f64>,
    /// What one stands for in the coordinates of a folder's clouds, metres.
    pub range_unit_m: Option<f64>,
    /// From the left camera of a pair to the right one, metres.
    pub baseline_m: Option<f64>,
}

impl CameraOptions {
    /// Whether the number that stands for a metre can be one.
    ///
    /// # Errors
    /// [`CloudError::Options`].
    pub fn check_scale(&self) -> Result<(), CloudError> {
        let numbers =
            [(self.depth_scale, DEPTH_SCALE_KEY), (self.range_unit_m, RANGE_UNIT_KEY), (self.baseline_m, BASELINE_KEY)];
        for (number, key) in numbers {
            if let Some(found) = number.filter(|number| !(number.is_finite() && *number > 0.0)) {
                let reason = format!("expected a finite number above zero, found {found}");
                return Err(CloudError::Options { key, reason });
            }
        }
        Ok(())
    }
}

/// What speaks against a camera, with what to type: its axis lies at the edge of the image.
#[must_use]
pub fn off_axis_words(camera: &PinholeCamera) -> Option<String> {
    let (words, likely) = camera.off_axis().filter(|_| camera.width > 0 && camera.height > 0)?;
    Some(match likely {
        Some(PinholeCamera { focal_px: [fx, fy], centre_px: [cx, cy], .. }) => format!(
            "{words}: are the camera's numbers those of another size? At this one they are `--intrinsics {},{},{},{}`",
            short(fx),
            short(fy),
            short(cx),
            short(cy)
        ),
        None => format!("{words}: is it this camera? `{INTRINSICS_KEY}` says what it is"),
    })
}

/// A number of pixels with at most three digits behind the point.
fn short(pixels: f64) -> f64 {
    (1e3 * pixels).round() / 1e3
}

/// The camera, and what a metre is in its images; the notes say what is wrong with files that should have said it.
pub(crate) fn camera(
    plan: &DepthPlan,
    options: &CameraOptions,
    notes: &Notes,
) -> Result<(Arc<PinholeCamera>, f64), CloudError> {
    let Some([fx, fy, cx, cy]) = options.intrinsics.or(plan.intrinsics) else {
        return Err(missing(plan, notes));
    };
    let [width, height] = plan.size;
    let camera = PinholeCamera { width, height, focal_px: [fx, fy], centre_px: [cx, cy], distortion: [0.0; 5] };
    let hint = if fy < 0.0 { "; ICL-NUIM writes fy with a minus: leave it out" } else { "" };
    let refused = |reason: &str| CloudError::Options { key: INTRINSICS_KEY, reason: format!("{reason}{hint}") };
    camera.check().map_err(refused)?;
    if options.range_unit_m.is_some() {
        let reason =
            "is for clouds and scans, found images of depth: --depth-scale says which number stands for a metre";
        return Err(CloudError::Options { key: RANGE_UNIT_KEY, reason: reason.to_owned() });
    }
    options.check_scale()?;
    Ok((Arc::new(camera), options.depth_scale.unwrap_or(plan.depth_per_m)))
}

/// What is used of what is known of a camera: decisions, and what casts doubt on them.
pub(crate) fn words(plan: &DepthPlan, options: &CameraOptions, camera: &PinholeCamera) -> (Vec<String>, Vec<String>) {
    let (mut decisions, mut doubts) = (Vec::new(), Vec::new());
    match (options.intrinsics, &plan.camera_words) {
        (Some([fx, fy, cx, cy]), _) => decisions.push(format!("the camera is {fx},{fy},{cx},{cy}, as asked for")),
        (None, Ok(words)) => decisions.push(words.clone()),
        (None, Err(doubt)) => doubts.push(doubt.clone()),
    }
    doubts.extend(off_axis_words(camera));
    decisions.push(match options.depth_scale {
        Some(scale) => format!("{scale} is a metre of depth, as asked for"),
        None => format!("{} is a metre of depth, {}", plan.depth_per_m, plan.scale_words),
    });
    (decisions, doubts)
}

fn missing(plan: &DepthPlan, notes: &Notes) -> CloudError {
    let noted = notes.kinds.get(&NoteKind::FileNotUsed).into_iter().flat_map(|noted| &noted.first);
    let unused: Vec<String> =
        noted.filter(|note| plan.calibrations.contains(&note.file)).map(ToString::to_string).collect();
    let why = if unused.is_empty() { String::new() } else { format!(" ({})", unused.join("; ")) };
    CloudError::Missing { what: format!("the camera's focal lengths and centre{why}"), key: INTRINSICS_KEY }
}

/// Intrinsics as a matrix of 3 x 3, as 7-Scenes' users write them.
pub(crate) fn of_matrix(file: &str, bytes: &[u8], notes: &mut Notes) -> Option<[f64; 4]> {
    let matrix: Option<Vec<f64>> =
        rows(bytes).take(4).map(|row| row.numbers()).collect::<Option<Vec<_>>>().map(|m| m.concat());
    let found = match matrix.as_deref() {
        Some(&[fx, _, cx, _, fy, cy, _, _, 1.0]) => sensible([fx, fy, cx, cy]),
        _ => None,
    };
    note_none(found, file, "a camera's matrix of 3 x 3", bytes, notes)
}

/// Open3D's JSON: the matrix column by column. Beside it a scale of depth, if there is one.
pub(crate) fn of_json(file: &str, bytes: &[u8], size: [u32; 2], notes: &mut Notes) -> Option<([f64; 4], Option<f64>)> {
    let json: Option<serde_json::Value> = serde_json::from_slice(bytes).ok();
    let found = json.as_ref().ok_or_else(|| excerpt(bytes)).and_then(|json| intrinsics_of_json(json, size));
    let scale = json.as_ref().and_then(|json| json.get("depth_scale")?.as_f64());
    match found {
        Ok(found) => Some((found, scale.filter(|s| s.is_finite() && *s > 0.0))),
        Err(found) => {
            let expected = || format!("an intrinsic_matrix of a camera of {} x {}", size[0], size[1]);
            notes.note(NoteKind::FileNotUsed, file, 0, || (expected(), found));
            None
        }
    }
}

/// Those of a camera of that size; otherwise what was found.
fn intrinsics_of_json(json: &serde_json::Value, size: [u32; 2]) -> Result<[f64; 4], String> {
    for (key, side) in [("width", size[0]), ("height", size[1])] {
        if let Some(found) = json.get(key).filter(|found| found.as_u64() != Some(u64::from(side))) {
            return Err(format!("{key} {}", excerpt(found.to_string().as_bytes())));
        }
    }
    let matrix = json.get("intrinsic_matrix").ok_or("no intrinsic_matrix")?;
    let numbers: Option<Vec<f64>> =
        matrix.as_array().and_then(|entries| entries.iter().map(serde_json::Value::as_f64).collect());
    match numbers.as_deref() {
        Some(&[fx, _, _, _, fy, _, cx, cy, _]) => sensible([fx, fy, cx, cy]),
        _ => None,
    }
    .ok_or_else(|| format!("intrinsic_matrix {}", excerpt(matrix.to_string().as_bytes())))
}

fn sensible(all: [f64; 4]) -> Option<[f64; 4]> {
    (all.iter().all(|v| v.is_finite()) && all[0] > 0.0 && all[1] > 0.0).then_some(all)
}

fn note_none<T>(found: Option<T>, file: &str, expected: &str, bytes: &[u8], notes: &mut Notes) -> Option<T> {
    if found.is_none() {
        notes.note(NoteKind::FileNotUsed, file, 0, || (expected, excerpt(bytes)));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_missing_is_named() {
        let calibrations = vec!["c.json".to_owned()];
        let plan = DepthPlan {
            size: [4, 3],
            intrinsics: None,
            camera_words: Ok(String::new()),
            depth_per_m: 1000.0,
            scale_words: "",
            calibrations,
        };
        let told = |notes: &Notes| camera(&plan, &CameraOptions::default(), notes).unwrap_err().to_string();
        let expected = "the folder does not say the camera's focal lengths and centre: give --intrinsics FX,FY,CX,CY";
        let mut notes = Notes::default();
        notes.note(NoteKind::FileNotUsed, "trajectory.log", 0, || ("poses", "none"));
        assert_eq!(told(&notes), expected);
        for (json, found) in [
            ("{}", "no intrinsic_matrix"),
            ("{", "`{`"),
            (r#"{"width":640,"height":480}"#, "width `640`"),
            (r#"{"intrinsic_matrix":[1,2]}"#, "intrinsic_matrix `[1,2]`"),
            (r#"{"intrinsic_matrix":[0,0,0,0,6,0,2,3,1]}"#, "intrinsic_matrix `[0,0,0,0,6,0,2,3,1]`"),
        ] {
            let mut notes = Notes::default();
            assert_eq!(of_json("c.json", json.as_bytes(), [4, 3], &mut notes), None);
            let told = told(&notes);
            assert!(
                told.contains("(c.json, byte 0: expected an intrinsic_matrix of a camera of 4 x 3, found"),
                "{told}"
            );
            assert!(told.contains(&format!("found {found}): give --intrinsics FX,FY,CX,CY")), "{told}");
        }
        let options = CameraOptions {
            intrinsics: Some([2.0, 2.0, 1.5, 1.0]),
            depth_scale: Some(0.0),
            ..CameraOptions::default()
        };
        let error = camera(&plan, &options, &notes).unwrap_err().to_string();
        assert!(error.contains("--depth-scale"), "{error}");
        let upside = CameraOptions { intrinsics: Some([481.2, -480.0, 319.5, 239.5]), ..CameraOptions::default() };
        let error = camera(&plan, &upside, &notes).unwrap_err().to_string();
        assert!(error.contains("above zero") && error.contains("with a minus: leave it out"), "{error}");
        let options = CameraOptions { depth_scale: Some(5000.0), ..options };
        let (camera, depth_per_m) = camera(&plan, &options, &notes).unwrap();
        assert_eq!((camera.width, camera.centre_px, depth_per_m), (4, [1.5, 1.0], 5000.0));
    }

    #[test]
    fn calibrations_that_are_none_are_noted() {
        let mut notes = Notes::default();
        assert_eq!(of_matrix("c", b"5 0 2\n0 6 3\n0 0 1\n", &mut notes), Some([5.0, 6.0, 2.0, 3.0]));
        assert_eq!(of_matrix("c", b"5 0 2\n0 6 3\n", &mut notes), None);
        let json = br#"{"width":4,"height":3,"intrinsic_matrix":[5,0,0,0,6,0,2,3,1]}"#;
        assert_eq!(of_json("c", json, [4, 3], &mut notes), Some(([5.0, 6.0, 2.0, 3.0], None)));
        assert_eq!(of_json("c", json, [8, 3], &mut notes), None);
        assert_eq!(notes.count(NoteKind::FileNotUsed), 2);
    }

    proptest! {
        #[test]
        fn any_bytes(bytes: Vec<u8>) {
            let _ = of_matrix("c", &bytes, &mut Notes::default());
            let _ = of_json("c", &bytes, [4, 3], &mut Notes::default());
        }
    }
}
