//! Points of a point cloud, whatever its layout.

mod access;
mod colour;
mod space;
mod time;

pub use space::CloudPoints;
pub(crate) use time::SWEEP_S;
pub use time::{PointTime, TimeUnit};

use crate::error::RosError;
use crate::messages::{PointCloud2, PointField};
use crate::schema::Primitive;
use crate::wire::Scalar;
use access::Access;
use colour::Colour;

/// One point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// Where, metres in the sensor's frame; not finite for beams that brought nothing back.
    pub position: [f64; 3],
    /// How bright, in units of the device; zero where the cloud does not say.
    pub intensity: f32,
    /// Which of the laser's rings; zero where the cloud does not say.
    pub ring: u32,
    /// Seconds after the header's stamp; zero where the cloud does not say.
    pub time_s: f64,
}

/// Access to the points of a [`PointCloud2`], which are not copied.
#[derive(Debug, Clone)]
pub struct Cloud<'a> {
    data: &'a [u8],
    width: usize,
    height: usize,
    point_step: usize,
    row_step: usize,
    position: [Access; 3],
    intensity: Option<Access>,
    ring: Option<Access>,
    colour: Option<Colour>,
    time: Option<(Access, PointTime)>,
    /// The field of times, where these are none.
    refused_time: Option<String>,
}

const INTENSITY: [&str; 3] = ["intensity", "intensities", "reflectivity"];
const RING: [&str; 3] = ["ring", "channel", "line"];
/// So few points of those that are looked at may miss most of a sweep.
const SAMPLED_LEAST: usize = 64;
/// Of Ouster; Velodyne; Hesai, RoboSense and others; Livox.
const TIME: [&str; 6] = ["t", "time", "timestamp", "offset_time", "time_offset", "time_stamp"];

impl<'a> Cloud<'a> {
    /// Finds the points of a message.
    ///
    /// # Errors
    /// [`RosError::Cloud`] where there is no `x`, `y` or `z`, a field lies outside of its point, or the data is not as
    /// long as width, height and steps say.
    pub fn new(message: &PointCloud2<'a>) -> Result<Self, RosError> {
        let (width, height) = (message.width as usize, message.height as usize);
        let point_step = message.point_step as usize;
        let row_step = check_size(message)?;
        let find = |names: &[&str]| names.iter().find_map(|name| message.fields.iter().find(|f| f.name == *name));
        let access = |field: &PointField<'_>| Access::of(field, point_step, message.is_bigendian);
        let position = |name: &str| match find(&[name]) {
            Some(field) => access(field),
            None => Err(missing(name, &message.fields)),
        };
        let mut cloud = Self {
            data: message.data,
            width,
            height,
            point_step,
            row_step,
            position: [position("x")?, position("y")?, position("z")?],
            intensity: find(&INTENSITY).map(access).transpose()?,
            ring: find(&RING).map(access).transpose()?,
            colour: Colour::of(&message.fields, point_step, message.is_bigendian),
            time: None,
            refused_time: None,
        };
        if let Some(field) = find(&TIME) {
            let access = access(field)?;
            let time = PointTime::of(&field.name, access, &cloud.sampled_returns(), message.header.stamp);
            cloud.refused_time = time.is_none().then(|| field.name.clone().into_owned());
            cloud.time = time.map(|time| (access, time));
        }
        Ok(cloud)
    }

    /// How many points there are, those without a return included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How times of points are given; none where they are not, or not plausibly.
    #[must_use]
    pub fn time(&self) -> Option<&PointTime> {
        self.time.as_ref().map(|(_, time)| time)
    }

    /// Whether points say how bright they are, and of which ring.
    #[must_use]
    pub fn has_intensity_and_ring(&self) -> (bool, bool) {
        (self.intensity.is_some(), self.ring.is_some())
    }

    /// Whether points say what colour they are.
    #[must_use]
    pub fn has_colours(&self) -> bool {
        self.colour.is_some()
    }

    /// The points, row by row.
    pub fn points(&self) -> impl Iterator<Item = CloudPoint> + '_ {
        self.rows().map(|point| self.point(point))
    }

    /// Calls a function with the place of each point, row by row; the fastest way to all of them.
    pub fn for_each_position(&self, mut call: impl FnMut([f64; 3])) {
        let plain = |axis: &Access| axis.primitive == Primitive::F32 && !axis.big_endian;
        if !self.position.iter().all(plain) {
            return self.positions().for_each(call);
        }
        let offsets = self.position.map(|axis| axis.offset);
        let axis = |point: &[u8], offset: usize| f64::from(f32::decode(point.get(offset..).unwrap_or_default(), false));
        self.rows().for_each(|point| call(offsets.map(|offset| axis(point, offset))));
    }

    /// The places of the points, row by row.
    pub fn positions(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.rows().map(|point| self.position.map(|axis| axis.read(point)))
    }

    fn point(&self, point: &[u8]) -> CloudPoint {
        CloudPoint {
            position: self.position.map(|axis| axis.read(point)),
            intensity: self.intensity.map_or(0.0, |access| access.read(point) as f32),
            ring: self.ring.map_or(0, |access| access.read(point) as u32),
            time_s: self.time.as_ref().map_or(0.0, |(access, time)| time.seconds(access.read(point))),
        }
    }

    fn rows(&self) -> impl Iterator<Item = &'a [u8]> + '_ {
        let row_bytes = self.width * self.point_step;
        let row = move |row: usize| self.data.get(row * self.row_step..row * self.row_step + row_bytes);
        let rows = if self.width == 0 { 0 } else { self.height };
        (0..rows).filter_map(row).flat_map(|row| row.chunks_exact(self.point_step.max(1)))
    }

    /// Whether something came back: drivers put what did not nowhere or into the sensor, with any time.
    fn is_return(&self, point: &[u8]) -> bool {
        let place = self.position.map(|axis| axis.read(point));
        place.iter().all(|axis| axis.is_finite()) && place != [0.0; 3]
    }

    /// Points that say when they were taken: the returns of those looked at, or all returns where they are too few.
    fn sampled_returns(&self) -> Vec<&'a [u8]> {
        let mut sampled = self.sampled();
        sampled.retain(|point| self.is_return(point));
        if sampled.len() >= SAMPLED_LEAST {
            return sampled;
        }
        self.rows().filter(|point| self.is_return(point)).collect()
    }

    /// Up to 256 points spread over the cloud, with the first and the last.
    fn sampled(&self) -> Vec<&'a [u8]> {
        let last = self.len().saturating_sub(1);
        let place = |index: usize| {
            let start = (index / self.width) * self.row_step + (index % self.width) * self.point_step;
            self.data.get(start..start + self.point_step)
        };
        let count = self.len().min(256);
        (0..count).filter_map(|k| place(k * last / count.saturating_sub(1).max(1))).collect()
    }
}

/// The row step, once the data is found to be as long as it must be. Some drivers leave it zero or count points.
fn check_size(message: &PointCloud2<'_>) -> Result<usize, RosError> {
    let (width, height) = (message.width as usize, message.height as usize);
    let row_bytes = width.saturating_mul(message.point_step as usize);
    let given = message.row_step as usize;
    let row_step = if height <= 1 || given < row_bytes { row_bytes } else { given };
    let needed = if height == 0 { 0 } else { row_step.saturating_mul(height - 1).saturating_add(row_bytes) };
    let no_step = message.point_step == 0 && width > 0 && height > 0;
    if no_step || needed > message.data.len() {
        return Err(RosError::Cloud {
            what: "data".to_owned(),
            expected: format!("{height} x {width} points of {} bytes ({needed} bytes)", message.point_step),
            found: format!("{} bytes", message.data.len()),
        });
    }
    Ok(row_step)
}

fn missing(name: &str, fields: &[PointField<'_>]) -> RosError {
    let names: Vec<_> = fields.iter().take(20).map(|field| &*field.name).collect();
    RosError::Cloud {
        what: "fields".to_owned(),
        expected: format!("one named `{name}`"),
        found: if names.is_empty() { "none".to_owned() } else { crate::error::excerpt(&names.join(", ")) },
    }
}

#[cfg(test)]
mod tests;
