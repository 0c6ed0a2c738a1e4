//! The global map: every keyframe's beams where the keyframe is, or was until it moved by enough to see.

use crate::front::{DOUBT_SHARE, MISFIT_KNOWN_SHARE};
use crate::settings::Settings;
use mapwright_geom::Pose2;
use mapwright_grid::{Change, Changes, CountGrid, floor_cell};
use mapwright_record::{KeyframeId, SeparateMap, Session};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// A drawn keyframe is drawn anew when one of its points may have moved by more than this share of a cell, or of a voxel.
pub(crate) const FOLLOW_CELLS: f64 = 0.25;
/// Keyframes that a thread takes at a time.
const SHARE: usize = 32;

/// The whole map, drawn once and then kept in step with corrections.
///
/// Each keyframe has a *render pose*, where its beams are drawn. [`GlobalMap::follow`] sets it to the present pose where
/// the two are visibly apart, [`GlobalMap::export`] everywhere. Counts are integers: however it came about, an exported
/// map equals one drawn from scratch to the bit, on any number of threads.
///
/// ```
/// # use mapwright::{GlobalMap, Mapper, Settings};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let mapper = Mapper::new(Settings::default())?;
/// let mut map = GlobalMap::new(mapper.settings());
/// // After each correction, or when somebody looks:
/// map.follow(mapper.session(), 2);
/// let known = map.counts().known_cells().count();
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct GlobalMap {
    counts: CountGrid,
    pen: Pen,
    drawn: Vec<Option<Drawn>>,
}

/// What is drawn where: of each keyframe a sweep, if anything.
type Wanted<'a> = Option<(&'a Arc<Sweep>, Pose2)>;

/// How keyframes are drawn.
#[derive(Debug, Clone, Copy)]
struct Pen {
    resolution_m: f64,
    free_range_m: f64,
    passes_per_hit: u32,
    normals: bool,
}

#[derive(Debug, Clone)]
struct Drawn {
    sweep: Arc<Sweep>,
    world_from_keyframe: Pose2,
    /// Distance of the farthest drawn point from the keyframe, metres; how far a rotation moves it.
    lever_m: f64,
}

/// A keyframe to be drawn, taken out or both.
struct Work<'a> {
    number: usize,
    from: Option<Drawn>,
    to: Wanted<'a>,
}

impl GlobalMap {
    /// An empty map.
    #[must_use]
    pub fn new(settings: &Settings) -> Self {
        Self {
            counts: CountGrid::new(settings.map.resolution_m),
            pen: Pen {
                resolution_m: settings.map.resolution_m,
                free_range_m: settings.scan.free_range_m,
                passes_per_hit: settings.map.passes_per_hit,
                normals: true,
            },
            drawn: Vec::new(),
        }
    }

    /// An empty map that counts hits and passes and where in a cell the hits are, but not which way surfaces face: all that
    /// a picture shows, in less time.
    #[must_use]
    pub fn without_normals(settings: &Settings) -> Self {
        let mut map = Self::new(settings);
        map.pen.normals = false;
        map
    }

    /// Counts of all keyframes at their render poses.
    #[must_use]
    pub fn counts(&self) -> &CountGrid {
        &self.counts
    }

    /// Where a keyframe is drawn, if it is.
    #[must_use]
    pub fn render_pose(&self, number: usize) -> Option<Pose2> {
        self.drawn.get(number)?.as_ref().map(|drawn| drawn.world_from_keyframe)
    }

    /// Draws new keyframes, takes out what is left out, and draws those anew of which a point may have moved by more
    /// than a quarter of a cell. Returns how many there were of all these.
    ///
    /// The session is that of the last call, which may have grown. The work is shared by `threads` threads, of which the
    /// caller's is one.
    pub fn follow(&mut self, session: &Session, threads: usize) -> usize {
        let visible_m = FOLLOW_CELLS * self.counts.resolution_m();
        self.update(&wanted(session.drawn(), session.map_from_keyframe()), threads, |drawn, now| {
            let turned_rad = drawn.world_from_keyframe.between(now).theta.abs();
            drawn.world_from_keyframe.distance(now) + drawn.lever_m * turned_rad > visible_m
        })
    }

    /// As [`GlobalMap::follow`], for all that have moved at all: afterwards the map is the one drawn from scratch, its
    /// tiles and slots in the same order.
    pub fn export(&mut self, session: &Session, threads: usize) -> &CountGrid {
        self.export_at(session.drawn(), session.map_from_keyframe(), threads)
    }

    /// As [`GlobalMap::export`], of any sweeps at any poses; those that are none are left out.
    pub fn export_at(
        &mut self,
        drawn: &[Option<Arc<Sweep>>],
        map_from_keyframe: &[Pose2],
        threads: usize,
    ) -> &CountGrid {
        self.export_wanted(&wanted(drawn, map_from_keyframe), threads);
        &self.counts
    }

    fn export_wanted(&mut self, wanted: &[Wanted<'_>], threads: usize) {
        self.update(wanted, threads, |drawn, now| drawn.world_from_keyframe != now);
        self.counts.compact();
    }

    /// As [`GlobalMap::export`], but of the keyframes whose scan hardly fitted only those are drawn that agree with what all others
    /// show or that end where these show nothing. Returns those that are left out.
    ///
    /// A scan that hardly fitted may have been matched wrong, turned in a doorway say; what it saw is shown by those before and
    /// after it. It is judged by the whole map, for where a loop was open it may have been the map that was wrong, and with every
    /// beam it had.
    pub fn export_believed(&mut self, session: &Session, threads: usize) -> Vec<KeyframeId> {
        self.export_wanted_believed(session, &wanted(session.drawn(), session.map_from_keyframe()), threads)
    }

    /// As [`GlobalMap::export_believed`], of the keyframes of one of the session's maps ([`Session::maps`]): nothing of another is drawn, and by
    /// nothing of another is anything judged.
    pub fn export_believed_of(&mut self, session: &Session, map: &SeparateMap, threads: usize) -> Vec<KeyframeId> {
        let all = wanted(session.drawn(), session.map_from_keyframe());
        let own = all.into_iter().enumerate().map(|(place, wanted)| wanted.filter(|_| map.has(place)));
        self.export_wanted_believed(session, &own.collect::<Vec<_>>(), threads)
    }

    fn export_wanted_believed(&mut self, session: &Session, all: &[Wanted<'_>], threads: usize) -> Vec<KeyframeId> {
        let mut sure = all.to_vec();
        let doubted: Vec<usize> =
            (0..all.len()).filter(|&k| session.keyframes()[k].hardly_fits && sure[k].take().is_some()).collect();
        self.export_wanted(&sure, threads);
        let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
        let mut left_out = Vec::new();
        for &k in &doubted {
            let keyframe = &session.keyframes()[k];
            points.fill(&keyframe.sweep, &mut table, self.pen.free_range_m);
            if self.contradicts(&points.hits, session.map_from_keyframe()[k]) {
                left_out.push(keyframe.id);
            } else {
                sure[k] = all[k];
            }
        }
        if left_out.len() < doubted.len() {
            self.export_wanted(&sure, threads);
        }
        left_out
    }

    /// Whether most of a scan's end points lie where something is known, and too few of these where anything is.
    fn contradicts(&self, hits: &[[f64; 2]], world_from_robot: Pose2) -> bool {
        let (s, c) = world_from_robot.theta.sin_cos();
        let cells_per_m = 1.0 / self.pen.resolution_m;
        let (mut known, mut fitting) = (0_u32, 0_u32);
        for &[x, y] in hits {
            let cell_x = floor_cell((world_from_robot.x + c * x - s * y) * cells_per_m);
            let cell_y = floor_cell((world_from_robot.y + s * x + c * y) * cells_per_m);
            let fits = (-1..=1).any(|dy| (-1..=1).any(|dx| self.is_obstacle(cell_x + dx, cell_y + dy)));
            fitting += u32::from(fits);
            known += u32::from(fits || self.counts.passes(cell_x, cell_y) > 0);
        }
        f64::from(known) > MISFIT_KNOWN_SHARE * hits.len() as f64 && f64::from(fitting) < DOUBT_SHARE * f64::from(known)
    }

    fn is_obstacle(&self, cell_x: i32, cell_y: i32) -> bool {
        let passes = || self.counts.passes(cell_x, cell_y);
        let slot = self.counts.slot(cell_x, cell_y);
        slot.is_some_and(|slot| self.counts.cell(slot).is_obstacle(passes(), self.pen.passes_per_hit))
    }

    /// The counts, when nothing more is to follow.
    #[must_use]
    pub fn into_counts(self) -> CountGrid {
        self.counts
    }

    fn update(&mut self, wanted: &[Wanted<'_>], threads: usize, moved: impl Fn(&Drawn, Pose2) -> bool) -> usize {
        self.drawn.resize(wanted.len().max(self.drawn.len()), None);
        let mut work = Vec::new();
        for (number, &to) in wanted.iter().enumerate() {
            let drawn = &self.drawn[number];
            let stays = match (drawn, to) {
                (None, None) => true,
                (Some(drawn), Some((sweep, now))) => Arc::ptr_eq(&drawn.sweep, sweep) && !moved(drawn, now),
                _ => false,
            };
            if !stays {
                work.push(Work { number, from: drawn.clone(), to });
            }
        }
        let changed = work.len();
        self.draw_from_scratch_if_cheaper(wanted, &mut work);
        self.draw(&work, threads);
        changed
    }

    /// Where more is to be taken out than stays, all is drawn from scratch: the counts are the same.
    fn draw_from_scratch_if_cheaper<'a>(&mut self, wanted: &[Wanted<'a>], work: &mut Vec<Work<'a>>) {
        for work in &*work {
            self.drawn[work.number] = None;
        }
        let taken_out = work.iter().filter(|work| work.from.is_some()).count();
        let staying = self.drawn.iter().flatten().count();
        // Keyframes that are no longer handed over cannot be drawn.
        if taken_out <= staying || self.drawn.len() > wanted.len() {
            return;
        }
        self.counts = CountGrid::new(self.counts.resolution_m());
        work.iter_mut().for_each(|work| work.from = None);
        work.extend(wanted.iter().enumerate().filter_map(|(number, &to)| {
            let at = self.render_pose(number)?;
            let (sweep, _) = to?;
            Some(Work { number, from: None, to: Some((sweep, at)) })
        }));
    }

    fn draw(&mut self, work: &[Work<'_>], threads: usize) {
        let helpers = threads.min(work.len().div_ceil(SHARE)).saturating_sub(1);
        let next = AtomicUsize::new(0);
        let pen = self.pen;
        let take_shares = || take_shares(work, &next, pen);
        let done = thread::scope(|scope| {
            let spawn = |_| thread::Builder::new().spawn_scoped(scope, take_shares).ok();
            // Where there is no thread to be had, the others do its share.
            let helpers: Vec<_> = (0..helpers).filter_map(spawn).collect();
            let mut done = vec![take_shares()];
            for helper in helpers {
                done.push(helper.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            }
            done
        });
        let (shares, levers): (Vec<_>, Vec<_>) = done.into_iter().unzip();
        self.counts.take_in(shares);
        for (k, lever_m) in levers.into_iter().flatten() {
            let drawn_at = |(sweep, world_from_keyframe): (&Arc<Sweep>, Pose2)| Drawn {
                sweep: Arc::clone(sweep),
                world_from_keyframe,
                lever_m,
            };
            self.drawn[work[k].number] = work[k].to.map(drawn_at);
        }
    }
}

/// What is drawn of keyframes at these poses.
fn wanted<'a>(drawn: &'a [Option<Arc<Sweep>>], map_from_keyframe: &[Pose2]) -> Vec<Wanted<'a>> {
    drawn.iter().zip(map_from_keyframe).map(|(sweep, &pose)| Some((sweep.as_ref()?, pose))).collect()
}

/// Takes a few keyframes at a time until there are none left; returns what that changes and the levers of the keyframes.
fn take_shares(work: &[Work<'_>], next: &AtomicUsize, pen: Pen) -> (Changes, Vec<(usize, f64)>) {
    let (mut changes, mut levers) = (Changes::new(pen.resolution_m), Vec::new());
    let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
    loop {
        let first = next.fetch_add(SHARE, Ordering::Relaxed);
        if first >= work.len() {
            return (changes, levers);
        }
        for k in first..work.len().min(first + SHARE) {
            let Work { from, to, .. } = &work[k];
            let from = from.as_ref().map(|drawn| (&drawn.sweep, drawn.world_from_keyframe));
            let mut filled: Option<&Arc<Sweep>> = None;
            for (wanted, change) in [(from, Change::Remove), (*to, Change::Add)] {
                let Some((sweep, world_from_keyframe)) = wanted else { continue };
                if !filled.replace(sweep).is_some_and(|filled| Arc::ptr_eq(filled, sweep)) {
                    pen.fill(&mut points, sweep, &mut table);
                }
                changes.draw(&points, world_from_keyframe, change);
            }
            levers.push((k, farthest_m(&points)));
        }
    }
}

impl Pen {
    fn fill(&self, points: &mut SweepPoints, sweep: &Sweep, table: &mut BeamTable) {
        points.fill(sweep, table, self.free_range_m);
        if self.normals {
            points.fill_normals();
        } else {
            points.normals.resize(points.hits.len(), [0.0; 2]);
        }
    }
}

/// Distance of the farthest point of all beams from the robot.
fn farthest_m(points: &SweepPoints) -> f64 {
    let ends = points.hits.iter().chain(&points.free_ends).chain([&points.origin]);
    ends.map(|[x, y]| x * x + y * y).fold(0.0, f64::max).sqrt()
}
