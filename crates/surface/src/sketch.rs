//! What one view says of voxels at one pose, before it is counted into a volume.

use crate::key::{BLOCK_BITS, BLOCK_SIDE, BLOCK_VOXELS, Key, floor, is_within, pack, within_block};
use crate::patch::{Disc, Patch};
use mapwright_geom::Pose3;
use nalgebra::{Matrix3, Vector3};
use rustc_hash::FxHashMap;

/// A set of voxels of a block.
pub(crate) type Mask = [u64; BLOCK_VOXELS / 64];

/// Steps of a distance up to the truncation.
pub(crate) const DISTANCE_STEPS: i32 = 511;
/// What a view says of a voxel counts so much at most.
pub(crate) const WEIGHT_MOST: u32 = 31;
/// A block that rays only pass takes so much less memory than one with readings.
const PASSED_BLOCKS: usize = 8;
/// A ray is followed for so many voxels at most, the last before its point.
const RAY_VOXELS: usize = 4096;

/// Sums over the discs around a voxel: weight times distance, weight, what the discs' reach alone would weigh, and that of the discs whose colour counts.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    distance: f32,
    weight: f32,
    reach: f32,
    colour_weight: f32,
}

/// What one view says of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Reading {
    /// Signed distance, in [`DISTANCE_STEPS`]ths of the truncation: positive where the sensor was.
    pub(crate) distance: i32,
    /// 1 to [`WEIGHT_MOST`].
    pub(crate) weight: u32,
    /// Of the surface, where it is near.
    pub(crate) colour: Option<[u8; 3]>,
}

/// The voxels that one view sees, by blocks. Kept from view to view for its memory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sketch {
    truncation: f32,
    places: FxHashMap<Key, u32>,
    keys: Vec<Key>,
    /// Voxels within the truncation.
    near: Vec<Mask>,
    sums: Vec<[Sums; BLOCK_VOXELS]>,
    colours: Vec<[[f32; 3]; BLOCK_VOXELS]>,
    passed_places: FxHashMap<Key, u32>,
    passed: Vec<(Key, Mask)>,
    outside: usize,
    block_limit: usize,
}

impl Sketch {
    /// For views of so many blocks at most.
    pub(crate) fn new(truncation_voxels: f64, block_limit: usize) -> Self {
        Self { truncation: truncation_voxels as f32, block_limit, ..Self::default() }
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
                self.add_ray(from, to, turned(&rotation, disc.normal));
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

    /// The mean of what discs say; less than a full disc's reach counts for less.
    fn reading(&self, slot: usize, voxel: usize) -> Reading {
        let sums = &self.sums[slot][voxel];
        let share = sums.distance / (sums.weight * self.truncation);
        let weight = sums.weight / sums.reach.max(1.0);
        let colour = (sums.colour_weight > 0.0)
            .then(|| self.colours[slot][voxel].map(|sum| (sum / sums.colour_weight + 0.5) as u8));
        Reading {
            distance: ((share * DISTANCE_STEPS as f32).round() as i32).clamp(-DISTANCE_STEPS, DISTANCE_STEPS),
            weight: ((weight * WEIGHT_MOST as f32 + 0.5) as u32).clamp(1, WEIGHT_MOST),
            colour,
        }
    }

    fn clear(&mut self) {
        for slot in 0..self.keys.len() {
            for voxel in voxels(&std::mem::take(&mut self.near[slot])) {
                self.sums[slot][voxel] = Sums::default();
                if let Some(colours) = self.colours.get_mut(slot) {
                    colours[voxel] = [0.0; 3];
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

    /// Writes the voxels around a disc, up to the truncation before and behind it and as far aside as it reaches.
    fn add_disc(&mut self, disc: &Disc, at: [f64; 3], normal: [f32; 3], colour: Option<[u8; 3]>) {
        let reach = |k: usize| {
            let aside = (1.0 - normal[k] * normal[k]).max(0.0).sqrt();
            f64::from(self.truncation * normal[k].abs() + disc.radius * aside)
        };
        let low: [i32; 3] = [0, 1, 2].map(|k| floor((at[k] - reach(k)).ceil()));
        let high: [i32; 3] = [0, 1, 2].map(|k| floor(at[k] + reach(k)));
        let blocks = |k: usize| low[k] >> BLOCK_BITS..=high[k] >> BLOCK_BITS;
        for (x, y, z) in blocks(2).flat_map(|z| blocks(1).flat_map(move |y| blocks(0).map(move |x| (x, y, z)))) {
            let block = [x, y, z].map(|v| v << BLOCK_BITS);
            let from = [0, 1, 2].map(|k| low[k].max(block[k]));
            let to = [0, 1, 2].map(|k| high[k].min(block[k] + BLOCK_SIDE - 1));
            self.write(pack([x, y, z]), Part { from, to }, at, normal, disc, colour);
        }
    }

    /// The voxels of one block.
    fn write(&mut self, key: Key, part: Part, at: [f64; 3], normal: [f32; 3], disc: &Disc, colour: Option<[u8; 3]>) {
        let (truncation, reach2) = (self.truncation, disc.radius * disc.radius);
        let mut slot = None;
        let apart = |k: usize, v: i32| (f64::from(v) - at[k]) as f32;
        for z in part.from[2]..=part.to[2] {
            let dz = apart(2, z);
            for y in part.from[1]..=part.to[1] {
                let dy = apart(1, y);
                let (along, apart2) = (normal[1] * dy + normal[2] * dz, dy * dy + dz * dz);
                for x in part.from[0]..=part.to[0] {
                    let dx = apart(0, x);
                    let distance = along + normal[0] * dx;
                    let aside2 = apart2 + dx * dx - distance * distance;
                    if !(distance.abs() < truncation && aside2 < reach2) {
                        continue;
                    }
                    let reach = 1.0 - aside2.max(0.0) / reach2;
                    let behind = if distance < 0.0 { 1.0 + distance / truncation } else { 1.0 };
                    let weight = disc.weight * reach * behind;
                    if weight <= 0.0 {
                        continue;
                    }
                    let slot = match slot {
                        Some(slot) => slot,
                        None => *slot.insert(self.slot(key)),
                    };
                    self.add(slot, within_block([x, y, z]), distance, [reach, weight], colour);
                }
            }
        }
    }

    #[inline]
    fn add(&mut self, slot: usize, voxel: usize, distance: f32, [reach, weight]: [f32; 2], colour: Option<[u8; 3]>) {
        self.near[slot][voxel / 64] |= 1 << (voxel % 64);
        let sums = &mut self.sums[slot][voxel];
        sums.distance += weight * distance;
        sums.weight += weight;
        sums.reach += reach;
        let Some(colour) = colour.filter(|_| distance.abs() < COLOUR_REACH) else { return };
        sums.colour_weight += weight;
        if self.colours.len() <= slot {
            self.colours.resize(self.sums.len(), [[0.0; 3]; BLOCK_VOXELS]);
        }
        (0..3).for_each(|k| self.colours[slot][voxel][k] += weight * f32::from(colour[k]));
    }

    /// Notes the voxels that a ray goes through before it comes near the surface (Amanatides and Woo 1987, "A fast voxel traversal algorithm"), from the surface to the sensor. A voxel
    /// is here the cube around its place.
    fn add_ray(&mut self, from: [f64; 3], to: [f64; 3], normal: [f32; 3]) {
        let way = Vector3::from(from) - Vector3::from(to);
        let length = way.norm();
        let direction = way / length;
        let cosine = direction.dot(&Vector3::from(normal.map(f64::from)));
        let skipped = f64::from(self.truncation) / cosine + 1.0;
        let is_long = skipped < length;
        if !is_long {
            return;
        }
        let start = Vector3::from(to) + direction * skipped;
        let mut steps = Steps::new(start.into(), direction.into());
        let mut last = (Key::MAX, 0_usize);
        let voxels = ((length - skipped) * direction.iter().map(|v| v.abs()).sum::<f64>()) as usize;
        for _ in 0..=voxels.min(RAY_VOXELS) {
            let key = pack(steps.at.map(|v| v >> BLOCK_BITS));
            if key != last.0 {
                last = (key, self.passed_slot(key));
            }
            let voxel = within_block(steps.at);
            self.passed[last.1].1[voxel / 64] |= 1 << (voxel % 64);
            steps.advance();
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

/// Voxels from one to another, both included.
#[derive(Clone, Copy)]
struct Part {
    from: [i32; 3],
    to: [i32; 3],
}

/// From voxel to voxel along a ray.
struct Steps {
    at: [i32; 3],
    step: [i32; 3],
    /// How far along the ray the next voxel begins, along each axis.
    next: [f64; 3],
    width: [f64; 3],
}

impl Steps {
    fn new(start: [f64; 3], direction: [f64; 3]) -> Self {
        let at = start.map(|v| floor((v + 0.5).floor()));
        let width = direction.map(|v| 1.0 / v.abs());
        let next = [0, 1, 2].map(|k| {
            let gone = start[k] + 0.5 - f64::from(at[k]);
            let ahead = if direction[k] > 0.0 { 1.0 - gone } else { gone };
            if direction[k] == 0.0 { f64::INFINITY } else { ahead * width[k] }
        });
        Self { at, step: direction.map(|v| if v > 0.0 { 1 } else { -1 }), next, width }
    }

    #[inline]
    fn advance(&mut self) {
        let [x, y, z] = self.next;
        let axis = if x <= y && x <= z { 0 } else { 1 + usize::from(z < y) };
        self.at[axis] += self.step[axis];
        self.next[axis] += self.width[axis];
    }
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
