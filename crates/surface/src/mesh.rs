//! The surface of a volume as triangles.

mod cases;
mod grid;
mod nets;
mod pieces;

use crate::error::SurfaceError;
use crate::volume::Volume;

/// How a mesh is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshSettings {
    /// Cells of which no corner was seen so well make no surface: 1 is one view that faces it from near, or more from afar and aslant.
    pub least_weight: f64,
    /// Pieces that hang together and are less than so wide are left out, metres: the diagonal of the box around them. 0 keeps all.
    pub least_piece_m: f64,
    /// Threads to work on at most. The mesh is the same with any number.
    pub threads: usize,
}

impl Default for MeshSettings {
    fn default() -> Self {
        Self { least_weight: 0.5, least_piece_m: 0.0, threads: 1 }
    }
}

/// A surface as triangles.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertices in the map's frame, metres.
    pub positions_m: Vec<[f32; 3]>,
    /// Of length one each, to the side that was seen.
    pub normals: Vec<[f32; 3]>,
    /// Red, green and blue of each, sRGB; empty where no view had colours.
    pub colours: Vec<[u8; 3]>,
    /// Three vertices each, counterclockwise seen from where the sensor was.
    pub triangles: Vec<[u32; 3]>,
}

/// Edges of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EdgeCounts {
    /// Of one triangle: where the surface ends.
    pub boundary: usize,
    /// Of two.
    pub inner: usize,
    /// Of more.
    pub non_manifold: usize,
}

impl Volume {
    /// The surface as triangles: one vertex for each sheet of surface in a cell of eight voxels, four cells around an edge that the surface crosses make two triangles (surface
    /// nets: Gibson 1998, "Constrained elastic surface nets"; several sheets: Nielson 2004, "Dual marching cubes"). A vertex is the mean of where edges are
    /// crossed.
    ///
    /// There is a surface where all eight voxels were seen near it and one of them well, and none where rays that passed say there is nothing. Blocks
    /// share their vertices. The mesh is a function of the volume, whatever came and went before, and in an order of places.
    #[must_use]
    pub fn mesh(&self, settings: &MeshSettings) -> Mesh {
        let mesh = pieces::without_unused(nets::mesh_of(self, settings));
        if settings.least_piece_m > 0.0 { pieces::without_small(mesh, settings.least_piece_m) } else { mesh }
    }
}

impl Mesh {
    /// Counts its edges by how many triangles have them.
    #[must_use]
    pub fn edges(&self) -> EdgeCounts {
        let ends = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
        let mut edges: Vec<[u32; 2]> =
            self.triangles.iter().flat_map(ends).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        let mut counts = EdgeCounts::default();
        for same in edges.chunk_by(|a, b| a == b) {
            *match same.len() {
                1 => &mut counts.boundary,
                2 => &mut counts.inner,
                _ => &mut counts.non_manifold,
            } += 1;
        }
        counts
    }

    /// Whether its columns belong together, its positions are finite and its triangles name vertices that are there.
    pub(crate) fn check(&self) -> Result<(), SurfaceError> {
        let vertices = self.positions_m.len();
        let is_there = |triangle: &[u32; 3]| triangle.iter().all(|&vertex| (vertex as usize) < vertices);
        let what = if self.normals.len() != vertices {
            "as many normals as vertices are expected"
        } else if !(self.colours.is_empty() || self.colours.len() == vertices) {
            "as many colours as vertices are expected, or none"
        } else if !self.positions_m.iter().chain(&self.normals).flatten().all(|v| v.is_finite()) {
            "positions and normals are expected to be finite"
        } else if !self.triangles.iter().all(is_there) {
            "a triangle has a vertex that is not there"
        } else {
            return Ok(());
        };
        Err(SurfaceError::Mesh { what })
    }
}
