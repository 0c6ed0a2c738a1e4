//! The map as others see it, drawn beside the mapper from what is written down.

use super::clock::Clock;
use crate::image::map_image;
use mapwright::{Entry, GlobalMap, Session, Settings, Stamp};
use mapwright_formats::UNKNOWN;
use mapwright_live::outgoing::Grid;
use mapwright_live::wire::Publisher;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

/// What the drawer is told.
pub(super) enum ToDraw {
    /// What was written down.
    Entries(Vec<Entry>),
    /// Everything begins anew, with this.
    Anew(Box<Session>),
    /// Somebody wants the map as it is.
    Asked(SyncSender<Grid>),
}

/// Where it goes.
pub(super) struct Outlet {
    pub(super) map: Box<dyn Publisher>,
    pub(super) metadata: Box<dyn Publisher>,
    pub(super) frame: String,
}

/// Draws until nobody tells it anything any more.
pub(super) fn draw(
    heard: &Receiver<ToDraw>,
    (settings, mut session): (Settings, Session),
    outlet: Option<&Outlet>,
    clock: &Clock,
    every: Duration,
) {
    let mut map = GlobalMap::without_normals(&settings);
    let mut is_new = !session.keyframes().is_empty();
    let mut next = Instant::now();
    loop {
        match heard.recv_timeout(next.saturating_duration_since(Instant::now())) {
            Ok(ToDraw::Entries(entries)) => {
                for entry in entries {
                    is_new |= !matches!(entry, Entry::Scan(_));
                    // What cannot be added is said by whoever writes the session.
                    let _ = session.add(entry);
                }
                continue;
            }
            Ok(ToDraw::Anew(anew)) => {
                (session, map, is_new) = (*anew, GlobalMap::without_normals(&settings), true);
                continue;
            }
            Ok(ToDraw::Asked(reply)) => {
                map.follow(&session, 1);
                let _ = reply.try_send(grid(&map, &settings, clock));
                continue;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        next = Instant::now() + every;
        if let Some(outlet) = outlet.filter(|_| std::mem::take(&mut is_new)) {
            map.follow(&session, 1);
            outlet.tell(&grid(&map, &settings, clock));
        }
    }
}

impl Outlet {
    /// What cannot be sent now is sent with the next one.
    fn tell(&self, grid: &Grid) {
        let _ = grid.metadata().map(|bytes| self.metadata.publish(&bytes));
        let _ = grid.message(&self.frame).map(|bytes| self.map.publish(&bytes));
    }
}

fn grid(map: &GlobalMap, settings: &Settings, clock: &Clock) -> Grid {
    let image = map_image(map.counts(), settings.map.passes_per_hit).image;
    Grid {
        stamp: clock.stamp().unwrap_or(Stamp(0)),
        resolution_m: image.resolution_m,
        size: [image.width as u32, image.height as u32],
        origin: image.world_from_map,
        cells: image.cells.iter().map(|&cell| if cell == UNKNOWN { -1 } else { cell.min(100) as i8 }).collect(),
    }
}
