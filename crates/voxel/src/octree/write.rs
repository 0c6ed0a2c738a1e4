//! OctoMap's files, written: `.bt` (binary) and `.ot` (full), as `AbstractOccupancyOcTree::writeBinary` and `AbstractOcTree::write` do.

use super::build::{Leaves, Nodes, Sink, build, greatest, same_leaf};
use super::{DEPTH, Node, Octree, OctreeError};
use crate::occupancy::{FREE_LEAST, OCCUPIED_MOST, Occupancy};
use std::borrow::Cow;
use std::io::Write;

pub(super) const BINARY: &str = "# Octomap OcTree binary file";
pub(super) const FULL: &str = "# Octomap OcTree file";
/// Two bits a child in `.bt` files.
pub(super) const FREE: u16 = 0b01;
pub(super) const OCCUPIED: u16 = 0b10;
pub(super) const INNER: u16 = 0b11;

impl Octree {
    /// Writes a `.bt` file: of each leaf whether it is occupied or free, two bits. Other leaves are [simplified](Self::most_likely)
    /// first.
    ///
    /// # Errors
    /// What the stream says.
    pub fn write_bt(&self, stream: &mut impl Write) -> Result<(), OctreeError> {
        let tree = self.written_as_bt();
        tree.write_header(BINARY, stream)?;
        tree.nodes.last().map_or(Ok(()), |root| tree.write_codes(*root, stream, DEPTH))
    }

    /// Writes an `.ot` file: of every node the logarithm of its odds.
    ///
    /// # Errors
    /// What the stream says.
    pub fn write_ot(&self, stream: &mut impl Write) -> Result<(), OctreeError> {
        self.write_header(FULL, stream)?;
        self.nodes.last().map_or(Ok(()), |root| self.write_values(*root, stream, DEPTH))
    }

    fn write_header(&self, kind: &str, stream: &mut impl Write) -> Result<(), OctreeError> {
        write_header(kind, self.nodes.len(), self.resolution_m, stream)
    }

    /// What a `.bt` file can say: leaves of two kinds, and a root that is none.
    fn written_as_bt(&self) -> Cow<'_, Self> {
        let is_plain = |node: &Node| !node.is_leaf() || [FREE_LEAST, OCCUPIED_MOST].contains(&node.log_odds);
        let tree = if self.nodes.iter().all(is_plain) { Cow::Borrowed(self) } else { Cow::Owned(self.most_likely()) };
        match tree.nodes.last() {
            Some(root) if root.is_leaf() => {
                let mut nodes = Nodes::default();
                let root = nodes.inner(&[Some(*root); 8], root.log_odds);
                Cow::Owned(nodes.into_octree(self.resolution_m, Some(root)))
            }
            _ => tree,
        }
    }

    fn write_codes(&self, node: Node, stream: &mut impl Write, level: u32) -> Result<(), OctreeError> {
        stream.write_all(&codes_of(self.children(node)))?;
        let mut inner = self.children(node).filter(|(_, child)| !child.is_leaf() && level > 0);
        inner.try_for_each(|(_, child)| self.write_codes(child, stream, level - 1))
    }

    fn write_values(&self, node: Node, stream: &mut impl Write, level: u32) -> Result<(), OctreeError> {
        let [a, b, c, d] = node.log_odds.to_le_bytes();
        stream.write_all(&[a, b, c, d, node.children])?;
        let mut children = self.children(node).filter(|_| level > 0);
        children.try_for_each(|(_, child)| self.write_values(child, stream, level - 1))
    }

    fn children(&self, node: Node) -> impl Iterator<Item = (usize, Node)> + '_ {
        node.places().filter_map(|(number, at)| self.nodes.get(at).map(|child| (number, *child)))
    }
}

fn write_header(kind: &str, nodes: usize, resolution_m: f64, stream: &mut impl Write) -> Result<(), OctreeError> {
    writeln!(stream, "{kind}")?;
    writeln!(stream, "# (feel free to add / change comments, but leave the first line as it is!)\n#")?;
    write!(stream, "id OcTree\nsize {nodes}\nres {resolution_m}\ndata\n")?;
    Ok(())
}

/// The two bytes of an inner node with such children.
fn codes_of(children: impl Iterator<Item = (usize, Node)>) -> [u8; 2] {
    let code = |child: Node| match child.is_leaf() {
        false => INNER,
        true if child.log_odds >= 0.0 => OCCUPIED,
        true => FREE,
    };
    children.fold(0, |codes, (number, child)| codes | code(child) << (2 * number)).to_le_bytes()
}

/// What a `.bt` file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BtCounts {
    /// Nodes, the root and leaves among them.
    pub nodes: usize,
    /// Occupied leaves.
    pub occupied: usize,
}

/// Writes the same `.bt` file as `Octree::of(occupancy, Leaves::MostLikely)` does, without holding the tree: in the memory of the
/// file alone.
///
/// # Errors
/// What the stream says.
pub fn write_bt(occupancy: &Occupancy, stream: &mut impl Write) -> Result<BtCounts, OctreeError> {
    let mut codes = Codes { bytes: Vec::new(), counts: BtCounts { nodes: 0, occupied: 0 } };
    // The cube around the origin is cut at the origin: a root that is a leaf is one of a map of 2^48 voxels.
    codes.counts.nodes += usize::from(build(&mut codes, occupancy, Leaves::MostLikely).is_some());
    write_header(BINARY, codes.counts.nodes, occupancy.resolution_m(), stream)?;
    stream.write_all(&codes.bytes)?;
    Ok(codes.counts)
}

/// Inner nodes as a `.bt` file's bytes: each before those below it.
struct Codes {
    bytes: Vec<u8>,
    counts: BtCounts,
}

impl Sink for Codes {
    fn open(&mut self) -> usize {
        self.bytes.extend([0; 2]);
        self.bytes.len() - 2
    }

    fn close(&mut self, opened: usize, children: &[Option<Node>; 8]) -> Option<Node> {
        let there = || children.iter().enumerate().filter_map(|(number, child)| Some((number, (*child)?)));
        let leaf = same_leaf(children);
        if leaf.is_some() || there().next().is_none() {
            self.bytes.truncate(opened);
            return leaf;
        }
        self.bytes[opened..opened + 2].copy_from_slice(&codes_of(there()));
        self.counts.nodes += there().count();
        self.counts.occupied += there().filter(|(_, child)| child.is_leaf() && child.log_odds >= 0.0).count();
        let bits = there().fold(0, |bits, (number, _)| bits | 1 << number);
        Some(Node { log_odds: greatest(children), first: 0, children: bits })
    }
}
