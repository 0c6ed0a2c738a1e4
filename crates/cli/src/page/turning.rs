//! A map of space that can be turned: its points thinned and rounded to what a page has room for, along the axes of its picture.

use super::html::base64;
use mapwright::{MapPoints, Pose3};
use mapwright_formats::{SpacePlacement, SpaceView, height_colour};
use mapwright_voxel::Thinner;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Bytes of a point: three coordinates of 16 bits, and a colour of 5, 6 and 5 bits.
const POINT_BYTES: usize = 8;
/// Points that lie farther beside what the picture shows than this share of it are left out: a stray one would make all others coarse.
const AROUND_SHARE: f64 = 0.5;
/// Places of the way; more would not be seen apart.
const WAY_PLACES: usize = 3000;
/// Sides of a cell whose points say which way a surface lies, of how far apart they are.
const CELL_POINTS: f64 = 2.5;
/// A plane is told by so many points at least.
const PLANE_POINTS: f64 = 5.0;
/// Where light comes from, along the picture's axes, and how dark what it only grazes is: floors, and walls of either direction, differ.
const LIGHT: [f64; 3] = [0.36, 0.46, 0.81];
const DARKEST: f64 = 0.55;
/// What nobody knows the direction of.
const USUAL_LIGHT: f64 = 0.8;
/// Each thinning is so much coarser than the square law of surfaces says, so that few rounds do.
const COARSER: f64 = 1.03;
const ROUNDS: usize = 40;

/// What is shown of a map.
pub(super) struct Shown<'a> {
    pub(super) points: &'a MapPoints,
    pub(super) way: &'a [Pose3],
    /// Both ends of each closure, metres.
    pub(super) closures: &'a [[[f64; 3]; 2]],
    pub(super) placement: &'a SpacePlacement,
    /// How far apart neighbouring points lie, metres.
    pub(super) point_m: f64,
}

/// A map as the script is told.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Turning {
    json: Value,
    /// Whether it has storeys that lie over each other.
    pub(super) has_storeys: bool,
    /// What of the map it has, in words.
    pub(super) words: String,
}

impl Turning {
    /// With so many bytes of points at most.
    pub(super) fn of(shown: &Shown<'_>, bytes: usize) -> Self {
        let Shown { points, placement, .. } = *shown;
        let Box3 { low, step } = Box3::around(placement);
        let all = points.points_m.len();
        let is_coloured = points.colours.len() == all;
        let inside = inside(shown);
        let (thinned, point_m) = thinned(&inside, shown.point_m, bytes / POINT_BYTES);
        let along = |p: &[f32; 3]| placement.axes.map(|axis| dot(axis, p.map(f64::from)));
        let places: Vec<[f64; 3]> = thinned.points_m.iter().map(along).collect();
        let lights = lights(&places, CELL_POINTS * point_m);
        let heights = placement.heights_m.map(|height| height as f32);
        let mut rows: Vec<u8> = Vec::with_capacity(POINT_BYTES * places.len());
        for (number, (place, light)) in places.iter().zip(&lights).enumerate() {
            let colour = match thinned.colours.get(number).filter(|_| is_coloured) {
                Some(colour) => *colour,
                None => height_colour(place[2] as f32, heights),
            };
            rows.extend(coded(*place, low, step));
            rows.extend(short(colour.map(|part| f64::from(part) * light)).to_le_bytes());
        }
        let line = |places: &mut dyn Iterator<Item = [f64; 3]>| {
            let coded: Vec<u8> =
                places.flat_map(|p| coded(placement.axes.map(|axis| dot(axis, p)), low, step)).collect();
            base64(&coded)
        };
        let every = shown.way.len().div_ceil(WAY_PLACES).max(1);
        let last = shown.way.last().filter(|_| !(shown.way.len() - 1).is_multiple_of(every));
        let way = shown.way.iter().step_by(every).chain(last).map(|pose| <[f64; 3]>::from(pose.translation));
        let highest = shown.way.iter().map(|pose| dot(placement.axes[2], pose.translation.into()));
        let outside = all - inside.points_m.len();
        let outside = if outside > 0 {
            format!("; {outside} of the map lie far outside and are not shown")
        } else {
            String::new()
        };
        let storeys = storeys(placement, shown.way);
        Self {
            has_storeys: storeys.len() > 1,
            words: format!("{} points, one in each cube of {point_m:.2} m{outside}", places.len()),
            json: json!({
                "points": base64(&rows),
                "low": low,
                "step": step,
                "point": point_m,
                "frame": [placement.low_m, placement.high_m],
                "way": line(&mut way.into_iter()),
                "highest": highest.reduce(f64::max),
                "storeys": storeys,
                "closures": line(&mut shown.closures.iter().flatten().copied()),
            }),
        }
    }

    pub(super) fn to_json(&self) -> &Value {
        &self.json
    }
}

/// Of each storey, from the lowest up, the height where it begins and the middle one of the way there, metres along the axis up.
fn storeys(placement: &SpacePlacement, way: &[Pose3]) -> Vec<[f64; 2]> {
    let above = placement.views.split_last().map_or(&[][..], |(_, above)| above);
    let heights: Vec<f64> = way.iter().map(|pose| dot(placement.axes[2], pose.translation.into())).collect();
    let storey = |view: &SpaceView| {
        let [from, to] = view.heights_m;
        let mut there: Vec<f64> = heights.iter().copied().filter(|height| (from..to).contains(height)).collect();
        there.sort_unstable_by(f64::total_cmp);
        let begin = from.max(placement.low_m[2]);
        [begin, there.get(there.len() / 2).copied().unwrap_or(begin)]
    };
    above.iter().map(storey).collect()
}

/// Where places are rounded: 65,536 steps along each axis from `low` on, metres.
struct Box3 {
    low: [f64; 3],
    step: [f64; 3],
}

impl Box3 {
    /// What the picture shows, and a share of it around.
    fn around(placement: &SpacePlacement) -> Self {
        let size = |k: usize| (placement.high_m[k] - placement.low_m[k]).max(1e-3);
        let axes = [0, 1, 2];
        Self {
            low: axes.map(|k| placement.low_m[k] - AROUND_SHARE * size(k)),
            step: axes.map(|k| (1.0 + 2.0 * AROUND_SHARE) * size(k) / f64::from(u16::MAX)),
        }
    }
}

/// The points within the box.
fn inside(shown: &Shown<'_>) -> MapPoints {
    let Shown { points, placement, .. } = *shown;
    let Box3 { low, step } = Box3::around(placement);
    let is_inside = |p: &[f32; 3]| {
        (0..3).all(|k| {
            let at = (dot(placement.axes[k], p.map(f64::from)) - low[k]) / step[k];
            (0.0..=f64::from(u16::MAX)).contains(&at)
        })
    };
    let is_coloured = points.colours.len() == points.points_m.len();
    let kept: Vec<usize> = (0..points.points_m.len()).filter(|&at| is_inside(&points.points_m[at])).collect();
    MapPoints {
        points_m: kept.iter().map(|&at| points.points_m[at]).collect(),
        colours: if is_coloured { kept.iter().map(|&at| points.colours[at]).collect() } else { Vec::new() },
        ..MapPoints::default()
    }
}

/// The mean of the points in each cube, of cubes so large that there are so many at most; and their side, metres.
fn thinned(points: &MapPoints, point_m: f64, most: usize) -> (MapPoints, f64) {
    let mut side_m = point_m.max(1e-3);
    let mut made = MapPoints::default();
    for _ in 0..ROUNDS {
        Thinner::default().thin_columns(points, side_m, &mut made);
        if made.points_m.len() <= most {
            break;
        }
        // Surfaces fill cubes by the square of their side.
        side_m *= COARSER * (made.points_m.len() as f64 / most.max(1) as f64).sqrt();
    }
    // Nothing but chance makes this necessary: rounds that do not converge.
    made.points_m.truncate(most);
    made.colours.truncate(most);
    (made, side_m)
}

fn coded(place: [f64; 3], low: [f64; 3], step: [f64; 3]) -> impl Iterator<Item = u8> {
    // Casts saturate: what lies beyond is shown at the edge.
    let code = move |k: usize| (((place[k] - low[k]) / step[k]).round() as u16).to_le_bytes();
    (0..3).flat_map(code)
}

/// Red, green and blue, up to 255, in 5, 6 and 5 bits.
fn short(colour: [f64; 3]) -> u16 {
    let [red, green, blue] =
        [(0, 31.0), (1, 63.0), (2, 31.0)].map(|(k, most)| (colour[k] / 255.0 * most).round() as u16);
    red << 11 | green << 5 | blue
}

/// Sums over the points of a cell: count, coordinates, and their products xx, yy, zz, xy, xz, yz.
#[derive(Debug, Clone, Copy, Default)]
struct Moments([f64; 10]);

impl Moments {
    fn add(&mut self, [x, y, z]: [f64; 3]) {
        let one = [1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z];
        self.merge(&Self(one));
    }

    fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, v)| *sum += v);
    }

    /// The direction across the plane that the points lie closest to.
    fn normal(&self) -> Option<Vector3<f64>> {
        let [n, x, y, z, xx, yy, zz, xy, xz, yz] = self.0;
        let of = |product: f64, a: f64, b: f64| product / n - a * b / (n * n);
        let (xx, yy, zz) = (of(xx, x, x), of(yy, y, y), of(zz, z, z));
        let (xy, xz, yz) = (of(xy, x, y), of(xz, x, z), of(yz, y, z));
        let is_known = n >= PLANE_POINTS && [xx, yy, zz, xy, xz, yz].iter().all(|v| v.is_finite());
        let eigen = is_known.then(|| SymmetricEigen::new(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)))?;
        let least = (0..3).min_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]))?;
        Some(eigen.eigenvectors.column(least).into_owned())
    }
}

/// How light each place is, from [`DARKEST`] to 1, by the plane through the places in the cells around it.
fn lights(places: &[[f64; 3]], cell_m: f64) -> Vec<f64> {
    let cell = |place: &[f64; 3]| place.map(|v| (v / cell_m).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Moments> = BTreeMap::new();
    places.iter().for_each(|place| cells.entry(cell(place)).or_default().add(*place));
    let around = |[x, y, z]: [i64; 3]| {
        let mut all = Moments::default();
        for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
            let row = cells.range([x + dx, y + dy, z - 1]..=[x + dx, y + dy, z + 1]);
            row.for_each(|(_, moments)| all.merge(moments));
        }
        all
    };
    let light = Vector3::from(LIGHT).normalize();
    let of_cell = |at: [i64; 3]| {
        let normal = around(at).normal();
        normal.map_or(USUAL_LIGHT, |normal| DARKEST + (1.0 - DARKEST) * normal.dot(&light).abs())
    };
    let known: BTreeMap<[i64; 3], f64> = cells.keys().map(|&at| (at, of_cell(at))).collect();
    places.iter().map(|place| known.get(&cell(place)).copied().unwrap_or(USUAL_LIGHT)).collect()
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright_formats::{SpacePicture, write_bare_space_png};

    fn room() -> MapPoints {
        let at = |k: i32| k as f32 * 0.05;
        let floor = (0..200).flat_map(|i| (0..100).map(move |j| [at(i), at(j), 0.0]));
        let wall = (0..200).flat_map(|i| (0..50).map(move |j| [at(i), 5.0, at(j)]));
        let stray = [[500.0, 2.0, 1.0]];
        MapPoints { points_m: floor.chain(wall).chain(stray).collect(), ..MapPoints::default() }
    }

    #[test]
    fn each_storey_is_told_with_the_height_of_its_way() {
        let floor = |z: f32| (0..200).flat_map(move |i| (0..100).map(move |j| [i as f32 * 0.1, j as f32 * 0.1, z]));
        let points = MapPoints { points_m: floor(0.0).chain(floor(3.0)).collect(), ..MapPoints::default() };
        let at = |x: f64, z: f64| Pose3 { translation: [x, 5.0, z].into(), ..Pose3::identity() };
        let along = |z: f64| (0..160).map(move |k| at(2.0 + 0.1 * f64::from(k), z));
        let way: Vec<Pose3> = along(0.4).chain(along(3.6)).collect();
        let way_m: Vec<[f64; 3]> = way.iter().map(|pose| pose.translation.into()).collect();
        let told = |count: usize| {
            let picture =
                SpacePicture { points_m: &points.points_m, way_m: &way_m[..count], ..SpacePicture::default() };
            let placement = write_bare_space_png(&picture, Vec::new()).unwrap();
            let shown =
                Shown { points: &points, way: &way[..count], closures: &[], placement: &placement, point_m: 0.1 };
            let turning = Turning::of(&shown, 40_000);
            let storeys: Vec<[f64; 2]> = serde_json::from_value(turning.json["storeys"].clone()).unwrap();
            assert_eq!(turning.has_storeys, storeys.len() > 1);
            storeys
        };
        let [lower, upper]: [[f64; 2]; 2] = told(320).try_into().unwrap();
        assert!(lower[0] < 0.0 && lower[1] == 0.4, "{lower:?}");
        assert!((2.5..3.0).contains(&upper[0]) && upper[1] == 3.6, "{upper:?}");
        assert_eq!(told(160).len(), 1);
    }

    #[test]
    fn points_are_thinned_to_the_room_that_there_is_and_come_back() {
        let points = room();
        let picture = SpacePicture { points_m: &points.points_m, ..SpacePicture::default() };
        let placement = write_bare_space_png(&picture, Vec::new()).unwrap();
        let way = [Pose3 { translation: [1.0, 1.0, 0.5].into(), ..Pose3::identity() }];
        let shown = Shown { points: &points, way: &way, closures: &[], placement: &placement, point_m: 0.05 };
        let bytes = 40_000;
        let turning = Turning::of(&shown, bytes);
        let text = turning.json["points"].as_str().unwrap();
        assert!(text.len() <= bytes * 4 / 3 + 4 && text.len() > bytes, "{}", text.len());
        assert!(turning.words.contains("1 of the map lie far outside"), "{}", turning.words);
        // rounded to less than a millimetre
        let Box3 { low, step } = Box3::around(&placement);
        assert!(step.iter().all(|step| *step < 1e-3));
        let place = [3.2, 1.1, 0.7];
        let bytes: Vec<u8> = coded(place, low, step).collect();
        for k in 0..3 {
            let code = u16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]);
            assert!((low[k] + f64::from(code) * step[k] - place[k]).abs() < 1e-3);
        }
        // of a floor and a wall the floor is lighter
        let places: Vec<[f64; 3]> = points.points_m.iter().map(|p| p.map(f64::from)).collect();
        let lights = lights(&places, 0.125);
        assert!(lights[10_050] > 0.85 && lights[20_025 + 50 * 100] < 0.8, "{} {}", lights[10_050], lights[25_025]);
        assert_eq!(short([255.0, 0.0, 255.0]), 0xf81f);
    }
}
