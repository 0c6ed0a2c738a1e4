//! A surface that follows its keyframes.

use crate::block::Change;
use crate::error::SurfaceError;
use crate::mesh::{Mesh, MeshSettings};
use crate::patch::Patch;
use crate::settings::SurfaceSettings;
use crate::view::{PointCounts, View};
use crate::volume::Volume;
use mapwright_geom::Pose3;
use std::collections::BTreeMap;

/// The surface of keyframes, drawn once and then kept in step with corrections of their poses.
///
/// Each keyframe has a *render pose*, where it is drawn. [`Surface::update`] sets it to the present pose where the two are farther apart than
/// asked. However it came about, the surface of some keyframes at some render poses is the same to the bit.
///
/// ```
/// use mapwright_geom::Pose3;
/// use mapwright_surface::{MeshSettings, Surface, SurfaceSettings, View, write_ply};
/// # fn main() -> Result<(), mapwright_surface::SurfaceError> {
/// // A wall, one metre ahead of the sensor.
/// let steps = |k: i32| k as f32 * 0.02;
/// let points_m: Vec<[f32; 3]> = (-40..40).flat_map(|y| (-40..40).map(move |z| [1.0, steps(y), steps(z)])).collect();
/// let view = View { points_m: &points_m, origins_m: &[[0.0; 3]], colours: &[] };
///
/// let mut surface = Surface::new(SurfaceSettings { voxel_m: 0.05, ..SurfaceSettings::default() })?;
/// surface.add(7, &view, Pose3::identity())?;
/// // After each correction of poses:
/// let corrected = Pose3 { translation: [0.0, 0.0, 0.3].into(), ..Pose3::identity() };
/// surface.update(&[(7, corrected)], 0.0)?;
///
/// let mesh = surface.mesh(&MeshSettings::default());
/// assert!(mesh.positions_m.iter().all(|[x, ..]| (x - 1.0).abs() < 0.001));
/// let mut file = Vec::new();
/// write_ply(&mut file, &mesh)?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Surface {
    volume: Volume,
    keyframes: BTreeMap<u64, Keyframe>,
}

#[derive(Debug, Clone)]
struct Keyframe {
    patch: Patch,
    /// None where memory did not suffice to draw it.
    map_from_keyframe: Option<Pose3>,
    /// Discs that lie beyond the places of a map, and are not drawn.
    outside: usize,
}

/// What an update did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Updated {
    /// Keyframes that were drawn elsewhere.
    pub moved: usize,
    /// Poses of keyframes that the surface does not have.
    pub unknown: usize,
}

impl Surface {
    /// No keyframe yet.
    ///
    /// # Errors
    /// [`SurfaceError::Setting`].
    pub fn new(settings: SurfaceSettings) -> Result<Self, SurfaceError> {
        Ok(Self { volume: Volume::new(settings)?, keyframes: BTreeMap::new() })
    }

    /// The distances that it is made of.
    #[must_use]
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// Numbers of its keyframes in rising order, and where each is drawn, if it is.
    pub fn keyframes(&self) -> impl Iterator<Item = (u64, Option<Pose3>)> + '_ {
        self.keyframes.iter().map(|(&id, keyframe)| (id, keyframe.map_from_keyframe))
    }

    /// Pieces of surface that lie beyond half a million voxels from the map's origin at the present render poses, and are not drawn.
    #[must_use]
    pub fn outside(&self) -> usize {
        self.keyframes.values().map(|keyframe| keyframe.outside).sum()
    }

    /// Adds a keyframe at its pose. Says which of its points could not be used.
    ///
    /// # Errors
    /// [`SurfaceError::Twice`], [`SurfaceError::Columns`], [`SurfaceError::Pose`], [`SurfaceError::TooManyClouds`] and [`SurfaceError::Memory`], after which
    /// the surface is as before.
    pub fn add(&mut self, id: u64, view: &View<'_>, map_from_keyframe: Pose3) -> Result<PointCounts, SurfaceError> {
        let patch = Patch::prepare(view, self.volume.settings())?;
        let counts = *patch.counts();
        self.add_patch(id, patch, map_from_keyframe)?;
        Ok(counts)
    }

    /// As [`Surface::add`], of a view that was prepared before, perhaps by another thread.
    ///
    /// # Errors
    /// The same, and [`SurfaceError::OtherVoxels`].
    pub fn add_patch(&mut self, id: u64, patch: Patch, map_from_keyframe: Pose3) -> Result<(), SurfaceError> {
        if self.keyframes.contains_key(&id) {
            return Err(SurfaceError::Twice { id });
        }
        let outside = self.volume.draw(&patch, map_from_keyframe, Change::Add)?;
        self.keyframes.insert(id, Keyframe { patch, map_from_keyframe: Some(map_from_keyframe), outside });
        Ok(())
    }

    /// Takes a keyframe out: what is left is as if it had never been there.
    ///
    /// # Errors
    /// [`SurfaceError::Unknown`].
    pub fn remove(&mut self, id: u64) -> Result<(), SurfaceError> {
        let Keyframe { patch, map_from_keyframe, .. } =
            self.keyframes.remove(&id).ok_or(SurfaceError::Unknown { id })?;
        map_from_keyframe.map_or(Ok(()), |at| self.volume.draw(&patch, at, Change::Remove).map(drop))
    }

    /// Draws keyframes anew of which a point may lie more than `threshold_m` from where it should, metres. With a threshold of 0 the surface is afterwards
    /// the one drawn from scratch. Keyframes without a pose here stay where they are.
    ///
    /// # Errors
    /// [`SurfaceError::Pose`], after which the surface is as before. [`SurfaceError::Memory`]: those that did not fit are not drawn
    /// until an update has memory for them.
    pub fn update(&mut self, map_from_keyframe: &[(u64, Pose3)], threshold_m: f64) -> Result<Updated, SurfaceError> {
        if !map_from_keyframe.iter().all(|(_, pose)| pose.is_finite()) {
            return Err(SurfaceError::Pose);
        }
        let is_known = |it: &&(u64, Pose3)| self.keyframes.contains_key(&it.0);
        let known: BTreeMap<u64, Pose3> = map_from_keyframe.iter().filter(is_known).copied().collect();
        let has_moved = |it: &(u64, Pose3)| self.keyframes.get(&it.0).is_some_and(|is| is.has_moved(it.1, threshold_m));
        let unknown = map_from_keyframe.len() - map_from_keyframe.iter().filter(is_known).count();
        let moved: Vec<(u64, Pose3)> = known.into_iter().filter(has_moved).collect();
        self.take_out(&moved)?;
        moved.iter().try_for_each(|&(id, pose)| self.draw_at(id, pose))?;
        Ok(Updated { moved: moved.len(), unknown })
    }

    /// The surface as triangles.
    #[must_use]
    pub fn mesh(&self, settings: &MeshSettings) -> Mesh {
        self.volume.mesh(settings)
    }

    /// Takes keyframes out that are to be drawn elsewhere. Where they are more than those that stay, these are drawn from scratch: the sums are the same.
    fn take_out(&mut self, moved: &[(u64, Pose3)]) -> Result<(), SurfaceError> {
        let taken: Vec<(u64, Pose3)> = moved
            .iter()
            .filter_map(|&(id, _)| Some((id, self.keyframes.get_mut(&id)?.map_from_keyframe.take()?)))
            .collect();
        let stays = |keyframe: &Keyframe| keyframe.map_from_keyframe.is_some();
        if taken.len() <= self.keyframes.values().filter(|&it| stays(it)).count() {
            let Self { volume, keyframes } = self;
            let patches = taken.iter().filter_map(|(id, at)| Some((&keyframes.get(id)?.patch, *at)));
            return patches.into_iter().try_for_each(|(patch, at)| volume.draw(patch, at, Change::Remove).map(drop));
        }
        self.volume.clear();
        let staying: Vec<(u64, Pose3)> =
            self.keyframes.iter().filter_map(|(&id, it)| Some((id, it.map_from_keyframe?))).collect();
        staying.into_iter().try_for_each(|(id, pose)| self.draw_at(id, pose))
    }

    fn draw_at(&mut self, id: u64, map_from_keyframe: Pose3) -> Result<(), SurfaceError> {
        let Some(keyframe) = self.keyframes.get_mut(&id) else { return Ok(()) };
        keyframe.map_from_keyframe = None;
        keyframe.outside = self.volume.draw(&keyframe.patch, map_from_keyframe, Change::Add)?;
        keyframe.map_from_keyframe = Some(map_from_keyframe);
        Ok(())
    }
}

impl Keyframe {
    /// Whether a point of it may lie farther than this from where it is drawn, metres.
    fn has_moved(&self, now: Pose3, threshold_m: f64) -> bool {
        self.map_from_keyframe.is_none_or(|drawn| {
            let turned_rad = drawn.rotation.angle_to(&now.rotation);
            drawn != now
                && !(drawn.distance(now) + self.patch.lever_m() * turned_rad <= threshold_m && threshold_m > 0.0)
        })
    }
}
