//! Definitions of the standard types, for files without any and for writing.
//!
//! ROS 2's are those of Humble; ROS 1's (Noetic) are derived from them where they do not differ.

use crate::definition::{Definition, DefinitionFormat, short_name};
use crate::error::RosError;
use crate::wire::Encoding;

const ROS2: &str = include_str!("standard_ros2.msgs");
/// What differs by more than `time` and `duration`.
const ROS1: &str = include_str!("standard_ros1.msgs");
const MARK: &str = "MSG: ";

/// Whether a `package/Type` has a built-in definition.
pub(crate) fn knows(name: &str) -> bool {
    section(ROS2, name).is_some()
}

/// A standard type's definition with those of the types it uses, as bags of that encoding carry it.
///
/// # Errors
/// [`RosError::UnknownType`].
pub fn text(type_name: &str, encoding: Encoding) -> Result<String, RosError> {
    let root = short_name(type_name);
    let mut names = vec![root.clone()];
    let mut text = String::new();
    let mut done = 0;
    while let Some(name) = names.get(done).cloned() {
        let body = body(&name, encoding).ok_or_else(|| RosError::UnknownType { message: root.clone() })?;
        if done > 0 {
            text.push_str(&format!("{}\n{MARK}{name}\n", "=".repeat(80)));
        }
        text.push_str(&body);
        let used = body.lines().filter_map(|line| line.split(['[', ' ']).next()).filter(|word| word.contains('/'));
        for used in used {
            if !names.iter().any(|name| name == used) {
                names.push(used.to_owned());
            }
        }
        done += 1;
    }
    Ok(text)
}

/// The same, parsed.
///
/// # Errors
/// [`RosError::UnknownType`].
pub fn definition(type_name: &str, encoding: Encoding) -> Result<Definition, RosError> {
    Definition::parse(type_name, format(encoding), &text(type_name, encoding)?)
}

/// The language of the built-in definitions for an encoding.
#[must_use]
pub fn format(encoding: Encoding) -> DefinitionFormat {
    match encoding {
        Encoding::Ros1 => DefinitionFormat::Ros1Msg,
        Encoding::Cdr => DefinitionFormat::Ros2Msg,
    }
}

fn body(name: &str, encoding: Encoding) -> Option<String> {
    if encoding == Encoding::Cdr {
        return section(ROS2, name).map(str::to_owned);
    }
    let shared = || {
        section(ROS2, name).map(|body| {
            body.replace("builtin_interfaces/Time ", "time ").replace("builtin_interfaces/Duration ", "duration ")
        })
    };
    section(ROS1, name).map(str::to_owned).or_else(shared)
}

fn section<'t>(all: &'t str, name: &str) -> Option<&'t str> {
    all.split(MARK).find_map(|section| section.strip_prefix(name)?.strip_prefix('\n'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::StructType;

    fn all_names() -> impl Iterator<Item = &'static str> {
        ROS2.lines().filter_map(|line| line.strip_prefix(MARK))
    }

    #[test]
    fn every_definition_resolves_in_both_worlds() {
        for name in all_names() {
            for encoding in [Encoding::Ros1, Encoding::Cdr] {
                let kind: std::sync::Arc<StructType> = definition(name, encoding).unwrap().schema().unwrap();
                assert_eq!(kind.name, name);
                assert!(!kind.fields.is_empty(), "{name}");
            }
        }
    }

    #[test]
    fn checksums_are_those_that_bags_carry() {
        for (name, sum) in [
            ("std_msgs/Header", "2176decaecbce78abc3b96ef049fabed"),
            ("std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"),
            ("sensor_msgs/LaserScan", "90c7ef2dc6895d81024acba2ac42f369"),
            ("sensor_msgs/MultiEchoLaserScan", "6fefb0c6da89d7c8abe4b339f5c2f8fb"),
            ("sensor_msgs/PointCloud2", "1158d486dd51d683ce2f1be655c3c181"),
            ("sensor_msgs/NavSatFix", "2d3a8cd499b9b4a0249fb98fd05cfa48"),
            ("sensor_msgs/Imu", "6a62c6daae103f4ff57a132d6f95cec2"),
            ("sensor_msgs/CameraInfo", "c9a58c1b0b154e0e6da7578cb991d214"),
            ("sensor_msgs/Range", "c005c34273dc426c67a020a87bc24148"),
            ("nav_msgs/Odometry", "cd5e73d190d741a2f92e81eda573aca7"),
            ("nav_msgs/OccupancyGrid", "3381f2d731d4076ec5c71b0759edbe4e"),
            ("nav_msgs/Path", "6227e2b7e9cce15051f669a5e197bbf7"),
            ("tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec"),
            ("tf/tfMessage", "94810edda583a504dfda3829e70d7eec"),
            ("visualization_msgs/Marker", "4048c9de2a16f4ae8e0538085ebf1b97"),
        ] {
            assert_eq!(definition(name, Encoding::Ros1).unwrap().md5sum().unwrap(), sum, "{name}");
        }
    }
}
