//! Meshes as PLY (Turk 1994), binary, little endian.

use crate::error::SurfaceError;
use crate::mesh::Mesh;
use std::io::{BufWriter, Write};

/// Writes a mesh: vertices `x y z nx ny nz`, metres, with `red green blue` where there are any, and triangles.
///
/// # Errors
/// [`SurfaceError::Mesh`] of a mesh that is none, and what the stream says.
pub fn write_ply(stream: &mut impl Write, mesh: &Mesh) -> Result<(), SurfaceError> {
    mesh.check()?;
    let mut stream = BufWriter::new(stream);
    write!(stream, "ply\nformat binary_little_endian 1.0\ncomment metres, in the map's frame\n")?;
    writeln!(stream, "element vertex {}", mesh.positions_m.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(stream, "property float {name}")?;
    }
    if !mesh.colours.is_empty() {
        stream.write_all(b"property uchar red\nproperty uchar green\nproperty uchar blue\n")?;
    }
    write!(stream, "element face {}\nproperty list uchar uint vertex_indices\nend_header\n", mesh.triangles.len())?;
    for (number, (position, normal)) in mesh.positions_m.iter().zip(&mesh.normals).enumerate() {
        for value in position.iter().chain(normal) {
            stream.write_all(&value.to_le_bytes())?;
        }
        if let Some(colour) = mesh.colours.get(number) {
            stream.write_all(colour)?;
        }
    }
    for triangle in &mesh.triangles {
        stream.write_all(&[3])?;
        for vertex in triangle {
            stream.write_all(&vertex.to_le_bytes())?;
        }
    }
    Ok(stream.flush()?)
}
