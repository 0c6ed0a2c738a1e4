//! Clouds in Foxglove's schema (`foxglove.PointCloud`), as JSON and as protobuf.

mod protobuf;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use mapwright_bags::{Connection, Encoding};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::{Header, PointCloud2, PointField};
use protobuf::{Fields, Part};
use serde_json::Value;
use std::borrow::Cow;

/// The schema's name.
pub(crate) const POINT_CLOUD: &str = "foxglove.PointCloud";
/// No point has more numbers.
const FIELDS_MAX: usize = 64;
/// ROS's number for each of Foxglove's types of numbers: none, u8, i8, u16, i16, u32, i32, f32, f64.
const DATATYPES: [u8; 9] = [0, 2, 1, 4, 3, 6, 5, 7, 8];

/// How messages are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Layout {
    Json,
    Protobuf,
}

/// A cloud.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct PointCloud<'a> {
    /// Zero where it has none.
    pub(crate) stamp: Stamp,
    pub(crate) frame: String,
    /// Where the points' origin is in the frame.
    pub(crate) frame_from_points: Pose3,
    point_stride: u32,
    fields: Vec<PointField<'static>>,
    data: Cow<'a, [u8]>,
}

impl Layout {
    /// That of a connection.
    ///
    /// # Errors
    /// Why its messages are not read, and what to do.
    pub(crate) fn of(connection: &Connection) -> Result<Self, String> {
        match &connection.encoding {
            Encoding::Other(name) if name == "json" => Ok(Self::Json),
            Encoding::Other(name) if name == "protobuf" => Ok(Self::Protobuf),
            other => {
                Err(format!("expected {POINT_CLOUD} as json or protobuf, found {other}: publish a PointCloud2 instead"))
            }
        }
    }

    /// A message.
    ///
    /// # Errors
    /// What was expected and what was found, in words.
    pub(crate) fn decode(self, data: &[u8]) -> Result<PointCloud<'_>, String> {
        match self {
            Self::Json => of_json(data),
            Self::Protobuf => of_protobuf(data),
        }
    }
}

impl PointCloud<'_> {
    /// As ROS has it, in one row.
    ///
    /// # Errors
    /// Where the points take more bytes than 32 bits count.
    pub(crate) fn message(&self) -> Result<PointCloud2<'_>, String> {
        let bytes = u32::try_from(self.data.len()).map_err(|_| format!("{} bytes of points", self.data.len()))?;
        let width = bytes.checked_div(self.point_stride).ok_or("expected `point_stride` above zero, found 0")?;
        Ok(PointCloud2 {
            header: Header::new(self.stamp, &self.frame),
            height: 1,
            width,
            fields: self.fields.clone(),
            point_step: self.point_stride,
            row_step: width * self.point_stride,
            data: &self.data,
            ..PointCloud2::default()
        })
    }

    fn add_field(&mut self, name: &str, offset: u64, kind: u64) -> Result<(), String> {
        let datatype = usize::try_from(kind).ok().and_then(|kind| DATATYPES.get(kind)).copied().unwrap_or(0);
        let offset = u32::try_from(offset).map_err(|_| format!("a field at byte {offset} of a point"))?;
        if self.fields.len() >= FIELDS_MAX {
            return Err(format!("expected at most {FIELDS_MAX} fields, found more"));
        }
        if datatype != 0 {
            let name = Cow::Owned(name.chars().take(80).collect());
            self.fields.push(PointField { name, offset, datatype, count: 1 });
        }
        Ok(())
    }
}

fn of_json(data: &[u8]) -> Result<PointCloud<'static>, String> {
    let json: Value = serde_json::from_slice(data).map_err(|error| format!("expected a cloud as JSON, {error}"))?;
    let number = |value: &Value, key: &str| value.get(key).and_then(Value::as_u64).unwrap_or(0);
    let time = &json["timestamp"];
    let text = json["data"].as_str().ok_or("expected the points as `data` in base64, found none")?;
    let mut cloud = PointCloud {
        stamp: stamp(number(time, "sec"), number(time, "nsec")),
        frame: json["frame_id"].as_str().unwrap_or("").to_owned(),
        frame_from_points: pose(
            ["x", "y", "z"].map(|axis| json["pose"]["position"][axis].as_f64()),
            ["x", "y", "z", "w"].map(|axis| json["pose"]["orientation"][axis].as_f64()),
        ),
        point_stride: u32::try_from(number(&json, "point_stride")).unwrap_or(0),
        data: Cow::Owned(STANDARD.decode(text).map_err(|error| format!("expected base64, {error}"))?),
        ..PointCloud::default()
    };
    for field in json["fields"].as_array().into_iter().flatten() {
        cloud.add_field(field["name"].as_str().unwrap_or(""), number(field, "offset"), number(field, "type"))?;
    }
    Ok(cloud)
}

/// Numbers of fields are those of `PointCloud.proto`.
fn of_protobuf(data: &[u8]) -> Result<PointCloud<'_>, String> {
    let mut cloud = PointCloud::default();
    for entry in Fields::of(data) {
        match entry? {
            (1, Part::Bytes(time)) => {
                let [seconds, nanoseconds] = protobuf::numbers(time)?;
                cloud.stamp = stamp(seconds, nanoseconds);
            }
            (2, Part::Bytes(frame)) => cloud.frame = String::from_utf8_lossy(frame).into_owned(),
            (3, Part::Bytes(place)) => cloud.frame_from_points = pose_of(place)?,
            (4, Part::Number(stride)) => cloud.point_stride = u32::try_from(stride).unwrap_or(0),
            (5, Part::Bytes(field)) => add_field(&mut cloud, field)?,
            (6, Part::Bytes(points)) => cloud.data = Cow::Borrowed(points),
            _ => {}
        }
    }
    Ok(cloud)
}

fn add_field(cloud: &mut PointCloud<'_>, bytes: &[u8]) -> Result<(), String> {
    let (mut name, mut numbers) = (Cow::Borrowed(""), [0; 2]);
    for entry in Fields::of(bytes) {
        match entry? {
            (1, Part::Bytes(text)) => name = String::from_utf8_lossy(text),
            (2, Part::Number(offset)) => numbers[0] = offset,
            (3, Part::Number(kind)) => numbers[1] = kind,
            _ => {}
        }
    }
    cloud.add_field(&name, numbers[0], numbers[1])
}

fn pose_of(bytes: &[u8]) -> Result<Pose3, String> {
    let (mut place, mut turn) = ([None; 3], [None; 4]);
    for entry in Fields::of(bytes) {
        match entry? {
            (1, Part::Bytes(vector)) => place = protobuf::doubles::<3>(vector)?.map(Some),
            (2, Part::Bytes(quaternion)) => turn = protobuf::doubles::<4>(quaternion)?.map(Some),
            _ => {}
        }
    }
    Ok(pose(place, turn))
}

/// A pose of which nothing that is not there moves or turns.
fn pose(place: [Option<f64>; 3], turn: [Option<f64>; 4]) -> Pose3 {
    let quaternion = turn.map(|part| part.unwrap_or(0.0));
    let place = place.map(|part| part.unwrap_or(0.0));
    let is_turned = quaternion.iter().any(|part| *part != 0.0);
    let found = Pose3::from_quaternion(place, if is_turned { quaternion } else { [0.0, 0.0, 0.0, 1.0] });
    found.unwrap_or_else(Pose3::identity)
}

fn stamp(seconds: u64, nanoseconds: u64) -> Stamp {
    let ns = i128::from(seconds) * 1_000_000_000 + i128::from(nanoseconds);
    Stamp(i64::try_from(ns).unwrap_or(0))
}

#[cfg(test)]
mod tests;
