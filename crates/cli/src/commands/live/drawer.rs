//! The map as others see it, drawn beside the mapper from what is written down.

use super::asking::{Reply, ToDraw};
use super::clock::Clock;
use super::node::Node;
use crate::failure::Failure;
use crate::image::map_image;
use crate::output::write_whole;
use mapwright::{Entry, GlobalMap, Session, Settings, Stamp};
use mapwright_formats::{GridImage, UNKNOWN, write_map_yaml, write_pgm};
use mapwright_live::node::asked::{Said, Why};
use mapwright_live::node::parameters::Setting;
use mapwright_live::outgoing::Grid;
use mapwright_live::wire::Publisher;
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Where it goes.
pub(super) struct Outlet {
    pub(super) map: Box<dyn Publisher>,
    pub(super) metadata: Box<dyn Publisher>,
    pub(super) updates: Box<dyn Publisher>,
    pub(super) frame: String,
    /// What was told last.
    pub(super) told: Option<Grid>,
}

/// Who draws.
pub(super) struct Drawer {
    pub(super) settings: Settings,
    pub(super) session: Session,
    /// Where files go.
    pub(super) folder: PathBuf,
    pub(super) clock: Arc<Clock>,
    pub(super) node: Arc<Node>,
}

impl Drawer {
    /// Draws until it is told that nothing more comes.
    pub(super) fn draw(mut self, heard: &Receiver<ToDraw>, mut outlet: Option<Outlet>) {
        let mut map = GlobalMap::without_normals(&self.settings);
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
                    (self.session, map, is_new) = (*session, GlobalMap::without_normals(&self.settings), true);
                }
                // Whoever asked may have gone.
                Ok(ToDraw::Map(reply)) => drop(reply.try_send(self.said(&mut map))),
                Ok(ToDraw::Save { name, reply }) => drop(reply.try_send(self.save(&name, &mut map))),
                Ok(ToDraw::Serialize { file, reply }) => drop(reply.try_send(self.serialize(&file))),
                Ok(ToDraw::End) | Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {
                    next = Instant::now() + Duration::from_secs_f64(self.node.number(Setting::MapInterval).max(0.05));
                    if let Some(outlet) = outlet.as_mut().filter(|_| is_new && self.node.is_active()) {
                        is_new = false;
                        outlet.tell(self.grid(&mut map));
                    }
                }
            }
        }
    }

    fn image(&self, map: &mut GlobalMap) -> GridImage {
        map.follow(&self.session, 1);
        map_image(map.counts(), self.settings.map.passes_per_hit).image
    }

    fn grid(&self, map: &mut GlobalMap) -> Grid {
        let image = self.image(map);
        Grid {
            stamp: self.clock.stamp().unwrap_or(Stamp(0)),
            resolution_m: image.resolution_m,
            size: [image.width as u32, image.height as u32],
            origin: image.world_from_map,
            cells: image.cells.iter().map(|&cell| if cell == UNKNOWN { -1 } else { cell.min(100) as i8 }).collect(),
        }
    }

    fn said(&self, map: &mut GlobalMap) -> Reply {
        if self.session.keyframes().is_empty() {
            return Reply::refused(Why::NoMap, "nothing is mapped yet");
        }
        Reply::Map(self.grid(map))
    }

    /// The map as Nav2 reads it.
    fn save(&self, name: &str, map: &mut GlobalMap) -> Reply {
        if self.session.keyframes().is_empty() {
            return Reply::refused(Why::NoMap, "nothing is mapped yet");
        }
        let name = if name.is_empty() { "saved" } else { name };
        self.written(name, |path| {
            let (image, pgm) = (self.image(map), with_ending(&path, "pgm"));
            let name = pgm.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let failed = |cause| Failure::write(&pgm, cause);
            write_whole(&pgm, |writer| write_pgm(&image, writer).map_err(failed))?;
            write_whole(&with_ending(&path, "yaml"), |writer| write_map_yaml(&image, &name, writer).map_err(failed))
        })
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

impl Outlet {
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
