//! What is known of a run, and how it becomes a scene.

use crate::clouds::Clouds;
use crate::news::{Closure, News, Placed, Seen};
use crate::picture::{Pen, Picture, Work};
use crate::scene::{Key, Scene};
use crate::wire;
use mapwright_record::{Objection, Verdict};
use mapwright_sensor::{BeamTable, SweepPoints};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// Keyframes, and closures, that are told together.
const BLOCK: usize = 64;
/// Points of a scan at most.
const MOST_SCAN_POINTS: usize = 2000;
/// How long a round may take to draw what is new, and what has moved: what is new is missing, what has moved is only somewhat off.
const TO_DRAW_NEW: Duration = Duration::from_millis(80);
const TO_DRAW_MOVED: Duration = Duration::from_millis(20);
/// How long it may take to read tiles, those that nobody has seen yet and those that may have changed: these come in turn.
const TO_READ_NEW: Duration = Duration::from_millis(50);
const TO_READ_AGAIN: Duration = Duration::from_millis(3);
/// A closure that was not told yet: numbers of the session may come in any order.
const UNTOLD: Closure = Closure { from: u32::MAX, to: u32::MAX, verdict: Verdict::Waiting(Objection::Alone) };
/// Numbers of closures beyond this are a fault of the caller.
const MOST_CLOSURES: usize = 1 << 22;

/// A run as far as it is known.
pub(crate) struct Model {
    picture: Picture,
    clouds: Clouds,
    keyframes: Vec<Placed>,
    closures: Vec<Closure>,
    changed_paths: BTreeSet<usize>,
    changed_closures: BTreeSet<usize>,
    is_space: bool,
    abilities: u32,
}

impl Model {
    pub(crate) fn new(pen: Pen, abilities: u32) -> Self {
        Self {
            picture: Picture::new(pen),
            clouds: Clouds::default(),
            keyframes: Vec::new(),
            closures: Vec::new(),
            changed_paths: BTreeSet::new(),
            changed_closures: BTreeSet::new(),
            is_space: false,
            abilities,
        }
    }

    /// Forgets what is known, but not what is drawn: most of it comes again.
    pub(crate) fn rewind(&mut self) {
        self.keyframes.clear();
        self.closures.clear();
    }

    /// Takes in what is new.
    pub(crate) fn apply(&mut self, news: News, scene: &mut Scene) {
        self.is_space |= news.is_space;
        for placed in news.keyframes {
            self.changed_paths.insert(self.keyframes.len() / BLOCK);
            self.keyframes.push(placed);
        }
        for (number, pose) in news.moved {
            if let Some(keyframe) = self.keyframes.get_mut(number as usize) {
                keyframe.map_from_robot = pose;
                self.changed_paths.insert(number as usize / BLOCK);
            }
        }
        for (number, seen) in news.redrawn {
            if let Some(keyframe) = self.keyframes.get_mut(number as usize) {
                keyframe.seen = seen;
                self.changed_paths.insert(number as usize / BLOCK);
            }
        }
        for (number, closure) in news.closures {
            self.set_closure(number as usize, closure);
        }
        if let Some(robot) = &news.robot {
            scene.set(Key::Robot, wire::robot(robot));
        }
        match (news.scan, news.robot) {
            (Some(points_m), Some(robot)) => scene.set(Key::Scan, wire::scan(&robot.map_from_robot, &every(&points_m))),
            _ => self.show_newest_sweep(scene),
        }
    }

    fn set_closure(&mut self, number: usize, closure: Closure) {
        if number >= MOST_CLOSURES {
            return;
        }
        if self.closures.len() <= number {
            self.closures.resize(number + 1, UNTOLD);
        }
        self.closures[number] = closure;
        self.changed_closures.insert(number / BLOCK);
    }

    /// Where nobody tells the scan itself, the newest keyframe's stands for it.
    fn show_newest_sweep(&self, scene: &mut Scene) {
        let Some(newest) = self.keyframes.last() else { return };
        let points_m: Vec<[f32; 3]> = match &newest.seen {
            Seen::Plane(sweep) => {
                let mut points = SweepPoints::default();
                points.fill(sweep, &mut BeamTable::default(), 0.0);
                points.hits.iter().map(|&[x, y]| [x as f32, y as f32, 0.0]).collect()
            }
            Seen::Space(sweep) => sweep.points_m().collect(),
            Seen::Nothing => Vec::new(),
        };
        scene.set(Key::Scan, wire::scan(&newest.map_from_robot, &every(&points_m)));
    }

    /// Draws what is not drawn where it is, as far as the time of a round goes, and tells all that has changed.
    pub(crate) fn settle(&mut self, scene: &mut Scene) {
        scene.set(Key::Frame, wire::frame(self.picture.resolution_m(), self.is_space, self.abilities));
        scene.set(Key::Words, wire::words());
        if self.is_space {
            self.take_clouds(scene)
        } else {
            self.draw(scene)
        }
        self.tell_lists(scene);
    }

    fn draw(&mut self, scene: &mut Scene) {
        let begun = Instant::now();
        let work = self.picture.work(self.keyframes.iter().map(|keyframe| (&keyframe.seen, &keyframe.map_from_robot)));
        let is_new = |work: &&Work| matches!(work, Work::New(_));
        let rounds = [
            (work.iter().filter(is_new).collect::<Vec<_>>(), TO_DRAW_NEW),
            (work.iter().filter(|work| !is_new(work)).collect(), TO_DRAW_MOVED),
        ];
        for (works, time) in rounds {
            for work in works {
                if begun.elapsed() > time {
                    break;
                }
                let (Work::New(number) | Work::Old(number)) = *work;
                let wanted = self.keyframes.get(number).map(|keyframe| (&keyframe.seen, &keyframe.map_from_robot));
                self.picture.redraw(number, wanted);
            }
        }
        for (fresh, time) in [(true, TO_READ_NEW), (false, TO_READ_AGAIN)] {
            let begun = Instant::now();
            while let Some((tile, cells)) = self.picture.next_changed(fresh) {
                scene.set(Key::Tile(tile.0, tile.1), wire::tile(tile, &cells));
                if begun.elapsed() > time {
                    break;
                }
            }
        }
    }

    fn take_clouds(&mut self, scene: &mut Scene) {
        let begun = Instant::now();
        for (number, keyframe) in self.keyframes.iter().enumerate().rev() {
            if begun.elapsed() > TO_DRAW_NEW {
                return;
            }
            let Seen::Space(sweep) = &keyframe.seen else { continue };
            if self.clouds.has(number) {
                continue;
            }
            let told = if self.clouds.take(number, sweep) { 0..self.clouds.len() } else { number..number + 1 };
            for number in told {
                if let Some((step_m, points)) = self.clouds.of(number) {
                    scene.set(Key::Cloud(number as u32), wire::cloud(number, step_m, points));
                }
            }
        }
    }

    fn tell_lists(&mut self, scene: &mut Scene) {
        for block in std::mem::take(&mut self.changed_paths) {
            let key = Key::Path(block as u32);
            match part(&self.keyframes, block) {
                Some(keyframes) => scene.set(key, wire::path(block * BLOCK, keyframes)),
                None => scene.remove(key),
            }
        }
        for block in std::mem::take(&mut self.changed_closures) {
            let key = Key::Closures(block as u32);
            match part(&self.closures, block) {
                Some(closures) => scene.set(key, wire::closures(block * BLOCK, closures)),
                None => scene.remove(key),
            }
        }
        scene.set(Key::Totals, wire::totals(self.keyframes.len(), self.closures.len()));
    }

    /// After [`Model::rewind`] and what came again: all lists may have become shorter.
    pub(crate) fn tell_all(&mut self, before: [usize; 2]) {
        self.changed_paths.extend(0..=before[0].max(self.keyframes.len()) / BLOCK);
        self.changed_closures.extend(0..=before[1].max(self.closures.len()) / BLOCK);
    }

    /// How many keyframes and closures there are.
    pub(crate) fn lengths(&self) -> [usize; 2] {
        [self.keyframes.len(), self.closures.len()]
    }

    /// Whether all is drawn where it is.
    #[cfg(test)]
    pub(crate) fn is_settled(&self) -> bool {
        self.picture.work(self.keyframes.iter().map(|keyframe| (&keyframe.seen, &keyframe.map_from_robot))).is_empty()
    }

    #[cfg(test)]
    pub(crate) fn picture(&self) -> &Picture {
        &self.picture
    }
}

/// The items of a block; none where it begins beyond the last.
fn part<T>(all: &[T], block: usize) -> Option<&[T]> {
    let begin = block * BLOCK;
    all.get(begin..all.len().min(begin + BLOCK)).filter(|part| !part.is_empty())
}

/// As many of them as a scan shows, evenly.
fn every(points_m: &[[f32; 3]]) -> Vec<[f32; 3]> {
    points_m.iter().step_by(points_m.len().div_ceil(MOST_SCAN_POINTS).max(1)).copied().collect()
}

#[cfg(test)]
mod tests;
