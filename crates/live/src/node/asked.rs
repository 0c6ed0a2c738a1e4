//! What others ask of a node that maps or localises.
//!
//! The services, their types and their response codes are those of slam_toolbox (Jazzy and Kilted), of Nav2's AMCL and of Nav2's map server.

use super::{Answer, NodeError, NodeName, bytes_of, decode, decode_nothing};
use mapwright_geom::Pose3;
use mapwright_ros::messages::services::{
    ClearQueueResponse, DeserializePoseGraphRequest, DeserializePoseGraphRequest3D, GetMapResponse, LoadMapRequest,
    LoadMapResponse, Nothing, PauseResponse, ResetRequest, ResetResponse, SaveMapRequest, SaveMapResponse,
    SerializePoseGraphRequest, SerializePoseGraphResponse, SetInitialPoseRequest,
};
use mapwright_ros::messages::{OccupancyGrid, PoseWithCovarianceStamped};

/// What somebody asks for.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Asked {
    /// The map as an image and its description.
    SaveMap {
        /// Name of the files without an ending; may be empty.
        name: String,
    },
    /// The session in a file.
    Serialize {
        /// Name of the file without an ending.
        file: String,
    },
    /// To go on with a session of a file.
    Deserialize {
        /// Name of the file without an ending.
        file: String,
        /// Where the robot stands.
        start: Start,
    },
    /// To take in no more scans, or to take them in again: each request switches.
    Pause,
    /// A new map.
    Reset {
        /// To take in no scans then.
        pause: bool,
    },
    /// To drop the scans that wait.
    ClearQueue,
    /// The map.
    Map,
    /// To look for the robot anywhere.
    FindAnew,
    /// Where the robot is.
    SetPose(PoseGiven),
    /// To match the next scan although the robot stands.
    NoMotionUpdate,
    /// Another map.
    LoadMap {
        /// A file's name, or `file:` or `package:` and one.
        url: String,
    },
}

/// Where the robot is, as somebody says.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseGiven {
    /// The frame, without a slash in front; may be empty.
    pub frame: String,
    /// Pose of the robot in it.
    pub frame_from_robot: Pose3,
    /// Of x, y, z and rotations about the frame's x, y and z axes, row by row; metres and radians, squared.
    pub covariance: Box<[f64; 36]>,
}

/// Where a robot stands whose session is continued.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// It is not said.
    Unsaid,
    /// Where that session began.
    Beginning,
    /// About there in the map, and the map goes on.
    At {
        /// Pose of the robot.
        map_from_robot: Pose3,
    },
    /// About there in the map, which stays as it is.
    LocaliseFrom {
        /// Pose of the robot.
        map_from_robot: Pose3,
    },
}

/// What is answered.
#[derive(Debug, Clone, PartialEq)]
pub enum Said<'a> {
    /// It is done.
    Done,
    /// Whether the node waits now.
    Paused(bool),
    /// The map.
    Map(OccupancyGrid<'a>),
    /// It is not done.
    Refused(Why, String),
}

/// Why something was not done, as far as responses have codes for it; the words are for the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Why {
    /// There is no map yet.
    NoMap,
    /// There is no such file.
    NoSuchFile,
    /// The file cannot be read, or is another kind's.
    Unreadable,
    /// The map's description is not what it should be.
    WrongDescription,
    /// The file cannot be written.
    Unwritable,
    /// The node does something that does not go with it.
    WrongMode,
    /// Anything else, a request that is none among it.
    Other,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Service {
    SaveMap,
    Serialize,
    Deserialize,
    Pause,
    Reset,
    ClearQueue,
    Map,
    FindAnew,
    SetPose,
    NoMotionUpdate,
    LoadMap,
}

/// A service that a node offers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Offered {
    /// Its name, with the namespace.
    pub name: String,
    /// Its type, as `package/srv/Type`.
    pub type_name: &'static str,
    service: Service,
}

/// Names below the node: slam_toolbox's.
const BELOW: [(&str, &str, Service); 7] = [
    ("save_map", "slam_toolbox/srv/SaveMap", Service::SaveMap),
    ("serialize_map", "slam_toolbox/srv/SerializePoseGraph", Service::Serialize),
    ("deserialize_map", "slam_toolbox/srv/DeserializePoseGraph", Service::Deserialize),
    ("pause_new_measurements", "slam_toolbox/srv/Pause", Service::Pause),
    ("reset", "slam_toolbox/srv/Reset", Service::Reset),
    ("clear_queue", "slam_toolbox/srv/ClearQueue", Service::ClearQueue),
    ("dynamic_map", "nav_msgs/srv/GetMap", Service::Map),
];

/// Names beside the node: those of AMCL, and of Nav2's map server.
const BESIDE: [(&str, &str, Service); 5] = [
    ("reinitialize_global_localization", "std_srvs/srv/Empty", Service::FindAnew),
    ("set_initial_pose", "nav2_msgs/srv/SetInitialPose", Service::SetPose),
    ("request_nomotion_update", "std_srvs/srv/Empty", Service::NoMotionUpdate),
    ("map_server/load_map", "nav2_msgs/srv/LoadMap", Service::LoadMap),
    ("map_server/map", "nav_msgs/srv/GetMap", Service::Map),
];

/// The services of a node: slam_toolbox's below its name, AMCL's and the map server's in its namespace. A node that is called `slam_toolbox` has
/// all of them where that, AMCL and the map server have them.
#[must_use]
pub fn offered(node: &NodeName) -> Vec<Offered> {
    let below = BELOW.iter().map(|(name, type_name, service)| (node.below(name), *type_name, *service));
    let beside = BESIDE.iter().map(|(name, type_name, service)| (node.beside(name), *type_name, *service));
    below.chain(beside).map(|(name, type_name, service)| Offered { name, type_name, service }).collect()
}

impl Offered {
    /// What a request asks for.
    ///
    /// # Errors
    /// [`NodeError::Message`] where the bytes are no such request, [`NodeError::Request`] for a pose that is none.
    pub fn asked(&self, request: &[u8]) -> Result<Asked, NodeError> {
        let without = |asked| decode_nothing(request).map(|()| asked).map_err(NodeError::from);
        match self.service {
            Service::SaveMap => {
                let name = decode::<SaveMapRequest<'_>>(request)?.name.data.into_owned();
                Ok(Asked::SaveMap { name })
            }
            Service::Serialize => {
                let file = decode::<SerializePoseGraphRequest<'_>>(request)?.filename.into_owned();
                Ok(Asked::Serialize { file })
            }
            Service::Deserialize => deserialize(request),
            Service::Pause => without(Asked::Pause),
            Service::Reset => Ok(Asked::Reset { pause: decode::<ResetRequest>(request)?.pause_new_measurements }),
            Service::ClearQueue => without(Asked::ClearQueue),
            Service::Map => without(Asked::Map),
            Service::FindAnew => without(Asked::FindAnew),
            Service::SetPose => pose_given(&decode::<SetInitialPoseRequest<'_>>(request)?.pose).map(Asked::SetPose),
            Service::NoMotionUpdate => without(Asked::NoMotionUpdate),
            Service::LoadMap => Ok(Asked::LoadMap { url: decode::<LoadMapRequest<'_>>(request)?.map_url.into_owned() }),
        }
    }

    /// The response. A refusal has the service's own code where it has one; [`Why`] says which.
    #[must_use]
    pub fn response(&self, said: &Said<'_>) -> Vec<u8> {
        let why = if let Said::Refused(why, _) = said { Some(*why) } else { None };
        let map = || if let Said::Map(map) = said { map.clone() } else { OccupancyGrid::default() };
        let result = why.map_or(0, |why| self.code(why));
        match self.service {
            Service::SaveMap => bytes_of(&SaveMapResponse { result }),
            Service::Serialize => bytes_of(&SerializePoseGraphResponse { result }),
            // nothing up to Kilted, and the result after it: one byte both
            Service::Deserialize => bytes_of(&Nothing { structure_needs_at_least_one_member: result }),
            Service::Reset => bytes_of(&ResetResponse { result }),
            Service::Pause => bytes_of(&PauseResponse { status: why.is_none() }),
            Service::ClearQueue => bytes_of(&ClearQueueResponse { status: why.is_none() }),
            Service::Map => bytes_of(&GetMapResponse { map: map() }),
            Service::LoadMap => bytes_of(&LoadMapResponse { map: map(), result }),
            Service::FindAnew | Service::SetPose | Service::NoMotionUpdate => bytes_of(&Nothing::default()),
        }
    }

    /// The response to a request, of which `act` does what is asked for. A request that is none is refused without it.
    pub fn answer<'m>(&self, request: &[u8], act: impl FnOnce(Asked) -> Said<'m>) -> Answer {
        let said = match self.asked(request) {
            Ok(asked) => act(asked),
            Err(error) => Said::Refused(Why::Other, error.to_string()),
        };
        let bytes = self.response(&said);
        let refusal = if let Said::Refused(_, words) = said { Some(format!("{}: {words}", self.name)) } else { None };
        Answer { bytes, refusal }
    }

    fn code(&self, why: Why) -> u8 {
        match (self.service, why) {
            (Service::SaveMap, Why::NoMap) | (Service::Deserialize | Service::LoadMap, Why::NoSuchFile) => 1,
            (Service::Deserialize, Why::WrongMode) | (Service::LoadMap, Why::Unreadable) => 2,
            (Service::Deserialize, Why::Unreadable) | (Service::LoadMap, Why::WrongDescription) => 3,
            _ => 255,
        }
    }
}

/// Where the robot is, of a message of the topic `initialpose` or of a request.
///
/// # Errors
/// [`NodeError::Request`] where its numbers are no pose.
pub fn pose_given(message: &PoseWithCovarianceStamped<'_>) -> Result<PoseGiven, NodeError> {
    let covariance = message.pose.covariance.0;
    if let Some(found) = covariance.iter().find(|number| !number.is_finite()) {
        let found = found.to_string();
        return Err(NodeError::Request { what: "the pose's covariance", expected: "36 finite numbers", found });
    }
    let frame_from_robot = finite(message.pose.pose.to_pose3())?;
    Ok(PoseGiven { frame: message.header.frame().to_owned(), frame_from_robot, covariance: Box::new(covariance) })
}

fn finite(pose: Option<Pose3>) -> Result<Pose3, NodeError> {
    let found = || "a quaternion without a direction, or numbers that are not finite".to_owned();
    pose.filter(|pose| pose.is_finite()).ok_or_else(|| NodeError::Request {
        what: "the pose",
        expected: "a place and a rotation",
        found: found(),
    })
}

/// With a pose of the plane, or where there is room for it of space.
fn deserialize(request: &[u8]) -> Result<Asked, NodeError> {
    let (file, kind, pose) = match decode::<DeserializePoseGraphRequest3D<'_>>(request) {
        Ok(spatial) => (spatial.filename, spatial.match_type, spatial.initial_pose.to_pose3()),
        Err(_) => {
            let planar = decode::<DeserializePoseGraphRequest<'_>>(request)?;
            let pose = planar.initial_pose;
            let (sin, cos) = (0.5 * pose.theta).sin_cos();
            let pose = Pose3::from_quaternion([pose.x, pose.y, 0.0], [0.0, 0.0, sin, cos]);
            (planar.filename, planar.match_type, pose)
        }
    };
    let start = match kind {
        0 => Start::Unsaid,
        1 => Start::Beginning,
        2 => Start::At { map_from_robot: finite(pose)? },
        3 => Start::LocaliseFrom { map_from_robot: finite(pose)? },
        other => {
            let found = other.to_string();
            return Err(NodeError::Request { what: "match_type", expected: "a number from 0 to 3", found });
        }
    };
    Ok(Asked::Deserialize { file: file.into_owned(), start })
}
