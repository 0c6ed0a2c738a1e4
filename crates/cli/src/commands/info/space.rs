//! What is in a recording of a sensor in space: all that is known without its clouds, and the first few of them.

use crate::args::SourceArgs;
use crate::failure::Failure;
use crate::space::{notes_in_words, notes_json};
use crate::terminal::{count, duration, grouped};
use mapwright::{Cloud, Stamp};
use mapwright_clouds::{Recording, Reference};
use mapwright_sensor::{PinholeCamera, SpaceSensor};
use serde_json::{Value, json};
use std::fmt::Write;

/// Clouds that are read; a long recording has gigabytes of them.
const CLOUDS_READ: usize = 3;

/// Words, the same as JSON, and what was lost.
pub(super) fn look(
    name: &str,
    recording: &Recording<'_>,
    source: &SourceArgs,
) -> Result<(String, Value, Vec<String>), Failure> {
    let failed = |cause| Failure::Log(format!("{name}: {cause}"));
    let options = source.camera();
    let camera = recording.camera(&options).map_err(failed)?;
    let mut clouds = recording.clouds(&options).map_err(failed)?;
    let mut first = Vec::new();
    while first.len() < CLOUDS_READ
        && let Some(cloud) = clouds.next_cloud().map_err(failed)?
    {
        first.push(FirstCloud::of(&cloud, clouds.sensor()));
    }
    let mut notes = recording.notes().clone();
    notes.extend(clouds.notes());
    let span = Span::of(recording, &first);
    let (losses, mut odd) = notes_in_words(&notes);
    odd.extend(clouds.odd().iter().chain(clouds.doubts()).cloned());
    let mut words = format!(
        "{name}: {}, {}, {}\n{}",
        recording.kind(),
        count(recording.frames() as u64, "frame"),
        span.words(),
        sensor_words(clouds.sensor())
    );
    words += &camera.as_ref().map_or_else(String::new, |camera| camera_words(camera));
    words += &first_words(&first, recording.frames());
    recording.references().iter().for_each(|reference| words += &reference_words(reference));
    clouds.decisions().iter().for_each(|decision| words += &format!("decided  {decision}\n"));
    words += &crate::report::remarks(&losses, &odd);
    let value = json!({
        "log": name,
        "kind": recording.kind().to_string(),
        "frames": recording.frames(),
        "first_stamp_s": span.first.map(Stamp::as_secs_f64),
        "span_s": span.seconds,
        "span_is_estimated": span.is_estimated,
        "sensor": sensor_json(clouds.sensor()),
        "camera": camera.as_ref().map(|camera| camera_json(camera)),
        "first_clouds": first.iter().map(FirstCloud::to_json).collect::<Vec<_>>(),
        "references": recording.references().iter().map(reference_json).collect::<Vec<_>>(),
        "decisions": clouds.decisions(),
        "notes": notes_json(&notes),
        "odd": odd,
        "losses": losses,
    });
    Ok((words, value, losses))
}

/// A cloud that was read.
struct FirstCloud {
    stamp: Stamp,
    points: usize,
    returns: usize,
    nearest_m: f64,
    farthest_m: f64,
    has_times: bool,
    has_colours: bool,
    has_intensities: bool,
}

impl FirstCloud {
    fn of(cloud: &Cloud, sensor: &SpaceSensor) -> Self {
        let range = |point: &[f32; 3]| point.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt();
        let is_return = |range: &f64| (sensor.range_min_m..sensor.range_max_m).contains(range);
        let ranges: Vec<f64> = cloud.points_m.iter().map(range).filter(is_return).collect();
        Self {
            stamp: cloud.stamp,
            points: cloud.points_m.len(),
            returns: ranges.len(),
            nearest_m: ranges.iter().copied().fold(f64::INFINITY, f64::min),
            farthest_m: ranges.iter().copied().fold(0.0, f64::max),
            has_times: !cloud.times_s.is_empty(),
            has_colours: !cloud.colours.is_empty(),
            has_intensities: !cloud.intensities.is_empty(),
        }
    }

    fn to_json(&self) -> Value {
        json!({
            "stamp_s": self.stamp.as_secs_f64(),
            "points": self.points,
            "returns": self.returns,
            "nearest_m": (self.returns > 0).then_some(self.nearest_m),
            "farthest_m": (self.returns > 0).then_some(self.farthest_m),
            "point_times": self.has_times,
            "colours": self.has_colours,
            "intensities": self.has_intensities,
        })
    }
}

/// How long the recording is.
struct Span {
    first: Option<Stamp>,
    seconds: Option<f64>,
    /// Whether it follows from the first clouds and their number, because only the clouds have stamps.
    is_estimated: bool,
}

impl Span {
    fn of(recording: &Recording<'_>, clouds: &[FirstCloud]) -> Self {
        if let Some([first, last]) = recording.stamps() {
            return Self { first: Some(first), seconds: Some(last.secs_since(first)), is_estimated: false };
        }
        let first = clouds.first().map(|cloud| cloud.stamp);
        let step = match clouds {
            [first, .., last] => Some(last.stamp.secs_since(first.stamp) / (clouds.len() - 1) as f64),
            _ => None,
        };
        let seconds = step.map(|step| step * recording.frames().saturating_sub(1) as f64);
        Self { first, seconds, is_estimated: true }
    }

    fn words(&self) -> String {
        match self.seconds {
            Some(seconds) if self.is_estimated => format!("about {} by the first clouds", duration(seconds)),
            Some(seconds) => format!("{} by their stamps", duration(seconds)),
            None => "of unknown duration".to_owned(),
        }
    }
}

fn sensor_words(sensor: &SpaceSensor) -> String {
    let at = sensor.robot_from_sensor.translation;
    let (roll, pitch, yaw) = sensor.robot_from_sensor.rotation.euler_angles();
    let degrees = [roll, pitch, yaw].map(|angle| format!("{:.1}", angle.to_degrees() + 0.0));
    format!(
        "sensor   {}: {} to {} m; on the robot at x {:.3} m, y {:.3} m, z {:.3} m; roll, pitch, yaw {} deg\n",
        sensor.name,
        sensor.range_min_m,
        sensor.range_max_m,
        at.x,
        at.y,
        at.z,
        degrees.join(" ")
    )
}

fn sensor_json(sensor: &SpaceSensor) -> Value {
    json!({
        "name": sensor.name,
        "range_min_m": sensor.range_min_m,
        "range_max_m": sensor.range_max_m,
        "range_sigma_m": sensor.range_sigma_m,
        "range_sigma_per_m": sensor.range_sigma_per_m,
        "robot_from_sensor": {
            "position_m": sensor.robot_from_sensor.translation.as_slice(),
            "quaternion_xyzw": sensor.robot_from_sensor.rotation.coords.as_slice(),
        },
    })
}

fn camera_words(camera: &PinholeCamera) -> String {
    let PinholeCamera { width, height, focal_px: [fx, fy], centre_px: [cx, cy], distortion } = camera;
    let bent = if distortion.iter().all(|&k| k == 0.0) { "rectified" } else { "distorted" };
    format!("camera   {width} x {height} pixels, focal lengths {fx} {fy}, axis at {cx} {cy}, {bent}\n")
}

fn camera_json(camera: &PinholeCamera) -> Value {
    json!({
        "width": camera.width,
        "height": camera.height,
        "focal_px": camera.focal_px,
        "centre_px": camera.centre_px,
        "distortion": camera.distortion,
    })
}

fn first_words(first: &[FirstCloud], frames: usize) -> String {
    let mut text = String::new();
    for (number, cloud) in first.iter().enumerate() {
        let _ = write!(
            text,
            "cloud {:<2} at {:.6} s: {}, {} in range",
            number + 1,
            cloud.stamp.as_secs_f64(),
            count(cloud.points as u64, "point"),
            grouped(cloud.returns as u64)
        );
        if cloud.returns > 0 {
            let _ = write!(text, ", {:.2} to {:.1} m away", cloud.nearest_m, cloud.farthest_m);
        }
        text += if cloud.has_times { ", with times" } else { "" };
        text += if cloud.has_intensities { ", with intensities" } else { "" };
        text += if cloud.has_colours { ", in colour\n" } else { "\n" };
    }
    if frames > first.len() {
        let _ = writeln!(text, "         the other {} were not read", grouped((frames - first.len()) as u64));
    }
    text
}

fn reference_words(reference: &Reference) -> String {
    format!(
        "poses    {}: {}, of {}; {:.1} m of way\n",
        reference.file,
        count(reference.poses.len() as u64, "pose"),
        reference.frame,
        way_m(reference)
    )
}

fn reference_json(reference: &Reference) -> Value {
    json!({
        "file": reference.file,
        "poses": reference.poses.len(),
        "of": reference.frame.to_string(),
        "path_m": way_m(reference),
    })
}

fn way_m(reference: &Reference) -> f64 {
    reference.poses.windows(2).map(|w| w[0].1.distance(w[1].1)).sum()
}
