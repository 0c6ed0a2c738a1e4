//! The map as others see it, drawn beside the mapper from what is written down.

use super::asking::{Reply, ToDraw};
use super::beat::Known;
use super::clock::Clock;
use super::node::Node;
use super::robot::Names;
use crate::failure::Failure;
use crate::output::write_whole;
use mapwright::{Entry, Maps, Pose3, Session, Settings, Update};
use mapwright_live::node::asked::{Said, Why};
use mapwright_live::node::parameters::Setting;
use mapwright_live::wire::Wire;
use mapwright_logs::SliceBounds;
use mapwright_ros::RosError;
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// What takes long to draw is drawn more seldom: for so many times as long nothing is drawn.
const PAUSES: u32 = 10;

/// What is wanted beside the map.
pub(super) struct Wanted<'a> {
    pub(super) settings: &'a Settings,
    /// Whether goals are to be told.
    pub(super) explores: bool,
    /// Radius of the circle that the robot needs, metres.
    pub(super) radius_m: f64,
    /// Whether a floor plan of a map of space is.
    pub(super) band: Option<SliceBounds>,
    /// Where the robot is.
    pub(super) known: &'a Arc<Known>,
}

/// What can be drawn while a robot drives, and told.
pub(super) trait Drawn: Maps {
    /// Whether it is clouds that are mapped.
    const IS_IN_SPACE: bool;
    /// What is drawn on.
    type Canvas;
    /// Where it goes.
    type Outlet: Send;
    /// Topics for it.
    fn advertise(wire: &mut dyn Wire, names: &Names, wanted: &Wanted<'_>) -> Result<Self::Outlet, Failure>;
    /// One that nothing is drawn on.
    fn canvas(drawer: &Drawer<Self>) -> Self::Canvas;
    /// Tells the map as it is now.
    fn tell(drawer: &Drawer<Self>, canvas: &mut Self::Canvas, outlet: &mut Self::Outlet);
    /// What a service says of the map.
    fn said(drawer: &Drawer<Self>, canvas: &mut Self::Canvas) -> Reply;
    /// Writes the map in files of a name.
    fn save(drawer: &Drawer<Self>, canvas: &mut Self::Canvas, path: &Path) -> Result<(), Failure>;
    /// A pose in space; in the plane z is zero.
    fn in_space(pose: Self::Pose) -> Pose3;
    /// Where the robot is, as a message.
    fn pose(frame: &str, update: &Update<Self>) -> Result<Vec<u8>, RosError>;
}

/// Who draws.
pub(super) struct Drawer<M: Drawn> {
    pub(super) settings: Settings,
    pub(super) session: Session<M>,
    /// Where files go.
    pub(super) folder: PathBuf,
    /// Heights of obstacles above the robot's way, where a floor plan of a map of space is asked for.
    pub(super) band: Option<SliceBounds>,
    pub(super) clock: Arc<Clock>,
    pub(super) node: Arc<Node>,
}

impl<M: Drawn> Drawer<M> {
    /// Draws until it is told that nothing more comes.
    pub(super) fn draw(mut self, heard: &Receiver<ToDraw<M>>, mut outlet: M::Outlet) {
        let mut canvas = M::canvas(&self);
        let mut is_new = !self.session.keyframes().is_empty();
        let mut next = Instant::now();
        loop {
            match heard.recv_timeout(next.saturating_duration_since(Instant::now())) {
                Ok(ToDraw::Entries(entries)) => {
                    for entry in entries {
                        is_new |= !matches!(entry, Entry::Scan(_));
                        // What cannot be added is said by whoever writes the session.
                        let _ = self.session.add(entry);
                    }
                }
                Ok(ToDraw::Anew(session)) => {
                    (self.session, is_new) = (*session, true);
                    canvas = M::canvas(&self);
                }
                // Whoever asked may have gone.
                Ok(ToDraw::Map(reply)) => {
                    let said = self.if_any(|drawer| M::said(drawer, &mut canvas));
                    drop(reply.try_send(said));
                }
                Ok(ToDraw::Save { name, reply }) => {
                    let name = if name.is_empty() { "saved" } else { &name };
                    let save = |path: PathBuf| M::save(&self, &mut canvas, &path);
                    let said = self.if_any(|drawer| drawer.written(name, save));
                    drop(reply.try_send(said));
                }
                Ok(ToDraw::Serialize { file, reply }) => drop(reply.try_send(self.serialize(&file))),
                Ok(ToDraw::End) | Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {
                    let begun = Instant::now();
                    if is_new && self.node.is_active() {
                        is_new = false;
                        M::tell(&self, &mut canvas, &mut outlet);
                    }
                    let interval_s = self.node.number(Setting::MapInterval).max(0.05);
                    let drawn = begun.elapsed() * PAUSES;
                    next = Instant::now() + Duration::from_secs_f64(interval_s).max(drawn);
                }
            }
        }
    }

    /// What is said where something is mapped.
    fn if_any(&self, said: impl FnOnce(&Self) -> Reply) -> Reply {
        if self.session.keyframes().is_empty() {
            return Reply::refused(Why::NoMap, "nothing is mapped yet");
        }
        said(self)
    }

    /// Everything, to go on with.
    fn serialize(&self, file: &str) -> Reply {
        let bytes = self.session.encode();
        self.written(file, |path| {
            let path = with_ending(&path, "mapwright");
            write_whole(&path, |writer| writer.write_all(&bytes).map_err(|error| Failure::write(&path, error)))
        })
    }

    /// Whatever others name lies in the folder of results.
    fn written(&self, name: &str, write: impl FnOnce(PathBuf) -> Result<(), Failure>) -> Reply {
        match place_of(&self.folder, name) {
            Err(words) => Reply::refused(Why::Unwritable, words),
            Ok(path) => match write(path) {
                Ok(()) => Reply::Said(Said::Done),
                Err(failure) => Reply::refused(Why::Unwritable, failure.to_string()),
            },
        }
    }
}

/// Where a file of a name lies that somebody in the network has given: in the folder of results and nowhere else.
pub(super) fn place_of(folder: &Path, name: &str) -> Result<PathBuf, String> {
    let path = Path::new(name);
    let is_below = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !is_below || path.file_name().is_none() || name.contains('\0') {
        return Err(format!("expected the name of a file in {}, found {name:?}", folder.display()));
    }
    Ok(folder.join(path))
}

/// A name with an ending, in place of one of those that such files have.
pub(super) fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let is_ending = |found: &OsStr| ["pgm", "yaml", "mapwright"].iter().any(|known| found == *known);
    match path.extension().filter(|found| is_ending(found)) {
        Some(_) => path.with_extension(ending),
        None => path.with_file_name(format!("{}.{ending}", path.file_name().unwrap_or_default().to_string_lossy())),
    }
}
