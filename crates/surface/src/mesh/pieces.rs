//! Pieces of a mesh that hang together, and vertices that belong to none.

use super::Mesh;

/// The mesh without pieces whose box has a diagonal shorter than this, metres.
pub(super) fn without_small(mesh: Mesh, least_m: f64) -> Mesh {
    let mut groups = Groups((0..mesh.positions_m.len() as u32).collect());
    for &[a, b, c] in &mesh.triangles {
        groups.join(a, b);
        groups.join(a, c);
    }
    let mut boxes = vec![[[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]; mesh.positions_m.len()];
    let roots: Vec<usize> = (0..mesh.positions_m.len() as u32).map(|vertex| groups.root(vertex) as usize).collect();
    for (position, &root) in mesh.positions_m.iter().zip(&roots) {
        let [low, high] = &mut boxes[root];
        (0..3).for_each(|k| (low[k], high[k]) = (low[k].min(position[k]), high[k].max(position[k])));
    }
    let is_wide = |[low, high]: &[[f32; 3]; 2]| {
        (0..3).map(|k| f64::from(high[k] - low[k]).powi(2)).sum::<f64>().sqrt() >= least_m
    };
    let stays: Vec<bool> = roots.iter().map(|&root| is_wide(&boxes[root])).collect();
    keep(mesh, &stays)
}

/// The mesh without vertices that no triangle has.
pub(super) fn without_unused(mesh: Mesh) -> Mesh {
    let mut is_used = vec![false; mesh.positions_m.len()];
    mesh.triangles.iter().flatten().for_each(|&vertex| is_used[vertex as usize] = true);
    keep(mesh, &is_used)
}

fn keep(mesh: Mesh, stays: &[bool]) -> Mesh {
    let numbers: Vec<u32> = stays
        .iter()
        .scan(0, |next, &stays| {
            *next += u32::from(stays);
            Some(*next - u32::from(stays))
        })
        .collect();
    let is_kept = |vertex: &u32| stays[*vertex as usize];
    let triangles = mesh.triangles.iter().filter(|[a, ..]| is_kept(a));
    Mesh {
        triangles: triangles.map(|triangle| triangle.map(|vertex| numbers[vertex as usize])).collect(),
        positions_m: kept(mesh.positions_m, stays),
        normals: kept(mesh.normals, stays),
        colours: kept(mesh.colours, stays),
    }
}

fn kept<T>(column: Vec<T>, stays: &[bool]) -> Vec<T> {
    column.into_iter().zip(stays).filter(|(_, stays)| **stays).map(|(it, _)| it).collect()
}

/// Disjoint sets of vertices.
struct Groups(Vec<u32>);

impl Groups {
    fn root(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            let above = self.0[vertex as usize];
            self.0[vertex as usize] = self.0[above as usize];
            vertex = self.0[vertex as usize];
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
