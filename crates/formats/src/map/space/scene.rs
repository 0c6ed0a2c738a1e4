//! What a picture shows, along the axes of the picture.

use super::extent::extent;
use super::single::are_single;
use super::storeys::parting_heights;
use super::vectors::{dot, horizontals, unit};
use super::{Colour, SpacePicture};
use crate::map::walls::dominant_wall_angle;
use mapwright_geom::sin_cos;

/// Around what is shown, as a share of its longer side.
const RIM_SHARE: f32 = 0.01;

/// Points and lines along the picture's axes: to the right, away from who looks from the side, and up; metres.
pub(super) struct Scene<'a> {
    pub(super) points: Vec<[f32; 3]>,
    pub(super) colours: Vec<&'a Colour>,
    /// Of each point whether it is single.
    pub(super) single: Vec<bool>,
    pub(super) way: Vec<[f32; 3]>,
    pub(super) closures: Vec<[[f32; 3]; 2]>,
    /// The picture's axes in the map's frame.
    pub(super) axes: [[f64; 3]; 3],
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
    /// Heights that part storeys, rising.
    pub(super) parted: Vec<f32>,
    pub(super) point_m: f32,
}

impl<'a> Scene<'a> {
    pub(super) fn of(picture: &SpacePicture<'a>) -> Self {
        let axes = axes_of(picture);
        let turned = |p: [f64; 3]| axes.map(|axis| dot(axis, p) as f32);
        let is_far = |p: &[f64; 3]| !p.iter().all(|v| v.abs() < 1e6);
        let finite = || picture.points_m.iter().enumerate().filter(|(_, p)| !is_far(&p.map(f64::from)));
        let is_coloured = picture.colours.len() == picture.points_m.len();
        let points: Vec<[f32; 3]> = finite().map(|(_, p)| turned(p.map(f64::from))).collect();
        let way: Vec<[f32; 3]> = picture.way_m.iter().filter(|p| !is_far(p)).map(|&p| turned(p)).collect();
        let point_m = picture.point_m as f32;
        let mut scene = Self {
            colours: if is_coloured { finite().map(|(at, _)| &picture.colours[at]).collect() } else { Vec::new() },
            single: are_single(&points, point_m),
            closures: picture
                .closures_m
                .iter()
                .filter(|ends| !ends.iter().any(is_far))
                .map(|ends| ends.map(turned))
                .collect(),
            axes,
            low: [0.0; 3],
            high: [1.0; 3],
            parted: parting_heights(&points, &way),
            points,
            way,
            point_m,
        };
        scene.frame();
        scene
    }

    /// What is shown: nearly all points, and the whole way.
    fn frame(&mut self) {
        for k in 0..3 {
            let mut along: Vec<f32> = self.points.iter().map(|p| p[k]).collect();
            let [low, high] = extent(&mut along).unwrap_or([f32::INFINITY, f32::NEG_INFINITY]);
            let way = self.way.iter().map(|p| p[k]);
            let (low, high) = way.fold((low, high), |(low, high), v| (low.min(v), high.max(v)));
            if low <= high {
                (self.low[k], self.high[k]) = (low, high);
            }
        }
        let rim = RIM_SHARE * (0..3).map(|k| self.high[k] - self.low[k]).fold(1.0, f32::max);
        for k in 0..3 {
            self.low[k] -= rim;
            self.high[k] += rim;
        }
    }

    pub(super) fn size(&self, axis: usize) -> f32 {
        self.high[axis] - self.low[axis]
    }

    /// Share of the points that lie outside of what is shown.
    pub(super) fn outside_share(&self) -> f64 {
        let is_outside = |p: &&[f32; 3]| (0..3).any(|k| p[k] < self.low[k] || p[k] > self.high[k]);
        self.points.iter().filter(is_outside).count() as f64 / self.points.len().max(1) as f64
    }

    /// The heights of each storey, from the lowest up: where it begins, and below which it ends.
    pub(super) fn storeys(&self) -> Vec<[f32; 2]> {
        let begins = [f32::NEG_INFINITY].into_iter().chain(self.parted.iter().copied());
        let ends = self.parted.iter().copied().chain([f32::INFINITY]);
        begins.zip(ends).map(|(begin, end)| [begin, end]).collect()
    }
}

/// The picture's axes: up as said, the others along the walls, the longer side to the right, and so that more lies behind the
/// way than before it.
fn axes_of(picture: &SpacePicture<'_>) -> [[f64; 3]; 3] {
    let up = unit(picture.up).unwrap_or([0.0, 0.0, 1.0]);
    let [first, second] = horizontals(up);
    let step = picture.points_m.len().div_ceil(20_000).max(1);
    let finite = |p: &&[f32; 3]| p.iter().all(|v| v.abs() < 1e6);
    let sample = || picture.points_m.iter().step_by(step).filter(finite).map(|p| p.map(f64::from));
    let ground: Vec<[f64; 2]> = sample().map(|p| [dot(p, first), dot(p, second)]).collect();
    let (s, c) = sin_cos(dominant_wall_angle(&ground, picture.point_m.max(0.02)));
    let right: [f64; 3] = std::array::from_fn(|k| c * first[k] + s * second[k]);
    let away: [f64; 3] = std::array::from_fn(|k| c * second[k] - s * first[k]);
    let spread = |axis: [f64; 3]| {
        let mut along: Vec<f64> = sample().map(|p| dot(p, axis)).collect();
        along.sort_unstable_by(f64::total_cmp);
        let cut = along.len() / 100;
        if along.is_empty() { 0.0 } else { along[along.len() - 1 - cut] - along[cut] }
    };
    let (right, away) = if spread(away) > spread(right) { (away, right.map(|v| -v)) } else { (right, away) };
    let middle = |mut along: Vec<f64>| {
        along.sort_unstable_by(f64::total_cmp);
        along.get(along.len() / 2).copied().unwrap_or(0.0)
    };
    let way = picture.way_m.iter().filter(|p| p.iter().all(|v| v.is_finite()));
    let is_before = middle(sample().map(|p| dot(p, away)).collect()) < middle(way.map(|&p| dot(p, away)).collect());
    let turn = if is_before { -1.0 } else { 1.0 };
    [right.map(|v| turn * v), away.map(|v| turn * v), up]
}
