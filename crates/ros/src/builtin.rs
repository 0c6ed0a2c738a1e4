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
    text_of(&short_name(type_name), |name| body(name, encoding))
}

/// The text of `root` and behind it those of all types it uses, as `body` has them.
fn text_of(root: &str, body: impl Fn(&str) -> Option<String>) -> Result<String, RosError> {
    let mut names = vec![root.to_owned()];
    let mut text = String::new();
    let mut done = 0;
    while let Some(name) = names.get(done).cloned() {
        let body = body(&name).ok_or_else(|| RosError::UnknownType { message: root.to_owned() })?;
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

/// The hash by which nodes of ROS 2 tell whether they mean the same by `package/msg/Type` or `package/srv/Type`: `RIHS01_` and 64 hexadecimal digits.
///
/// # Errors
/// [`RosError::UnknownType`] where a definition is missing.
pub fn type_hash(type_name: &str) -> Result<String, RosError> {
    match type_name.trim().split_once("/srv/") {
        None => definition(type_name, Encoding::Cdr)?.type_hash(),
        Some((package, name)) => {
            let text = service(type_name.trim(), &format!("{package}/{name}"))?;
            Definition::parse(type_name, DefinitionFormat::Ros2Msg, &text)?.type_hash()
        }
    }
}

/// A service as a message: its request, its response, and the event in which both are told to who listens in (`service_msgs`).
fn service(root: &str, name: &str) -> Result<String, RosError> {
    let (request, response, event) = (format!("{name}_Request"), format!("{name}_Response"), format!("{name}_Event"));
    text_of(root, |part| match part {
        _ if part == root => {
            Some(format!("{request} request_message\n{response} response_message\n{event} event_message\n"))
        }
        _ if part == event => {
            Some(format!("service_msgs/ServiceEventInfo info\n{request}[<=1] request\n{response}[<=1] response\n"))
        }
        part => body(part, Encoding::Cdr),
    })
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

    /// As rosidl made them: in `share/<package>` of its packages for ROS 2 Kilted, or, of packages without, from the definitions of Jazzy. Of
    /// all that are here `sensor_msgs/Range` alone has changed since Humble, by a field.
    #[test]
    fn type_hashes_are_those_of_rosidl() {
        for (name, hash) in [
            ("tf2_msgs/msg/TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
            ("bond/msg/Status", "87eaccffa254ffffadc0b61600452e8251740f06c25659a2dbda4927fdb1f70a"),
            ("map_msgs/msg/OccupancyGridUpdate", "c4095b0be2e4363f8978a1570e0293ee093436f1e1c61d99b48502ac317025e8"),
            ("nav2_msgs/srv/LoadMap", "eb875de5ea9bb394573effc3f239015b19869dd7a8988136768372c6ef907ec1"),
            ("nav2_msgs/srv/SetInitialPose", "1f818551d505d16d89c8bf9b07121a6408de4408b7889dfda9a0db326c296153"),
            ("slam_toolbox/srv/ClearQueue", "5ae7286887351a43cd6265cbd3ec3fdf0074fa6e9f39c17057351b6ab4415477"),
            (
                "slam_toolbox/srv/DeserializePoseGraph",
                "ec7e27ad873d1c3961583c3288d7fe516bb0035fc9769078657f0377bd55547a",
            ),
            ("slam_toolbox/srv/Pause", "70971da2d6da308b62b9ef6e4615202d9b3c6e945fcfce5ffded1b45423a236d"),
            ("slam_toolbox/srv/Reset", "add9db4656fcb5220b2d20b9f8f22a9094272dffc63bc4d4caf8df63c7079342"),
            ("slam_toolbox/srv/SaveMap", "fe7c2a4b4f985a83fa1a651ba83f19dd13417c6f3c6efa6ece887e79c23c3c09"),
            ("slam_toolbox/srv/SerializePoseGraph", "d7adce484b2589d9e97a4179c1c3d1a8343fec6acb2715d5f98ac5b79609e46b"),
            ("builtin_interfaces/msg/Duration", "e8d009f659816f758b75334ee1a9ca5b5c0b859843261f14c7f937349599d93b"),
            ("builtin_interfaces/msg/Time", "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"),
            ("diagnostic_msgs/msg/DiagnosticArray", "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
            (
                "diagnostic_msgs/msg/DiagnosticStatus",
                "b0e3e692ea2d54a8af2f4ef1930e81556a2db55216b771f8a7d2724ed47bf0e4",
            ),
            ("diagnostic_msgs/msg/KeyValue", "d68081eaa540288c5440753baecef0c4e16e81a5f78ad68902ded5100413bb42"),
            ("geometry_msgs/msg/Point", "6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881"),
            ("geometry_msgs/msg/Point32", "2fc4db7cae16a4582c79a56b66173a8d48d52c7dc520ddc55a0d4bcf2a4bfdbc"),
            ("geometry_msgs/msg/Pose", "d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa"),
            ("geometry_msgs/msg/Pose2D", "d68efa5b46e70f7b16ca23085474fdac5a44b638783ec42f661da64da4724ccc"),
            ("geometry_msgs/msg/PoseArray", "af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0"),
            ("geometry_msgs/msg/PoseStamped", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"),
            (
                "geometry_msgs/msg/PoseWithCovariance",
                "9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb",
            ),
            (
                "geometry_msgs/msg/PoseWithCovarianceStamped",
                "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
            ),
            ("geometry_msgs/msg/Quaternion", "8a765f66778c8ff7c8ab94afcc590a2ed5325a1d9a076ffff38fbce36f458684"),
            ("geometry_msgs/msg/Transform", "beb83fbe698636351461f6f35d1abb20010c43d55374d81bd041f1ba2581fddc"),
            ("geometry_msgs/msg/TransformStamped", "0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206"),
            ("geometry_msgs/msg/Twist", "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"),
            ("geometry_msgs/msg/TwistStamped", "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"),
            (
                "geometry_msgs/msg/TwistWithCovariance",
                "49f574f033f095d8b6cd1beaca5ca7925e296e84af1716d16c89d38b059c8c18",
            ),
            ("geometry_msgs/msg/Vector3", "cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d"),
            ("geometry_msgs/msg/Vector3Stamped", "d4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a"),
            ("lifecycle_msgs/msg/State", "dd2d02b82f3ebc858e53c431b1e6e91f3ffc71436fc81d0715214ac6ee2107a0"),
            ("lifecycle_msgs/msg/Transition", "c65d7b31ea134cba4f54fc867b817979be799f7452035cd35fac9b7421fb3424"),
            (
                "lifecycle_msgs/msg/TransitionDescription",
                "c5f1cd4bb1ad2ba0e3329d4ac7015c52a674a72c1faf7974c37a33f4f6048b28",
            ),
            ("lifecycle_msgs/msg/TransitionEvent", "d5f8873a2f0146498f812d7885c7327ce27e463d36811d8792f35ee38c0d6c38"),
            ("lifecycle_msgs/srv/ChangeState", "356fe34f0475a43acf54542013af4167b0e729f77ea22ffb045c6ad8e20668e5"),
            (
                "lifecycle_msgs/srv/GetAvailableStates",
                "00a07d79d2207d71e81a8cbc1880e5d924cc16d4688ea8e8e06e443dc8f8aa1d",
            ),
            (
                "lifecycle_msgs/srv/GetAvailableTransitions",
                "59b7ecefce0982a8a844b9f2c4f14764c1c4543cc55e72924e2aa4adad83e9bc",
            ),
            ("lifecycle_msgs/srv/GetState", "800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795"),
            ("nav_msgs/msg/MapMetaData", "2772d4b2000ef2b35dbaeb80fd3946c1369f817fb4f75677d916d27c17d763c8"),
            ("nav_msgs/msg/OccupancyGrid", "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"),
            ("nav_msgs/msg/Odometry", "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"),
            ("nav_msgs/msg/Path", "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b"),
            ("nav_msgs/srv/GetMap", "c8ae77c9995b3554b5ba80e4d4d443f970ac65143102a1d893ec24fc07b31147"),
            (
                "rcl_interfaces/msg/FloatingPointRange",
                "e6af23a23c177fee5f3075c8b1e435162a9b63c863d78c06017460b49684262d",
            ),
            ("rcl_interfaces/msg/IntegerRange", "f7b7fdc0f65f07702e099218e13288c3963bcb9345bde78b560e6cd19800fc5a"),
            (
                "rcl_interfaces/msg/ListParametersResult",
                "237ae3428413dcbcfb452b510c42355f3a2b021dc091afa3e18526d57022f1cd",
            ),
            ("rcl_interfaces/msg/Parameter", "ddfe6442cffc462317adb5c92536a7b6dd55858c5c3e1e328165a6b73c2831af"),
            (
                "rcl_interfaces/msg/ParameterDescriptor",
                "52175dbfda6c51153101d33d2a9da05743f66f02d5ab2ca9ec4709b46b73d704",
            ),
            ("rcl_interfaces/msg/ParameterEvent", "043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204"),
            ("rcl_interfaces/msg/ParameterType", "df29ed057a834862187be24dd187d981790ff3ea6502f4cd27b432cbc42c6d46"),
            ("rcl_interfaces/msg/ParameterValue", "115fc089a387e23c7ecd3525c9189c379109119d6ab82e8dfbde0fdf6a7f9b68"),
            (
                "rcl_interfaces/msg/SetParametersResult",
                "cfcc0fb0371ee5159b403960ef4300f8f9d2f1fd6117c8666b7f9654d528a9b1",
            ),
            (
                "rcl_interfaces/srv/DescribeParameters",
                "845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
            ),
            (
                "rcl_interfaces/srv/GetParameterTypes",
                "da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
            ),
            ("rcl_interfaces/srv/GetParameters", "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"),
            ("rcl_interfaces/srv/ListParameters", "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d"),
            ("rcl_interfaces/srv/SetParameters", "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"),
            (
                "rcl_interfaces/srv/SetParametersAtomically",
                "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
            ),
            ("rosgraph_msgs/msg/Clock", "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"),
            ("sensor_msgs/msg/BatteryState", "4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741"),
            ("sensor_msgs/msg/CameraInfo", "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"),
            ("sensor_msgs/msg/CompressedImage", "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"),
            ("sensor_msgs/msg/Image", "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"),
            ("sensor_msgs/msg/Imu", "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"),
            ("sensor_msgs/msg/JointState", "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"),
            ("sensor_msgs/msg/LaserEcho", "0fbc05a0db7d37fe52c0f0375356db55da0046f7ef5bd27ca6b34bd0582bc952"),
            ("sensor_msgs/msg/LaserScan", "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"),
            ("sensor_msgs/msg/MagneticField", "e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff"),
            ("sensor_msgs/msg/MultiEchoLaserScan", "ba5eac341cd5bbb2701527aa4568e8baec172b69cadb9a1945d6f149d087ee48"),
            ("sensor_msgs/msg/NavSatFix", "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"),
            ("sensor_msgs/msg/NavSatStatus", "d1ed3befa628e09571bd273b888ba1c1fd187c9a5e0006b385d7e5e9095a3204"),
            ("sensor_msgs/msg/PointCloud2", "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"),
            ("sensor_msgs/msg/PointField", "5c6a4750728c2bcfbbf7037225b20b02d4429634732146b742dee1726637ef01"),
            ("sensor_msgs/msg/RegionOfInterest", "ad16bcba5f9131dcdba6fbded19f726f5440e3c513b4fb586dd3027eeed8abb1"),
            ("service_msgs/msg/ServiceEventInfo", "41bcbbe07a75c9b52bc96bfd5c24d7f0fc0a08c0cb7921b3373c5732345a6f45"),
            ("std_msgs/msg/ColorRGBA", "77a7a5b9ae477306097665106e0413ba74440245b1f3d0c6d6405fe5c7813fe8"),
            ("std_msgs/msg/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
            ("std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
            ("std_srvs/srv/Empty", "5888399dedec5ccc85ea6451949fd2c9f97bfdf963f9a588821639fcd31b5d19"),
        ] {
            assert_eq!(type_hash(name).unwrap(), format!("RIHS01_{hash}"), "{name}");
        }
    }
}
