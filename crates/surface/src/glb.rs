//! Meshes as glTF 2.0 in one binary file (Khronos Group 2021, "glTF 2.0 Specification", section 4.4).

use crate::error::SurfaceError;
use crate::mesh::Mesh;
use serde_json::{Value, json};
use std::io::{BufWriter, Write};

/// `glTF`, `JSON` and `BIN\0`.
const MAGIC: u32 = 0x4654_6c67;
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
/// Component types of the format.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
/// What a buffer view is for: vertices, triangles.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Turns z up into y up: by -90 degrees about x, as a quaternion x y z w.
const Y_UP: [f64; 4] = [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// Writes a mesh that any viewer of glTF opens: `POSITION`, `NORMAL`, where there are any `COLOR_0`, and indices. A node turns the map's frame, z up, into the
/// format's, y up.
///
/// Colours are linear there (section 3.9.2): 16 bits of each, for 8 are too few for what is dark.
///
/// # Errors
/// [`SurfaceError::Mesh`] of a mesh that is none, [`SurfaceError::TooLarge`], and what the stream says.
pub fn write_glb(stream: &mut impl Write, mesh: &Mesh) -> Result<(), SurfaceError> {
    mesh.check()?;
    let layout = Layout::of(mesh);
    let mut text = layout.json(mesh).to_string();
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(4) - text.len()));
    let binary = layout.bytes();
    let bytes = 12 + 8 + text.len() as u64 + if binary > 0 { 8 + binary } else { 0 };
    let total = u32::try_from(bytes).map_err(|_| SurfaceError::TooLarge { bytes })?;
    let mut stream = BufWriter::new(stream);
    write_words(&mut stream, &[MAGIC, 2, total, text.len() as u32, JSON_CHUNK])?;
    stream.write_all(text.as_bytes())?;
    if binary > 0 {
        write_words(&mut stream, &[binary as u32, BINARY_CHUNK])?;
        write_columns(&mut stream, mesh)?;
    }
    Ok(stream.flush()?)
}

fn write_words(stream: &mut impl Write, words: &[u32]) -> std::io::Result<()> {
    words.iter().try_for_each(|word| stream.write_all(&word.to_le_bytes()))
}

fn write_columns(stream: &mut impl Write, mesh: &Mesh) -> std::io::Result<()> {
    for value in mesh.positions_m.iter().chain(&mesh.normals).flatten() {
        stream.write_all(&value.to_le_bytes())?;
    }
    let linear: Vec<u16> = (0..=255).map(linear).collect();
    for colour in &mesh.colours {
        let [red, green, blue] = colour.map(|part| linear[usize::from(part)]);
        [red, green, blue, u16::MAX].iter().try_for_each(|part| stream.write_all(&part.to_le_bytes()))?;
    }
    mesh.triangles.iter().try_for_each(|triangle| write_words(stream, triangle))
}

/// What the screen shows as this, as light (IEC 61966-2-1, sRGB).
fn linear(shown: u8) -> u16 {
    let shown = f64::from(shown) / 255.0;
    let light = if shown <= 0.04045 { shown / 12.92 } else { ((shown + 0.055) / 1.055).powf(2.4) };
    (light * f64::from(u16::MAX)).round() as u16
}

/// One column in the buffer.
struct Column {
    name: &'static str,
    component: u32,
    shape: &'static str,
    bytes_each: u64,
    count: u64,
}

/// The columns, one after the other; each is a whole number of four bytes.
struct Layout(Vec<Column>);

impl Layout {
    fn of(mesh: &Mesh) -> Self {
        let vertices = mesh.positions_m.len() as u64;
        let column = |name, component, shape, bytes_each, count| Column { name, component, shape, bytes_each, count };
        let all = [
            column("POSITION", FLOAT, "VEC3", 12, vertices),
            column("NORMAL", FLOAT, "VEC3", 12, vertices),
            column("COLOR_0", UNSIGNED_SHORT, "VEC4", 8, mesh.colours.len() as u64),
            column("indices", UNSIGNED_INT, "SCALAR", 4, 3 * mesh.triangles.len() as u64),
        ];
        let is_drawn = vertices > 0 && !mesh.triangles.is_empty();
        Self(all.into_iter().filter(|column| is_drawn && column.count > 0).collect())
    }

    fn bytes(&self) -> u64 {
        self.0.iter().map(|column| column.bytes_each * column.count).sum()
    }

    /// The text before the buffer. A mesh without triangles is a scene without anything, for the format knows no empty columns.
    fn json(&self, mesh: &Mesh) -> Value {
        let asset = json!({"version": "2.0", "generator": "mapwright"});
        if self.0.is_empty() {
            return json!({"asset": asset, "scene": 0, "scenes": [{}]});
        }
        let is_triangles = |column: &Column| column.name == "indices";
        let offsets = self.0.iter().scan(0_u64, |next, column| {
            let offset = *next;
            *next += column.bytes_each * column.count;
            Some(offset)
        });
        let view = |(column, offset): (&Column, u64)| {
            let target = if is_triangles(column) { ELEMENT_ARRAY_BUFFER } else { ARRAY_BUFFER };
            json!({"buffer": 0, "byteOffset": offset, "byteLength": column.bytes_each * column.count, "target": target})
        };
        let accessor = |(number, column): (usize, &Column)| {
            let (component, shape, count) = (column.component, column.shape, column.count);
            let mut accessor = json!({"bufferView": number, "componentType": component, "count": count, "type": shape});
            if column.name == "POSITION" {
                let (low, high) = bounds(&mesh.positions_m);
                (accessor["min"], accessor["max"]) = (json!(low), json!(high));
            }
            if component == UNSIGNED_SHORT {
                accessor["normalized"] = json!(true);
            }
            accessor
        };
        let attributes: serde_json::Map<String, Value> = (0..)
            .zip(&self.0)
            .filter(|(_, column)| !is_triangles(column))
            .map(|(number, column): (usize, _)| (column.name.to_owned(), json!(number)))
            .collect();
        json!({
            "asset": asset,
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "map", "mesh": 0, "rotation": Y_UP}],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": self.0.len() - 1, "material": 0, "mode": 4}]}],
            "materials": [{"doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
            "buffers": [{"byteLength": self.bytes()}],
            "bufferViews": self.0.iter().zip(offsets).map(view).collect::<Vec<_>>(),
            "accessors": self.0.iter().enumerate().map(accessor).collect::<Vec<_>>(),
        })
    }
}

fn bounds(positions_m: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let all = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    positions_m
        .iter()
        .fold(all, |(low, high), at| ([0, 1, 2].map(|k| low[k].min(at[k])), [0, 1, 2].map(|k| high[k].max(at[k]))))
}
