//! What is written can be read.

use crate::simulated::{looking, settings, sphere, surface_of};
use mapwright_surface::{Mesh, MeshSettings, SurfaceError, write_glb, write_ply};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::Value;

fn ball(is_coloured: bool) -> Mesh {
    let world = sphere(Vector3::new(0.3, -0.1, 5.0), 0.4);
    let cameras = [looking([1.4, -0.1, 5.0], [0.3, -0.1, 5.0]), looking([0.3, 1.0, 5.0], [0.3, -0.1, 5.0])];
    let mesh = surface_of(&world, &cameras, 80, settings(0.05)).mesh(&MeshSettings::default());
    let colours = (0..mesh.positions_m.len()).filter(|_| is_coloured).map(|k| [k as u8, 128, 255]).collect();
    Mesh { colours, ..mesh }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(word(bytes, at))
}

/// The text and the buffer of a file, after its chunks' lengths were checked.
fn chunks(file: &[u8]) -> (Value, &[u8]) {
    assert_eq!((&file[..4], word(file, 4), word(file, 8) as usize), (&b"glTF"[..], 2, file.len()));
    let length = word(file, 12) as usize;
    assert_eq!((&file[16..20], length % 4), (&b"JSON"[..], 0));
    let text = serde_json::from_slice(&file[20..20 + length]).unwrap();
    let rest = &file[20 + length..];
    if rest.is_empty() {
        return (text, rest);
    }
    assert_eq!((&rest[4..8], word(rest, 0) as usize, rest.len() % 4), (&b"BIN\0"[..], rest.len() - 8, 0));
    (text, &rest[8..])
}

/// The bytes of an accessor, one element each, after its bounds and alignment were checked.
fn elements<'a>(text: &Value, buffer: &'a [u8], number: &Value) -> Vec<&'a [u8]> {
    let accessor = &text["accessors"][number.as_u64().unwrap() as usize];
    let view = &text["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let get = |value: &Value, name: &str| value[name].as_u64().unwrap() as usize;
    let size = match get(accessor, "componentType") {
        5126 | 5125 => 4,
        5123 => 2,
        other => panic!("{other}"),
    };
    let width = match accessor["type"].as_str().unwrap() {
        "SCALAR" => 1,
        "VEC3" => 3,
        "VEC4" => 4,
        other => panic!("{other}"),
    };
    let (from, length) = (get(view, "byteOffset"), get(view, "byteLength"));
    assert_eq!((from % 4, size * width % 4, length), (0, 0, get(accessor, "count") * size * width));
    buffer[from..from + length].chunks(size * width).collect()
}

#[test]
fn a_glb_has_what_the_mesh_has() {
    for mesh in [ball(true), ball(false)] {
        let mut file = Vec::new();
        write_glb(&mut file, &mesh).unwrap();
        let (text, buffer) = chunks(&file);
        assert_eq!(text["buffers"][0]["byteLength"], buffer.len());
        let primitive = &text["meshes"][0]["primitives"][0];
        let of = |name: &str| elements(&text, buffer, &primitive["attributes"][name]);
        let vectors = |name| -> Vec<[f32; 3]> { of(name).iter().map(|e| [0, 4, 8].map(|at| float(e, at))).collect() };
        assert_eq!((vectors("POSITION"), vectors("NORMAL")), (mesh.positions_m.clone(), mesh.normals.clone()));
        let indices: Vec<u32> = elements(&text, buffer, &primitive["indices"]).iter().map(|e| word(e, 0)).collect();
        assert_eq!(indices, mesh.triangles.as_flattened());
        let has_colours = primitive["attributes"].get("COLOR_0").is_some();
        assert_eq!(has_colours, !mesh.colours.is_empty());
        if has_colours {
            let colours = of("COLOR_0");
            let part = |at: usize, k: usize| u16::from_le_bytes(colours[at][2 * k..2 * k + 2].try_into().unwrap());
            assert_eq!((part(0, 0), part(255, 0), part(9, 2), part(9, 3)), (0, 65535, 65535, 65535));
            assert_eq!(part(9, 1), 14_146, "128 of 255 is 0.2158 of the light");
            assert_eq!(text["accessors"][2]["normalized"], true);
        }
        let bound = |name: &str, k: usize| text["accessors"][0][name][k].as_f64().unwrap() as f32;
        let along = |k: usize| mesh.positions_m.iter().map(move |at| at[k]);
        for k in 0..3 {
            assert_eq!(bound("min", k), along(k).fold(f32::INFINITY, f32::min));
            assert_eq!(bound("max", k), along(k).fold(f32::NEG_INFINITY, f32::max));
        }
        let [x, y, z, w] = [0, 1, 2, 3].map(|k| text["nodes"][0]["rotation"][k].as_f64().unwrap());
        let turn = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        assert!((turn * Vector3::z() - Vector3::y()).norm() < 1e-9, "what is up in the map is up there");
        assert!((turn * Vector3::x() - Vector3::x()).norm() < 1e-9);
    }
}

#[test]
fn a_ply_has_what_the_mesh_has() {
    let mesh = ball(true);
    let mut file = Vec::new();
    write_ply(&mut file, &mesh).unwrap();
    let end = file.windows(11).position(|it| it == b"end_header\n").unwrap() + 11;
    let head = String::from_utf8_lossy(&file[..end]);
    assert!(head.contains(&format!("element vertex {}\n", mesh.positions_m.len())));
    assert!(head.contains(&format!("element face {}\n", mesh.triangles.len())));
    let (vertices, faces) = file[end..].split_at(27 * mesh.positions_m.len());
    for (k, vertex) in vertices.chunks(27).enumerate() {
        assert_eq!([0, 4, 8].map(|at| float(vertex, at)), mesh.positions_m[k]);
        assert_eq!([12, 16, 20].map(|at| float(vertex, at)), mesh.normals[k]);
        assert_eq!(vertex[24..], mesh.colours[k]);
    }
    assert_eq!(faces.len(), 13 * mesh.triangles.len());
    assert!(
        faces.chunks(13).zip(&mesh.triangles).all(|(face, t)| face[0] == 3 && [1, 5, 9].map(|at| word(face, at)) == *t)
    );
}

#[test]
fn a_mesh_of_nothing_is_a_file_and_one_that_is_none_is_refused() {
    let nothing = Mesh::default();
    let mut file = Vec::new();
    write_glb(&mut file, &nothing).unwrap();
    let (text, buffer) = chunks(&file);
    assert!(buffer.is_empty() && text["asset"]["version"] == "2.0" && text.get("meshes").is_none());
    write_ply(&mut Vec::new(), &nothing).unwrap();
    let good = Mesh {
        positions_m: vec![[0.0; 3]; 3],
        normals: vec![[0.0; 3]; 3],
        colours: vec![],
        triangles: vec![[0, 1, 2]],
    };
    let bad = [
        Mesh { normals: vec![], ..good.clone() },
        Mesh { colours: vec![[0; 3]], ..good.clone() },
        Mesh { triangles: vec![[0, 1, 3]], ..good.clone() },
        Mesh { positions_m: vec![[f32::NAN; 3]; 3], ..good },
    ];
    for mesh in bad {
        assert!(matches!(write_glb(&mut Vec::new(), &mesh), Err(SurfaceError::Mesh { .. })));
        assert!(matches!(write_ply(&mut Vec::new(), &mesh), Err(SurfaceError::Mesh { .. })));
    }
}
