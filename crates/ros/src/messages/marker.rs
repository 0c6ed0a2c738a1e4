//! Drawings for viewers; written only.

use super::{Header, Point, Pose, Vector3, message};
use crate::encoder::Encoder;
use crate::error::RosError;
use crate::field::Field;
use crate::wire::Encoding;
use std::borrow::Cow;

message! {
    /// A colour with opacity, all from 0 to 1.
    ColorRgba = ["std_msgs/ColorRGBA"];
    /// Red.
    r: f32,
    /// Green.
    g: f32,
    /// Blue.
    b: f32,
    /// Opacity.
    a: f32,
}

/// What a marker looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
#[allow(missing_docs)] // the names say it
pub enum MarkerShape {
    Arrow = 0,
    Cube = 1,
    Sphere = 2,
    Cylinder = 3,
    LineStrip = 4,
    LineList = 5,
    CubeList = 6,
    SphereList = 7,
    Points = 8,
    Text = 9,
}

/// What is to be done with a marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum MarkerAction {
    /// Draw it, in place of the one with the same namespace and number.
    Add = 0,
    /// Take it away.
    Delete = 2,
    /// Take all away.
    DeleteAll = 3,
}

/// Something to draw. Textures and meshes are written as empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Marker<'a> {
    /// When and in which frame.
    pub header: Header<'a>,
    /// Namespace.
    pub ns: Cow<'a, str>,
    /// Number within the namespace.
    pub id: i32,
    /// What it looks like.
    pub shape: MarkerShape,
    /// What is to be done with it.
    pub action: MarkerAction,
    /// Where.
    pub pose: Pose,
    /// How large, metres; the width of lines is x.
    pub scale: Vector3,
    /// In which colour.
    pub color: ColorRgba,
    /// Whether it moves with its frame.
    pub frame_locked: bool,
    /// Corners, for lines, lists and points.
    pub points: Vec<Point>,
    /// A colour for each of them, or none.
    pub colors: Vec<ColorRgba>,
    /// What it says.
    pub text: Cow<'a, str>,
}

/// Markers drawn together.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MarkerArray<'a> {
    /// The markers.
    pub markers: Vec<Marker<'a>>,
}

impl Marker<'_> {
    fn write(&self, out: &mut Encoder) {
        self.header.write(out);
        self.ns.write(out);
        out.scalar(self.id);
        out.scalar(self.shape as i32);
        out.scalar(self.action as i32);
        self.pose.write(out);
        self.scale.write(out);
        self.color.write(out);
        out.scalar(0i32); // lifetime: for ever
        out.scalar(0i32);
        out.scalar(self.frame_locked);
        self.points.write(out);
        self.colors.write(out);
        let is_ros2 = out.encoding() == Encoding::Cdr;
        if is_ros2 {
            out.text(""); // texture_resource
            Header::default().write(out);
            out.text(""); // texture.format
            out.count(0); // texture.data
            out.count(0); // uv_coordinates
        }
        self.text.write(out);
        out.text(""); // mesh_resource
        if is_ros2 {
            out.text(""); // mesh_file.filename
            out.count(0); // mesh_file.data
        }
        out.scalar(false); // mesh_use_embedded_materials
    }
}

impl MarkerArray<'_> {
    /// Name of the type.
    pub const TYPE: &'static str = "visualization_msgs/MarkerArray";

    /// The message's bytes.
    ///
    /// # Errors
    /// [`RosError::TooLong`].
    pub fn encode(&self, encoding: Encoding) -> Result<Vec<u8>, RosError> {
        let mut out = Encoder::new(encoding);
        out.count(self.markers.len());
        self.markers.iter().for_each(|marker| marker.write(&mut out));
        out.finish()
    }
}
