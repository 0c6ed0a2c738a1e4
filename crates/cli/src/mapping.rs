//! One mapping run: scans in, files out.

use crate::advice::{numbered, seen_from};
use crate::args::{Align, MappingArgs, StampPolicy};
use crate::closures::{CLOSURES, ClosureFile, taken_back};
use crate::drawing::draw_believed;
use crate::failure::Failure;
use crate::image::{MapImage, map_image, without_outliers};
use crate::output::OutputFolder;
use crate::pose_graph::pose_graph;
use crate::progress::Progress;
use crate::session::{SESSION, session_of};
use crate::settings;
use crate::stamps::Stamper;
use crate::tally::Tally;
use crate::timing::StageClock;
use mapwright::{Advice, Edge, EdgeKind, LaserScan, LivePolicy, Mapper, Odometry, Pose2, Settings, Update};
use mapwright_formats::{Confidence, GridImage, Picture, TumWriter, dominant_wall_angle};
use mapwright_formats::{write_map_yaml, write_pgm, write_png};
use mapwright_graph::g2o::{AnyPoseGraph, write_g2o};
use std::fs::File;
use std::io::Write;

const ONLINE: &str = "trajectory_online.tum";
/// The way's length is summed over steps of at least so much, so that standing still adds nothing, metres.
const PATH_STEP_M: f64 = 0.05;

/// A mapper with everything that is written beside it.
pub(crate) struct Mapping {
    pub(crate) mapper: Mapper,
    pub(crate) tally: Tally,
    pub(crate) clock: StageClock,
    pub(crate) output: OutputFolder,
    online: Option<TumWriter<File>>,
    stamper: Stamper,
    progress: Progress,
    policy: StampPolicy,
    align: Align,
    picture_side: Option<u16>,
    has_odometry: bool,
    wheels: WheelPoses,
}

/// Odometry's pose at every scan, in the frame of the log's own odometry.
#[derive(Default)]
struct WheelPoses {
    odom_from_robot: Vec<Pose2>,
    /// The mapper's odometry starts at the origin, the log's does not.
    odom_from_start: Option<Pose2>,
}

/// What a run has made, for report and people.
#[derive(Debug, Clone)]
pub(crate) struct Made {
    pub(crate) path_m: f64,
    pub(crate) map_cells: [usize; 2],
    pub(crate) map_m: [f64; 2],
    pub(crate) cells_left_out: u64,
    pub(crate) keyframes_left_out: usize,
    pub(crate) wall_angle_rad: Option<f64>,
    pub(crate) advice: Advice,
}

/// Settings of a run: those of file and command line, and `--no-odometry`.
pub(crate) fn settings_of(args: &MappingArgs) -> Result<Settings, Failure> {
    let mut settings = settings::load(&args.settings)?;
    settings.motion.use_odometry &= !args.no_odometry;
    if let Some(how) = &args.correction {
        settings.set("loops.correction", how)?;
    }
    Ok(settings)
}

impl Mapping {
    /// Begins a run; `length` is that of the progress bar.
    pub(crate) fn begin(args: &MappingArgs, mut output: OutputFolder, length: Option<u64>) -> Result<Self, Failure> {
        let clock = StageClock::start();
        let start = args.start.unwrap_or(Pose2::IDENTITY);
        let mapper = Mapper::starting_at(settings_of(args)?, start)?;
        let online = Some(TumWriter::new(output.begin(ONLINE)?));
        Ok(Self {
            mapper,
            tally: Tally::default(),
            clock,
            output,
            online,
            stamper: Stamper::new(args.stamps),
            progress: Progress::new(length, args.voice.quiet || args.voice.json),
            policy: args.stamps,
            align: args.align,
            picture_side: args.picture_side,
            has_odometry: false,
            wheels: WheelPoses::default(),
        })
    }

    /// One scan through the mapper; `position` is how far along the bar it lies.
    pub(crate) fn add_scan(&mut self, scan: &LaserScan, position: u64) -> Result<Update, Failure> {
        let update = self.mapper.add_scan_probed(scan, &mut self.clock);
        self.has_odometry |= scan.odom_from_robot.is_some();
        self.tally.add(&update, self.has_odometry && self.mapper.settings().motion.use_odometry);
        if let Some(online) = &mut self.online {
            let written = online.write_planar(self.stamper.next(update.stamp), update.map_from_robot);
            written.map_err(|cause| Failure::write(self.output.path(ONLINE), cause))?;
        }
        self.wheels.add(scan, &update);
        self.progress.scan(update.stamp, position);
        Ok(update)
    }

    /// A reading of the wheels.
    pub(crate) fn add_odometry(&mut self, odometry: &Odometry) {
        self.has_odometry = true;
        self.mapper.add_odometry(odometry);
    }

    /// No more scans: takes the bar away.
    pub(crate) fn end_of_scans(&mut self) {
        self.clock.end_of_scans();
        self.progress.finish();
    }

    /// Writes trajectories and maps.
    pub(crate) fn write_results(&mut self) -> Result<Made, Failure> {
        if let Some(online) = self.online.take() {
            online.finish().map_err(|cause| Failure::write(self.output.path(ONLINE), cause))?;
        }
        let way = self.write_trajectory()?;
        self.write_graph()?;
        let (MapImage { image, cells_left_out }, keyframes_left_out) = self.render();
        let session = session_of(&self.mapper, &self.wheels.in_the_logs_frame(), &keyframes_left_out);
        self.output.write(SESSION, |writer| Ok(writer.write_all(&session.encode())?))?;
        self.output.write("map.pgm", |writer| write_pgm(&image, writer))?;
        self.output.write("map.yaml", |writer| write_map_yaml(&image, "map.pgm", writer))?;
        let wall_angle_rad = self.wall_angle(&image);
        let advice = Advice::of(&self.mapper);
        let (seen_from, places) = (seen_from(&self.mapper, &advice), numbered(&advice));
        let confidence = Confidence { seen_from: &seen_from, places: &places };
        let picture = Picture { confidence: Some(confidence), ..self.picture(&way, wall_angle_rad) };
        let shown = without_outliers(&image, &way);
        self.output.write("map.png", |writer| write_png(&shown, &picture, writer))?;
        Ok(Made {
            path_m: path_length_m(&way),
            map_cells: [image.width, image.height],
            map_m: [shown.width, shown.height].map(|cells| cells as f64 * image.resolution_m),
            cells_left_out,
            keyframes_left_out: keyframes_left_out.len(),
            wall_angle_rad,
            advice,
        })
    }

    /// The final trajectory, every scan in arrival order; returns the way.
    fn write_trajectory(&mut self) -> Result<Vec<Pose2>, Failure> {
        let mut stamper = Stamper::new(self.policy);
        let poses = self.mapper.trajectory();
        let mut way = Vec::with_capacity(poses.len());
        self.output.write("trajectory.tum", |writer| {
            let mut trajectory = TumWriter::new(writer);
            for pose in poses {
                trajectory.write_planar(stamper.next(pose.stamp), pose.map_from_robot)?;
                way.push(pose.map_from_robot);
            }
            trajectory.finish().map(|_| ())
        })?;
        Ok(way)
    }

    /// Keyframes with the edges that stand, and all candidates.
    fn write_graph(&mut self) -> Result<(), Failure> {
        let gone = taken_back(self.mapper.candidates());
        let stands = |edge: &Edge| edge.kind != EdgeKind::Closure || !gone.contains(&[edge.from, edge.to]);
        let graph = AnyPoseGraph::Planar(pose_graph(&self.mapper, self.mapper.keyframe_poses(), stands));
        self.output.write("graph.g2o", |writer| Ok(write_g2o(&graph, writer)?))?;
        let closures = ClosureFile::of(&self.mapper);
        self.output.write(CLOSURES, |mut writer| {
            serde_json::to_writer_pretty(&mut writer, &closures).map_err(std::io::Error::from)?;
            Ok(writer.write_all(b"\n")?)
        })
    }

    /// Every keyframe at its present pose, and the numbers of those that are left out. A live map of everything is that map
    /// already.
    fn render(&self) -> (MapImage, Vec<u32>) {
        let Settings { live, map, .. } = self.mapper.settings();
        if live.policy == LivePolicy::Everything {
            (map_image(self.mapper.live_map().counts(), map.passes_per_hit), Vec::new())
        } else {
            let (counts, left_out) = draw_believed(&self.mapper);
            (map_image(&counts, map.passes_per_hit), left_out)
        }
    }

    fn picture<'a>(&self, way: &'a [Pose2], wall_angle_rad: Option<f64>) -> Picture<'a> {
        let picture = Picture { world_from_robot: way, level_rad: wall_angle_rad.unwrap_or(0.0), ..Picture::default() };
        match self.picture_side.map(usize::from) {
            Some(side) => Picture { min_side_px: side / 2, max_side_px: side, ..picture },
            None => picture,
        }
    }

    fn wall_angle(&self, image: &GridImage) -> Option<f64> {
        (self.align == Align::Walls).then(|| dominant_wall_angle(&image.wall_points_map(), image.resolution_m))
    }
}

impl WheelPoses {
    fn add(&mut self, scan: &LaserScan, update: &Update) {
        let own = scan.odom_from_robot.filter(|pose| pose.is_finite());
        if let (None, Some(odom_from_robot)) = (self.odom_from_start, own) {
            self.odom_from_start = Some(odom_from_robot * update.odom_from_robot.inverse());
        }
        self.odom_from_robot.push(update.odom_from_robot);
    }

    fn in_the_logs_frame(&self) -> Vec<Pose2> {
        let odom_from_start = self.odom_from_start.unwrap_or(Pose2::IDENTITY);
        self.odom_from_robot.iter().map(|&start_from_robot| odom_from_start * start_from_robot).collect()
    }
}

fn path_length_m(way: &[Pose2]) -> f64 {
    let Some(mut last) = way.first() else { return 0.0 };
    let mut length_m = 0.0;
    for pose in way {
        let step_m = pose.distance(*last);
        if step_m >= PATH_STEP_M {
            length_m += step_m;
            last = pose;
        }
    }
    length_m
}
