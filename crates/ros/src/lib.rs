//! ROS messages without ROS: definitions, decoding, encoding, transforms.
//!
//! Containers (bags, MCAP) deliver raw messages: a type's name, an encoding, perhaps a definition, bytes. A [`Channel`]
//! knows what such bytes consist of; [`Channel::value`] decodes any message by its definition, and a [`Decoder`] the
//! standard ones as structs that borrow what is large. Fields are found by name in the definition that came with the
//! file, so that a changed message is read properly or refused, never misread.
//!
//! ```
//! use mapwright_ros::{Channel, Decoder, Encoding, encode, messages::{Header, LaserScan}};
//! # use mapwright_geom::Stamp;
//! let ranges = [1.0_f32, 2.0];
//! let scan = LaserScan { header: Header::new(Stamp(5), "laser"), ranges: ranges[..].into(), ..Default::default() };
//! let bytes = encode(&scan, Encoding::Cdr)?;
//!
//! let channel = Channel::new("sensor_msgs/msg/LaserScan", Encoding::Cdr, None)?;
//! let mut decoder = Decoder::<LaserScan>::new(&channel)?;
//! assert_eq!(decoder.decode(&bytes)?.ranges.get(1), Some(2.0));
//! # Ok::<(), mapwright_ros::RosError>(())
//! ```

pub mod builtin;
mod channel;
mod cloud;
mod definition;
mod depth;
mod encoder;
mod error;
mod field;
mod laser;
mod livox;
pub mod messages;
mod mounting;
mod picture;
mod planar;
pub mod schema;
mod slice;
mod tf;
mod track;
mod value;
mod wire;

pub use channel::{Channel, Decoder, DefinitionSource, encode, is_built_in};
pub use cloud::{Cloud, CloudPoint, CloudPoints, PointTime, TimeUnit};
pub use definition::{Definition, DefinitionFormat, long_name, short_name};
pub use depth::{DepthNumbers, DistortionLeftOut};
pub use encoder::Encoder;
pub use error::RosError;
pub use field::{Field, Fit, FitCheck, Fixed};
pub use mounting::{Mounting, planar};
pub use picture::Picture;
pub use planar::{PlanarSlice, SliceCounts};
pub use slice::{Slice, SliceIter};
pub use tf::{TransformBuffer, TransformCounts, TransformLimits};
pub use value::{Numbers, Record, Value, decode_record};
pub use wire::{Cursor, Encoding, Scalar};
