//! What one view says of voxels at one pose, before it is counted into a volume.

use crate::key::{BLOCK_BITS, BLOCK_VOXELS, Key, along, floor, is_within, pack, within_block};
use crate::patch::{Disc, Patch};
use mapwright_geom::Pose3;
use nalgebra::{Matrix3, Vector3};
use rustc_hash::FxHashMap;

/// A set of voxels of a block.
pub(crate) type Mask = [u64; BLOCK_VOXELS / 64];

/// Steps of a distance for each voxel.
pub(crate) const STEPS_PER_VOXEL: f32 = 128.0;
/// Steps of the greatest distance: just under eight voxels, farther than any truncation.
pub(crate) const STEPS_MOST: i32 = 1023;
/// What a view says of a voxel counts so much at most.
pub(crate) const WEIGHT_MOST: u32 = 31;
/// A block that rays only pass takes so much less memory than one with readings.
const PASSED_BLOCKS: usize = 8;
/// Places along rays are whole numbers of this part of a voxel.
const RAY_BITS: u32 = 32;
const RAY_UNIT: f64 = (1_u64 << RAY_BITS) as f64;
/// A ray is followed for so many voxels at most, the last before its point.
const RAY_VOXELS: usize = 4096;

/// Sums over the discs around a voxel.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Of weight times distance.
    distance: f32,
    weight: f32,
}

/// Sums over the discs whose colour counts there: of weight times red, green and blue, and of weights.
type ColourSums = [f32; 4];

/// What one view says of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Reading {
    /// Signed distance, [`STEPS_PER_VOXEL`]: positive where the sensor was.
    pub(crate) distance: i32,
    /// 1 to [`WEIGHT_MOST`].
    pub(crate) weight: u32,
    /// Of the surface, where it is near.
    pub(crate) colour: Option<[u8; 3]>,
}

/// The voxels that one view sees, by blocks. Kept from view to view for its memory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sketch {
    places: FxHashMap<Key, u32>,
    keys: Vec<Key>,
    /// Voxels within the truncation.
    near: Vec<Mask>,
    sums: Vec<[Sums; BLOCK_VOXELS]>,
    colours: Vec<[ColourSums; BLOCK_VOXELS]>,
    passed_places: FxHashMap<Key, u32>,
    passed: Vec<(Key, Mask)>,
    outside: usize,
    block_limit: usize,
}

impl Sketch {
    /// For views of so many blocks at most.
    pub(crate) fn new(block_limit: usize) -> Self {
        Self { block_limit, ..Self::default() }
    }

    /// Draws a patch; what was drawn before is forgotten. Ends early once there are more blocks than the limit.
    pub(crate) fn draw(&mut self, patch: &Patch, map_from_keyframe: Pose3) {
        self.clear();
        let per_m = 1.0 / patch.voxel_m;
        let rotation = *map_from_keyframe.rotation.to_rotation_matrix().matrix();
        let place = |at_m: [f32; 3]| -> [f64; 3] {
            ((rotation * Vector3::from(at_m.map(f64::from)) + map_from_keyframe.translation) * per_m).into()
        };
        for (number, disc) in patch.discs.iter().enumerate() {
            let at = place(disc.mean_m);
            if self.is_beyond_limit() {
                return;
            }
            if is_within(at) {
                self.add_disc(disc, at, turned(&rotation, disc.normal), patch.colours.get(number).copied());
            } else {
                self.outside += 1;
            }
        }
        for &number in &patch.rays {
            let disc = &patch.discs[number as usize];
            let (from, to) = (place(patch.origin_m(number as usize)), place(disc.mean_m));
            if self.is_beyond_limit() {
                return;
            }
            if is_within(from) && is_within(to) {
                self.add_ray(from, to, turned(&rotation, disc.normal), disc.truncation);
            }
        }
    }

    /// Discs that lie beyond the places of a map.
    pub(crate) fn outside(&self) -> usize {
        self.outside
    }

    /// Blocks with readings.
    pub(crate) fn keys(&self) -> impl Iterator<Item = Key> + '_ {
        self.keys.iter().copied()
    }

    /// Blocks that rays passed.
    pub(crate) fn passed_blocks(&self) -> usize {
        self.passed.len()
    }

    /// Whether it was not drawn to its end.
    pub(crate) fn is_beyond_limit(&self) -> bool {
        self.keys.len() + self.passed.len() / PASSED_BLOCKS > self.block_limit
    }

    /// Each block's readings by voxels.
    pub(crate) fn readings(&self) -> impl Iterator<Item = (Key, impl Iterator<Item = (usize, Reading)> + '_)> + '_ {
        self.keys.iter().enumerate().map(move |(slot, &key)| {
            (key, voxels(&self.near[slot]).map(move |voxel| (voxel, self.reading(slot, voxel))))
        })
    }

    /// Blocks that rays passed and voxels that they passed there, but those near a surface of the same view.
    pub(crate) fn passes(&self) -> impl Iterator<Item = (Key, Mask)> + '_ {
        let without_near = |&(key, mut mask): &(Key, Mask)| {
            if let Some(&slot) = self.places.get(&key) {
                mask.iter_mut().zip(&self.near[slot as usize]).for_each(|(word, near)| *word &= !near);
            }
            (key, mask)
        };
        self.passed.iter().map(without_near).filter(|(_, mask)| mask.iter().any(|&word| word != 0))
    }

    /// The mean of what discs say. Where they do not lie as close as around most places it counts for less.
    fn reading(&self, slot: usize, voxel: usize) -> Reading {
        let sums = &self.sums[slot][voxel];
        let steps = sums.distance / sums.weight * STEPS_PER_VOXEL;
        let weight = (sums.weight * WEIGHT_MOST as f32 + 0.5) as u32;
        let colour = self.colours.get(slot).map(|colours| colours[voxel]).filter(|colour| colour[3] > 0.0);
        Reading {
            distance: ((steps + 0.5_f32.copysign(steps)) as i32).clamp(-STEPS_MOST, STEPS_MOST),
            weight: weight.clamp(1, WEIGHT_MOST),
            colour: colour.map(|colour| along(|k| (colour[k] / colour[3] + 0.5) as u8)),
        }
    }

    fn clear(&mut self) {
        for slot in 0..self.keys.len() {
            for voxel in voxels(&std::mem::take(&mut self.near[slot])) {
                self.sums[slot][voxel] = Sums::default();
                if let Some(colours) = self.colours.get_mut(slot) {
                    colours[voxel] = ColourSums::default();
                }
            }
        }
        self.keys.clear();
        self.places.clear();
        self.passed_places.clear();
        self.passed.clear();
        self.outside = 0;
    }

    fn slot(&mut self, key: Key) -> usize {
        let next = self.keys.len() as u32;
        let slot = *self.places.entry(key).or_insert(next);
        if slot == next {
            self.keys.push(key);
            if self.sums.len() < self.keys.len() {
                self.near.push(Mask::default());
                self.sums.push([Sums::default(); BLOCK_VOXELS]);
            }
        }
        slot as usize
    }

    /// Writes the voxels around a disc, up to the truncation before and behind it and as far aside as it reaches: in rows along the axis that its normal is nearest to, for
    /// which both bounds are intervals.
    fn add_disc(&mut self, disc: &Disc, at: [f64; 3], normal: [f32; 3], colour: Option<[u8; 3]>) {
        let a = (0..3).fold(0, |a, k| if normal[k].abs() > normal[a].abs() { k } else { a });
        let (u, v) = ((a + 1) % 3, (a + 2) % 3);
        let base = along(|k| floor(at[k]));
        let offset = along(|k| (at[k] - f64::from(base[k])) as f32);
        let reach =
            |k: usize| disc.truncation * normal[k].abs() + disc.radius * (1.0 - normal[k] * normal[k]).max(0.0).sqrt();
        let steps = along(|k| (ceil_of(offset[k] - reach(k)), floor_of(offset[k] + reach(k))));
        let colour = colour.map(|[red, green, blue]| [f32::from(red), f32::from(green), f32::from(blue), 1.0]);
        let shape = Shape::of(disc, normal[a]);
        let mut slots = Slots::new(along(|k| (base[k] + steps[k].0) >> BLOCK_BITS));
        for iv in steps[v].0..=steps[v].1 {
            for iu in steps[u].0..=steps[u].1 {
                let (du, dv) = (iu as f32 - offset[u], iv as f32 - offset[v]);
                let row = Row { along: normal[u] * du + normal[v] * dv, apart2: du * du + dv * dv };
                let Some([from, to]) = shape.interval(&row) else { continue };
                let mut voxel = base;
                voxel[u] += iu;
                voxel[v] += iv;
                for ia in ceil_of(offset[a] + from)..=floor_of(offset[a] + to) {
                    voxel[a] = base[a] + ia;
                    let (distance, aside2) = shape.at(&row, ia as f32 - offset[a]);
                    let reach = 1.0 - aside2 * shape.per_radius2;
                    let behind = 1.0 + distance.min(0.0) * shape.per_truncation;
                    let weight = disc.weight * reach * behind;
                    if weight > 0.0 {
                        let slot = slots.get(self, voxel);
                        self.add(slot, within_block(voxel), distance, weight, colour);
                    }
                }
            }
        }
    }

    #[inline]
    fn add(&mut self, slot: usize, voxel: usize, distance: f32, weight: f32, colour: Option<[f32; 4]>) {
        self.near[slot][voxel / 64] |= 1 << (voxel % 64);
        let sums = &mut self.sums[slot][voxel];
        sums.distance += weight * distance;
        sums.weight += weight;
        let Some(colour) = colour.filter(|_| distance.abs() < COLOUR_REACH) else { return };
        if self.colours.len() <= slot {
            self.colours.resize(self.sums.len(), [ColourSums::default(); BLOCK_VOXELS]);
        }
        (0..4).for_each(|k| self.colours[slot][voxel][k] += weight * colour[k]);
    }

    /// Notes the voxels on a ray before it comes near the surface, from there to the sensor: the nearest to it in each layer across the axis that it follows most (Bresenham
    /// 1965, in three dimensions).
    fn add_ray(&mut self, from: [f64; 3], to: [f64; 3], normal: [f32; 3], truncation: f32) {
        let way = Vector3::from(from) - Vector3::from(to);
        let length = way.norm();
        let direction = way / length;
        let cosine = direction.dot(&Vector3::from(normal.map(f64::from)));
        let skipped = f64::from(truncation) / cosine + 1.0;
        let layers = (length - skipped) * direction.amax();
        let is_long = layers > 0.0;
        if !is_long {
            return;
        }
        let fixed = |v: f64| (v * RAY_UNIT) as i64;
        let start = Vector3::from(to) + direction * skipped;
        let [mut x, mut y, mut z] = along(|k| fixed(start[k] + 0.5));
        let [dx, dy, dz] = along(|k| fixed(direction[k] / direction.amax()));
        let mut last = (Key::MAX, 0_usize);
        for _ in 0..(layers as usize).min(RAY_VOXELS) {
            let voxel = [(x >> RAY_BITS) as i32, (y >> RAY_BITS) as i32, (z >> RAY_BITS) as i32];
            let key = pack(along(|k| voxel[k] >> BLOCK_BITS));
            if key != last.0 {
                last = (key, self.passed_slot(key));
            }
            let bit = within_block(voxel);
            self.passed[last.1].1[bit / 64] |= 1 << (bit % 64);
            (x, y, z) = (x + dx, y + dy, z + dz);
        }
    }

    fn passed_slot(&mut self, key: Key) -> usize {
        let next = self.passed.len() as u32;
        let slot = *self.passed_places.entry(key).or_insert(next);
        if slot == next {
            self.passed.push((key, Mask::default()));
        }
        slot as usize
    }
}

/// Colours are those of a surface up to here, voxels: the ends of an edge that it crosses.
const COLOUR_REACH: f32 = 1.0;

/// Voxels in a row, by how far along it they lie from the foot of a disc's middle.
struct Row {
    /// Distance from the disc's plane there, voxels.
    along: f32,
    /// Square of the distance from the disc's middle there.
    apart2: f32,
}

/// What is the same for all rows of a disc.
struct Shape {
    truncation: f32,
    per_truncation: f32,
    radius2: f32,
    per_radius2: f32,
    /// How the distance from the plane grows along a row: the normal's greatest part.
    slope: f32,
    per_slope: f32,
    /// `1 - slope^2`.
    square: f32,
    per_square: f32,
}

impl Shape {
    fn of(disc: &Disc, slope: f32) -> Self {
        let (radius2, square) = (disc.radius * disc.radius, 1.0 - slope * slope);
        Self {
            truncation: disc.truncation,
            per_truncation: 1.0 / disc.truncation,
            radius2,
            per_radius2: 1.0 / radius2,
            slope,
            per_slope: 1.0 / slope,
            square,
            per_square: 1.0 / square,
        }
    }

    /// Where a row is within the disc's reach and within the truncation. Both are intervals: of a quadratic, and of `|along + slope x| < truncation`.
    #[inline]
    fn interval(&self, &Row { along, apart2 }: &Row) -> Option<[f32; 2]> {
        let rest = apart2 - along * along - self.radius2;
        let half = along * self.slope;
        let inside = half * half - self.square * rest;
        let is_upright = self.square < UPRIGHT;
        if if is_upright { rest >= 0.0 } else { inside <= 0.0 } {
            return None;
        }
        let [before, behind] = [-self.truncation - along, self.truncation - along].map(|v| v * self.per_slope);
        let (low, high) = (before.min(behind), before.max(behind));
        if is_upright {
            return Some([low, high]);
        }
        let root = inside.sqrt();
        Some([low.max((half - root) * self.per_square), high.min((half + root) * self.per_square)])
    }

    /// The distance from the plane, and the square of that from the middle along it.
    #[inline]
    fn at(&self, row: &Row, x: f32) -> (f32, f32) {
        let distance = row.along + self.slope * x;
        (distance, (row.apart2 + x * x - distance * distance).max(0.0))
    }
}

/// A disc's rows go along its normal: they leave it nowhere.
const UPRIGHT: f32 = 1e-4;

/// The slots of blocks around a disc, each looked for once.
struct Slots {
    low: [i32; 3],
    slots: [u32; SLOTS * SLOTS * SLOTS],
}

/// Blocks along an axis that a disc may lie in: it reaches less than 12 voxels to either side.
const SLOTS: usize = 4;
const NO_SLOT: u32 = u32::MAX;

impl Slots {
    fn new(low: [i32; 3]) -> Self {
        Self { low, slots: [NO_SLOT; SLOTS * SLOTS * SLOTS] }
    }

    #[inline]
    fn get(&mut self, sketch: &mut Sketch, voxel: [i32; 3]) -> usize {
        let block = along(|k| voxel[k] >> BLOCK_BITS);
        let [x, y, z] = along(|k| (block[k] - self.low[k]) as usize & (SLOTS - 1));
        let slot = &mut self.slots[x + SLOTS * (y + SLOTS * z)];
        if *slot == NO_SLOT {
            *slot = sketch.slot(pack(block)) as u32;
        }
        *slot as usize
    }
}

/// Of numbers as small as a disc.
#[inline]
fn floor_of(v: f32) -> i32 {
    let whole = v as i32;
    whole - i32::from(v < whole as f32)
}

#[inline]
fn ceil_of(v: f32) -> i32 {
    -floor_of(-v)
}

fn turned(rotation: &Matrix3<f64>, normal: [f32; 3]) -> [f32; 3] {
    let turned = rotation * Vector3::from(normal.map(f64::from));
    [turned.x as f32, turned.y as f32, turned.z as f32]
}

/// The numbers of the voxels of a set.
pub(crate) fn voxels(mask: &Mask) -> impl Iterator<Item = usize> + use<> {
    let mut words = *mask;
    let mut word = 0;
    std::iter::from_fn(move || {
        while *words.get(word)? == 0 {
            word += 1;
        }
        let bit = words[word].trailing_zeros() as usize;
        words[word] &= words[word] - 1;
        Some(64 * word + bit)
    })
}
