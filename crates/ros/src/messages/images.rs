//! Pictures and the cameras that took them.

use super::{Header, message};
use crate::field::Fixed;
use crate::slice::Slice;
use std::borrow::Cow;

message! {
    /// A picture.
    Image<'a> = ["sensor_msgs/Image"];
    /// When, and the camera's optical frame.
    header: Header<'a>,
    /// Rows.
    height: u32,
    /// Columns.
    width: u32,
    /// What a pixel consists of, such as `16UC1` or `rgb8`.
    encoding: Cow<'a, str>,
    /// 1 where numbers have their most significant byte first.
    is_bigendian: u8,
    /// Bytes from one row to the next.
    step: u32,
    /// The pixels.
    data: &'a [u8],
}

message! {
    /// The part of the sensor that a picture shows.
    RegionOfInterest = ["sensor_msgs/RegionOfInterest"];
    /// First column.
    x_offset: u32,
    /// First row.
    y_offset: u32,
    /// Rows; zero for all.
    height: u32,
    /// Columns; zero for all.
    width: u32,
    /// Whether it is to be rectified.
    do_rectify: bool,
}

message! {
    /// How a camera projects. ROS 1 calls the matrices `D`, `K`, `R` and `P`.
    CameraInfo<'a> = ["sensor_msgs/CameraInfo"];
    /// When, and the camera's optical frame.
    header: Header<'a>,
    /// Rows.
    height: u32,
    /// Columns.
    width: u32,
    /// Name of the distortion's model.
    distortion_model: Cow<'a, str>,
    /// The distortion's parameters.
    d: Slice<'a, f64>,
    /// Intrinsic matrix of the raw pictures, row by row.
    k: Fixed<9>,
    /// Rectifying rotation, row by row.
    r: Fixed<9>,
    /// Projection of the rectified pictures, row by row.
    p: Fixed<12>,
    /// Columns put into one; optional.
    binning_x: u32 = optional,
    /// Rows put into one; optional.
    binning_y: u32 = optional,
    /// The part that is shown; optional.
    roi: RegionOfInterest = optional,
}

message! {
    /// A picture as a file in memory.
    CompressedImage<'a> = ["sensor_msgs/CompressedImage"];
    /// When, and the camera's optical frame.
    header: Header<'a>,
    /// What it is: `jpeg`, `png`, `16UC1; compressedDepth png`, ...
    format: Cow<'a, str>,
    /// The file, behind 12 bytes of parameters for compressed depth.
    data: &'a [u8],
}

/// How the `compressedDepth` transport packs a depth picture: floats are `quant_a / (stored - quant_b)`, integers are
/// stored as they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthCompression<'a> {
    /// First parameter of the quantisation.
    pub quant_a: f32,
    /// Second parameter of the quantisation.
    pub quant_b: f32,
    /// The picture's file behind the parameters.
    pub file: &'a [u8],
}

impl<'a> CompressedImage<'a> {
    /// The parts of a picture sent by `compressed_depth_image_transport`; none for other pictures.
    #[must_use]
    pub fn depth(&self) -> Option<DepthCompression<'a>> {
        use crate::wire::Scalar;
        let (prefix, file) = self.data.split_at_checked(12)?;
        let number = |at: usize| f32::decode(&prefix[at..], false);
        let packed = self.format.contains("compressedDepth");
        packed.then(|| DepthCompression { quant_a: number(4), quant_b: number(8), file })
    }
}
