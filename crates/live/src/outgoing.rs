//! What others are told, as messages of ROS 2 in CDR.

use mapwright_geom::{Cov3, Cov6, Pose2, Pose3, Stamp};
use mapwright_ros::messages::{
    Header, MapMetaData, OccupancyGrid, OccupancyGridUpdate, PointCloud2, PointField, PoseStamped, PoseWithCovariance,
    PoseWithCovarianceStamped, TfMessage, TransformStamped,
};
use mapwright_ros::{Encoding, RosError, encode};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

/// Height, roll and pitch are not estimated in the plane, m^2 and rad^2: as Nav2's nodes say it.
const NOT_ESTIMATED: f64 = 1e-6;

/// A map to be told.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// When it was drawn.
    pub stamp: Stamp,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Cells along x and y.
    pub size: [u32; 2],
    /// Pose of the outer corner of the first cell in the map's frame.
    pub origin: Pose2,
    /// Probability in percent that a cell is occupied, -1 where not known; rows along x from the origin on.
    pub cells: Vec<i8>,
}

impl Grid {
    /// Where its cells are.
    fn info(&self) -> MapMetaData {
        let [width, height] = self.size;
        let (map_load_time, resolution) = (self.stamp, self.resolution_m as f32);
        MapMetaData { map_load_time, resolution, width, height, origin: in_space(self.origin).into() }
    }

    /// `nav_msgs/OccupancyGrid` of a frame.
    ///
    /// # Errors
    /// [`RosError`] where it has more cells than a message can.
    pub fn message(&self, frame: &str) -> Result<Vec<u8>, RosError> {
        encode(&self.as_message(frame), Encoding::Cdr)
    }

    /// The same, to be a part of another message.
    #[must_use]
    pub fn as_message<'a>(&'a self, frame: &'a str) -> OccupancyGrid<'a> {
        OccupancyGrid { header: Header::new(self.stamp, frame), info: self.info(), data: self.cells[..].into() }
    }

    /// `map_msgs/OccupancyGridUpdate` of a rectangle of cells.
    ///
    /// # Errors
    /// [`RosError`] for a stamp that is none.
    pub fn update(&self, frame: &str, rectangle: [[u32; 2]; 2]) -> Result<Vec<u8>, RosError> {
        let [[x, y], [width, height]] = rectangle;
        let (header, data) = (Header::new(self.stamp, frame), self.part(rectangle));
        let [x, y] = [x, y].map(|cell| i32::try_from(cell).unwrap_or(i32::MAX));
        encode(&OccupancyGridUpdate { header, x, y, width, height, data: data[..].into() }, Encoding::Cdr)
    }

    /// `nav_msgs/MapMetaData`.
    ///
    /// # Errors
    /// [`RosError`] where its stamp is none.
    pub fn metadata(&self) -> Result<Vec<u8>, RosError> {
        encode(&self.info(), Encoding::Cdr)
    }

    /// The rectangle of cells in which it differs from an earlier one of the same cells: its first cell, and its size; none where nothing
    /// differs. Where the cells are others it is all of it.
    #[must_use]
    pub fn changed(&self, earlier: &Self) -> Option<[[u32; 2]; 2]> {
        let [width, height] = self.size;
        if (earlier.size, earlier.resolution_m, earlier.origin) != (self.size, self.resolution_m, self.origin) {
            return Some([[0, 0], self.size]);
        }
        let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
        let rows =
            (0..height).zip(self.cells.chunks(width.max(1) as usize).zip(earlier.cells.chunks(width.max(1) as usize)));
        for (y, (now, then)) in rows {
            let differs = |(a, b): (&i8, &i8)| a != b;
            let Some(first) = now.iter().zip(then).position(differs) else { continue };
            let last = now.len() - 1 - now.iter().rev().zip(then.iter().rev()).position(differs).unwrap_or(0);
            low = [low[0].min(first as u32), low[1].min(y)];
            high = [high[0].max(last as u32), y];
        }
        (low[0] != u32::MAX).then(|| [low, [high[0] - low[0] + 1, high[1] - low[1] + 1]])
    }

    /// The cells of a rectangle, row by row; empty where it is not inside.
    #[must_use]
    pub fn part(&self, [[x, y], [width, height]]: [[u32; 2]; 2]) -> Vec<i8> {
        let row = |y: u32| {
            let from = y as usize * self.size[0] as usize + x as usize;
            self.cells.get(from..from + width as usize)
        };
        let rows: Option<Vec<_>> = (y..y.saturating_add(height)).map(row).collect();
        rows.unwrap_or_default().concat()
    }
}

/// A transform to be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link<'a> {
    /// The frame above.
    pub parent: &'a str,
    /// The frame below.
    pub child: &'a str,
    /// Until when it holds.
    pub stamp: Stamp,
    /// Pose of the child in the parent.
    pub parent_from_child: Pose3,
}

/// `tf2_msgs/TFMessage` of these transforms.
///
/// # Errors
/// [`RosError`] for a stamp that is none.
pub fn transforms(links: &[Link<'_>]) -> Result<Vec<u8>, RosError> {
    let transforms = links.iter().map(|link| TransformStamped {
        header: Header::new(link.stamp, link.parent),
        child_frame_id: link.child.into(),
        transform: link.parent_from_child.into(),
    });
    encode(&TfMessage { transforms: transforms.collect() }, Encoding::Cdr)
}

/// `geometry_msgs/PoseWithCovarianceStamped` of the robot in a frame; `covariance` is a right perturbation (m^2, m rad, rad^2), as updates
/// have it, and is turned into the frame's axes.
///
/// # Errors
/// [`RosError`] for a stamp that is none.
pub fn pose(frame: &str, stamp: Stamp, map_from_robot: Pose2, covariance: &Cov3) -> Result<Vec<u8>, RosError> {
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), map_from_robot.theta);
    let in_map = turned.matrix() * covariance * turned.matrix().transpose();
    let mut message = PoseWithCovariance { pose: in_space(map_from_robot).into(), ..PoseWithCovariance::default() };
    let places = [0, 1, 5];
    let entries = &mut message.covariance.0;
    (0..6).filter(|k| !places.contains(k)).for_each(|k| entries[7 * k] = NOT_ESTIMATED);
    for (row, at) in places.into_iter().enumerate() {
        for (column, across) in places.into_iter().enumerate() {
            entries[6 * at + across] = in_map[(row, column)];
        }
    }
    encode(&PoseWithCovarianceStamped { header: Header::new(stamp, frame), pose: message }, Encoding::Cdr)
}

/// `geometry_msgs/PoseStamped` in a frame.
///
/// # Errors
/// [`RosError`] for a stamp that is none.
pub fn goal(frame: &str, stamp: Stamp, map_from_goal: Pose2) -> Result<Vec<u8>, RosError> {
    let message = PoseStamped { header: Header::new(stamp, frame), pose: in_space(map_from_goal).into() };
    encode(&message, Encoding::Cdr)
}

/// `geometry_msgs/PoseWithCovarianceStamped` of a robot in space, whose covariance is of its position and its rotation vector.
///
/// # Errors
/// [`RosError`] for a stamp that is none.
pub fn pose_in_space(frame: &str, stamp: Stamp, map_from_robot: Pose3, covariance: &Cov6) -> Result<Vec<u8>, RosError> {
    let rotation = map_from_robot.rotation.to_rotation_matrix();
    let mut turned = Cov6::zeros();
    turned.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    turned.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    let in_map = turned * covariance * turned.transpose();
    let mut message = PoseWithCovariance { pose: map_from_robot.into(), ..PoseWithCovariance::default() };
    let entries = &mut message.covariance.0;
    (0..36).for_each(|at| entries[at] = in_map[(at / 6, at % 6)]);
    encode(&PoseWithCovarianceStamped { header: Header::new(stamp, frame), pose: message }, Encoding::Cdr)
}

/// `sensor_msgs/PointCloud2` of points in a frame, metres.
///
/// # Errors
/// [`RosError`] for a stamp that is none, or where there are more points than a message can have.
pub fn points(frame: &str, stamp: Stamp, points_m: &[[f32; 3]]) -> Result<Vec<u8>, RosError> {
    /// Bytes of a point: three numbers of four bytes.
    const STEP: u32 = 12;
    /// What PointField calls them.
    const FLOAT32: u8 = 7;
    let field =
        |(name, offset): (&'static str, u32)| PointField { name: name.into(), offset, datatype: FLOAT32, count: 1 };
    let width = u32::try_from(points_m.len()).unwrap_or(u32::MAX);
    let data: Vec<u8> = points_m.iter().flatten().flat_map(|coordinate| coordinate.to_le_bytes()).collect();
    let message = PointCloud2 {
        header: Header::new(stamp, frame),
        height: 1,
        width,
        fields: [("x", 0), ("y", 4), ("z", 8)].map(field).into(),
        is_bigendian: false,
        point_step: STEP,
        row_step: STEP.saturating_mul(width),
        data: &data,
        is_dense: true,
    };
    encode(&message, Encoding::Cdr)
}

/// A pose of the plane in space.
#[must_use]
pub fn in_space(pose: Pose2) -> Pose3 {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta);
    Pose3 { translation: Vector3::new(pose.x, pose.y, 0.0), rotation }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_ros::{Channel, Decoder};
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn channel(kind: &str) -> Channel {
        Channel::new(kind, Encoding::Cdr, None).unwrap()
    }

    #[test]
    fn a_pose_has_its_covariance_in_the_maps_axes() {
        // 3 along the robot's way, which is the map's y
        let covariance = Cov3::from_diagonal(&Vector3::new(3.0, 1.0, 0.5));
        let bytes = pose("map", Stamp(5), Pose2::new(1.0, 2.0, FRAC_PI_2), &covariance).unwrap();
        let mut decoder: Decoder<PoseWithCovarianceStamped<'static>> =
            Decoder::new(&channel("geometry_msgs/PoseWithCovarianceStamped")).unwrap();
        let read = decoder.decode(&bytes).unwrap();
        let entries = read.pose.covariance.0;
        assert!(
            (entries[0] - 1.0).abs() < 1e-12 && (entries[7] - 3.0).abs() < 1e-12 && entries[35] == 0.5,
            "{entries:?}"
        );
        assert_eq!((entries[14], read.header.frame(), read.header.stamp), (NOT_ESTIMATED, "map", Stamp(5)));
    }

    #[test]
    fn a_pose_in_space_has_its_covariance_in_the_maps_axes() {
        // 3 along the robot's way, which is the map's y; 0.5 about its upright axis, which is the map's
        let covariance = Cov6::from_diagonal(&[3.0, 1.0, 2.0, 0.1, 0.2, 0.5].into());
        let map_from_robot = in_space(Pose2::new(1.0, 2.0, FRAC_PI_2));
        let bytes = pose_in_space("map", Stamp(5), map_from_robot, &covariance).unwrap();
        let mut decoder: Decoder<PoseWithCovarianceStamped<'static>> =
            Decoder::new(&channel("geometry_msgs/PoseWithCovarianceStamped")).unwrap();
        let entries = decoder.decode(&bytes).unwrap().pose.covariance.0;
        let found = [0, 7, 14, 21, 28, 35].map(|at| (1e9 * entries[at]).round() / 1e9);
        assert_eq!(found, [1.0, 3.0, 2.0, 0.2, 0.1, 0.5]);
    }

    #[test]
    fn points_are_read_as_they_were() {
        let told = [[1.0, -2.0, 3.5], [0.0, 0.25, -7.0]];
        let bytes = points("map", Stamp(5), &told).unwrap();
        let mut decoder: Decoder<PointCloud2<'static>> = Decoder::new(&channel("sensor_msgs/PointCloud2")).unwrap();
        let read = decoder.decode(&bytes).unwrap();
        assert_eq!(mapwright_ros::Cloud::new(&read).unwrap().to_points().points_m, told);
    }

    #[test]
    fn a_map_is_told_with_its_corner() {
        let grid = Grid {
            stamp: Stamp(7),
            resolution_m: 0.05,
            size: [2, 3],
            origin: Pose2::new(-1.0, 4.0, 0.0),
            cells: vec![-1, 0, 100, 65, 20, -1],
        };
        let bytes = grid.message("map").unwrap();
        let mut decoder: Decoder<OccupancyGrid<'static>> = Decoder::new(&channel("nav_msgs/OccupancyGrid")).unwrap();
        let read = decoder.decode(&bytes).unwrap();
        assert_eq!((read.info.width, read.info.height, read.info.origin.position.y), (2, 3, 4.0));
        assert_eq!(read.data.to_vec(), grid.cells);
    }

    proptest! {
        #[test]
        fn what_has_changed_makes_the_new_map_of_the_old(
            then in prop::collection::vec(-1..2_i8, 35),
            now in prop::collection::vec(-1..2_i8, 35),
        ) {
            let grid = |cells| Grid { stamp: Stamp(1), resolution_m: 0.05, size: [5, 7], origin: Pose2::IDENTITY, cells };
            let (mut then, now) = (grid(then), grid(now));
            if let Some(rectangle) = now.changed(&then) {
                let [[x, y], [width, height]] = rectangle;
                let part = now.part(rectangle);
                prop_assert_eq!(part.len() as u32, width * height);
                for (k, cell) in part.into_iter().enumerate() {
                    let (row, column) = (y + k as u32 / width, x + k as u32 % width);
                    then.cells[(row * 5 + column) as usize] = cell;
                }
            }
            prop_assert_eq!(then.cells, now.cells);
        }
    }
}
