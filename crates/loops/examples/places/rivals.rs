//! Descriptors that were beaten: functions of a direction, in rings, by their Fourier coefficients.

use mapwright_geom::sin_cos;
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

const RINGS: usize = 8;
const HARMONICS: usize = 11;
const RADIUS_M: f64 = 8.0;
const TURNS: usize = 72;
static WAVES: LazyLock<Vec<(f64, f64)>> =
    LazyLock::new(|| (0..TURNS).map(|turn| sin_cos(TAU * turn as f64 / TURNS as f64)).collect());

#[derive(Clone, Copy)]
pub(crate) enum Rival {
    /// Points by range and bearing, as in scan context.
    Polar,
    /// Free space up to the nearest point of each bearing.
    Free,
    /// Lengths between pairs of points, without their directions.
    Lengths,
    /// Hough spectrum and ranges.
    Hough,
}

/// By ring and harmonic; a vector of length 1.
pub(crate) type Coefficients = Vec<[f64; 2]>;

impl Rival {
    pub(crate) fn describe(self, points: &[[f64; 2]]) -> Coefficients {
        let mut sums = vec![[0.0; 2]; RINGS * HARMONICS];
        match self {
            Self::Polar => polar(&mut sums, points),
            Self::Free => free(&mut sums, points),
            Self::Lengths => lengths(&mut sums, points),
            Self::Hough => hough(&mut sums, points),
        }
        let length = sums.iter().flatten().map(|v| v * v).sum::<f64>().sqrt().max(1e-12);
        sums.iter().map(|z| z.map(|v| v / length)).collect()
    }

    /// Likeness at the best turn, and the turn `place_from_query`.
    pub(crate) fn compare(self, query: &Coefficients, place: &Coefficients) -> (f64, f64) {
        let mut cross = [[0.0; 2]; HARMONICS];
        for (k, (q, p)) in query.iter().zip(place).enumerate() {
            let z = &mut cross[k % HARMONICS];
            z[0] += q[0] * p[0] + q[1] * p[1];
            z[1] += q[0] * p[1] - q[1] * p[0];
        }
        let at = |turn: usize| {
            let turn_rad = TAU * turn as f64 / TURNS as f64;
            let term = |(m, z): (usize, &[f64; 2])| {
                let (s, c) = WAVES[turn * m % TURNS];
                z[0] * c - z[1] * s
            };
            let share: f64 = cross.iter().enumerate().map(term).sum();
            (share, if matches!(self, Self::Hough) { 0.5 * turn_rad } else { turn_rad })
        };
        (0..TURNS).map(at).fold((f64::MIN, 0.0), |best, next| if next.0 > best.0 { next } else { best })
    }
}

fn thin(points: &[[f64; 2]], cell_m: f64) -> Vec<[f64; 2]> {
    let near = points.iter().filter(|p| p[0].hypot(p[1]) < RADIUS_M);
    let mut keyed: Vec<_> = near.map(|p| (p.map(|v| (v / cell_m).floor() as i32), *p)).collect();
    keyed.sort_by_key(|(cell, _)| *cell);
    keyed.dedup_by_key(|(cell, _)| *cell);
    keyed.into_iter().map(|(_, p)| p).collect()
}

fn add(sums: &mut [[f64; 2]], ring: usize, angle_rad: f64, weight: f64) {
    for (m, z) in sums[ring * HARMONICS..(ring + 1) * HARMONICS].iter_mut().enumerate() {
        let (s, c) = sin_cos(angle_rad * m as f64);
        let weight = weight * if m == 0 { 0.5 } else { 1.0 };
        z[0] += weight * c;
        z[1] -= weight * s;
    }
}

fn polar(sums: &mut [[f64; 2]], points: &[[f64; 2]]) {
    for [x, y] in thin(points, 0.2) {
        add(sums, (x.hypot(y) / RADIUS_M * RINGS as f64) as usize, y.atan2(x), 1.0);
    }
}

fn free(sums: &mut [[f64; 2]], points: &[[f64; 2]]) {
    let mut nearest_m = [RADIUS_M; TURNS];
    for [x, y] in points {
        let sector = &mut nearest_m[((y.atan2(*x) / TAU + 1.0) * TURNS as f64) as usize % TURNS];
        *sector = sector.min(x.hypot(*y));
    }
    for (k, range_m) in nearest_m.iter().enumerate() {
        for ring in 0..RINGS {
            let share = (range_m / RADIUS_M * RINGS as f64 - ring as f64).clamp(0.0, 1.0);
            add(sums, ring, TAU * (k as f64 + 0.5) / TURNS as f64, share);
        }
    }
}

fn lengths(sums: &mut [[f64; 2]], points: &[[f64; 2]]) {
    let thinned = thin(points, 0.3);
    for (k, a) in thinned.iter().enumerate() {
        for b in &thinned[..k] {
            let ring = ((a[0] - b[0]).hypot(a[1] - b[1]) / 5.0 * RINGS as f64) as usize;
            if ring < RINGS {
                sums[ring * HARMONICS][0] += 1.0;
            }
        }
    }
}

fn hough(sums: &mut [[f64; 2]], points: &[[f64; 2]]) {
    let thinned = thin(points, 0.2);
    let count = thinned.len().max(1) as f64;
    for k in 0..90 {
        let angle_rad = PI * f64::from(k) / 90.0;
        let (s, c) = sin_cos(angle_rad);
        let mut lines = [0.0; 65];
        thinned.iter().for_each(|p| lines[((p[0] * c + p[1] * s + RADIUS_M) * 4.0) as usize] += 1.0);
        add(sums, 0, 2.0 * angle_rad, lines.iter().map(|n| n * n).sum::<f64>() / (90.0 * count));
    }
    for [x, y] in thinned {
        let ring = 1 + (x.hypot(y) / RADIUS_M * (RINGS - 1) as f64) as usize;
        sums[ring.min(RINGS - 1) * HARMONICS][0] += 2.0 / count;
    }
}
