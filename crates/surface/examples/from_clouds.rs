//! Draws clouds at their poses, and says how long it took and how the mesh lies to them.
//!
//! `from_clouds CLOUDS VOXEL_M NOISE_M NOISE_PER_M [OUT.ply|OUT.glb] [key=value ...]`; keys: near, carve, weight, piece, threads, lazy (keep
//! keyframes, move all of them, and back), every and range (which points are compared: each of so many, seen from so near).
//! `from_clouds CLOUDS MESH.ply [every=N] [range=M]` says how a mesh that was made elsewhere, such as by `mapwright export --to mesh`, lies to them.
//! CLOUDS is, for each cloud, little endian: points u32, 1 where they have colours u32, translation and quaternion x y z w f64, origin f32 x 3, points f32 x 3, colours u8 x 3
//! (`clouds.py` beside this file writes it).

#![allow(clippy::print_stdout, reason = "an example talks to who runs it")]

use mapwright_geom::Pose3;
use mapwright_surface::{
    Change, Mesh, MeshSettings, Patch, Surface, SurfaceSettings, View, Volume, write_glb, write_ply,
};
use std::collections::HashMap;
use std::error::Error;
use std::fs::File;
use std::io::{BufReader, Read};
use std::time::Duration;

struct Cloud {
    map_from_cloud: Pose3,
    origin_m: [f32; 3],
    points_m: Vec<[f32; 3]>,
    colours: Vec<[u8; 3]>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let (named, plain): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|arg| arg.contains('='));
    let named: HashMap<&str, f64> =
        named.iter().filter_map(|arg| arg.split_once('=')).filter_map(|(k, v)| Some((k, v.parse().ok()?))).collect();
    let get = |name: &str, default: f64| named.get(name).copied().unwrap_or(default);
    if plain.get(1).is_some_and(|name| name.ends_with(".ply")) {
        return compare(&plain[0], &plain[1], get("every", 211.0) as usize, get("range", f64::INFINITY));
    }
    let number = |at: usize| -> Result<f64, Box<dyn Error>> { Ok(plain.get(at).ok_or("too few arguments")?.parse()?) };
    let settings = SurfaceSettings {
        voxel_m: number(1)?,
        noise_m: number(2)?,
        noise_per_m: number(3)?,
        near_m: get("near", 0.0),
        carve: get("carve", 1.0) > 0.0,
        memory_mb: 16_000,
    };
    let mesh_settings = MeshSettings {
        least_weight: get("weight", MeshSettings::default().least_weight),
        least_piece_m: get("piece", 0.0),
        threads: get("threads", 1.0) as usize,
    };
    let mut volume = Volume::new(settings)?;
    let mut surface = Surface::new(settings)?;
    let (mut samples, mut prepare, mut draw) = (Vec::new(), Duration::ZERO, Duration::ZERO);
    let mut stream = BufReader::with_capacity(1 << 20, File::open(&plain[0])?);
    let (mut clouds, mut discs) = (0_u64, 0);
    while let Some(cloud) = read_cloud(&mut stream)? {
        let view = View { points_m: &cloud.points_m, origins_m: &[cloud.origin_m], colours: &cloud.colours };
        let start = cpu();
        let patch = Patch::prepare(&view, &settings)?;
        prepare += cpu() - start;
        let start = cpu();
        discs += patch.len();
        if get("lazy", 0.0) > 0.0 {
            surface.add_patch(clouds, patch, cloud.map_from_cloud)?;
        } else {
            volume.draw(&patch, cloud.map_from_cloud, Change::Add)?;
        }
        draw += cpu() - start;
        clouds += 1;
        let every = get("every", 211.0) as usize;
        let range_m = |p: &[f32; 3]| f64::from(p.iter().map(|v| v * v).sum::<f32>().sqrt());
        let is_asked = |p: &&[f32; 3]| range_m(p) > 0.1 && range_m(p) < get("range", f64::INFINITY);
        samples.extend(cloud.points_m.iter().step_by(every).filter(is_asked).map(|p| {
            let at = cloud.map_from_cloud.transform(nalgebra::Vector3::from(p.map(f64::from)));
            [at.x, at.y, at.z]
        }));
    }
    if get("lazy", 0.0) > 0.0 {
        move_and_back(&mut surface)?;
        volume = surface.volume().clone();
    }
    let start = cpu();
    let mesh = volume.mesh(&mesh_settings);
    let meshing = cpu() - start;
    let seconds = |time: Duration| time.as_secs_f64();
    println!("clouds {clouds}, discs {discs}, blocks {}, {} MB", volume.blocks(), volume.bytes() / 1_000_000);
    println!(
        "CPU: prepare {:.2} s, draw {:.2} s, mesh {:.2} s, together {:.2} s",
        seconds(prepare),
        seconds(draw),
        seconds(meshing),
        seconds(prepare + draw + meshing)
    );
    println!("vertices {}, triangles {}, edges {:?}", mesh.positions_m.len(), mesh.triangles.len(), mesh.edges());
    report_distances(&mesh, &samples, settings.voxel_m);
    if let Some(path) = plain.get(4) {
        let mut file = File::create(path)?;
        if path.ends_with(".glb") { write_glb(&mut file, &mesh)? } else { write_ply(&mut file, &mesh)? }
    }
    Ok(())
}

/// How a mesh lies to clouds: distances within two voxels of 5 cm are told, all that is farther is far.
fn compare(clouds: &str, mesh: &str, every: usize, range_m: f64) -> Result<(), Box<dyn Error>> {
    let mut stream = BufReader::with_capacity(1 << 20, File::open(clouds)?);
    let mut samples = Vec::new();
    while let Some(cloud) = read_cloud(&mut stream)? {
        let asked = cloud.points_m.iter().step_by(every).filter(|p| {
            let from_sensor_m = f64::from(p.iter().map(|v| v * v).sum::<f32>().sqrt());
            from_sensor_m > 0.1 && from_sensor_m < range_m
        });
        samples.extend(asked.map(|p| {
            let at = cloud.map_from_cloud.transform(nalgebra::Vector3::from(p.map(f64::from)));
            [at.x, at.y, at.z]
        }));
    }
    let mesh = read_mesh(&std::fs::read(mesh)?).ok_or("no mesh as mapwright writes it")?;
    println!("vertices {}, triangles {}, edges {:?}", mesh.positions_m.len(), mesh.triangles.len(), mesh.edges());
    for voxel_m in [0.05, 0.01] {
        report_distances(&mesh, &samples, voxel_m);
    }
    Ok(())
}

/// A PLY file as `write_ply` makes it.
fn read_mesh(bytes: &[u8]) -> Option<Mesh> {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|part| part == end)? + end.len();
    let head = std::str::from_utf8(&bytes[..at]).ok()?;
    let count = |of: &str| head.lines().find_map(|line| line.strip_prefix(of)?.parse::<usize>().ok());
    let row = if head.contains("uchar red") { 27 } else { 24 };
    let (vertices, faces) = bytes.get(at..)?.split_at_checked(row * count("element vertex ")?)?;
    let single = |bytes: &[u8], k: usize| f32::from_le_bytes(std::array::from_fn(|i| bytes[4 * k + i]));
    let whole = |bytes: &[u8], k: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[1 + 4 * k + i]));
    Some(Mesh {
        positions_m: vertices.chunks_exact(row).map(|v| [0, 1, 2].map(|k| single(v, k))).collect(),
        triangles: faces.chunks_exact(13).map(|f| [0, 1, 2].map(|k| whole(f, k))).collect(),
        ..Mesh::default()
    })
}

/// What the first thread has worked so far (Linux); nothing where nobody says.
fn cpu() -> Duration {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    Duration::from_nanos(text.split(' ').next().and_then(|word| word.parse().ok()).unwrap_or(0))
}

/// Moves every keyframe and brings it back: the volume is the same to the bit.
fn move_and_back(surface: &mut Surface) -> Result<(), Box<dyn Error>> {
    let before = surface.volume().clone();
    let there: Vec<(u64, Pose3)> = surface.keyframes().filter_map(|(id, at)| Some((id, at?))).collect();
    let some: Vec<_> = there.iter().step_by(3).copied().collect();
    let moved = |it: &[(u64, Pose3)]| -> Vec<(u64, Pose3)> {
        let by = Pose3::exp(nalgebra::Vector6::new(0.1, 0.0, 0.02, 0.0, 0.01, 0.0));
        it.iter().map(|&(id, at)| (id, at * by)).collect()
    };
    for some in [some, there] {
        let start = cpu();
        surface.update(&moved(&some), 0.0)?;
        let is_other = *surface.volume() != before;
        surface.update(&some, 0.0)?;
        let is_same = *surface.volume() == before;
        let seconds = (cpu() - start).as_secs_f64();
        println!("moved {} there {is_other} and back {is_same}: {seconds:.2} s", some.len());
    }
    Ok(())
}

fn read_cloud(stream: &mut impl Read) -> Result<Option<Cloud>, Box<dyn Error>> {
    let mut head = [0_u8; 8 + 56 + 12];
    if stream.read_exact(&mut head).is_err() {
        return Ok(None);
    }
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|k| head[at + k]));
    let double = |k: usize| f64::from_le_bytes(std::array::from_fn(|i| head[8 + 8 * k + i]));
    let count = word(0) as usize;
    let mut points = vec![0_u8; 12 * count];
    stream.read_exact(&mut points)?;
    let mut colours = vec![0_u8; if word(4) == 1 { 3 * count } else { 0 }];
    stream.read_exact(&mut colours)?;
    let single = |bytes: &[u8]| f32::from_le_bytes(std::array::from_fn(|k| bytes[k]));
    Ok(Some(Cloud {
        map_from_cloud: Pose3::from_quaternion(
            [double(0), double(1), double(2)],
            [double(3), double(4), double(5), double(6)],
        )
        .ok_or("no rotation")?,
        origin_m: [0, 1, 2].map(|k| f32::from_bits(word(64 + 4 * k))),
        points_m: points.chunks_exact(12).map(|p| [single(p), single(&p[4..]), single(&p[8..])]).collect(),
        colours: colours.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    }))
}

/// Of points to the mesh, in the metres that hold a share of them.
fn report_distances(mesh: &Mesh, samples: &[[f64; 3]], voxel_m: f64) {
    let side = 2.0 * voxel_m;
    let place = |at: [f64; 3]| at.map(|v| (v / side).floor() as i64);
    let corner = |vertex: u32| mesh.positions_m[vertex as usize].map(f64::from);
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for (number, triangle) in mesh.triangles.iter().enumerate() {
        let mut places = triangle.map(|vertex| place(corner(vertex))).to_vec();
        places.dedup();
        places.iter().for_each(|&at| cells.entry(at).or_default().push(number as u32));
    }
    let nearest = |at: &[f64; 3]| -> f64 {
        let [x, y, z] = place(*at);
        let around = (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| [x + a, y + b, z + c])));
        let triangles = around.filter_map(|key| cells.get(&key)).flatten();
        let distance = |&number: &u32| to_triangle(*at, mesh.triangles[number as usize].map(corner));
        triangles.map(distance).fold(f64::INFINITY, f64::min)
    };
    let mut distances: Vec<f64> = samples.iter().map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    let far = distances.iter().filter(|v| **v > side).count();
    let at = |share: f64| 1000.0 * distances[((distances.len() - 1) as f64 * share) as usize];
    println!(
        "{} points to the mesh: median {:.1} mm, 75 % {:.1}, 90 % {:.1}, 95 % {:.1}; farther than two voxels {:.2} %",
        distances.len(),
        at(0.5),
        at(0.75),
        at(0.9),
        at(0.95),
        100.0 * far as f64 / distances.len() as f64
    );
}

/// Ericson 2005, "Real-time collision detection", section 5.1.5.
fn to_triangle(at: [f64; 3], triangle: [[f64; 3]; 3]) -> f64 {
    let [p, a, b, c] = [at, triangle[0], triangle[1], triangle[2]].map(nalgebra::Vector3::from);
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    let to = |q: nalgebra::Vector3<f64>| (p - q).norm();
    if d1 <= 0.0 && d2 <= 0.0 {
        return to(a);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return to(b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return to(a + ab * (d1 / (d1 - d3)));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return to(c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return to(a + ac * (d2 / (d2 - d6)));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return to(b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))));
    }
    let all = va + vb + vc;
    to(a + ab * (vb / all) + ac * (vc / all))
}
