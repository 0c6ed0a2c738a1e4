//! Occupancy at all resolutions at once, and as OctoMap's files.

mod build;
mod error;
mod read;
mod write;

use crate::key::{key_of, unpack};
pub use build::Leaves;
pub use error::OctreeError;
pub use write::{BtCounts, write_bt};

/// Levels below the root; the voxels of the last have the side of the map's resolution.
const DEPTH: u32 = 16;
/// Voxels from the origin to the border, along each axis.
const HALF: i32 = 1 << (DEPTH - 1);

/// What is known of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Something is there.
    Occupied,
    /// Nothing is there.
    Free,
    /// Nobody looked.
    Unknown,
}

/// A cube all of which is the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    /// Its least corner, in voxels of the map's resolution.
    pub corner: [i32; 3],
    /// Its side, in voxels.
    pub side: u32,
    /// Logarithm of the odds that it is occupied.
    pub log_odds: f32,
}

impl Leaf {
    /// Whether it is taken for occupied: as likely as not is, as in OctoMap.
    #[must_use]
    pub fn is_occupied(&self) -> bool {
        self.log_odds >= 0.0
    }
}

/// An octree of 16 levels in the shape of OctoMap's (Hornung et al. 2013): a cube of 2^16 voxels a side around the origin, cut into eight
/// where not all of it is the same. A node's value is the greatest of its children's.
#[derive(Debug, Clone, PartialEq)]
pub struct Octree {
    resolution_m: f64,
    /// Those of one parent side by side, after all that is below them; the root last. None where nothing is known.
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    log_odds: f32,
    /// Where its children begin.
    first: u32,
    /// Which children it has, a bit each: x is the lowest bit of a child's number, z the highest.
    children: u8,
}

impl Node {
    const fn leaf(log_odds: f32) -> Self {
        Self { log_odds, first: 0, children: 0 }
    }

    const fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// Numbers of its children and where they are.
    fn places(self) -> impl Iterator<Item = (usize, usize)> {
        (0..8).filter(move |number| self.children >> number & 1 == 1).zip(self.first as usize..)
    }

    fn place(self, number: usize) -> Option<usize> {
        let before = self.children & ((1_u8 << number) - 1);
        (self.children >> number & 1 == 1).then(|| self.first as usize + before.count_ones() as usize)
    }
}

impl Octree {
    /// Side of the smallest voxels, metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// How many nodes it has.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// What is known of a place in the map's frame, metres, in the cube of `2^(16 - depth)` voxels a side around it: at depth 16 of the
    /// voxel, at less of more. Occupied where any of it is; free where some of it is free and the rest is not known.
    #[must_use]
    pub fn state_at(&self, at_m: [f64; 3], depth: u32) -> State {
        match self.log_odds_at(at_m, depth) {
            None => State::Unknown,
            Some(log_odds) if log_odds >= 0.0 => State::Occupied,
            Some(_) => State::Free,
        }
    }

    /// The logarithm of the odds that it is occupied; none where nothing is known.
    #[must_use]
    pub fn log_odds_at(&self, at_m: [f64; 3], depth: u32) -> Option<f32> {
        let index = unpack(key_of(at_m.map(|v| v / self.resolution_m))?).map(|v| v + HALF);
        if index.iter().any(|v| !(0..2 * HALF).contains(v)) {
            return None;
        }
        let mut node = *self.nodes.last()?;
        for level in (DEPTH - depth.min(DEPTH)..DEPTH).rev() {
            if node.is_leaf() {
                break;
            }
            let [x, y, z] = index.map(|v| (v >> level & 1) as usize);
            node = *self.nodes.get(node.place(x | y << 1 | z << 2)?)?;
        }
        Some(node.log_odds)
    }

    /// Its leaves, in the order of OctoMap's files.
    pub fn leaves(&self) -> impl Iterator<Item = Leaf> + '_ {
        let root = self.nodes.last().map(|root| (*root, [-HALF; 3], DEPTH));
        let mut open: Vec<_> = root.into_iter().collect();
        std::iter::from_fn(move || {
            loop {
                let (node, corner, level) = open.pop()?;
                if node.is_leaf() || level == 0 {
                    return Some(Leaf { corner, side: 1 << level, log_odds: node.log_odds });
                }
                let side = 1 << (level - 1);
                let start = open.len();
                open.extend(node.places().filter_map(|(number, at)| {
                    let corner = [0, 1, 2].map(|k| corner[k] + if number >> k & 1 == 1 { side } else { 0 });
                    self.nodes.get(at).map(|child| (*child, corner, level - 1))
                }));
                open[start..].reverse();
            }
        })
    }
}

#[cfg(test)]
mod tests;
