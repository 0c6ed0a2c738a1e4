//! Requests and responses of mapping, localisation and maps, as slam_toolbox and Nav2 define them.

use super::{OccupancyGrid, Pose, PoseWithCovarianceStamped, Text, message};
use std::borrow::Cow;

message! {
    /// A request or a response that says nothing. DDS has no empty structures: there is one byte without meaning.
    Nothing = [
        "std_srvs/Empty_Request",
        "std_srvs/Empty_Response",
        "lifecycle_msgs/GetState_Request",
        "lifecycle_msgs/GetAvailableStates_Request",
        "lifecycle_msgs/GetAvailableTransitions_Request",
        "nav_msgs/GetMap_Request",
        "nav2_msgs/SetInitialPose_Response",
        "slam_toolbox/DeserializePoseGraph_Response",
        "slam_toolbox/Pause_Request",
        "slam_toolbox/ClearQueue_Request",
    ];
    /// Of no meaning.
    structure_needs_at_least_one_member: u8,
}

message! {
    /// A place and a direction in the plane.
    Pose2D = ["geometry_msgs/Pose2D"];
    /// Metres.
    x: f64,
    /// Metres.
    y: f64,
    /// Radians.
    theta: f64,
}

message! {
    /// The whole map.
    GetMapResponse<'a> = ["nav_msgs/GetMap_Response"];
    /// It.
    map: OccupancyGrid<'a>,
}

message! {
    /// That a map shall be read.
    LoadMapRequest<'a> = ["nav2_msgs/LoadMap_Request"];
    /// A file's name, or `file:` or `package:` and one.
    map_url: Cow<'a, str>,
}

message! {
    /// The map that was read.
    LoadMapResponse<'a> = ["nav2_msgs/LoadMap_Response"];
    /// It, where the result is 0.
    map: OccupancyGrid<'a>,
    /// 0 read, 1 no such map, 2 its cells are wrong, 3 its description is, 255 else.
    result: u8,
}

message! {
    /// Where the robot is.
    SetInitialPoseRequest<'a> = ["nav2_msgs/SetInitialPose_Request"];
    /// The pose.
    pose: PoseWithCovarianceStamped<'a>,
}

message! {
    /// That the map shall be written as an image.
    SaveMapRequest<'a> = ["slam_toolbox/SaveMap_Request"];
    /// Name of the files, without an ending.
    name: Text<'a>,
}

message! {
    /// Whether it was.
    SaveMapResponse = ["slam_toolbox/SaveMap_Response"];
    /// 0 written, 1 there is no map yet, 255 else.
    result: u8,
}

message! {
    /// That the session shall be written.
    SerializePoseGraphRequest<'a> = ["slam_toolbox/SerializePoseGraph_Request"];
    /// The file, without an ending.
    filename: Cow<'a, str>,
}

message! {
    /// Whether it was.
    SerializePoseGraphResponse = ["slam_toolbox/SerializePoseGraph_Response"];
    /// 0 written, 255 not.
    result: u8,
}

message! {
    /// That a session shall be read and continued: slam_toolbox up to Kilted. The response is [`Nothing`].
    DeserializePoseGraphRequest<'a> = ["slam_toolbox/DeserializePoseGraph_Request"];
    /// The file, without an ending.
    filename: Cow<'a, str>,
    /// 0 not said, 1 the robot stands where that session began, 2 at the pose, 3 it localises from the pose on.
    match_type: i8,
    /// Of the robot in the map.
    initial_pose: Pose2D,
}

message! {
    /// The same after Kilted, with a pose of space. It has the same name, and its response has a result.
    DeserializePoseGraphRequest3D<'a> = ["slam_toolbox/DeserializePoseGraph_Request"];
    /// The file, without an ending.
    filename: Cow<'a, str>,
    /// As in [`DeserializePoseGraphRequest`].
    match_type: i8,
    /// Of the robot in the map.
    initial_pose: Pose,
}

message! {
    /// Whether pausing was switched.
    PauseResponse = ["slam_toolbox/Pause_Response"];
    /// Whether it was; not whether it is on.
    status: bool,
}

message! {
    /// That mapping shall begin anew.
    ResetRequest = ["slam_toolbox/Reset_Request"];
    /// Whether it shall wait then.
    pause_new_measurements: bool,
}

message! {
    /// Whether it does.
    ResetResponse = ["slam_toolbox/Reset_Response"];
    /// 0 it does.
    result: u8,
}

message! {
    /// Whether what waited was dropped.
    ClearQueueResponse = ["slam_toolbox/ClearQueue_Response"];
    /// Whether it was.
    status: bool,
}
