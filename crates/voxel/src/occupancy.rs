//! Occupancy of space as integer counts of hits and passes, so that adding and removing a cloud is exact and commutative.

mod block;
mod counts;
mod ray;
mod reading;
mod scan;
mod sets;

use crate::key::{Key, key_of, unpack};
use crate::surfel_map::Change;
use block::Blocks;
use mapwright_geom::Pose3;
use scan::Scan;

pub(crate) use block::Block;
pub use reading::log_odds;
pub(crate) use reading::{FREE_LEAST, OCCUPIED_MOST};
pub(crate) use sets::{BLOCK_BITS, BLOCK_SIDE};

/// How counts are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OccupancySettings {
    /// Side of a voxel, metres.
    pub resolution_m: f64,
    /// A ray ends here at the latest, metres; of a point farther away only the way up to there counts. At most 8,192 voxels.
    pub max_range_m: f64,
}

impl Default for OccupancySettings {
    fn default() -> Self {
        Self { resolution_m: 0.1, max_range_m: 60.0 }
    }
}

/// A ray may be so long, voxels.
const RANGE_AT_MOST: f64 = 8192.0;

/// What is known of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelCounts {
    /// Place in voxels: it reaches from `index * resolution_m` to `(index + 1) * resolution_m`, in the map's frame.
    pub index: [i32; 3],
    /// Clouds with a point in it.
    pub hits: u32,
    /// Clouds with no point in it of which a ray went through it.
    pub passes: u32,
}

impl VoxelCounts {
    /// [`log_odds`] of its counts.
    #[must_use]
    pub fn log_odds(&self) -> f32 {
        log_odds(self.hits, self.passes)
    }
}

/// Voxels with the clouds that saw something in them and those that saw through them. Memory goes with the space seen: a byte a voxel
/// for passes, one more near surfaces.
///
/// What a cloud says is a set: a voxel is hit, passed or neither, once, however many points and rays meet it, and what is
/// hit is not passed. A ray goes from the sensor to the middle of the voxel that its point lies in, through every voxel on the way (Amanatides and Woo
/// 1987, "A fast voxel traversal algorithm"), so that points in one voxel have one ray. Sums of sets do not depend on their order, and
/// taking a cloud out leaves what was there without it.
#[derive(Debug, Clone)]
pub struct Occupancy {
    resolution_m: f64,
    range_voxels: f64,
    blocks: Blocks,
    scan: Scan,
}

impl Occupancy {
    /// Nothing known yet. A resolution that is no number above zero counts as the default one.
    #[must_use]
    pub fn new(settings: OccupancySettings) -> Self {
        let asked_m = settings.resolution_m;
        let is_usable = asked_m.is_finite() && asked_m > 0.0;
        let resolution_m = if is_usable { asked_m } else { OccupancySettings::default().resolution_m };
        let range_voxels = settings.max_range_m / resolution_m;
        let range_voxels = if range_voxels > 0.0 { range_voxels.min(RANGE_AT_MOST) } else { 0.0 };
        Self { resolution_m, range_voxels, blocks: Blocks::default(), scan: Scan::default() }
    }

    /// Side of a voxel, metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Counts a cloud in, or out again. The points are in the cloud's frame, as is the place of the sensor that saw them, both in metres.
    /// Points that are not finite or beyond 2^20 voxels from the map's origin are left out.
    pub fn draw(
        &mut self,
        points_m: impl IntoIterator<Item = [f32; 3]>,
        sensor_m: [f64; 3],
        map_from_cloud: Pose3,
        change: Change,
    ) {
        let per_m = 1.0 / self.resolution_m;
        let rotation = map_from_cloud.rotation.to_rotation_matrix();
        let origin: [f64; 3] = (map_from_cloud.transform(sensor_m.into()) * per_m).into();
        if key_of(origin).is_none() {
            return;
        }
        self.scan.begin(origin, self.range_voxels);
        for point in points_m {
            let at = rotation * nalgebra::Vector3::from(point.map(f64::from)) + map_from_cloud.translation;
            self.scan.add_point((at * per_m).into());
        }
        self.scan.cast_rays();
        self.blocks.apply(self.scan.sets(), change);
    }

    /// What is known of a place in the map's frame, metres; none of a voxel that nothing is known of.
    #[must_use]
    pub fn counts_at(&self, at_m: [f64; 3]) -> Option<VoxelCounts> {
        let index = unpack(key_of(at_m.map(|v| v / self.resolution_m))?);
        let block = self.blocks.get(index.map(|v| v >> BLOCK_BITS))?;
        let [x, y, z] = index.map(|v| (v & (BLOCK_SIDE - 1)) as usize);
        let (hits, passes) = block.counts(x | y << BLOCK_BITS | z << (2 * BLOCK_BITS));
        (hits > 0 || passes > 0).then_some(VoxelCounts { index, hits, passes })
    }

    /// All voxels that something is known of, in an order that depends on nothing but their places.
    pub fn voxels(&self) -> impl Iterator<Item = VoxelCounts> + '_ {
        self.sorted_blocks().into_iter().flat_map(|(_, block)| block.voxels())
    }

    /// Blocks by their keys.
    pub(crate) fn sorted_blocks(&self) -> Vec<(Key, &Block)> {
        self.blocks.sorted()
    }
}

#[cfg(test)]
mod tests;
