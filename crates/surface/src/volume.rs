//! Truncated signed distances in hashed blocks.

use crate::block::{Block, Change, VIEWS_MOST};
use crate::error::SurfaceError;
use crate::key::{BLOCK_BITS, BLOCK_VOXELS, Key, is_within, pack, unpack, within_block};
use crate::patch::Patch;
use crate::settings::SurfaceSettings;
use crate::sketch::{STEPS_PER_VOXEL, Sketch, WEIGHT_MOST};
use mapwright_geom::Pose3;
use rustc_hash::FxHashMap;

/// Signed distances to the nearest surface (Curless and Levoy 1996, "A volumetric method for building complex models from range images"), in blocks of 8 x 8 x 8
/// voxels that are found by their places (Niessner et al. 2013, "Real-time 3D reconstruction at scale using voxel hashing").
///
/// What one view says of a voxel at one pose is rounded to integers once: a distance, a weight and perhaps a colour, or that a ray passed. Their sums do not
/// depend on the order of views, and taking a view out leaves what was there without it, to the bit.
///
/// Two volumes are equal where every voxel's sums are.
#[derive(Debug, Clone)]
pub struct Volume {
    settings: SurfaceSettings,
    places: FxHashMap<Key, u32>,
    blocks: Vec<Block>,
    /// Blocks that are empty and may be used again.
    empty: Vec<u32>,
    bytes: usize,
    views: u32,
    sketch: Sketch,
}

/// What is known of a voxel near a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelDistance {
    /// Its place in voxels: the distance is that of the point `index * voxel_m`, in the map's frame.
    pub index: [i32; 3],
    /// Mean signed distance to the surface, metres, positive where the sensor was; at most the truncation.
    pub distance_m: f64,
    /// How many views facing the surface, from near, would count as much.
    pub weight: f64,
    /// Views of which rays passed it.
    pub passes: u16,
}

impl PartialEq for Volume {
    fn eq(&self, other: &Self) -> bool {
        let is_there = |block: &&Block| !block.is_empty();
        let same = |block: &Block| other.block(block.key) == Some(block);
        let count = |volume: &Self| volume.blocks.iter().filter(is_there).count();
        self.settings == other.settings && count(self) == count(other) && self.blocks.iter().filter(is_there).all(same)
    }
}

impl Volume {
    /// Nothing known yet.
    ///
    /// # Errors
    /// [`SurfaceError::Setting`].
    pub fn new(settings: SurfaceSettings) -> Result<Self, SurfaceError> {
        settings.validate()?;
        let limit = memory_bytes(&settings) / Block::bytes_with(None, [true, true]);
        Ok(Self {
            settings,
            places: FxHashMap::default(),
            blocks: Vec::new(),
            empty: Vec::new(),
            bytes: 0,
            views: 0,
            sketch: Sketch::new(limit),
        })
    }

    /// How it was made.
    #[must_use]
    pub fn settings(&self) -> &SurfaceSettings {
        &self.settings
    }

    /// Views that are drawn.
    #[must_use]
    pub fn views(&self) -> u32 {
        self.views
    }

    /// Whether nothing is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Blocks of which anything is known.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.places.len()
    }

    /// What the voxels take, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Adds what a patch says at a pose, or takes it away again. What is taken away must have been added at the very same pose. Returns how many of its discs lie beyond
    /// half a million voxels from the map's origin and were left out.
    ///
    /// # Errors
    /// [`SurfaceError::OtherVoxels`], [`SurfaceError::Pose`], [`SurfaceError::TooManyClouds`] and [`SurfaceError::Memory`], after which the volume is as
    /// before.
    pub fn draw(&mut self, patch: &Patch, map_from_keyframe: Pose3, change: Change) -> Result<usize, SurfaceError> {
        let (found_m, expected_m) = (patch.voxel_m, self.settings.voxel_m);
        if found_m != expected_m {
            return Err(SurfaceError::OtherVoxels { found_m, expected_m });
        }
        if !map_from_keyframe.is_finite() {
            return Err(SurfaceError::Pose);
        }
        if change == Change::Add && self.views >= VIEWS_MOST {
            return Err(SurfaceError::TooManyClouds { limit: VIEWS_MOST });
        }
        let mut sketch = std::mem::take(&mut self.sketch);
        sketch.draw(patch, map_from_keyframe);
        let fits = if change == Change::Add { self.check_memory(&sketch, !patch.colours.is_empty()) } else { Ok(()) };
        if fits.is_ok() {
            self.apply(&sketch, change);
        }
        let outside = sketch.outside();
        self.sketch = sketch;
        fits.map(|()| outside)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.places.clear();
        self.blocks.clear();
        self.empty.clear();
        self.bytes = 0;
        self.views = 0;
    }

    /// What is known of the voxel nearest to a place in the map's frame, metres; none where no view saw a surface near it.
    #[must_use]
    pub fn distance_at(&self, at_m: [f64; 3]) -> Option<VoxelDistance> {
        let at = at_m.map(|v| (v / self.settings.voxel_m).round());
        let index = is_within(at).then(|| at.map(|v| v as i32))?;
        self.voxel(self.block(pack(index.map(|v| v >> BLOCK_BITS)))?, within_block(index))
    }

    /// All voxels near a surface, in an order that depends on nothing but their places.
    pub fn voxels(&self) -> impl Iterator<Item = VoxelDistance> + '_ {
        let of_block = move |block| (0..BLOCK_VOXELS).filter_map(move |voxel| self.voxel(block, voxel));
        self.sorted_blocks().into_iter().flat_map(of_block)
    }

    /// Blocks by their keys.
    pub(crate) fn sorted_blocks(&self) -> Vec<&Block> {
        let mut sorted: Vec<_> = self.blocks.iter().filter(|block| !block.is_empty()).collect();
        sorted.sort_unstable_by_key(|block| block.key);
        sorted
    }

    /// The block of a place in blocks.
    pub(crate) fn block(&self, key: Key) -> Option<&Block> {
        self.places.get(&key).map(|&at| &self.blocks[at as usize])
    }

    fn voxel(&self, block: &Block, voxel: usize) -> Option<VoxelDistance> {
        let near = block.near(voxel);
        let corner = unpack(block.key).map(|v| v << BLOCK_BITS);
        let part = |k: u32| (voxel >> (k * BLOCK_BITS) & 7) as i32;
        let step_m = self.settings.voxel_m / f64::from(STEPS_PER_VOXEL);
        (near.weight > 0).then(|| VoxelDistance {
            index: [corner[0] + part(0), corner[1] + part(1), corner[2] + part(2)],
            distance_m: f64::from(near.distance) / f64::from(near.weight) * step_m,
            weight: f64::from(near.weight) / f64::from(WEIGHT_MOST),
            passes: block.passes(voxel),
        })
    }

    fn apply(&mut self, sketch: &Sketch, change: Change) {
        for (key, readings) in sketch.readings() {
            self.change_block(key, change, |block| block.count(readings, change));
        }
        for (key, mask) in sketch.passes() {
            self.change_block(key, change, |block| block.count_passes(&mask, change));
        }
        self.views = match change {
            Change::Add => self.views.saturating_add(1),
            Change::Remove => self.views.saturating_sub(1),
        };
    }

    fn change_block(&mut self, key: Key, change: Change, count: impl FnOnce(&mut Block)) {
        let at = self.get_or_make(key);
        let block = &mut self.blocks[at as usize];
        let before = if block.is_empty() { 0 } else { block.bytes() };
        count(block);
        if change == Change::Remove {
            block.trim();
        }
        let after = if block.is_empty() { 0 } else { block.bytes() };
        if block.is_empty() {
            self.places.remove(&key);
            self.empty.push(at);
        }
        self.bytes = self.bytes.saturating_add(after).saturating_sub(before);
    }

    fn get_or_make(&mut self, key: Key) -> u32 {
        *self.places.entry(key).or_insert_with(|| match self.empty.pop() {
            Some(at) => {
                self.blocks[at as usize] = Block::new(key);
                at
            }
            None => {
                self.blocks.push(Block::new(key));
                self.blocks.len() as u32 - 1
            }
        })
    }

    /// Whether a sketch fits into the memory allowed.
    fn check_memory(&self, sketch: &Sketch, is_coloured: bool) -> Result<(), SurfaceError> {
        let (allowed, voxel_m) = (memory_bytes(&self.settings), self.settings.voxel_m);
        let most = sketch.keys().count() * Block::bytes_with(None, [true, is_coloured])
            + sketch.passed_blocks() * Block::bytes_with(None, [false, false]);
        if self.bytes + most <= allowed && !sketch.is_beyond_limit() {
            return Ok(());
        }
        let more = |(key, needs): (Key, [bool; 2])| {
            let block = self.block(key);
            Block::bytes_with(block, needs) - block.map_or(0, Block::bytes)
        };
        let of_near = sketch.keys().map(|key| (key, [true, is_coloured]));
        let of_passes = sketch.passes().map(|(key, _)| (key, [false, false]));
        let needed = self.bytes + of_near.chain(of_passes).map(more).sum::<usize>();
        if needed <= allowed && !sketch.is_beyond_limit() {
            return Ok(());
        }
        // Surfaces fill blocks by the square of their side, what rays pass by the cube: half the memory, by the square, is on the safe side of both.
        let needed = needed.max(allowed);
        let fits_m = voxel_m * (2.0 * needed as f64 / allowed as f64).sqrt();
        let megabytes = |bytes: usize| bytes.div_ceil(1_000_000) as u64;
        Err(SurfaceError::Memory { needed_mb: megabytes(needed), limit_mb: megabytes(allowed), voxel_m, fits_m })
    }
}

fn memory_bytes(settings: &SurfaceSettings) -> usize {
    settings.memory_mb as usize * 1_000_000
}
