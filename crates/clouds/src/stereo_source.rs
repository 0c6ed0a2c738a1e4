//! Clouds of a folder's pairs of images.

use crate::camera::{BASELINE_KEY, CameraOptions, INTRINSICS_KEY, PAIR_KEY};
use crate::distances::RANGE_UNIT_KEY;
use crate::error::CloudError;
use crate::folder::{Folder, read};
use crate::image::{CameraImage, read_camera_image};
use crate::plan::{Frame, StereoPlan};
use crate::stereo::{StereoDepth, StereoPairPlan, is_turned_words};
use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud, ImuReading, PinholeCamera, SpaceSensor};
use mapwright_stereo::{StereoCamera, StereoError};
use std::collections::VecDeque;
use std::sync::Arc;

/// So many pairs are asked whether they are pairs: the first may show a blank wall.
const LOOKED_AT: usize = 3;
/// No image has more pixels; bounds the memory that one file may take.
const PIXELS_MOST: u64 = 1 << 26;

/// What makes clouds of pairs.
pub(crate) struct StereoSource {
    depth: StereoDepth,
    size: [u32; 2],
    /// Those that were not asked for yet.
    readings: VecDeque<ImuReading>,
}

impl StereoSource {
    /// By what the folder says, or by what the caller does, which counts more.
    pub(crate) fn new(plan: &StereoPlan, options: &CameraOptions) -> Result<Self, CloudError> {
        options.check_scale()?;
        for (is_there, key) in
            [(options.range_unit_m.is_some(), RANGE_UNIT_KEY), (options.depth_scale.is_some(), crate::DEPTH_SCALE_KEY)]
        {
            if is_there {
                let reason =
                    format!("found images of two cameras, whose unit is that of their baseline: {BASELINE_KEY}");
                return Err(CloudError::Options { key, reason });
            }
        }
        let pair = pair_of(plan, options)?;
        let depth = StereoDepth::new(&pair, plan.disparities).map_err(|cause| refused(plan, options, &cause))?;
        Ok(Self { depth, size: plan.size, readings: plan.readings.iter().copied().collect() })
    }

    /// Inertial readings up to the last pair, or all that are left at the end.
    pub(crate) fn readings_until(&mut self, last: Option<Stamp>, is_end: bool) -> Vec<ImuReading> {
        let due = self.readings.partition_point(|reading| is_end || last.is_some_and(|last| reading.stamp <= last));
        self.readings.drain(..due).collect()
    }

    /// The left camera as it is seen by after rectification.
    pub(crate) fn pinhole(&self) -> PinholeCamera {
        let StereoCamera { width, height, fx, fy, cx, cy, .. } = self.depth.camera();
        PinholeCamera { width, height, focal_px: [fx, fy], centre_px: [cx, cy], distortion: [0.0; 5] }
    }

    /// The sensor, where the folder says how it sits.
    pub(crate) fn sensor(&self, placed: &SpaceSensor) -> SpaceSensor {
        let made = self.depth.sensor(&placed.name);
        SpaceSensor { robot_from_sensor: placed.robot_from_sensor, ..made }
    }

    /// What is used of what is known of the cameras, in words.
    pub(crate) fn decisions(&self, plan: &StereoPlan, options: &CameraOptions) -> [String; 2] {
        let asked = options.intrinsics.is_some() || options.baseline_m.is_some();
        let whose = if asked { "the pair is as asked for".to_owned() } else { plan.pair_words.clone() };
        [whose, self.depth.words()]
    }

    /// Whether the first pairs are pairs: what casts doubt on that, in words.
    ///
    /// # Errors
    /// [`CloudError::Pair`] where left and right are swapped.
    pub(crate) fn judge_pairs(&mut self, folder: &dyn Folder, frames: &[Frame]) -> Result<Vec<String>, CloudError> {
        let mut found = Vec::new();
        for frame in frames.iter().take(LOOKED_AT) {
            let Ok([left, right]) = self.images(folder, frame) else { continue };
            if let Ok(pairing) = self.depth.pairing(&left.grey, &right.grey) {
                found.push((frame, pairing));
            }
        }
        let swapped = found.iter().filter(|(_, pairing)| pairing.is_swapped()).count();
        let most = |count: usize| count > 0 && 2 * count >= found.len();
        if let Some((frame, pairing)) = found.iter().find(|(_, pairing)| pairing.is_swapped()).filter(|_| most(swapped))
        {
            let reason = format!("{}: exchange their names or folders", pairing.words().join("; "));
            let right = frame.right.clone().unwrap_or_default();
            return Err(CloudError::Pair { left: frame.file.clone(), right, reason });
        }
        let odd = || found.iter().filter(|(_, pairing)| !pairing.words().is_empty());
        let first = odd().next().filter(|_| most(odd().count()));
        let words = first.map(|(frame, pairing)| is_turned_words(&frame.file, pairing));
        Ok(words.into_iter().collect())
    }

    /// The cloud of a pair.
    pub(crate) fn cloud(
        &mut self,
        folder: &dyn Folder,
        frame: &Frame,
        sensor: &Arc<SpaceSensor>,
    ) -> Result<Cloud, CloudError> {
        let [left, right] = self.images(folder, frame)?;
        let stamp = frame.stamp.unwrap_or(Stamp(0));
        let cloud = self.depth.cloud((&left.grey, &right.grey), (stamp, sensor), left.colours);
        cloud.map_err(|cause| CloudError::content(&frame.file, 0, "a pair of images", cause.to_string()))
    }

    fn images(&self, folder: &dyn Folder, frame: &Frame) -> Result<[CameraImage; 2], CloudError> {
        let image = |file: &str| read_camera_image(file, &read(folder, file)?, Some(self.size), PIXELS_MOST);
        let right = frame
            .right
            .as_deref()
            .ok_or_else(|| CloudError::content(&frame.file, 0, "an image of the right camera with it", "none"))?;
        Ok([image(&frame.file)?, image(right)?])
    }
}

/// The pair of cameras: what the caller says of it replaces what the folder does.
fn pair_of(plan: &StereoPlan, options: &CameraOptions) -> Result<StereoPairPlan, CloudError> {
    if options.intrinsics.is_none() && options.baseline_m.is_none() {
        return plan.pair.clone().ok_or_else(|| CloudError::Missing {
            what: format!("what the two cameras are ({})", plan.pair_words),
            key: PAIR_KEY,
        });
    }
    let known = match &plan.pair {
        Some(StereoPairPlan::Rectified(camera)) => Some(*camera),
        _ => None,
    };
    let missing = |what: &str, key| CloudError::Missing { what: what.to_owned(), key };
    let intrinsics = options.intrinsics.map(|[fx, fy, cx, cy]| (fx, fy, cx, cx, cy));
    let intrinsics = intrinsics.or(known.map(|camera| (camera.fx, camera.fy, camera.cx, camera.cx_right, camera.cy)));
    let baseline_m = options.baseline_m.or(known.map(|camera| camera.baseline_m));
    let (fx, fy, cx, cx_right, cy) =
        intrinsics.ok_or_else(|| missing("the focal lengths and centre of rectified images", INTRINSICS_KEY))?;
    let baseline_m =
        baseline_m.ok_or_else(|| missing("how far the right camera is from the left one", BASELINE_KEY))?;
    let [width, height] = plan.size;
    Ok(StereoPairPlan::Rectified(StereoCamera { width, height, fx, fy, cx, cx_right, cy, baseline_m }))
}

fn refused(plan: &StereoPlan, options: &CameraOptions, cause: &StereoError) -> CloudError {
    let asked = options.intrinsics.is_some() || options.baseline_m.is_some();
    let whose = if asked { String::new() } else { format!(" ({})", plan.pair_words) };
    CloudError::Options { key: PAIR_KEY, reason: format!("{cause}{whose}") }
}
