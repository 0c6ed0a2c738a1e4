//! The finished map as a surface: what [`super::SpaceMap`] is of occupancy, of signed distances.

use crate::render::FOLLOW_CELLS;
use mapwright_geom::Pose3;
use mapwright_record::{SeparateMap, Session};
use mapwright_sensor::{SpaceSensor, SpaceSweep};
use mapwright_surface::{Mesh, MeshSettings, Patch, PointCounts, Surface, SurfaceError, SurfaceSettings, View};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Noise of a point is at most so many voxels where a surface is drawn: larger noise asks for larger voxels.
const NOISE_VOXELS_MOST: f64 = 2.0;
/// Of a session's intensities this share is darker than what is shown as white.
const WHITE_SHARE: f64 = 0.98;
/// Points that are looked at for that, and for their usual range; more say nothing new.
const POINTS_USED: usize = 100_000;

/// How a surface of what this sensor saw is drawn with voxels of `voxel_m` metres: noise is the sensor's own, and what is seen from the usual range or nearer
/// counts fully ([`usual_range_m`]).
#[must_use]
pub fn surface_settings(sensor: &SpaceSensor, usual_range_m: f64, voxel_m: f64) -> SurfaceSettings {
    SurfaceSettings {
        voxel_m,
        near_m: usual_range_m.clamp(0.0, 1e6),
        noise_m: sensor.range_sigma_m.clamp(0.0, NOISE_VOXELS_MOST * voxel_m),
        noise_per_m: sensor.range_sigma_per_m.clamp(0.0, 1.0),
        ..SurfaceSettings::default()
    }
}

/// The median range of the points that a session's keyframes keep, metres; 0 where there are none.
#[must_use]
pub fn usual_range_m(session: &Session<SpaceSweep>) -> f64 {
    let drawn = || session.drawn().iter().flatten();
    let all: usize = drawn().map(|sweep| sweep.points.len()).sum();
    let step = all.div_ceil(POINTS_USED).max(1);
    let ranges = drawn().flat_map(|sweep| {
        let from = sweep.origin_m();
        sweep.points_m().map(move |p| (0..3).map(|k| (f64::from(p[k]) - from[k]).powi(2)).sum::<f64>().sqrt())
    });
    let mut ranges: Vec<f64> = ranges.step_by(step).collect();
    let at = ranges.len() / 2;
    if ranges.is_empty() { 0.0 } else { *ranges.select_nth_unstable_by(at, f64::total_cmp).1 }
}

/// The intensity that is shown as white where keyframes have intensities and no colours, in units of the device: of all of a session's, two in a hundred are
/// brighter. None where there are none.
#[must_use]
pub fn white_of(session: &Session<SpaceSweep>) -> Option<f32> {
    let drawn = || session.drawn().iter().flatten();
    let all: usize = drawn().map(|sweep| sweep.intensities.len()).sum();
    let step = all.div_ceil(POINTS_USED).max(1);
    let bright = drawn().flat_map(|sweep| sweep.intensities()).step_by(step).filter(|v| v.is_finite() && *v > 0.0);
    let mut bright: Vec<f32> = bright.collect();
    let at = (WHITE_SHARE * bright.len() as f64) as usize;
    (at < bright.len()).then(|| *bright.select_nth_unstable_by(at, f32::total_cmp).1)
}

/// The surface of a session, drawn once and then kept in step with corrections.
///
/// Each keyframe has a *render pose*, where it is drawn. [`SurfaceMap::follow`] sets it to the present pose where the two are visibly apart,
/// [`SurfaceMap::export`] everywhere. What is known of voxels is integers: however it came about, an exported surface equals the one drawn from scratch
/// to the bit, on any number of threads. Keyframes that a map leaves out, and what moved, are not drawn.
///
/// ```
/// # use mapwright::{Settings, SpaceMapper, SurfaceMap};
/// # use mapwright_surface::{MeshSettings, SurfaceSettings};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let mapper = SpaceMapper::new(Settings::default())?;
/// let mut map = SurfaceMap::new(SurfaceSettings::default(), None)?;
/// // After each correction, or when somebody looks:
/// map.follow(mapper.session(), 1)?;
/// let mesh = map.mesh(&MeshSettings::default());
/// # assert!(mesh.triangles.is_empty());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct SurfaceMap {
    surface: Surface,
    /// What shows intensities as white, where they stand for colours.
    white: Option<f32>,
    /// By their places in the session.
    drawn: BTreeMap<u64, Arc<SpaceSweep>>,
    counts: PointCounts,
}

/// A keyframe that is to be drawn.
type Wanted<'a> = (u64, &'a Arc<SpaceSweep>, Pose3);

impl SurfaceMap {
    /// An empty surface. Keyframes without colours are drawn in grey by their intensities, up to `white`, where it is given.
    ///
    /// # Errors
    /// [`SurfaceError::Setting`].
    pub fn new(settings: SurfaceSettings, white: Option<f32>) -> Result<Self, SurfaceError> {
        let white = white.filter(|white| white.is_finite() && *white > 0.0);
        Ok(Self { surface: Surface::new(settings)?, white, drawn: BTreeMap::new(), counts: PointCounts::default() })
    }

    /// The distances at the render poses; keyframes are called by their places in the session.
    #[must_use]
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// What became of the points of all keyframes that were ever drawn.
    #[must_use]
    pub fn counts(&self) -> &PointCounts {
        &self.counts
    }

    /// Draws new keyframes, takes out what is left out, and draws those anew of which a point may have moved by more than a quarter of a voxel since they were
    /// drawn. Returns how many there were of all these.
    ///
    /// # Errors
    /// [`SurfaceError::Memory`], [`SurfaceError::TooManyClouds`] and [`SurfaceError::Pose`]: what could not be drawn is drawn by the next call that can.
    pub fn follow(&mut self, session: &Session<SpaceSweep>, threads: usize) -> Result<usize, SurfaceError> {
        let visible_m = FOLLOW_CELLS * self.surface.volume().settings().voxel_m;
        self.update(&wanted(session, 0..session.keyframes().len()), visible_m, threads)
    }

    /// As [`SurfaceMap::follow`], of all that have moved at all: afterwards the surface is the one drawn from scratch.
    ///
    /// # Errors
    /// The same.
    pub fn export(&mut self, session: &Session<SpaceSweep>, threads: usize) -> Result<&Surface, SurfaceError> {
        self.update(&wanted(session, 0..session.keyframes().len()), 0.0, threads)?;
        Ok(&self.surface)
    }

    /// The same of one of its maps ([`Session::maps`]) alone.
    ///
    /// # Errors
    /// The same.
    pub fn export_map(
        &mut self,
        session: &Session<SpaceSweep>,
        map: &SeparateMap,
        threads: usize,
    ) -> Result<&Surface, SurfaceError> {
        self.update(&wanted(session, map.places()), 0.0, threads)?;
        Ok(&self.surface)
    }

    /// The surface as triangles.
    #[must_use]
    pub fn mesh(&self, settings: &MeshSettings) -> Mesh {
        self.surface.mesh(settings)
    }

    fn update(&mut self, wanted: &[Wanted<'_>], threshold_m: f64, threads: usize) -> Result<usize, SurfaceError> {
        let stays = |(id, sweep): (&u64, &Arc<SpaceSweep>)| {
            let known = wanted.binary_search_by_key(id, |it| it.0).ok();
            known.is_some_and(|at| Arc::ptr_eq(wanted[at].1, sweep))
        };
        let gone: Vec<u64> = self.drawn.iter().filter(|&it| !stays(it)).map(|(&id, _)| id).collect();
        for id in &gone {
            self.surface.remove(*id)?;
            self.drawn.remove(id);
        }
        let poses: Vec<(u64, Pose3)> = wanted.iter().map(|&(id, _, pose)| (id, pose)).collect();
        let moved = self.surface.update(
            &poses.iter().filter(|(id, _)| self.drawn.contains_key(id)).copied().collect::<Vec<_>>(),
            threshold_m,
        )?;
        let new: Vec<&Wanted<'_>> = wanted.iter().filter(|(id, ..)| !self.drawn.contains_key(id)).collect();
        let added = new.len();
        for share in new.chunks(threads.max(1)) {
            self.add(share)?;
        }
        Ok(gone.len() + moved.moved + added)
    }

    /// Adds keyframes, each prepared on a thread of its own; their sums commute.
    fn add(&mut self, keyframes: &[&Wanted<'_>]) -> Result<(), SurfaceError> {
        let (settings, white) = (*self.surface.volume().settings(), self.white);
        let sweeps: Vec<&SpaceSweep> = keyframes.iter().map(|it| it.1.as_ref()).collect();
        let patches = on_threads(&sweeps, |sweep| prepared(sweep, &settings, white));
        for (&&(id, sweep, pose), patch) in keyframes.iter().zip(patches) {
            let patch = patch?;
            let PointCounts { points, not_finite, near, far } = *patch.counts();
            self.surface.add_patch(id, patch, pose)?;
            self.drawn.insert(id, Arc::clone(sweep));
            self.counts.points += points;
            self.counts.not_finite += not_finite;
            self.counts.near += near;
            self.counts.far += far;
        }
        Ok(())
    }
}

/// Works on each of a few things on a thread of its own; results stand in their order.
fn on_threads<T: Sync, R: Send>(all: &[&T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    if let [one] = all {
        return vec![work(one)];
    }
    let work = &work;
    std::thread::scope(|scope| {
        let mut running = Vec::new();
        for &one in all {
            running.push((one, std::thread::Builder::new().spawn_scoped(scope, move || work(one))));
        }
        let finish = |(one, thread): (&T, std::io::Result<std::thread::ScopedJoinHandle<'_, R>>)| match thread {
            Ok(thread) => thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
            // No thread was to be had.
            Err(_) => work(one),
        };
        running.into_iter().map(finish).collect()
    })
}

/// What is to be drawn of these keyframes, by their places.
fn wanted(session: &Session<SpaceSweep>, places: impl Iterator<Item = usize>) -> Vec<Wanted<'_>> {
    let keyframe = |place: usize| {
        let sweep = session.drawn().get(place)?.as_ref()?;
        Some((place as u64, sweep, *session.map_from_keyframe().get(place)?))
    };
    let mut wanted: Vec<Wanted<'_>> = places.filter_map(keyframe).collect();
    wanted.sort_unstable_by_key(|it| it.0);
    wanted
}

fn prepared(sweep: &SpaceSweep, settings: &SurfaceSettings, white: Option<f32>) -> Result<Patch, SurfaceError> {
    let points_m: Vec<[f32; 3]> = sweep.points_m().collect();
    let has = |column: usize| column == points_m.len();
    let grey: Vec<[u8; 3]> = match white {
        Some(white) if !has(sweep.colours.len()) && has(sweep.intensities.len()) => {
            sweep.intensities().map(|intensity| grey(intensity, white)).collect()
        }
        _ => Vec::new(),
    };
    let colours = if has(sweep.colours.len()) { &sweep.colours } else { &grey };
    let origin_m = sweep.origin_m().map(|v| v as f32);
    Patch::prepare(&View { points_m: &points_m, origins_m: &[origin_m], colours }, settings)
}

/// How bright an intensity is shown; the root is near to what screens make of light.
fn grey(intensity: f32, white: f32) -> [u8; 3] {
    // Casts saturate; what is no number is black.
    [(255.0 * (intensity / white).clamp(0.0, 1.0).sqrt()).round() as u8; 3]
}
