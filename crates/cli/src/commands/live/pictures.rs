//! The map as others see it: a grid of the plane, points of space.

use super::asking::Reply;
use super::drawer::{Drawer, Drawn, Wanted, with_ending};
use super::goals::Goals;
use super::robot::Names;
use crate::failure::Failure;
use crate::floor::{RESOLUTION_M, floor_image};
use crate::image::map_image;
use crate::output::write_whole;
use mapwright::{
    GlobalMap, MapPoints, OccupancySettings, Pose2, Pose3, Session, SpaceMap, SpaceSweep, Stamp, Update, points_of,
    usual_range_m,
};
use mapwright_formats::{GridImage, UNKNOWN, write_map_yaml, write_pgm, write_ply};
use mapwright_live::node::asked::Why;
use mapwright_live::outgoing::{Grid, in_space, points, pose, pose_in_space};
use mapwright_live::wire::{Delivery, Publisher, Topic, Wire};
use mapwright_logs::SliceBounds;
use mapwright_ros::RosError;
use mapwright_sensor::Sweep;
use std::path::Path;

const LATEST: Delivery = Delivery::Latched { depth: 1 };
/// Side of the cubes of which one point each is told of a map of space, as a share of the usual range.
const CUBE_SHARE: f64 = 0.005;

/// Where a grid goes.
struct GridTopics {
    map: Box<dyn Publisher>,
    metadata: Box<dyn Publisher>,
    updates: Box<dyn Publisher>,
    frame: String,
    /// What was told last.
    told: Option<Grid>,
}

impl GridTopics {
    fn advertise(wire: &mut dyn Wire, names: &Names) -> Result<Self, Failure> {
        let mut topic = |ending, kind, delivery| {
            wire.advertise(&Topic::new(&format!("{}{ending}", names.map_topic), kind, delivery))
        };
        let map = topic("", "nav_msgs/msg/OccupancyGrid", LATEST)?;
        let metadata = topic("_metadata", "nav_msgs/msg/MapMetaData", LATEST)?;
        let updates = topic("_updates", "map_msgs/msg/OccupancyGridUpdate", Delivery::Reliable { depth: 1 })?;
        Ok(Self { map, metadata, updates, frame: names.map_frame.clone(), told: None })
    }

    /// The map whole for who comes later, and where its cells are the same what has changed, for those who have it: that comes first and is small.
    /// What cannot be sent now is sent with the next one.
    fn tell(&mut self, grid: Grid) {
        let rectangle = self.told.as_ref().and_then(|told| grid.changed(told)).filter(|[_, size]| *size != grid.size);
        let updated = rectangle.map(|rectangle| grid.update(&self.frame, rectangle));
        let _ = updated.map(|message| message.map(|bytes| self.updates.publish(&bytes)));
        let _ = grid.metadata().map(|bytes| self.metadata.publish(&bytes));
        let _ = grid.message(&self.frame).map(|bytes| self.map.publish(&bytes));
        self.told = Some(grid);
    }
}

/// Where a map of the plane goes.
pub(super) struct GridOutlet {
    topics: GridTopics,
    /// Where the robot should go, if that is asked for.
    goals: Option<Goals>,
}

impl Drawn for Sweep {
    const IS_IN_SPACE: bool = false;

    type Canvas = GlobalMap;
    type Outlet = GridOutlet;

    fn advertise(wire: &mut dyn Wire, names: &Names, wanted: &Wanted<'_>) -> Result<GridOutlet, Failure> {
        let topics = GridTopics::advertise(wire, names)?;
        let goals = wanted.explores.then(|| {
            let to = (names.goal_topic.as_str(), names.map_frame.as_str());
            Goals::advertise(wire, to, wanted.settings, (wanted.radius_m, wanted.known))
        });
        Ok(GridOutlet { topics, goals: goals.transpose()? })
    }

    fn canvas(drawer: &Drawer<Self>) -> GlobalMap {
        GlobalMap::without_normals(&drawer.settings)
    }

    fn tell(drawer: &Drawer<Self>, map: &mut GlobalMap, outlet: &mut GridOutlet) {
        outlet.topics.tell(grid(drawer, &image(drawer, map)));
        let now = (drawer.clock.since_start(), drawer.clock.stamp().unwrap_or(Stamp(0)));
        let passes_per_hit = drawer.settings.map.passes_per_hit;
        let words = outlet.goals.as_mut().and_then(|goals| goals.decide(map.counts(), passes_per_hit, now));
        words.into_iter().for_each(|words| drawer.node.note(words));
    }

    fn said(drawer: &Drawer<Self>, map: &mut GlobalMap) -> Reply {
        Reply::Map(grid(drawer, &image(drawer, map)))
    }

    /// The map as Nav2 reads it.
    fn save(drawer: &Drawer<Self>, map: &mut GlobalMap, path: &Path) -> Result<(), Failure> {
        save_grid(&image(drawer, map), path)
    }

    fn in_space(pose: Pose2) -> Pose3 {
        in_space(pose)
    }

    fn pose(frame: &str, update: &Update<Self>) -> Result<Vec<u8>, RosError> {
        pose(frame, update.stamp, update.map_from_robot, &update.covariance)
    }
}

fn image(drawer: &Drawer<Sweep>, map: &mut GlobalMap) -> GridImage {
    map.follow(&drawer.session, 1);
    map_image(map.counts(), drawer.settings.map.passes_per_hit).image
}

fn save_grid(image: &GridImage, path: &Path) -> Result<(), Failure> {
    let pgm = with_ending(path, "pgm");
    let name = pgm.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let failed = |cause| Failure::write(&pgm, cause);
    write_whole(&pgm, |writer| write_pgm(image, writer).map_err(failed))?;
    write_whole(&with_ending(path, "yaml"), |writer| write_map_yaml(image, &name, writer).map_err(failed))
}

fn grid<M: Drawn>(drawer: &Drawer<M>, image: &GridImage) -> Grid {
    Grid {
        stamp: drawer.clock.stamp().unwrap_or(Stamp(0)),
        resolution_m: image.resolution_m,
        size: [image.width as u32, image.height as u32],
        origin: image.world_from_map,
        cells: image.cells.iter().map(|&cell| if cell == UNKNOWN { -1 } else { cell.min(100) as i8 }).collect(),
    }
}

/// Where a map of space goes.
pub(super) struct PointsOutlet {
    points: Box<dyn Publisher>,
    frame: String,
    /// A floor plan, where one is asked for.
    grid: Option<GridTopics>,
}

/// What stands in the way of a robot that drives, kept in step with the map of space.
pub(super) struct Floor {
    map: SpaceMap,
    band: SliceBounds,
    /// Why there is none, as it was said last.
    said: Option<String>,
}

impl Floor {
    fn image(&mut self, session: &Session<SpaceSweep>) -> Result<GridImage, String> {
        self.map.follow(session);
        floor_image(self.map.occupancy(), session, self.band)
    }
}

impl Drawn for SpaceSweep {
    const IS_IN_SPACE: bool = true;

    type Canvas = Option<Floor>;
    type Outlet = PointsOutlet;

    fn advertise(wire: &mut dyn Wire, names: &Names, wanted: &Wanted<'_>) -> Result<PointsOutlet, Failure> {
        let topic = Topic::new(&format!("{}_points", names.map_topic), "sensor_msgs/msg/PointCloud2", LATEST);
        let grid = wanted.band.map(|_| GridTopics::advertise(wire, names)).transpose()?;
        Ok(PointsOutlet { points: wire.advertise(&topic)?, frame: names.map_frame.clone(), grid })
    }

    fn canvas(drawer: &Drawer<Self>) -> Option<Floor> {
        let settings = OccupancySettings { resolution_m: RESOLUTION_M, ..OccupancySettings::default() };
        drawer.band.map(|band| Floor { map: SpaceMap::new(settings), band, said: None })
    }

    fn tell(drawer: &Drawer<Self>, floor: &mut Option<Floor>, outlet: &mut PointsOutlet) {
        let stamp = drawer.clock.stamp().unwrap_or(Stamp(0));
        // What cannot be sent now is sent with the next one.
        let _ = points(&outlet.frame, stamp, &all_points(drawer).points_m).map(|bytes| outlet.points.publish(&bytes));
        let (Some(floor), Some(topics)) = (floor, &mut outlet.grid) else { return };
        match floor.image(&drawer.session) {
            Ok(image) => topics.tell(grid(drawer, &image)),
            Err(words) if floor.said.as_ref() != Some(&words) => {
                drawer.node.note(format!("no grid is told: {words}"));
                floor.said = Some(words);
            }
            Err(_) => {}
        }
    }

    fn said(drawer: &Drawer<Self>, floor: &mut Option<Floor>) -> Reply {
        match floor.as_mut().map(|floor| floor.image(&drawer.session)) {
            Some(Ok(image)) => Reply::Map(grid(drawer, &image)),
            Some(Err(words)) => Reply::refused(Why::Other, words),
            None => Reply::refused(
                Why::WrongMode,
                "clouds are mapped: the topic of its points has the map, and with --band it has a grid as well",
            ),
        }
    }

    fn save(drawer: &Drawer<Self>, floor: &mut Option<Floor>, path: &Path) -> Result<(), Failure> {
        let (points, ply) = (all_points(drawer), with_ending(path, "ply"));
        let failed = |cause| Failure::write(&ply, cause);
        write_whole(&ply, |writer| {
            write_ply(&points.points_m, &points.colours, &points.intensities, writer).map_err(failed)
        })?;
        let Some(floor) = floor else { return Ok(()) };
        let image = floor.image(&drawer.session).map_err(|words| Failure::write_in_words(path, &words))?;
        save_grid(&image, path)
    }

    fn in_space(pose: Pose3) -> Pose3 {
        pose
    }

    fn pose(frame: &str, update: &Update<Self>) -> Result<Vec<u8>, RosError> {
        pose_in_space(frame, update.stamp, update.map_from_robot, &update.covariance)
    }
}

/// One point in each cube of a share of the usual range, as far apart as walls are told apart there.
fn all_points(drawer: &Drawer<SpaceSweep>) -> MapPoints {
    points_of(&drawer.session, CUBE_SHARE * usual_range_m(&drawer.session))
}
