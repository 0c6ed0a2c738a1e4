//! A recording, and its clouds one by one.

use crate::bins::BinReader;
use crate::camera::{CameraOptions, camera};
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
use crate::text::excerpt;
use mapwright_geom::Stamp;
use mapwright_sensor::{Cloud, DepthImage, ImuReading, PinholeCamera, SpaceSensor};
use std::sync::Arc;

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
        matches!(&self.plan.decode, Decode::Packets(survey) if survey.readings > 0)
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
            _ => Ok(None),
        }
    }

    /// Poses that came with it.
    #[must_use]
    pub fn references(&self) -> &[Reference] {
        &self.plan.references
    }

    /// What was decided, and what was taken for granted because nothing says it, in words.
    #[must_use]
    pub fn decisions(&self) -> &[String] {
        &self.plan.decisions
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
        let source = match &self.plan.decode {
            Decode::Bins => Source::Bins(Box::default()),
            Decode::Files => Source::Files,
            Decode::Depth(plan) => {
                let (camera, depth_per_m) = camera(plan, options, &self.plan.notes)?;
                Source::Depth { directions: camera.directions(), camera, depth_per_m }
            }
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
        Ok(Clouds {
            folder: self.folder,
            sensor: Arc::clone(&self.sensor),
            frames: self.plan.frames.clone(),
            place: 0,
            delivered: 0,
            first_failure: None,
            last_stamp: None,
            notes: Notes::default(),
            source,
        })
    }
}

/// What clouds are made of.
enum Source<'a> {
    Bins(Box<BinReader>),
    Files,
    Depth { camera: Arc<PinholeCamera>, directions: Vec<[f32; 2]>, depth_per_m: f64 },
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

    /// Inertial readings that came with the clouds read so far, up to the end of the last, and were not asked for; of captures of lidars
    /// that have such a sensor, in the frame of the points.
    pub fn take_readings(&mut self) -> Vec<ImuReading> {
        match &mut self.source {
            Source::Packets(sweeps) => sweeps.readings().collect(),
            _ => Vec::new(),
        }
    }

    /// What was found to be wrong with the frames read so far.
    #[must_use]
    pub fn notes(&self) -> &Notes {
        &self.notes
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
        let bytes = read(self.folder, &frame.file)?;
        if let Source::Bins(reader) = &mut self.source {
            let points_m = reader.read(&frame.file, &bytes, &mut self.notes)?;
            return Ok(Cloud { points_m, ..self.empty(frame) });
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
        Cloud { stamp, points_m: points.points_m, times_s, colours: points.colours, ..self.empty(frame) }
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
        let file = sweeps.file().to_owned();
        let cloud = Cloud {
            stamp: sweep.stamp,
            sensor: Arc::clone(&self.sensor),
            points_m: sweep.points_m,
            times_s: sweep.times_s,
            colours: Vec::new(),
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
        if matches!(self.source, Source::Depth { .. }) {
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
