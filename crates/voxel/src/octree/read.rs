//! OctoMap's files, read. Any bytes may come.

use super::build::{Nodes, greatest};
use super::write::{BINARY, FREE, FULL, INNER, OCCUPIED};
use super::{DEPTH, Node, Octree, OctreeError};
use crate::occupancy::{FREE_LEAST, OCCUPIED_MOST};
use std::io::Read;

/// So much of what was found is told.
const TOLD_BYTES: usize = 40;
/// More nodes than can be numbered.
const NODES_AT_MOST: usize = u32::MAX as usize - 9;

impl Octree {
    /// Reads a `.bt` file of OctoMap's `OcTree`; leaves are as surely occupied or free as may be, probability 0.971 and 0.1192.
    ///
    /// # Errors
    /// What the stream says; bytes that are no such file, with where and what was expected.
    pub fn read_bt(stream: &mut impl Read) -> Result<Self, OctreeError> {
        Self::read(stream, BINARY, |bytes, nodes| bytes.codes(nodes, 0))
    }

    /// Reads an `.ot` file of OctoMap's `OcTree`.
    ///
    /// # Errors
    /// As [`read_bt`](Self::read_bt).
    pub fn read_ot(stream: &mut impl Read) -> Result<Self, OctreeError> {
        Self::read(stream, FULL, |bytes, nodes| bytes.values(nodes, 0))
    }

    fn read(
        stream: &mut impl Read,
        kind: &'static str,
        root: impl FnOnce(&mut Bytes<'_>, &mut Nodes) -> Result<Node, OctreeError>,
    ) -> Result<Self, OctreeError> {
        let mut all = Vec::new();
        stream.read_to_end(&mut all)?;
        let mut bytes = Bytes { all: &all, at: 0 };
        let header = bytes.header(kind)?;
        let mut nodes = Nodes::default();
        let root = if header.size > 0 { Some(root(&mut bytes, &mut nodes)?) } else { None };
        let left = all.len() - bytes.at;
        if left > 0 {
            return Err(OctreeError::Trailing { byte: bytes.at, count: left });
        }
        let tree = nodes.into_octree(header.resolution_m, root);
        match tree.nodes.len() as u64 {
            found if found == header.size => Ok(tree),
            found => Err(OctreeError::Size { said: header.size, found }),
        }
    }
}

struct Header {
    size: u64,
    resolution_m: f64,
}

/// A file's bytes, and how far they are read.
struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    /// Lines up to `data`. As OctoMap does, unknown ones are passed over.
    fn header(&mut self, kind: &'static str) -> Result<Header, OctreeError> {
        if self.line().map(|(_, line)| line.trim_ascii_end()) != Some(kind.as_bytes()) {
            return Err(OctreeError::NoOctree { expected: kind });
        }
        let (mut id, mut size, mut resolution_m) = (false, None, None);
        while let Some((byte, line)) = self.line() {
            let line = line.trim_ascii();
            let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
            let (word, value) = (&line[..end], line[end..].trim_ascii());
            let failed = |expected| OctreeError::Header { byte, expected, found: told(line) };
            match word {
                b"id" if value == b"OcTree" || value == b"1" => id = true,
                b"id" => return Err(failed("a tree of kind OcTree")),
                b"size" => size = Some(parsed(value).ok_or_else(|| failed("the number of nodes"))?),
                b"res" => {
                    let is_usable = |v: &f64| v.is_finite() && *v > 0.0;
                    let value = parsed(value).filter(is_usable);
                    resolution_m = Some(value.ok_or_else(|| failed("a voxel's side in metres, above zero"))?);
                }
                b"data" => return self.complete(byte, id, size, resolution_m),
                _ => {}
            }
        }
        Err(OctreeError::Cut { byte: self.all.len(), expected: "the line \"data\"" })
    }

    fn complete(&self, byte: usize, id: bool, size: Option<u64>, side: Option<f64>) -> Result<Header, OctreeError> {
        let missing = |expected| OctreeError::Header { byte, expected, found: "\"data\"".to_owned() };
        let size = size.ok_or_else(|| missing("a line \"size\" before"))?;
        let resolution_m = side.ok_or_else(|| missing("a line \"res\" before"))?;
        if id { Ok(Header { size, resolution_m }) } else { Err(missing("a line \"id\" before")) }
    }

    /// The next line and where it begins.
    fn line(&mut self) -> Option<(usize, &'a [u8])> {
        let (byte, rest) = (self.at, &self.all[self.at..]);
        let end = rest.iter().position(|&b| b == b'\n');
        self.at += end.map_or(rest.len(), |end| end + 1);
        (!rest.is_empty()).then(|| (byte, &rest[..end.unwrap_or(rest.len())]))
    }

    fn take<const N: usize>(&mut self, expected: &'static str) -> Result<[u8; N], OctreeError> {
        let taken = self.all[self.at..].first_chunk::<N>();
        let taken = taken.ok_or(OctreeError::Cut { byte: self.all.len(), expected })?;
        self.at += N;
        Ok(*taken)
    }

    /// An inner node of a `.bt` file.
    fn codes(&mut self, nodes: &mut Nodes, depth: u32) -> Result<Node, OctreeError> {
        let byte = self.at;
        let codes = u16::from_le_bytes(self.take("two bytes of a node")?);
        if codes == 0 {
            return Err(OctreeError::Node { byte, reason: "expected a node with children, found one without" });
        }
        let mut children = [None; 8];
        for (number, child) in children.iter_mut().enumerate() {
            *child = match codes >> (2 * number) & INNER {
                FREE => Some(Node::leaf(FREE_LEAST)),
                OCCUPIED => Some(Node::leaf(OCCUPIED_MOST)),
                INNER => {
                    check_depth(byte, depth + 1)?;
                    Some(self.codes(nodes, depth + 1)?)
                }
                _ => None,
            };
        }
        check_count(byte, nodes)?;
        Ok(nodes.inner(&children, greatest(&children)))
    }

    /// A node of an `.ot` file.
    fn values(&mut self, nodes: &mut Nodes, depth: u32) -> Result<Node, OctreeError> {
        let byte = self.at;
        let [a, b, c, d, bits] = self.take("five bytes of a node")?;
        let log_odds = f32::from_le_bytes([a, b, c, d]);
        if !log_odds.is_finite() {
            return Err(OctreeError::Node { byte, reason: "expected the logarithm of odds, found no finite number" });
        }
        if bits == 0 {
            return Ok(Node::leaf(log_odds));
        }
        check_depth(byte, depth)?;
        let mut children = [None; 8];
        for (number, child) in children.iter_mut().enumerate() {
            if bits >> number & 1 == 1 {
                *child = Some(self.values(nodes, depth + 1)?);
            }
        }
        check_count(byte, nodes)?;
        Ok(nodes.inner(&children, log_odds))
    }
}

/// Whether a node at such a depth may have children.
fn check_depth(byte: usize, depth: u32) -> Result<(), OctreeError> {
    let reason = "expected 16 levels at most, found more";
    if depth < DEPTH { Ok(()) } else { Err(OctreeError::Node { byte, reason }) }
}

fn check_count(byte: usize, nodes: &Nodes) -> Result<(), OctreeError> {
    let reason = "expected fewer than 2^32 nodes, found more";
    if nodes.len() < NODES_AT_MOST { Ok(()) } else { Err(OctreeError::Node { byte, reason }) }
}

fn parsed<T: std::str::FromStr>(value: &[u8]) -> Option<T> {
    std::str::from_utf8(value).ok()?.parse().ok()
}

fn told(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(&line[..line.len().min(TOLD_BYTES)]);
    format!("{text:?}")
}
