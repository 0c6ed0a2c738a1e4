//! A recording, and its clouds one by one.

use crate::bins::{BinReader, Columns};
use crate::camera::{self, CameraOptions, camera};
use crate::distances::{Distances, UnitOf};
use crate::error::CloudError;
use crate::folder::{Folder, Listing, read};
use crate::image::{read_colours, read_depth};
use crate::layouts;
use crate::notes::{NoteKind, Notes};
use crate::packets::capture::{Capture, HEADER_BYTES};
use crate::packets::flows::Sweeps;
use crate::packets::window::Window;
use crate::pcd::{is_pcd, read_pcd};
use crate::plan::{Decode, FRAME_NS, Frame, Kind, Plan};
use crate::ply::{is_ply, read_ply};
use crate::points::{First, Points, times_of};
use crate::poses::Reference;
use crate::stereo_source::StereoSource;
use crate::text::excerpt;
use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud, DepthImage, ImuReading, PinholeCamera, SpaceSensor, SweepTimes};
use std::sync::Arc;

/// So many frames tell in which units they are; nothing is known of the other ones.
const LOOKED_AT: usize = 3;

/// What a folder or a file holds, if it is a recording of a sensor in space; none where it is none that is read here.
///
/// Of the clouds themselves only what is needed to know them is looked at: the first files, and of a capture the packets' angles.
///
/// # Errors
/// [`CloudError`] where it looks like a recording and cannot be used: why, and where.
pub fn recognise(folder: &dyn Folder) -> Result<Option<Recording<'_>>, CloudError> {
    let plan = layouts::find(&Listing::of(folder))?;
    Ok(plan.map(|plan| Recording { folder, sensor: Arc::new(plan.sensor.clone()), plan }))
}

/// A recording of a sensor in space.
pub struct Recording<'a> {
    folder: &'a dyn Folder,
    sensor: Arc<SpaceSensor>,
    plan: Plan,
}

impl std::fmt::Debug for Recording<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recording").field("plan", &self.plan).finish_non_exhaustive()
    }
}

impl<'a> Recording<'a> {
    /// Its kind, which can be shown in words.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.plan.kind
    }

    /// How many clouds it has, unless some cannot be read.
    #[must_use]
    pub fn frames(&self) -> usize {
        match &self.plan.decode {
            Decode::Packets(survey) => survey.sweeps,
            _ => self.plan.frames.len(),
        }
    }

    /// The stamps of the first frame and of the last, in the order of the recording; none where only the clouds themselves say when
    /// they were taken.
    #[must_use]
    pub fn stamps(&self) -> Option<[Stamp; 2]> {
        let frames = &self.plan.frames;
        match &self.plan.decode {
            Decode::Packets(_) => None,
            _ => Some([frames.first()?.stamp?, frames.last()?.stamp?]),
        }
    }

    /// Whether inertial readings come with the clouds.
    #[must_use]
    pub fn has_readings(&self) -> bool {
        match &self.plan.decode {
            Decode::Packets(survey) => survey.readings > 0,
            Decode::Stereo(plan) => !plan.readings.is_empty(),
            _ => false,
        }
    }

    /// What took the clouds.
    #[must_use]
    pub fn sensor(&self) -> &Arc<SpaceSensor> {
        &self.sensor
    }

    /// The camera, where clouds are made of images of depth.
    ///
    /// # Errors
    /// As [`clouds`](Self::clouds).
    pub fn camera(&self, options: &CameraOptions) -> Result<Option<Arc<PinholeCamera>>, CloudError> {
        match &self.plan.decode {
            Decode::Depth(plan) => camera(plan, options, &self.plan.notes).map(|(camera, _)| Some(camera)),
            Decode::Stereo(plan) => StereoSource::new(plan, options).map(|source| Some(Arc::new(source.pinhole()))),
            _ => Ok(None),
        }
    }

    /// Poses that came with it.
    #[must_use]
    pub fn references(&self) -> &[Reference] {
        &self.plan.references
    }

    /// What was found to be wrong so far: with lists, times, poses and calibrations. What is wrong with clouds is noted as they are
    /// read.
    #[must_use]
    pub fn notes(&self) -> &Notes {
        &self.plan.notes
    }

    /// Its clouds, from the first on. The options are for images of depth.
    ///
    /// # Errors
    /// [`CloudError::Missing`] where neither the folder nor the options say what the camera is, [`CloudError::Options`] where they
    /// say what cannot be.
    pub fn clouds(&self, options: &CameraOptions) -> Result<Clouds<'a>, CloudError> {
        options.check_scale()?;
        let source = match &self.plan.decode {
            Decode::Bins(columns) => Source::Bins(Box::default(), *columns),
            Decode::Files => Source::Files,
            Decode::Depth(plan) => {
                let (camera, depth_per_m) = camera(plan, options, &self.plan.notes)?;
                Source::Depth { directions: camera.directions(), camera, depth_per_m }
            }
            Decode::Stereo(plan) => Source::Stereo(Box::new(StereoSource::new(plan, options)?)),
            Decode::Packets(survey) => {
                let file = self.plan.frames.first().map_or("", |frame| &frame.file);
                let mut window = Window::open(self.folder, file);
                let begin = window.get(0, HEADER_BYTES).and_then(Capture::begin);
                let Some(capture) = begin else {
                    let found = window.take_failure();
                    return Err(found.unwrap_or_else(|| CloudError::content(file, 0, "the capture", "something else")));
                };
                let sweeps = Sweeps::new(window, capture, survey);
                let sweeps = sweeps.map_err(|reason| CloudError::content(file, 0, "packets that are read", reason))?;
                Source::Packets(Box::new(sweeps))
            }
        };
        let mut clouds = Clouds {
            folder: self.folder,
            sensor: Arc::clone(&self.sensor),
            frames: self.plan.frames.clone(),
            place: 0,
            delivered: 0,
            first_failure: None,
            last_stamp: None,
            notes: Notes::default(),
            source,
            unit_m: options.range_unit_m.unwrap_or(1.0),
            times: SweepTimes::Seconds,
            decisions: self.plan.decisions.clone(),
            odd: Vec::new(),
            doubts: Vec::new(),
        };
        let of = match (&self.plan.decode, &clouds.source) {
            (Decode::Depth(plan), Source::Depth { camera, depth_per_m, .. }) => {
                let (decisions, doubts) = camera::words(plan, options, camera);
                clouds.decisions.extend(decisions);
                clouds.doubts = doubts;
                UnitOf::Images { per_m: *depth_per_m, is_asked: options.depth_scale.is_some() }
            }
            _ => UnitOf::Clouds(options.range_unit_m),
        };
        if let (Decode::Stereo(plan), Source::Stereo(source)) = (&self.plan.decode, &mut clouds.source) {
            clouds.decisions.extend(source.decisions(plan, options));
            clouds.sensor = Arc::new(source.sensor(&self.sensor));
            clouds.doubts = source.judge_pairs(self.folder, &self.plan.frames)?;
            return Ok(clouds);
        }
        clouds.look_ahead(of);
        Ok(clouds)
    }
}

/// What clouds are made of.
enum Source<'a> {
    Bins(Box<BinReader>, Columns),
    Files,
    Depth { camera: Arc<PinholeCamera>, directions: Vec<[f32; 2]>, depth_per_m: f64 },
    Stereo(Box<StereoSource>),
    Packets(Box<Sweeps<'a>>),
}

/// The clouds of a recording, one by one in its order. A frame is read when it is asked for; one that cannot be is noted and left
/// out.
pub struct Clouds<'a> {
    folder: &'a dyn Folder,
    sensor: Arc<SpaceSensor>,
    frames: Vec<Frame>,
    /// Of the next frame.
    place: usize,
    delivered: usize,
    first_failure: Option<String>,
    last_stamp: Option<Stamp>,
    notes: Notes,
    source: Source<'a>,
    /// What one stands for in coordinates, metres.
    unit_m: f64,
    times: SweepTimes,
    decisions: Vec<String>,
    odd: Vec<String>,
    doubts: Vec<String>,
}

impl std::fmt::Debug for Clouds<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Clouds").field("place", &self.place).field("notes", &self.notes).finish_non_exhaustive()
    }
}

impl Clouds<'_> {
    /// The next cloud; none at the end.
    ///
    /// # Errors
    /// [`CloudError::NoFrames`] at the end, if not one could be read.
    pub fn next_cloud(&mut self) -> Result<Option<Cloud>, CloudError> {
        if matches!(self.source, Source::Packets(_)) {
            return Ok(self.next_sweep());
        }
        while let Some((place, frame)) = self.next_frame() {
            let cloud = self.cloud(place, &frame);
            if let Some(cloud) = self.kept(&frame, cloud) {
                let cloud = self.settled(&frame.file, cloud);
                self.check_stamp(&frame.file, cloud.stamp);
                self.check_points(&frame.file, 0, &cloud);
                return Ok(Some(cloud));
            }
        }
        self.end()
    }

    /// The next image of depth; none at the end, or where clouds are not made of such. Images and clouds may be asked for in turn.
    ///
    /// # Errors
    /// As [`next_cloud`](Self::next_cloud).
    pub fn next_depth_image(&mut self) -> Result<Option<DepthImage>, CloudError> {
        if !matches!(self.source, Source::Depth { .. }) {
            return Ok(None);
        }
        while let Some((_, frame)) = self.next_frame() {
            let image = self.image(&frame);
            if let Some(image) = self.kept(&frame, image) {
                self.check_stamp(&frame.file, image.stamp);
                return Ok(Some(image));
            }
        }
        self.end()
    }

    /// Inertial readings that came with the clouds read so far, up to the end of the last, and were not asked for: of captures of lidars
    /// that have such a sensor in the frame of the points, of pairs of cameras in the robot's.
    pub fn take_readings(&mut self) -> Vec<ImuReading> {
        match &mut self.source {
            Source::Packets(sweeps) => sweeps.readings().collect(),
            Source::Stereo(source) => source.readings_until(self.last_stamp, self.place >= self.frames.len()),
            _ => Vec::new(),
        }
    }

    /// What was found to be wrong with the frames read so far.
    #[must_use]
    pub fn notes(&self) -> &Notes {
        &self.notes
    }

    /// What was decided, and what was taken for granted because nothing says it, in words.
    #[must_use]
    pub fn decisions(&self) -> &[String] {
        &self.decisions
    }

    /// What is odd about units, in words, with what to type where they are wrong.
    #[must_use]
    pub fn odd(&self) -> &[String] {
        &self.odd
    }

    /// What casts doubt on a map of it, in words: what had to be assumed of the camera, or cannot be.
    #[must_use]
    pub fn doubts(&self) -> &[String] {
        &self.doubts
    }

    /// What takes the clouds.
    #[must_use]
    pub fn sensor(&self) -> &Arc<SpaceSensor> {
        &self.sensor
    }

    /// Looks at the first frames before any is asked for: whether they are in metres, and their times in seconds.
    fn look_ahead(&mut self, of: UnitOf) {
        if matches!(self.source, Source::Packets(_)) {
            return;
        }
        let first: Vec<Frame> = self.frames.iter().take(LOOKED_AT).cloned().collect();
        let clouds = first.iter().enumerate().filter_map(|(place, frame)| self.cloud(place, frame).ok());
        let clouds: Vec<Cloud> = clouds.collect();
        self.notes = Notes::default(); // it is read once more
        let mut distances = Distances::default();
        clouds.iter().for_each(|cloud| distances.add_cloud(cloud));
        let found = distances.scaled(self.unit_m).judge(&self.sensor, of);
        self.unit_m = found.unit_m.unwrap_or(self.unit_m);
        if let Some(range_min_m) = found.range_min_m {
            self.sensor = Arc::new(SpaceSensor { range_min_m, ..(*self.sensor).clone() });
        }
        self.decisions.extend(found.assumed);
        self.odd.extend(found.odd);
        self.settle_times(&clouds);
    }

    fn settle_times(&mut self, first: &[Cloud]) {
        let latest_s = |cloud: &Cloud| cloud.times_s.iter().copied().fold(0.0, f32::max);
        let span_s = f64::from(first.iter().map(latest_s).fold(0.0, f32::max));
        let named: Option<Vec<Stamp>> = self.frames.iter().map(|frame| frame.stamp).collect();
        let has_stamps = named.is_some();
        let stamps = named.unwrap_or_else(|| first.iter().map(|cloud| cloud.stamp).collect());
        self.times = match SweepTimes::of(span_s, &stamps) {
            // where nothing says when files were taken, only what cannot be seconds is not
            SweepTimes::Refused { .. } if !has_stamps => SweepTimes::Seconds,
            times => times,
        };
        if let SweepTimes::Shares { sweep_s } = self.times {
            self.decisions.push(format!(
                "times of points span {span_s:.2} s, clouds come every {sweep_s:.2} s: taken for shares of a sweep that lasts from one \
                 cloud to the next"
            ));
        }
    }

    /// In metres and seconds.
    fn settled(&mut self, file: &str, mut cloud: Cloud) -> Cloud {
        if self.unit_m != 1.0 {
            let metres = |coordinate: &mut f32| *coordinate = (f64::from(*coordinate) * self.unit_m) as f32;
            cloud.points_m.iter_mut().flatten().for_each(metres);
        }
        match self.times {
            SweepTimes::Shares { sweep_s } => cloud.times_s.iter_mut().for_each(|time| *time *= sweep_s as f32),
            SweepTimes::Refused { interval_s } if !cloud.times_s.is_empty() => {
                let expected = || format!("times within a sweep, as clouds come every {interval_s:.2} s");
                self.notes.note(NoteKind::BadPointTimes, file, 0, || (expected(), "times of more than two sweeps"));
                cloud.times_s.clear();
            }
            _ => {}
        }
        Cloud { sensor: Arc::clone(&self.sensor), ..cloud }
    }

    fn next_frame(&mut self) -> Option<(usize, Frame)> {
        let frame = self.frames.get(self.place)?.clone();
        self.place += 1;
        Some((self.place - 1, frame))
    }

    /// What was read; a failure is noted.
    fn kept<T>(&mut self, frame: &Frame, read: Result<T, CloudError>) -> Option<T> {
        match read {
            Ok(read) => {
                self.delivered += 1;
                Some(read)
            }
            Err(error) => {
                self.first_failure.get_or_insert_with(|| error.to_string());
                self.notes.note_error(NoteKind::UnreadableFrame, &frame.file, error);
                None
            }
        }
    }

    fn end<T>(&self) -> Result<Option<T>, CloudError> {
        match &self.first_failure {
            Some(first) if self.delivered == 0 => {
                Err(CloudError::NoFrames { frames: self.frames.len(), first: first.clone() })
            }
            _ => Ok(None),
        }
    }

    fn cloud(&mut self, place: usize, frame: &Frame) -> Result<Cloud, CloudError> {
        if let Source::Depth { .. } = self.source {
            let image = self.image(frame)?;
            let Source::Depth { directions, .. } = &self.source else { return Ok(self.empty(frame)) };
            let cloud = image.to_cloud(&self.sensor, directions);
            return cloud.map_err(|reason| CloudError::content(&frame.file, 0, "the camera's size", reason));
        }
        if let Source::Stereo(source) = &mut self.source {
            return source.cloud(self.folder, frame, &self.sensor);
        }
        let bytes = read(self.folder, &frame.file)?;
        if let Source::Bins(reader, columns) = &mut self.source {
            let Points { points_m, intensities, .. } = reader.read(&frame.file, &bytes, *columns, &mut self.notes)?;
            return Ok(Cloud { points_m, intensities, ..self.empty(frame) });
        }
        let points = read_points(&frame.file, &bytes, &mut self.notes)?;
        Ok(self.of_points(place, frame, points))
    }

    /// A cloud without points.
    fn empty(&self, frame: &Frame) -> Cloud {
        Cloud {
            stamp: frame.stamp.unwrap_or_default(),
            sensor: Arc::clone(&self.sensor),
            points_m: Vec::new(),
            times_s: Vec::new(),
            colours: Vec::new(),
            intensities: Vec::new(),
            sigmas_m: Vec::new(),
            odom_from_robot: None,
        }
    }

    /// A cloud of a file's points, whose times may say when it was taken.
    fn of_points(&mut self, place: usize, frame: &Frame, points: Points) -> Cloud {
        let times = times_of(&points);
        if let (None, Some((field, _))) = (&times, &points.time_field) {
            let words = || (format!("`{field}` within a sweep of 1.5 s"), "other numbers");
            self.notes.note(NoteKind::BadPointTimes, &frame.file, 0, words);
        }
        let of_file = frame.stamp.unwrap_or_else(|| Stamp((place as i64).saturating_mul(FRAME_NS)));
        let stamp = match times.as_ref().map(|times| times.first) {
            Some(First::At(first)) if frame.stamp.is_none() => first,
            Some(First::AfterStamp(offset_s)) => Stamp(of_file.0.saturating_add(Stamp::from_secs_f64(offset_s).0)),
            _ => of_file,
        };
        let times_s = times.map_or_else(Vec::new, |times| times.times_s);
        let Points { points_m, colours, intensities, .. } = points;
        Cloud { stamp, points_m, times_s, colours, intensities, ..self.empty(frame) }
    }

    fn image(&mut self, frame: &Frame) -> Result<DepthImage, CloudError> {
        let Source::Depth { camera, depth_per_m, .. } = &self.source else {
            return Err(CloudError::content(&frame.file, 0, "an image of depth", "another recording"));
        };
        let size = [camera.width, camera.height];
        let depth_m = read_depth(&frame.file, &read(self.folder, &frame.file)?, size, *depth_per_m)?;
        let camera = Arc::clone(camera);
        let colours = frame.colour.as_ref().map_or_else(Vec::new, |file| {
            let colours = read(self.folder, file).and_then(|bytes| read_colours(file, &bytes, size));
            colours.unwrap_or_else(|error| {
                self.notes.note_error(NoteKind::UnreadableColour, file, error);
                Vec::new()
            })
        });
        Ok(DepthImage { stamp: frame.stamp.unwrap_or_default(), camera, depth_m, colours })
    }

    fn next_sweep(&mut self) -> Option<Cloud> {
        let Source::Packets(sweeps) = &mut self.source else { return None };
        let sweep = sweeps.next(&mut self.notes)?;
        let unit_m = self.unit_m as f32;
        let file = sweeps.file().to_owned();
        let cloud = Cloud {
            stamp: sweep.stamp,
            sensor: Arc::clone(&self.sensor),
            points_m: sweep.points_m.into_iter().map(|point| point.map(|coordinate| coordinate * unit_m)).collect(),
            times_s: sweep.times_s,
            colours: Vec::new(),
            intensities: sweep.intensities,
            sigmas_m: Vec::new(),
            odom_from_robot: None,
        };
        self.check_stamp(&file, cloud.stamp);
        self.check_points(&file, sweep.at, &cloud);
        Some(cloud)
    }

    fn check_stamp(&mut self, file: &str, stamp: Stamp) {
        if let Some(last) = self.last_stamp.filter(|last| stamp < *last) {
            let words =
                || (format!("a stamp after {:.6} s", last.as_secs_f64()), format!("{:.6} s", stamp.as_secs_f64()));
            self.notes.note(NoteKind::BackwardStamp, file, 0, words);
        }
        self.last_stamp = Some(stamp);
    }

    /// Counts what is no point in clouds of lidars; images of depth always have such pixels.
    fn check_points(&mut self, file: &str, at: usize, cloud: &Cloud) {
        if cloud.points_m.is_empty() {
            self.notes.note(NoteKind::EmptyCloud, file, at, || ("points", "none"));
        }
        if matches!(self.source, Source::Depth { .. } | Source::Stereo(_)) {
            return;
        }
        let is_none = |point: &&[f32; 3]| !point.iter().all(|v| v.is_finite());
        let none = cloud.points_m.iter().filter(is_none).count();
        if none > 0 {
            let words = || ("finite points", format!("{none} of {} that are not", cloud.points_m.len()));
            self.notes.note(NoteKind::NotFinite, file, at, words);
        }
    }
}

fn read_points(file: &str, bytes: &[u8], notes: &mut Notes) -> Result<Points, CloudError> {
    if is_ply(bytes) {
        read_ply(file, bytes, notes)
    } else if is_pcd(bytes) {
        read_pcd(file, bytes, notes)
    } else {
        Err(CloudError::content(file, 0, "a PCD or PLY file", excerpt(bytes)))
    }
}
