//! From two images to disparities.

use crate::census::{Compared, Costs, Padded, Planes, REACH};
use crate::clean::Cleaner;
use crate::disparity::DisparityMap;
use crate::error::StereoError;
use crate::image::{GreyImage, SIDE_MAX};
use crate::lanes::{lanes_for, run};
use crate::paths::{Front, PATHS, PassRow};
use crate::penalties::Penalties;
use crate::winners::{Choose, Keep, Winner};

/// How images are matched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatcherSettings {
    pub disparities: Option<u32>,
    pub small: u8,
    pub large: u8,
    pub large_least: u8,
    pub unique: f32,
    pub patch: u32,
    pub outside: u8,
    pub fit: u8,
    pub window: u8,
    pub lr: u16,
    pub median: u8,
    pub lrmode: u8,
    pub smooth: u8,
    pub dead: u16,
}

impl Default for MatcherSettings {
    fn default() -> Self {
        Self { disparities: None, small: 10, large: 120, large_least: 30, unique: 0.95, patch: 63, outside: 16, fit: 0, window: 0, lr: 1, median: 1, lrmode: 0, smooth: 0, dead: 0 }
    }
}

/// Matches pairs of images; its memory is used again from one pair to the next.
#[derive(Debug, Default)]
pub struct MatcherOf<const PLANES: usize> {
    settings: MatcherSettings,
    compared: Vec<Compared>,
    images: [Padded; 2],
    smoothed: [Padded; 2],
    left: Planes<PLANES>,
    right: Planes<PLANES>,
    mirrored: Planes<PLANES>,
    costs: Vec<u8>,
    sums: Vec<u8>,
    now: Vec<u8>,
    totals: Vec<u8>,
    claims: Vec<(u16, u16)>,
    front: Front,
    large: [Vec<u8>; PATHS],
    winners: Vec<Winner>,
    cleaner: Cleaner,
}

pub type Matcher = MatcherOf<4>;

/// Sizes of a match.
#[derive(Debug, Clone, Copy)]
struct Extent {
    width: usize,
    height: usize,
    asked: usize,
    disparities: usize,
}

impl<const PLANES: usize> MatcherOf<PLANES> {
    pub fn new(settings: MatcherSettings) -> Result<Self, StereoError> {
        let mut compared: Vec<Compared> = Vec::new();
        let (w, h, symmetric) = match settings.window {
            0 => (4, 3, true),
            1 => (2, 2, false),
            2 => (4, 3, false),
            3 | 6 => (3, 3, true),
            7 => (2, 2, false),
            4 => (3, 2, false),
            _ => (3, 3, false),
        };
        for y in -h..=h {
            for x in -w..=w {
                if symmetric && (y, x) < (0, 0) {
                    compared.push([[x, y], [-x, -y]]);
                } else if !symmetric && (y, x) != (0, 0) {
                    compared.push([[x, y], [0, 0]]);
                }
            }
        }
        if settings.window == 6 {
            for y in -1..=1 { for x in -1..=1 { if (x, y) != (0, 0) { compared.push([[x, y], [0, 0]]); } } }
        }
        if settings.window == 7 {
            for (x, y) in [(-4, -3), (0, -3), (4, -3), (-4, 0), (-3, -2), (3, -2), (-3, 1), (-1, -3)] { compared.push([[x, y], [-x, -y]]); }
        }
        assert!(compared.len().div_ceil(8) == PLANES, "{}", compared.len());
        Ok(Self { settings, compared, ..Self::default() })
    }

    fn extent(&self, left: &GreyImage, right: &GreyImage) -> Result<Extent, StereoError> {
        if left.size() != right.size() {
            return Err(StereoError::Size { what: "right image", expected: left.size(), found: right.size() });
        }
        let [width, height] = left.size().map(|side| side as usize);
        let asked = self.settings.disparities.map_or_else(|| (width / 8).max(1), |d| d as usize);
        if asked >= width {
            return Err(StereoError::Settings { setting: "disparities", expected: format!("fewer than the {width} columns"), found: asked.to_string() });
        }
        Ok(Extent { width, height, asked, disparities: lanes_for(asked) })
    }

    pub fn match_pair(
        &mut self,
        left: &GreyImage,
        right: &GreyImage,
        out: &mut DisparityMap,
    ) -> Result<(), StereoError> {
        let extent = self.extent(left, right)?;
        out.reset(left.size());
        self.images[0].set(left);
        self.images[1].set(right);
        for (i, image) in [left, right].into_iter().enumerate() {
            if self.settings.smooth == 0 { self.smoothed[i].set(image); continue; }
            let s = smooth(image, self.settings.smooth);
            self.smoothed[i].set(&s);
            if self.settings.smooth >= 2 { self.images[i].set(&s); }
        }
        let penalties = Penalties::of(left, self.settings.large, self.settings.large_least);
        self.sums.resize(extent.width * extent.height * extent.disparities, 0);
        self.costs.resize(extent.width * extent.height * extent.disparities, 0);
        self.now.resize(extent.disparities, 0);
        self.totals.resize(extent.disparities, 0);
        self.winners.clear();
        self.winners.resize(extent.width, Winner::default());
        for large in &mut self.large {
            large.resize(lanes_for(extent.width), 0);
        }
        self.down(extent, &penalties);
        self.up(extent, &penalties, out);
        if self.settings.median > 0 {
            self.cleaner.median(out);
        }
        self.cleaner.speckles(out, self.settings.patch as usize);
        Ok(())
    }

    fn down(&mut self, extent: Extent, penalties: &Penalties) {
        let Extent { width, height, asked, disparities } = extent;
        let row_len = width * disparities;
        self.front.reset(width, disparities);
        for y in 0..height {
            let costs = &mut self.costs[y * row_len..][..row_len];
            self.left.set(&self.compared, &self.images[0], &self.smoothed[0], y, self.settings.dead);
            self.right.set(&self.compared, &self.images[1], &self.smoothed[1], y, self.settings.dead);
            self.right.mirror(width, disparities, &mut self.mirrored);
            let (left, right) = (&self.left, &self.mirrored);
            let bits = self.compared.len() as u8;
            run(Costs { left, right, width, asked, disparities, outside: self.settings.outside, unasked: 2 * bits, costs: &mut *costs });
            penalties.set_row(&self.images[0], y, false, &mut self.large);
            let sink = Keep { sums: &mut self.sums[y * row_len..][..row_len], disparities };
            let small = self.settings.small;
            run(PassRow { front: &mut self.front, costs, disparities, small, large: &self.large, turned: false, sums: &mut self.now, sink });
            self.front.next_row();
        }
    }

    fn up(&mut self, extent: Extent, penalties: &Penalties, out: &mut DisparityMap) {
        let Extent { width, height, disparities, asked } = extent;
        let row_len = width * disparities;
        self.front.reset(width, disparities);
        for y in (0..height).rev() {
            penalties.set_row(&self.images[0], y, true, &mut self.large);
            let costs = &self.costs[y * row_len..][..row_len];
            let sink = Choose { first: &self.sums[y * row_len..][..row_len], disparities, totals: &mut self.totals, found: &mut self.winners };
            let small = self.settings.small;
            run(PassRow { front: &mut self.front, costs, disparities, small, large: &self.large, turned: true, sums: &mut self.now, sink });
            self.front.next_row();
            let claim = &mut self.claims; claim.clear(); claim.resize(width, (u16::MAX, 0u16));
            for x in 0..width {
                let w = self.winners[x];
                let d = w.disparity as usize;
                if d <= x && w.least < claim[x - d].0 { claim[x - d] = (w.least, w.disparity); }
            }
            for x in 0..width {
                let w = self.winners[x];
                let d = w.disparity as usize;
                if d > x || d + 1 >= asked {
                    continue;
                }
                let ok = |xr: usize| {
                    claim[xr].1.abs_diff(w.disparity) <= self.settings.lr
                };
                if !ok(x - d) { continue; }
                if 2.0 * f32::from(w.second) * self.settings.unique < f32::from(w.least) {
                    continue;
                }
                let (a, b) = (f32::from(w.beside[0].saturating_sub(w.least)), f32::from(w.beside[1].saturating_sub(w.least)));
                let delta = if d == 0 { 0.0 } else if self.settings.fit == 0 { 0.5 * (a - b) / a.max(b).max(1.0) } else { 0.5 * (a - b) / (a + b).max(1.0) };
                out.disparity[y * width + x] = d as f32 + delta;
                out.sigma[y * width + x] = (0.01 + 8.0 / (a + b).max(1.0)).sqrt();
            }
        }
    }
}

fn smooth(image: &GreyImage, mode: u8) -> GreyImage {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let mut out = vec![0u16; w * h];
    for y in 0..h { for x in 0..w {
        let mut sum = 0u32;
        for dy in [-1isize, 0, 1] { for dx in [-1isize, 0, 1] {
            let yy = y.saturating_add_signed(dy).min(h - 1); let xx = x.saturating_add_signed(dx).min(w - 1);
            let (kx, ky) = match mode { 3 => ([0, 4, 0], [1, 2, 1]), 4 => ([1, 2, 1], [0, 4, 0]), 5 => ([0, 4, 0], [0, 4, 0]), _ => ([1, 2, 1], [1, 2, 1]) };
            let k = ky[(dy + 1) as usize] * kx[(dx + 1) as usize];
            sum += k * u32::from(image.pixels()[yy * w + xx]);
        } }
        out[y * w + x] = (sum / 16) as u16;
    } }
    GreyImage::new(image.width(), image.height(), out).unwrap()
}
