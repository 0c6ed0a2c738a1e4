//! Octrees from occupancy, from below.

use super::{DEPTH, HALF, Node, Octree};
use crate::key::{Key, unpack};
use crate::occupancy::{BLOCK_BITS, Block, FREE_LEAST, OCCUPIED_MOST, Occupancy, log_odds};

/// What leaves say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Leaves {
    /// How likely each is occupied.
    LogOdds,
    /// Only whether it is rather occupied or rather free, as surely as may be: much larger leaves, and all that `.bt` files say.
    MostLikely,
}

impl Leaves {
    fn value(self, log_odds: f32) -> f32 {
        match self {
            Self::LogOdds => log_odds,
            Self::MostLikely if log_odds >= 0.0 => OCCUPIED_MOST,
            Self::MostLikely => FREE_LEAST,
        }
    }
}

/// Blocks from the origin to the border, along each axis.
const HALF_BLOCKS: i32 = HALF >> BLOCK_BITS;

/// A block's number in the order of an octree: the bits of x, y and z in turn, x the lowest. None beyond the tree's border.
fn morton(key: Key) -> Option<u64> {
    let place = unpack(key).map(|v| v + HALF_BLOCKS);
    let spread = |v: i32| (0..DEPTH - BLOCK_BITS).map(|bit| (v as u64 >> bit & 1) << (3 * bit)).sum::<u64>();
    let is_inside = place.iter().all(|v| (0..2 * HALF_BLOCKS).contains(v));
    is_inside.then(|| spread(place[0]) | spread(place[1]) << 1 | spread(place[2]) << 2)
}

impl Octree {
    /// The octree of what is known within 2^15 voxels from the origin, 3.2 km at 10 cm; leaves that are the same are one.
    #[must_use]
    pub fn of(occupancy: &Occupancy, leaves: Leaves) -> Self {
        let mut nodes = Nodes::default();
        let root = build(&mut nodes, occupancy, leaves);
        nodes.into_octree(occupancy.resolution_m(), root)
    }

    /// Voxels of an occupancy that lie too far out for an octree.
    #[must_use]
    pub fn left_out(occupancy: &Occupancy) -> u64 {
        let blocks = occupancy.sorted_blocks();
        let outside = blocks.into_iter().filter(|(key, _)| morton(*key).is_none());
        outside.map(|(_, block)| block.voxels().count() as u64).sum()
    }

    /// Of each leaf only whether it is rather occupied or rather free; leaves that are the same then are one.
    #[must_use]
    pub fn most_likely(&self) -> Self {
        let mut nodes = Nodes::default();
        let root = self.nodes.last().and_then(|root| self.simplified(*root, &mut nodes, DEPTH));
        nodes.into_octree(self.resolution_m, root)
    }

    fn simplified(&self, node: Node, nodes: &mut Nodes, level: u32) -> Option<Node> {
        if node.is_leaf() || level == 0 {
            return Some(Node::leaf(Leaves::MostLikely.value(node.log_odds)));
        }
        let mut children = [None; 8];
        for (number, at) in node.places() {
            children[number] = self.nodes.get(at).and_then(|child| self.simplified(*child, nodes, level - 1));
        }
        nodes.close(0, &children)
    }
}

/// What nodes are made into, from below: [`Nodes`], or the bytes of a file.
pub(super) trait Sink {
    /// Before the children of a node are made: what [`close`](Self::close) is told.
    fn open(&mut self) -> usize;

    /// A node over children that were made since; a leaf where all are leaves and the same, none where there are none.
    fn close(&mut self, opened: usize, children: &[Option<Node>; 8]) -> Option<Node>;
}

/// Makes all nodes; the root.
pub(super) fn build(sink: &mut impl Sink, occupancy: &Occupancy, leaves: Leaves) -> Option<Node> {
    let blocks = occupancy.sorted_blocks();
    let mut blocks: Vec<_> = blocks.into_iter().filter_map(|(key, block)| Some((morton(key)?, block))).collect();
    blocks.sort_unstable_by_key(|(number, _)| *number);
    of_blocks(sink, &blocks, DEPTH - BLOCK_BITS, leaves)
}

/// The node of blocks that all lie in it, `level` levels above blocks.
fn of_blocks(sink: &mut impl Sink, blocks: &[(u64, &Block)], level: u32, leaves: Leaves) -> Option<Node> {
    let (_, block) = blocks.first()?;
    if level == 0 {
        return of_voxels(sink, block, 0, BLOCK_BITS, leaves);
    }
    let opened = sink.open();
    let mut children = [None; 8];
    let mut rest = blocks;
    for (number, child) in children.iter_mut().enumerate() {
        let end = rest.partition_point(|(block, _)| (block >> (3 * (level - 1)) & 7) as usize <= number);
        let (inside, after) = rest.split_at(end);
        *child = of_blocks(sink, inside, level - 1, leaves);
        rest = after;
    }
    sink.close(opened, &children)
}

/// The node of a cube of 2^level voxels a side within a block, by its least voxel.
fn of_voxels(sink: &mut impl Sink, block: &Block, voxel: usize, level: u32, leaves: Leaves) -> Option<Node> {
    if level == 0 {
        let (hits, passes) = block.counts(voxel);
        return (hits > 0 || passes > 0).then(|| Node::leaf(leaves.value(log_odds(hits, passes))));
    }
    let (opened, below) = (sink.open(), level - 1);
    let children = [0, 1, 2, 3, 4, 5, 6, 7].map(|number: usize| {
        let step = |k: u32| (number >> k & 1) << (below + k * BLOCK_BITS);
        of_voxels(sink, block, voxel + step(0) + step(1) + step(2), below, leaves)
    });
    sink.close(opened, &children)
}

/// The leaf that eight leaves are, where they are the same.
pub(super) fn same_leaf(children: &[Option<Node>; 8]) -> Option<Node> {
    let first = children[0].filter(Node::is_leaf)?;
    let is_same = |child: &Option<Node>| child.is_some_and(|node| node.is_leaf() && node.log_odds == first.log_odds);
    children.iter().all(is_same).then_some(first)
}

/// Nodes as they are made: children before their parents.
#[derive(Debug, Default)]
pub(super) struct Nodes(Vec<Node>);

impl Sink for Nodes {
    fn open(&mut self) -> usize {
        0
    }

    fn close(&mut self, _: usize, children: &[Option<Node>; 8]) -> Option<Node> {
        let is_known = children.iter().any(Option::is_some);
        is_known.then(|| same_leaf(children).unwrap_or_else(|| self.inner(children, greatest(children))))
    }
}

impl Nodes {
    /// A node over children, of which there are some.
    pub(super) fn inner(&mut self, children: &[Option<Node>; 8], log_odds: f32) -> Node {
        // Beyond 2^32 nodes, 50 GB, nothing is found, but nothing wrong either.
        let first = u32::try_from(self.0.len()).unwrap_or(u32::MAX);
        let bits = (0..8).filter(|&k| children[k].is_some()).fold(0, |bits, k| bits | 1 << k);
        self.0.extend(children.iter().flatten());
        Node { log_odds, first, children: bits }
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn into_octree(mut self, resolution_m: f64, root: Option<Node>) -> Octree {
        self.0.extend(root);
        Octree { resolution_m, nodes: self.0 }
    }
}

/// The greatest value of children.
pub(super) fn greatest(children: &[Option<Node>; 8]) -> f32 {
    children.iter().flatten().fold(f32::NEG_INFINITY, |most, node| most.max(node.log_odds))
}
