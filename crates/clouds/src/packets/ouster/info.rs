//! What an Ouster sensor says of itself: the JSON that its HTTP interface, `ouster-cli` and the ROS driver write.

use mapwright_geom::{Pose3, sin_cos};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;

/// No sensor has more beams, columns in a packet or columns in a revolution.
const BEAMS_MAX: usize = 512;
const COLUMNS_MAX: usize = 64;
const FRAME_COLUMNS_MAX: usize = 16_384;
/// From the lidar's frame to the sensor's where nothing is said (all models since OS-1 gen 1), millimetres.
const SENSOR_FROM_LIDAR: [f64; 16] =
    [-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 36.18, 0.0, 0.0, 0.0, 1.0];
/// How far the beams of a first-generation OS-1 start from the axis, millimetres.
const BEAM_ORIGIN_GEN1_MM: f64 = 12.163;

/// How packets of points lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Profile {
    Legacy,
    Single,
    Dual,
    LowRate,
    LowRateDual,
}

impl Profile {
    /// By its name in the JSON.
    fn of(name: &str) -> Option<Self> {
        match name {
            "LEGACY" => Some(Self::Legacy),
            "RNG19_RFL8_SIG16_NIR16" => Some(Self::Single),
            "RNG19_RFL8_SIG16_NIR16_DUAL" => Some(Self::Dual),
            // the window's blockage stands where the other has the ambient light
            "RNG15_RFL8_NIR8" | "RNG15_RFL8_WIN8" => Some(Self::LowRate),
            "RNG15_RFL8_NIR8_DUAL" => Some(Self::LowRateDual),
            _ => None,
        }
    }

    /// Bytes of a reading of one beam.
    pub(super) fn reading_bytes(self) -> usize {
        match self {
            Self::Legacy | Self::Single => 12,
            Self::Dual => 16,
            Self::LowRate => 4,
            Self::LowRateDual => 8,
        }
    }

    /// Bytes before the columns and behind them, before a column's readings and behind them.
    pub(super) fn frame_bytes(self) -> [usize; 4] {
        if self == Self::Legacy { [0, 0, 16, 4] } else { [32, 32, 12, 0] }
    }
}

/// What a sensor says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct OusterInfo {
    /// Its product line, such as `OS-0-128`.
    pub product: String,
    /// How its inertial sensor is turned in it.
    pub sensor_from_imu: UnitQuaternion<f64>,
    pub(super) profile: Profile,
    profile_name: String,
    pub(super) columns_per_frame: usize,
    pub(super) columns_per_packet: usize,
    /// Columns that a revolution has where the sensor may be set to look one way only.
    pub(super) columns_seen: usize,
    pub(super) beams: Vec<Beam>,
    /// Where the beams start, from the axis outwards and up, metres.
    pub(super) origin_m: [f64; 2],
    pub(super) sensor_from_lidar: Pose3,
}

/// A beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Beam {
    /// Sine and cosine of its elevation.
    pub(super) elevation: (f64, f64),
    /// How far it looks to the right of its column, radians.
    pub(super) right_rad: f64,
}

impl OusterInfo {
    /// Whether a text may be one, by what all of them hold.
    #[must_use]
    pub fn is_like(text: &str) -> bool {
        text.contains("beam_altitude_angles") && text.contains("beam_azimuth_angles")
    }

    /// Reads it.
    ///
    /// # Errors
    /// What was expected and what was found, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let json: Value =
            serde_json::from_str(text).map_err(|error| format!("expected a sensor's metadata as JSON, {error}"))?;
        let angles = |key: &str| numbers(&json, "beam_intrinsics", key).ok_or_else(|| missing(key));
        let (up, right) = (angles("beam_altitude_angles")?, angles("beam_azimuth_angles")?);
        let format = ["lidar_data_format", "data_format"].iter().find_map(|key| json.get(key)).unwrap_or(&Value::Null);
        let count =
            |key: &str| format.get(key).and_then(Value::as_u64).map(|n| usize::try_from(n).unwrap_or(usize::MAX));
        let beams = count("pixels_per_column").unwrap_or(up.len());
        let columns_per_frame = count("columns_per_frame").or_else(|| columns_of_mode(&json));
        let columns_per_frame = columns_per_frame.ok_or_else(|| missing("columns_per_frame"))?;
        let columns_per_packet = count("columns_per_packet").unwrap_or(16);
        let is_possible = (1..=BEAMS_MAX).contains(&beams)
            && (1..=COLUMNS_MAX).contains(&columns_per_packet)
            && (1..=FRAME_COLUMNS_MAX).contains(&columns_per_frame);
        if up.len() != beams || right.len() != beams || !is_possible {
            return Err(format!(
                "expected as many angles as beams (1 to {BEAMS_MAX}), found {} and {} of {beams}, {columns_per_packet} columns in a \
                 packet, {columns_per_frame} in a revolution",
                up.len(),
                right.len()
            ));
        }
        let profile_name = format.get("udp_profile_lidar").and_then(Value::as_str).unwrap_or("LEGACY").to_owned();
        let profile = Profile::of(&profile_name).ok_or_else(|| {
            format!(
                "expected packets of the profiles LEGACY, RNG19_RFL8_SIG16_NIR16, its DUAL, RNG15_RFL8_NIR8, its DUAL or RNG15_RFL8_WIN8, found {profile_name}: \
                 `ouster-cli source FILE save OUT.pcd` writes its clouds"
            )
        })?;
        let beam =
            |(up, right): (&f64, &f64)| Beam { elevation: sin_cos(up.to_radians()), right_rad: right.to_radians() };
        Ok(Self {
            product: text_of(&json, "prod_line").unwrap_or("OS").chars().take(40).collect(),
            sensor_from_imu: transform(&json, "imu_intrinsics", "imu_to_sensor_transform")?
                .map_or_else(UnitQuaternion::identity, |pose| pose.rotation),
            profile,
            profile_name,
            columns_per_frame,
            columns_per_packet,
            columns_seen: columns_seen(format, columns_per_frame),
            beams: up.iter().zip(&right).map(beam).collect(),
            origin_m: origin_m(&json)?,
            sensor_from_lidar: match transform(&json, "lidar_intrinsics", "lidar_to_sensor_transform")? {
                Some(pose) => pose,
                None => pose_of(&SENSOR_FROM_LIDAR).unwrap_or_else(Pose3::identity),
            },
        })
    }

    /// Bytes of a column.
    pub(super) fn column_bytes(&self) -> usize {
        let [_, _, before, behind] = self.profile.frame_bytes();
        before + self.beams.len() * self.profile.reading_bytes() + behind
    }

    /// Bytes of a packet of points.
    #[must_use]
    pub fn packet_bytes(&self) -> usize {
        let [before, behind, ..] = self.profile.frame_bytes();
        before + self.columns_per_packet * self.column_bytes() + behind
    }

    /// Which of the two places in a packet where the number of a revolution may stand is the one: bytes 2 or 10.
    #[must_use]
    pub fn is_numbered_in_columns(&self) -> bool {
        self.profile == Profile::Legacy
    }

    /// In words: the product, and how packets lie.
    #[must_use]
    pub fn words(&self) -> String {
        format!(
            "{}, {} columns of {} beams a revolution, packets as {}",
            self.product,
            self.columns_per_frame,
            self.beams.len(),
            self.profile_name
        )
    }
}

/// Of `column_window`, the first and the last of them, which may lie beyond the last column of the revolution.
fn columns_seen(format: &Value, all: usize) -> usize {
    let end = |at: usize| format["column_window"][at].as_u64().and_then(|column| usize::try_from(column).ok());
    let (Some(first), Some(last)) = (end(0), end(1)) else { return all };
    if first >= all || last >= all {
        return all;
    }
    if last >= first { last - first + 1 } else { all - first + last + 1 }
}

fn missing(key: &str) -> String {
    format!("expected `{key}` in the sensor's metadata, found none")
}

/// In one of its groups, or beside these in older versions.
fn entry<'v>(json: &'v Value, group: &str, key: &str) -> Option<&'v Value> {
    json.get(group).and_then(|group| group.get(key)).or_else(|| json.get(key))
}

fn numbers(json: &Value, group: &str, key: &str) -> Option<Vec<f64>> {
    let list = entry(json, group, key)?.as_array()?;
    list.iter().map(|value| value.as_f64().filter(|v| v.abs() <= 1e6)).collect()
}

fn text_of<'v>(json: &'v Value, key: &str) -> Option<&'v str> {
    entry(json, "sensor_info", key)?.as_str()
}

/// Of `1024x10`.
fn columns_of_mode(json: &Value) -> Option<usize> {
    entry(json, "config_params", "lidar_mode")?.as_str()?.split('x').next()?.parse().ok()
}

/// Where the beams start, by the transform where there is one.
fn origin_m(json: &Value) -> Result<[f64; 2], String> {
    if let Some(matrix) = numbers(json, "beam_intrinsics", "beam_to_lidar_transform") {
        let at = |index: usize| matrix.get(index).map(|v| 1e-3 * v);
        return at(3).zip(at(11)).map(|(out, up)| [out, up]).ok_or_else(|| missing("beam_to_lidar_transform"));
    }
    let said = entry(json, "beam_intrinsics", "lidar_origin_to_beam_origin_mm").and_then(Value::as_f64);
    let product = text_of(json, "prod_line").unwrap_or("");
    let known = [("OS-0-", 27.67), ("OS-1-", 15.806), ("OS-2-", 13.762)];
    let by_product = known.iter().find(|(line, _)| product.starts_with(line)).map(|(_, mm)| *mm);
    let out_mm = said.or(by_product).unwrap_or(BEAM_ORIGIN_GEN1_MM);
    if out_mm.abs() <= 1000.0 { Ok([1e-3 * out_mm, 0.0]) } else { Err(missing("lidar_origin_to_beam_origin_mm")) }
}

/// A transform in millimetres; none where the JSON has none.
fn transform(json: &Value, group: &str, key: &str) -> Result<Option<Pose3>, String> {
    if entry(json, group, key).is_none() {
        return Ok(None);
    }
    let matrix: Option<[f64; 16]> = numbers(json, group, key).and_then(|matrix| matrix.try_into().ok());
    let pose = matrix.and_then(|matrix| pose_of(&matrix));
    pose.map(Some).ok_or_else(|| format!("expected `{key}` as 16 numbers of a rigid transform, found something else"))
}

fn pose_of(matrix: &[f64; 16]) -> Option<Pose3> {
    let row = |at: usize| [matrix[at], matrix[at + 1], matrix[at + 2]];
    let turn = Matrix3::from_fn(|r, c| row(4 * r)[c]);
    let is_turn = (turn * turn.transpose() - Matrix3::identity()).norm() < 1e-3 && turn.determinant() > 0.0;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
    is_turn.then_some(Pose3 { rotation, translation: 1e-3 * Vector3::new(matrix[3], matrix[7], matrix[11]) })
}
