//! Recordings of sensors in space: clouds in, files out.

mod disk;
mod going_on;
mod inertial;
mod messages;
mod picture;
mod report;
mod seek;
mod simulated;
mod source;
mod tally;
mod verdict;

pub(crate) use disk::Disk;
pub(crate) use messages::plan_in_words;
pub(crate) use picture::up;
pub(crate) use report::{notes_in_words, notes_json};
pub(crate) use seek::{Sought, seek};
pub(crate) use simulated::Simulation;
pub(crate) use source::Source;

use crate::args::{MappingArgs, SourceArgs};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::mapping::settings_of;
use crate::maps::{map_file, remove_outdated_exports, remove_outdated_maps, ways};
use crate::output::OutputFolder;
use crate::pose_graph::pose_graph;
use crate::progress::Progress;
use crate::report::written;
use crate::session::{EarlierInSpace, SessionLog, earlier_in_space, to_go_on_with_in_space};
use crate::stamps::Stamper;
use crate::terminal::{say, say_json};
use crate::timing::StageClock;
use going_on::GoesOn;
use inertial::Felt;
use mapwright::{Cloud, ImuReading, Pose3, Session, SpaceMapper, SpaceSweep, Stamp, Update};
use mapwright_formats::{StampedPose3, TumWriter, write_ply};
use mapwright_graph::g2o::{AnyPoseGraph, write_g2o};
use report::{Beside, Results};
use serde_json::json;
use std::fs::File;
use std::path::Path;
pub(crate) use tally::Tally;
pub(crate) use verdict::Facts as SpaceFacts;

const ONLINE: &str = "trajectory_online.tum";
/// Of the points of the finished map one is kept in each cube of such a side, of the smallest voxel's.
pub(crate) const MAP_SHARE: f64 = 0.1;

/// What the mapper knows is taken down once the log has grown by so many bytes, and by so many times what that took.
const FIRST_CHECKPOINT_BYTES: usize = 1 << 16;
const LOG_PER_CHECKPOINT: usize = 16;

/// What is said of a source that the recording of space at hand has no use for is wrong usage.
pub(crate) fn check_choice(args: &SourceArgs, is_of_files: bool) -> Result<(), Failure> {
    let choice = args.choice();
    if choice.range_unit_m.is_some() {
        return Err(Failure::Usage(
            "--range-unit is for scans of planar lasers, found a recording of space".to_owned(),
        ));
    }
    match choice.of_recordings().filter(|_| is_of_files) {
        Some(option) => Err(Failure::Usage(format!(
            "{option} is for recordings of messages, found files, which have no such thing"
        ))),
        None => Ok(()),
    }
}

/// What is mapped, under which name, where the results go, and how.
pub(crate) struct Run<'a> {
    pub(crate) name: &'a str,
    pub(crate) output: &'a Path,
    pub(crate) mapping: &'a MappingArgs,
    /// Go on with the session in the folder of results.
    pub(crate) goes_on: bool,
}

impl Run<'_> {
    /// The session that is gone on with.
    fn earlier(&self) -> Result<Option<EarlierInSpace>, Failure> {
        if self.goes_on {
            return to_go_on_with_in_space(self.output).map(Some);
        }
        self.mapping.resume.as_ref().map(|path| earlier_in_space(path)).transpose()
    }
}

/// Maps such a recording, or a simulated one.
pub(crate) fn map(args: &Run<'_>, mut source: Source<'_>, interrupt: &Interrupt) -> Result<Outcome, Failure> {
    if args.mapping.start.is_some() {
        let reason = "--start is for logs of planar lasers: maps of space begin at their origin";
        return Err(Failure::Log(reason.to_owned()));
    }
    let name = args.name;
    let mut readings: Vec<ImuReading> = Vec::new();
    let mut next = source.next_cloud(&mut |reading| readings.push(reading))?;
    let mut earlier = args.earlier()?;
    let earlier_losses = earlier.iter_mut().flat_map(|earlier| std::mem::take(&mut earlier.losses)).collect();
    let mut went_on = earlier.map(|earlier| GoesOn::with(earlier, next.as_ref()));
    if args.goes_on && went_on.as_ref().is_some_and(|went_on| !went_on.is_same) {
        return Err(Failure::Usage(format!(
            "--continue goes on with the recording that the session in {} is made of, found another one; what was recorded right after it, \
             in a file of its own, goes on with --resume {} into another folder",
            args.output.display(),
            args.output.display()
        )));
    }
    let session = went_on.as_mut().and_then(|went_on| went_on.session.take());
    let output = OutputFolder::create(args.output)?;
    let mut mapping = Mapping::begin(args.mapping, output, source.frames(), (session, earlier_losses))?;
    let mut is_cut = false;
    while let Some(cloud) = next {
        let is_new = went_on.as_mut().map_or(Ok(true), |went_on| went_on.is_new(&cloud)).map_err(Failure::Log)?;
        if is_new {
            readings.drain(..).for_each(|reading| {
                mapping.mapper.add_imu(reading);
            });
            mapping.add_cloud(&cloud)?;
        }
        is_cut = interrupt.came();
        if is_cut {
            break;
        }
        // Before a cloud that the session has come readings that its mapper knows.
        readings.clear();
        next = source.next_cloud(&mut |reading| readings.push(reading))?;
        if went_on.as_ref().is_some_and(|went_on| !went_on.is_through()) {
            readings.clear();
        }
    }
    mapping.end_of_clouds();
    let missing = went_on.as_ref().map_or(0, GoesOn::missing);
    if missing > 0 && !is_cut {
        return Err(Failure::Log(format!(
            "{name}: expected a recording of which the session has the beginning, found one that ends {missing} clouds before the session does"
        )));
    }
    let notes = source.notes();
    let (mut losses, mut odd) = source.damages();
    losses.append(&mut mapping.earlier_losses);
    let (lost, noted) = notes_in_words(&notes);
    losses.extend(lost);
    odd.extend(noted);
    if is_cut {
        losses.push(format!("interrupted after {} clouds; the results are complete up to there", mapping.tally.clouds));
    }
    if mapping.mapper.session().keyframes().is_empty() {
        return Err(Failure::Log(format!(
            "{name}: expected clouds with at least 100 returns, found none in {} clouds: there is nothing to map",
            mapping.tally.clouds
        )));
    }
    let results = mapping.write_results(&source)?;
    odd.extend(results.odd());
    losses.extend(results.losses());
    let usable = SpaceFacts::of(&mapping.tally, &mut mapping.mapper).judged();
    let all_losses: Vec<String> = losses.iter().cloned().chain(usable.loss()).collect();
    let mut report = report::to_json(name, &source, &notes, &mapping.tally, &results, (&usable, &all_losses));
    report["odd"] = json!(odd);
    mapping.output.write_json("report.json", &report)?;
    let timing = mapping.clock.report(mapping.tally.clouds, results.log_s);
    mapping.output.write_json("timing.json", &timing)?;
    odd.extend(remove_outdated_exports(&mut mapping.output));
    let written = written(args.output, mapping.output.names());
    let words =
        report::to_words((&source, &mapping.tally, &results), (name, &timing, &usable), (&losses, &odd), &written);
    let files = mapping.output.commit()?;
    if args.mapping.voice.json {
        say_json(&json!({ "files": files, "report": report, "timing": timing }))?;
    } else if !args.mapping.voice.quiet {
        say(&words)?;
    }
    Ok(Outcome::of_losses(&all_losses))
}

/// A mapper in space, and everything that is made of its updates.
struct Mapping {
    mapper: SpaceMapper,
    log: SessionLog<SpaceSweep>,
    earlier_losses: Vec<String>,
    tally: Tally,
    clock: StageClock,
    output: OutputFolder,
    online: Option<TumWriter<File>>,
    stamper: Stamper,
    policy: crate::args::StampPolicy,
    picture_side: Option<u16>,
    progress: Progress,
    /// From so many bytes of the log on all that the mapper knows is taken down again.
    checkpoint_at: usize,
}

impl Mapping {
    fn begin(
        args: &MappingArgs,
        mut output: OutputFolder,
        length: u64,
        (earlier, earlier_losses): (Option<Session<SpaceSweep>>, Vec<String>),
    ) -> Result<Self, Failure> {
        let clock = StageClock::start();
        let settings = settings_of(args)?;
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
            progress: Progress::new(Some(length), args.voice.quiet || args.voice.json),
            checkpoint_at: FIRST_CHECKPOINT_BYTES,
        })
    }

    fn add_cloud(&mut self, cloud: &Cloud) -> Result<(), Failure> {
        let update: Update<SpaceSweep> = self.mapper.add_cloud(cloud);
        self.tally.add(&update);
        if let Some(online) = &mut self.online {
            let pose = stamped(self.stamper.next(update.stamp), update.map_from_robot);
            online.write(&pose).map_err(|cause| Failure::write(self.output.path(ONLINE), cause))?;
        }
        self.clock.scan(update.scan);
        self.progress.scan(update.stamp, self.tally.clouds);
        self.log.add(update.entries).inspect_err(|_| self.output.failed_to_write())?;
        self.take_down()
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

    fn end_of_clouds(&mut self) {
        self.clock.end_of_scans();
        self.progress.finish();
    }

    fn write_results(&mut self, source: &Source<'_>) -> Result<Results, Failure> {
        if let Some(online) = self.online.take() {
            online.finish().map_err(|cause| Failure::write(self.output.path(ONLINE), cause))?;
        }
        self.log.add(self.mapper.checkpoint().entries)?;
        self.log.finish()?;
        let session = self.log.session();
        let mut stamper = Stamper::new(self.policy);
        let way: Vec<(Stamp, Pose3)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
        self.output.write("trajectory.tum", |writer| {
            let mut trajectory = TumWriter::new(writer);
            way.iter().try_for_each(|&(stamp, pose)| trajectory.write(&stamped(stamper.next(stamp), pose)))?;
            trajectory.finish().map(|_| ())
        })?;
        let graph = AnyPoseGraph::Spatial(pose_graph(session, session.map_from_keyframe(), |_, _| true));
        self.output.write("graph.g2o", |writer| Ok(write_g2o(&graph, writer)?))?;
        let resolution_m = self.mapper.resolution_m().unwrap_or(1.0);
        let maps = session.maps();
        let (ways, path_m) = ways(session, &maps);
        let mut map_points = 0;
        for (number, (map, way)) in maps.iter().zip(&ways).enumerate() {
            let points = mapwright::points_of_map(session, map, MAP_SHARE * resolution_m);
            map_points += points.points_m.len();
            self.output
                .write(map_file(number, "ply"), |writer| write_ply(&points.points_m, &points.colours, writer))?;
            let shown = picture::Shown { map, way, points: &points, point_m: MAP_SHARE * resolution_m };
            let name = map_file(number, "png");
            picture::write(&mut self.output, &name, (source.sensor(), session), &shown, self.picture_side)?;
        }
        remove_outdated_maps(&mut self.output, maps.len());
        let beside = Beside::of(source, &way);
        let truth = source.simulation().map(|simulation| simulation.judge(&mut self.output, session)).transpose()?;
        let felt = Felt::of(source, &self.mapper);
        Ok(Results::of(session, (&way, path_m), resolution_m, map_points, beside, truth).feeling(felt))
    }
}

fn stamped(stamp: Stamp, pose: Pose3) -> StampedPose3 {
    StampedPose3::of_pose(stamp, pose)
}
