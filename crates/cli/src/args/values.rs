//! What the values of arguments may be.

use mapwright::Pose2;
use mapwright_eval::Delta;
use mapwright_logs::{MountChoice, SliceBounds};
use mapwright_sim::Gap;
use nalgebra::UnitQuaternion;

/// Larger angles are not of radians.
const ANGLE_MOST_RAD: f64 = 10.0;

pub(super) fn parse_assignment(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected KEY=VALUE, such as map.resolution_m=0.1")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

pub(super) fn parse_pose(text: &str) -> Result<Pose2, String> {
    let numbers: Vec<f64> = text.split(',').map_while(|field| field.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, yaw] if [x, y, yaw].iter().all(|v| v.abs() <= 1e5) => Ok(Pose2::new(x, y, yaw)),
        _ => Err("expected three numbers within 100 km, such as 1.5,-2,0.1".to_owned()),
    }
}

pub(super) fn parse_mount(text: &str) -> Result<MountChoice, String> {
    let (place, inverted) = match text.rsplit_once(',') {
        Some((place, last)) if last.trim() == "flipped" => (place, true),
        _ => (text, false),
    };
    let numbers: Vec<Option<f64>> = place.split(',').map(|field| field.trim().parse().ok()).collect();
    match numbers[..] {
        [Some(x), Some(y), Some(yaw)] if x.abs() <= 100.0 && y.abs() <= 100.0 && yaw.abs() <= ANGLE_MOST_RAD => {
            Ok(MountChoice { robot_from_laser: Pose2::new(x, y, yaw), inverted })
        }
        _ => Err("expected metres, metres and radians, such as 0.2,0,3.14 or 0.2,0,3.14,flipped".to_owned()),
    }
}

pub(super) fn parse_imu_mount(text: &str) -> Result<UnitQuaternion<f64>, String> {
    let numbers: Vec<Option<f64>> = text.split(',').map(|field| field.trim().parse().ok()).collect();
    match numbers[..] {
        [Some(roll), Some(pitch), Some(yaw)]
            if [roll, pitch, yaw].iter().all(|rad: &f64| rad.abs() <= ANGLE_MOST_RAD) =>
        {
            Ok(UnitQuaternion::from_euler_angles(roll, pitch, yaw))
        }
        _ => {
            Err("expected roll, pitch and yaw in radians, such as 3.1416,0,0 of a sensor that hangs upside down"
                .to_owned())
        }
    }
}

pub(super) fn parse_intrinsics(text: &str) -> Result<[f64; 4], String> {
    let numbers: Vec<f64> = text.split(',').map_while(|field| field.trim().parse().ok()).collect();
    <[f64; 4]>::try_from(numbers).map_err(|_| "expected four numbers, pixels, such as 525,525,319.5,239.5".to_owned())
}

pub(super) fn parse_slice(text: &str) -> Result<SliceBounds, String> {
    let bounds = text.split_once(':').and_then(|(low, high)| {
        Some(SliceBounds { z_min_m: low.trim().parse().ok()?, z_max_m: high.trim().parse().ok()? })
    });
    let is_usable = |bounds: &SliceBounds| bounds.z_min_m < bounds.z_max_m && bounds.z_max_m - bounds.z_min_m <= 1e4;
    bounds
        .filter(is_usable)
        .ok_or_else(|| "expected two heights in metres, the lower first, such as 0.1:1.0".to_owned())
}

pub(super) fn parse_range_unit(text: &str) -> Result<f64, String> {
    within(text, 1e-6..=100.0, "metres from 0.000001 to 100, such as 0.001 for millimetres")
}

pub(super) fn parse_baseline(text: &str) -> Result<f64, String> {
    within(text, 1e-3..=100.0, "metres from 0.001 to 100, such as 0.12")
}

pub(super) fn parse_gap(text: &str) -> Result<Gap, String> {
    let numbers = text
        .split_once(':')
        .and_then(|(begins_at, lasts_s)| Some((begins_at.trim().parse().ok()?, lasts_s.trim().parse().ok()?)));
    let (begins_at, lasts_s) = numbers.ok_or("expected a share of the log's time and seconds, such as 0.25:30")?;
    Gap::new(begins_at, lasts_s).map_err(|error| error.to_string())
}

pub(super) fn parse_gap_seconds(text: &str) -> Result<f64, String> {
    within(text, 0.1..=10_000.0, "seconds from 0.1 to 10000")
}

pub(super) fn parse_error(text: &str) -> Result<f64, String> {
    within(text, 0.001..=100.0, "an error from 0.001 to 100 m")
}

pub(super) fn parse_delta(text: &str) -> Result<Delta, String> {
    let wrong = || "expected frames or metres, such as 1f or 5m".to_owned();
    if let Some(frames) = text.strip_suffix('f') {
        return frames.parse().map(Delta::Frames).map_err(|_| wrong());
    }
    let metres = text.strip_suffix('m').ok_or_else(wrong)?;
    metres.parse().map(Delta::Metres).map_err(|_| wrong())
}

pub(super) fn parse_share(text: &str) -> Result<f64, String> {
    within(text, 0.0..=1.0, "a share from 0 to 1")
}

pub(super) fn parse_factor(text: &str) -> Result<f64, String> {
    within(text, 0.01..=100.0, "a factor from 0.01 to 100")
}

pub(super) fn parse_radius(text: &str) -> Result<f64, String> {
    within(text, 0.05..=5.0, "a radius from 0.05 to 5 m")
}

fn within(text: &str, range: std::ops::RangeInclusive<f64>, expected: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v| range.contains(v)).ok_or_else(|| format!("expected {expected}"))
}

pub(super) fn parse_side(text: &str) -> Result<f64, String> {
    within(text, 0.005..=10.0, "a length from 0.005 to 10 m")
}

pub(super) fn parse_drive(text: &str) -> Result<f64, String> {
    within(text, 100.0..=5000.0, "a length from 100 to 5000 m")
}

pub(super) fn parse_seconds(text: &str) -> Result<f64, String> {
    within(text, 1.0..=100_000.0, "seconds from 1 to 100000")
}

pub(super) fn parse_length(text: &str) -> Result<f64, String> {
    within(text, 50.0..=2000.0, "a length from 50 to 2000 m")
}

pub(super) fn parse_reach(text: &str) -> Result<f64, String> {
    within(text, 0.1..=1000.0, "a distance from 0.1 to 1000 m")
}

pub(super) fn parse_positive(text: &str) -> Result<f64, String> {
    within(text, 1e-6..=1e6, "a number from 0.000001 to 1000000")
}
