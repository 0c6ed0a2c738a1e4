//! OctoMap's files, written: `.bt` (binary) and `.ot` (full), as `AbstractOccupancyOcTree::writeBinary` and `AbstractOcTree::write` do.

use super::build::Nodes;
use super::{DEPTH, Node, Octree, OctreeError};
use crate::occupancy::{FREE_LEAST, OCCUPIED_MOST};
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
        writeln!(stream, "{kind}")?;
        writeln!(stream, "# (feel free to add / change comments, but leave the first line as it is!)\n#")?;
        write!(stream, "id OcTree\nsize {}\nres {}\ndata\n", self.nodes.len(), self.resolution_m)?;
        Ok(())
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
        let mut codes = 0_u16;
        for (number, child) in self.children(node) {
            let leaf = if child.log_odds >= 0.0 { OCCUPIED } else { FREE };
            codes |= (if child.is_leaf() { leaf } else { INNER }) << (2 * number);
        }
        stream.write_all(&codes.to_le_bytes())?;
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
