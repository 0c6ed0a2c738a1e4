//! A keyframe as small pieces of surface, in its own frame: made once, drawn wherever it is.

use crate::error::SurfaceError;
use crate::pyramid::Pyramid;
use crate::settings::{NOISE_VOXELS, SurfaceSettings, truncation_voxels};
use crate::view::{PointCounts, View};
use nalgebra::Vector3;

/// A small disc of surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    /// Mean of the points of a voxel, metres, in the keyframe's frame.
    pub(crate) mean_m: [f32; 3],
    /// Of length one, towards the sensor.
    pub(crate) normal: [f32; 3],
    /// How far it speaks for its surroundings, voxels.
    pub(crate) radius: f32,
    /// How far before and behind it distances are known, voxels.
    pub(crate) truncation: f32,
    /// How much it counts in its middle: around most places that of all discs adds up to 1 where they face the sensor from near.
    pub(crate) weight: f32,
}

/// A view prepared for surfaces with certain settings: small discs in the keyframe's frame, whatever its pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    pub(crate) voxel_m: f64,
    pub(crate) discs: Vec<Disc>,
    /// One each, or none.
    pub(crate) colours: Vec<[u8; 3]>,
    /// One for all, or one each, metres.
    origins_m: Vec<[f32; 3]>,
    /// Discs to which rays are followed.
    pub(crate) rays: Vec<u32>,
    lever_m: f64,
    counts: PointCounts,
}

/// A surface that a ray meets at less than this, radians, is seen edge-on: where it lies cannot be said (as of surfels, `voxel/src/surfel.rs`).
const EDGE_ON: f64 = 0.05;
/// A disc reaches as far as the next, and so far at least, voxels: the nearest mean of a voxel's points may lie a voxel's diagonal aside.
const DISC_LEAST: f64 = 1.25;
/// Levels of cells from the first on that is wider than the noise: rings of a lidar up to 16 voxels apart make planes.
const LEVELS: usize = 5;
/// One ray is followed to each cell of this level, of two voxels a side: halfway to the sensor they lie a voxel apart.
const RAY_LEVEL: usize = 1;
/// Noise is taken to be so many voxels at least where points of different ranges are weighed: all of them are rounded by so much.
const LEAST_NOISE: f64 = 0.01;

impl Patch {
    /// Prepares a view.
    ///
    /// Points are merged by voxels (Oleynikova et al. 2017, "Voxblox", section IV.B, grouped raycasting). The mean of each voxel becomes a disc across the normal of the
    /// plane through the points around it: of those in the smallest cube, of sides that double, that is wider than the noise and in which they spread both
    /// ways. Where there is none, nothing is known: a single ring of a lidar on a distant floor does not say which way the floor lies. A disc counts by
    /// the cosine at which it is seen (Newcombe et al. 2011, "KinectFusion", section 3.3) and by the inverse of the variance at its range.
    ///
    /// # Errors
    /// [`SurfaceError::Setting`] and [`SurfaceError::Columns`]. Points that cannot be used are left out and counted.
    pub fn prepare(view: &View<'_>, settings: &SurfaceSettings) -> Result<Self, SurfaceError> {
        settings.validate()?;
        view.validate()?;
        let least = level_above(settings.noise_voxels(0.0));
        let most = if settings.noise_per_m > 0.0 { level_above(NOISE_VOXELS) } else { least };
        let (pyramid, counts) = Pyramid::build(view, settings.voxel_m, least, most + LEVELS);
        let mut patch = Self {
            voxel_m: settings.voxel_m,
            discs: Vec::with_capacity(pyramid.len()),
            colours: Vec::new(),
            origins_m: Vec::new(),
            rays: Vec::new(),
            lever_m: 0.0,
            counts,
        };
        let mut has_ray = vec![!settings.carve; pyramid.cells(RAY_LEVEL)];
        for number in pyramid.in_order() {
            let Some(disc) = disc_of(&pyramid, number, settings) else { continue };
            let cell = pyramid.cell_around(number, RAY_LEVEL);
            if let Some(has_ray) = cell.and_then(|cell| has_ray.get_mut(cell)).filter(|has_ray| !**has_ray) {
                *has_ray = true;
                patch.rays.push(patch.discs.len() as u32);
            }
            patch.discs.push(disc);
            patch.origins_m.push(to_f32(pyramid.origin_m(number)));
            patch.colours.extend(pyramid.colour(number));
        }
        let reach_m = |at: &[f32; 3]| Vector3::from(at.map(f64::from)).norm();
        let means_m = patch.discs.iter().map(|disc| &disc.mean_m);
        patch.lever_m = means_m.chain(&patch.origins_m).map(reach_m).fold(0.0, f64::max);
        if view.origins_m.len() == 1 {
            patch.origins_m.truncate(1);
        }
        Ok(patch)
    }

    /// What became of the view's points.
    #[must_use]
    pub fn counts(&self) -> &PointCounts {
        &self.counts
    }

    /// How many discs it has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.discs.len()
    }

    /// Whether nothing of the view could be used.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.discs.is_empty()
    }

    /// The farthest of its points and origins from the keyframe, metres: how far a rotation moves them.
    #[must_use]
    pub fn lever_m(&self) -> f64 {
        self.lever_m
    }

    /// Where a disc was seen from, metres.
    pub(crate) fn origin_m(&self, disc: usize) -> [f32; 3] {
        self.origins_m.get(disc).or(self.origins_m.first()).copied().unwrap_or_default()
    }
}

/// The disc of a voxel; none where it is seen edge-on, or where no plane goes through the points around it.
fn disc_of(pyramid: &Pyramid, number: usize, settings: &SurfaceSettings) -> Option<Disc> {
    let voxel_m = settings.voxel_m;
    let mean = pyramid.mean(number);
    let to_sensor = pyramid.origin_m(number) / voxel_m - mean;
    let range = to_sensor.norm();
    let towards = to_sensor / range;
    let noise = settings.noise_voxels(range);
    let (normal, level) = pyramid.plane_around(number, level_above(noise), noise)?;
    let normal = if normal.dot(&towards) < 0.0 { -normal } else { normal };
    let gap = pyramid.gap(number, level);
    let radius = gap.max(DISC_LEAST);
    // The sum of `1 - (r / radius)^2` over discs that lie one gap apart is one.
    let share = 2.0 / std::f64::consts::PI * (gap / radius).powi(2);
    let cosine = normal.dot(&towards);
    let near = settings.noise_voxels(settings.near_m / voxel_m).max(LEAST_NOISE);
    let here = noise.max(near);
    let disc = Disc {
        mean_m: to_f32(mean * voxel_m),
        normal: to_f32(normal),
        radius: radius as f32,
        truncation: truncation_voxels(noise) as f32,
        weight: (cosine * share * (near / here).powi(2)) as f32,
    };
    (cosine > EDGE_ON).then_some(disc)
}

/// The first level whose cells are so wide that noise, in voxels, does not turn a plane: evenly spread points spread by 0.29 of their side, three times the noise.
fn level_above(noise: f64) -> usize {
    (0..).find(|&level| f64::from(1_u32 << level) >= 10.0 * noise.min(NOISE_VOXELS)).unwrap_or(0)
}

fn to_f32(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}
