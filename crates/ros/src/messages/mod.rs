//! Typed messages. What is large is borrowed from the message's bytes.
//!
//! Fields have the names that ROS 2 gives them; a field described as optional is zero or empty where a file's
//! definition does not have it.

mod geometry;
mod health;
mod images;
mod lidar;
pub mod lifecycle;
mod map;
mod marker;
mod motion;
pub mod parameters;
mod scans;
pub mod services;

pub use geometry::{
    Header, Point, Pose, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion, TfMessage, Transform,
    TransformStamped, Twist, TwistWithCovariance, Vector3,
};
pub use health::{BondStatus, Clock, DiagnosticArray, DiagnosticStatus, KeyValue};
pub use images::{CameraInfo, CompressedImage, DepthCompression, Image, RegionOfInterest};
pub use lidar::{Bytes, LidarPacket, LidarPackets, LivoxPoint, LivoxScan, OusterPacket, Text};
pub use map::{MapMetaData, OccupancyGrid, OccupancyGridUpdate, Path};
pub use marker::{ColorRgba, Marker, MarkerAction, MarkerArray, MarkerShape};
pub use motion::{Imu, Odometry, Range};
pub use scans::{LaserEcho, LaserScan, MultiEchoLaserScan, PointCloud2, PointField};

use crate::definition::short_name;
use crate::field::Field;

/// A kind of message, whatever bytes it borrows from.
pub trait Kind {
    /// The message that borrows from bytes of a certain lifetime.
    type Message<'a>: Field<'a>;
    /// Names of the type, the one to write first.
    const TYPES: &'static [&'static str];

    /// Whether a type's name, with or without `msg` in the middle, is this kind's.
    #[must_use]
    fn is(type_name: &str) -> bool {
        Self::TYPES.contains(&short_name(type_name).as_str())
    }
}

/// A field's name without the mark that keywords need.
pub(crate) fn plain(name: &'static str) -> &'static str {
    name.strip_prefix("r#").unwrap_or(name)
}

/// A message with its fields in the order of the standard definition.
macro_rules! message {
    (
        $(#[$meta:meta])*
        $name:ident $(<$lifetime:lifetime>)? = $types:expr;
        $( $(#[$field_meta:meta])* $field:ident: $ty:ty $(= $optional:ident)?, )*
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct $name $(<$lifetime>)? {
            $( $(#[$field_meta])* pub $field: $ty, )*
        }

        impl<'a> $crate::field::Field<'a> for $name $(<$lifetime>)? {
            const MIN_BYTES: usize = 0 $( + <$ty as $crate::field::Field<'a>>::MIN_BYTES )*;

            fn fit(
                ty: &$crate::schema::FieldType,
                check: &mut $crate::field::FitCheck<'_>,
            ) -> Result<(), $crate::RosError> {
                let types: &[&str] = &$types;
                let kind = check.structure(ty, types[0])?;
                let mut next = 0;
                $(
                    let optional = [$(stringify!($optional),)? ""].len() > 1;
                    check.member::<$ty>(&kind, $crate::messages::plain(stringify!($field)), optional, &mut next)?;
                )*
                check.others(&kind, &[$($crate::messages::plain(stringify!($field))),*]);
                Ok(())
            }

            #[inline]
            fn read(cursor: &mut $crate::wire::Cursor<'a>) -> Result<Self, $crate::RosError> {
                Ok(Self {
                    $( $field: $crate::field::Field::read(cursor)
                        .map_err(|e| e.inside($crate::messages::plain(stringify!($field))))?, )*
                })
            }

            fn pick(value: &$crate::value::Value<'a>) -> Result<Self, $crate::RosError> {
                let $crate::value::Value::Struct(record) = value else {
                    return Err($crate::field::mismatch(stringify!($name), value));
                };
                Ok(Self {
                    $( $field: match record.field($crate::messages::plain(stringify!($field))) {
                        Some(value) => $crate::field::Field::pick(value)?,
                        None => Default::default(),
                    }, )*
                })
            }

            fn write(&self, out: &mut $crate::encoder::Encoder) {
                $( self.$field.write(out); )*
            }
        }

        impl $(<$lifetime>)? $crate::messages::Kind for $name $(<$lifetime>)? {
            type Message<'m> = message!(@with $name $(<$lifetime>)?);
            const TYPES: &'static [&'static str] = &$types;
        }
    };
    (@with $name:ident) => { $name };
    (@with $name:ident <$lifetime:lifetime>) => { $name<'m> };
}
use message;
