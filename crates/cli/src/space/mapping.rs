//! A mapper in space, and everything that is made of its updates.

use super::inertial::Felt;
use super::mesh::{usual_voxel_m, write_meshes};
use super::report::{Beside, Results};
use super::source::Read;
use super::{MAP_SHARE, Simulation, Tally, picture};
use crate::args::{MappingArgs, StampPolicy};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::mapping::{settings_of, take_in};
use crate::maps::{map_file, remove_outdated_maps, ways};
use crate::output::OutputFolder;
use crate::pose_graph::pose_graph;
use crate::progress::Progress;
use crate::session::SessionLog;
use crate::stamps::Stamper;
use crate::timing::StageClock;
use mapwright::{Cloud, Pose3, RunId, Session, Settings, SpaceMapper, SpaceSensor, SpaceSweep, Stamp, Update};
use mapwright_formats::{StampedPose3, TumWriter, write_ply};
use mapwright_graph::g2o::{AnyPoseGraph, write_g2o};
use std::fs::File;

const ONLINE: &str = "trajectory_online.tum";
/// What the mapper knows is taken down once the log has grown by so many bytes, and by so many times what that took.
const FIRST_CHECKPOINT_BYTES: usize = 1 << 16;
const LOG_PER_CHECKPOINT: usize = 16;

/// A mapper in space, and everything that is made of its updates.
pub(super) struct Mapping {
    pub(super) mapper: SpaceMapper,
    pub(super) log: SessionLog<SpaceSweep>,
    pub(super) earlier_losses: Vec<String>,
    pub(super) tally: Tally,
    pub(super) clock: StageClock,
    pub(super) output: OutputFolder,
    online: Option<TumWriter<File>>,
    stamper: Stamper,
    policy: StampPolicy,
    picture_side: Option<u16>,
    progress: Progress,
    /// From so many bytes of the log on all that the mapper knows is taken down again.
    checkpoint_at: usize,
}

impl Mapping {
    pub(super) fn begin(
        args: &MappingArgs,
        output: OutputFolder,
        length: Option<u64>,
        earlier: (Option<Session<SpaceSweep>>, Vec<String>),
    ) -> Result<Self, Failure> {
        Self::begin_with(args, settings_of(args)?, output, length, earlier)
    }

    /// The same with these settings.
    pub(super) fn begin_with(
        args: &MappingArgs,
        settings: Settings,
        mut output: OutputFolder,
        length: Option<u64>,
        (earlier, earlier_losses): (Option<Session<SpaceSweep>>, Vec<String>),
    ) -> Result<Self, Failure> {
        let clock = StageClock::start();
        let log = SessionLog::begin(&mut output, earlier.as_ref())?;
        let mapper = match earlier {
            Some(session) => SpaceMapper::resume(settings, session)?,
            None => SpaceMapper::new(settings)?,
        };
        let online = Some(TumWriter::new(output.begin(ONLINE)?));
        Ok(Self {
            mapper,
            log,
            earlier_losses,
            tally: Tally::default(),
            clock,
            output,
            online,
            stamper: Stamper::new(args.stamps),
            policy: args.stamps,
            picture_side: args.picture_side,
            progress: Progress::new(length, args.voice.quiet || args.voice.json),
            checkpoint_at: FIRST_CHECKPOINT_BYTES,
        })
    }

    pub(super) fn add_cloud(&mut self, cloud: &Cloud) -> Result<(), Failure> {
        let update = self.map(cloud);
        self.write(update)
    }

    /// The same while the robot drives: what came of it, and whether it could be written down.
    pub(super) fn add_cloud_live(&mut self, cloud: &Cloud) -> (Update<SpaceSweep>, Result<(), Failure>) {
        let update = self.map(cloud);
        (update.clone(), self.write(update))
    }

    /// All that was recorded.
    pub(super) fn session(&self) -> &Session<SpaceSweep> {
        self.log.session()
    }

    /// The trajectory as it is known while it is driven begins anew.
    pub(super) fn begin_trajectory(&mut self) -> Result<(), Failure> {
        self.online = Some(TumWriter::new(self.output.begin(ONLINE)?));
        self.tally = Tally::default();
        Ok(())
    }

    fn map(&mut self, cloud: &Cloud) -> Update<SpaceSweep> {
        let update = self.mapper.add_cloud(cloud);
        self.tally.add(cloud, &update);
        self.clock.scan(update.scan);
        self.progress.scan(update.stamp, self.tally.clouds);
        update
    }

    fn write(&mut self, update: Update<SpaceSweep>) -> Result<(), Failure> {
        if let Some(online) = &mut self.online {
            let pose = stamped(self.stamper.next(update.stamp), update.map_from_robot);
            online.write(&pose).map_err(|cause| Failure::write(self.output.path(ONLINE), cause))?;
        }
        self.log.add(update.entries).inspect_err(|_| self.output.failed_to_write())?;
        self.take_down()
    }

    /// Another run begins, wherever its robot is: the next one of the robot that the session ends with.
    pub(super) fn switch_on(&mut self) -> Result<(), Failure> {
        let robot = self.log.session().runs().last().map_or(RunId::of_robot("robot"), |run| run.id);
        let update = self.mapper.switch_on(robot);
        self.log.add(update.entries)
    }

    /// Takes in a session that was mapped apart.
    pub(super) fn import(
        &mut self,
        session: &Session<SpaceSweep>,
        name: &str,
        interrupt: &Interrupt,
    ) -> Result<(), Failure> {
        self.earlier_losses.extend(take_in(&mut self.mapper, &mut self.log, (session, name), interrupt)?);
        Ok(())
    }

    /// All that the mapper knows, from time to time, for a run that goes on after this one was killed.
    fn take_down(&mut self) -> Result<(), Failure> {
        let before = self.log.added_bytes();
        if before < self.checkpoint_at {
            return Ok(());
        }
        self.log.add(self.mapper.checkpoint().entries).inspect_err(|_| self.output.failed_to_write())?;
        let after = self.log.added_bytes();
        self.checkpoint_at = after + (LOG_PER_CHECKPOINT * (after - before)).max(FIRST_CHECKPOINT_BYTES);
        Ok(())
    }

    /// No more clouds will come: old places are looked for anew.
    pub(super) fn look_again(&mut self) -> Result<(), Failure> {
        let update = self.mapper.look_again();
        self.log.add(update.entries)
    }

    pub(super) fn end_of_clouds(&mut self) {
        self.clock.end_of_scans();
        self.progress.finish();
    }

    pub(super) fn write_results(&mut self, read: &Read, simulation: Option<&Simulation>) -> Result<Results, Failure> {
        if let Some(online) = self.online.take() {
            online.finish().map_err(|cause| Failure::write(self.output.path(ONLINE), cause))?;
        }
        self.log.add(self.mapper.checkpoint().entries)?;
        self.log.finish()?;
        let session = self.log.session();
        let resolution_m = self.mapper.resolution_m().unwrap_or(1.0);
        let files = Files { policy: self.policy, picture_side: self.picture_side, resolution_m };
        let Written { way, path_m, map_points } = files.write(&mut self.output, session, read.sensor.as_ref())?;
        let beside = Beside::of(read, &way);
        let truth = simulation.map(|simulation| simulation.judge(&mut self.output, session)).transpose()?;
        let felt = Felt::of(read, &self.mapper);
        Ok(Results::of(session, (&way, path_m), resolution_m, map_points, beside, truth).feeling(felt))
    }

    /// The maps' meshes; what is missing of them, in words.
    pub(super) fn write_meshes(&mut self, threads: usize) -> Result<Vec<String>, Failure> {
        let voxel_m = usual_voxel_m(self.mapper.resolution_m());
        write_meshes(&mut self.output, self.log.session(), (voxel_m, threads))
    }
}

/// How a session's files are written.
struct Files {
    policy: StampPolicy,
    picture_side: Option<u16>,
    /// Side of the smallest voxels.
    resolution_m: f64,
}

/// What was written of a session.
struct Written {
    way: Vec<(Stamp, Pose3)>,
    path_m: f64,
    map_points: usize,
}

impl Files {
    /// Trajectory, graph and maps; `sensor` is the recording's, where that is known.
    fn write(
        &self,
        output: &mut OutputFolder,
        session: &Session<SpaceSweep>,
        sensor: Option<&SpaceSensor>,
    ) -> Result<Written, Failure> {
        let mut stamper = Stamper::new(self.policy);
        let way: Vec<(Stamp, Pose3)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
        output.write("trajectory.tum", |writer| {
            let mut trajectory = TumWriter::new(writer);
            way.iter().try_for_each(|&(stamp, pose)| trajectory.write(&stamped(stamper.next(stamp), pose)))?;
            trajectory.finish().map(|_| ())
        })?;
        let graph = AnyPoseGraph::Spatial(pose_graph(session, session.map_from_keyframe(), |_, _| true));
        output.write("graph.g2o", |writer| Ok(write_g2o(&graph, writer)?))?;
        let first = session.keyframes().first().map(|keyframe| keyframe.sweep.sensor.as_ref());
        let sensor = sensor.or(first).cloned().unwrap_or_else(|| SpaceSensor::lidar("lidar"));
        let maps = session.maps();
        let (ways, path_m) = ways(session, &maps);
        let (mut map_points, point_m) = (0, MAP_SHARE * self.resolution_m);
        for (number, (map, way)) in maps.iter().zip(&ways).enumerate() {
            let points = mapwright::points_of_map(session, map, point_m);
            map_points += points.points_m.len();
            output.write(map_file(number, "ply"), |writer| {
                write_ply(&points.points_m, &points.colours, &points.intensities, writer)
            })?;
            let shown = picture::Shown { map, way, points: &points, point_m };
            let name = map_file(number, "png");
            picture::write(output, &name, (&sensor, session), &shown, self.picture_side)?;
        }
        remove_outdated_maps(output, maps.len());
        Ok(Written { way, path_m, map_points })
    }
}

/// Writes what a session alone tells.
pub(crate) fn write_session(
    output: &mut OutputFolder,
    session: &Session<SpaceSweep>,
    resolution_m: f64,
) -> Result<(), Failure> {
    SessionLog::begin(output, Some(session))?;
    let files = Files { policy: StampPolicy::Log, picture_side: None, resolution_m };
    files.write(output, session, None).map(|_| ())
}

fn stamped(stamp: Stamp, pose: Pose3) -> StampedPose3 {
    StampedPose3::of_pose(stamp, pose)
}
