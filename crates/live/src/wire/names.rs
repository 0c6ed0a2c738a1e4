//! Names of ROS 2 as wires have them (design.ros2.org, "Topic and Service name mapping to DDS").

/// `sensor_msgs/msg/LaserScan` as `sensor_msgs::msg::dds_::LaserScan_`, with `part` (`_Request`) before the last line; none where it is no
/// name of a type.
#[must_use]
pub fn dds_type(kind: &str, part: &str) -> Option<String> {
    let mut parts = kind.split('/');
    let (Some(package), Some(middle), Some(name), None) = (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return None;
    };
    let is_name =
        |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
    [package, middle, name].into_iter().all(is_name).then(|| format!("{package}::{middle}::dds_::{name}{part}_"))
}

/// Whether a topic or service can be called so: absolute, of letters, digits and lines, no empty parts.
#[must_use]
pub fn is_name(name: &str) -> bool {
    let is_part = |part: &str| {
        !part.is_empty()
            && !part.starts_with(|c: char| c.is_ascii_digit())
            && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_part)) && name.len() < 200
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_named_as_ros_names_them() {
        assert_eq!(dds_type("sensor_msgs/msg/LaserScan", "").unwrap(), "sensor_msgs::msg::dds_::LaserScan_");
        assert_eq!(dds_type("std_srvs/srv/Empty", "_Request").unwrap(), "std_srvs::srv::dds_::Empty_Request_");
        for wrong in ["", "LaserScan", "sensor_msgs/LaserScan", "a/b/c/d", "a//c", "a/b/c d"] {
            assert_eq!(dds_type(wrong, ""), None, "{wrong}");
        }
    }

    #[test]
    fn names_of_topics() {
        assert!(["/scan", "/robot_1/map", "/_a"].into_iter().all(is_name));
        assert!(["", "/", "scan", "/a//b", "/1a", "/a b", "/a/", "/ä"].into_iter().all(|name| !is_name(name)));
    }
}
