//! What is derived from how far a sensor sees, and how densely.

use crate::settings::Settings;
use mapwright_geom::{Pose3, Stored};
use mapwright_sensor::SpaceSensor;
use mapwright_voxel::{Change, Matcher, SurfelMap, SurfelMapSettings, TELLING_POINTS, Thinner};

/// Side of the smallest voxels, of the rms range: 0.5 m in a hall, 0.1 m in a room;
const FINEST_SHARE: f64 = 1.0 / 16.0;
/// half of that where points lie so densely that of those of one cloud this share then lies on planes that the cloud itself tells.
const DENSE_SHARE: f64 = 0.5;
/// A voxel holds what lies three standard deviations to either side of a surface, where points say how uncertain they are, of which three
/// quarters are true of simulated pairs: in smaller ones a point that is where it should be is hardly more likely there than anywhere.
const NOISE_IN_VOXEL: f64 = 4.5;
/// The largest have this side at least, of the rms range.
const COARSEST_SHARE: f64 = 0.48;
/// So certain keyframes are matched against, of a voxel's side.
const GATE_SHARE: f64 = 0.3;
const LEVELS_AT_MOST: usize = 8;
/// What is drawn has so many points to a voxel's side.
pub(super) const DRAWN_SHARE: f64 = 0.2;

/// What depends on how far a sensor sees, derived from the first cloud with enough points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    /// Root mean square of the ranges, metres.
    pub(crate) range_m: f64,
    /// Side of the smallest voxels, metres.
    pub(crate) resolution_m: f64,
    /// How many resolutions, each twice as coarse: up to what the robot may move between two clouds.
    pub(crate) levels: usize,
    /// Noise of a surface's points beside what each says of itself, metres.
    pub(crate) noise_m: f64,
}

impl Scale {
    /// The maps that are made so.
    pub(crate) fn maps(self) -> SurfelMapSettings {
        SurfelMapSettings { resolution_m: self.resolution_m, levels: self.levels, noise_m: self.noise_m }
    }

    /// So certain relative to the robot what is matched against is, standard deviation, metres.
    pub(crate) fn gate_m(self) -> f64 {
        GATE_SHARE * self.resolution_m
    }

    /// By the points of a cloud, and the standard deviation of each where it is known.
    pub(super) fn of(settings: &Settings, sensor: &SpaceSensor, points_m: &[[f32; 3]], sigmas_m: &[f32]) -> Self {
        let square = |point: &[f32; 3]| point.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>();
        let range_m = (points_m.iter().map(square).sum::<f64>() / points_m.len() as f64).sqrt();
        let asked_m = settings.space.resolution_m;
        let of_points_m = median(sigmas_m);
        // the matcher adds that of each point, where it is known: of a surface what the points of a surfel leave open together is enough
        let of_surfaces_m = of_points_m.map(|sigma_m| sigma_m / f64::from(TELLING_POINTS).sqrt());
        let noise_m = of_surfaces_m.unwrap_or_else(|| sensor.sigma_m(range_m));
        let derived_m = || {
            let finest_m = finest_m(points_m, sensor.origin_m(), range_m, noise_m);
            two_digits(finest_m.max(NOISE_IN_VOXEL * of_points_m.unwrap_or(0.0)))
        };
        let resolution_m = if asked_m > 0.0 { asked_m } else { derived_m() };
        let levels =
            (1..LEVELS_AT_MOST).find(|&k| resolution_m * f64::from(1_u32 << (k - 1)) >= COARSEST_SHARE * range_m);
        Self { range_m, resolution_m, levels: levels.unwrap_or(LEVELS_AT_MOST), noise_m }
    }
}

/// The median of those that are above zero.
fn median(sigmas_m: &[f32]) -> Option<f64> {
    let mut known: Vec<f32> = sigmas_m.iter().copied().filter(|sigma_m| *sigma_m > 0.0).collect();
    let middle = known.len() / 2;
    (!known.is_empty()).then(|| f64::from(*known.select_nth_unstable_by(middle, f32::total_cmp).1))
}

/// Side of the smallest voxels by how far and how densely a cloud's points lie, metres.
fn finest_m(points_m: &[[f32; 3]], origin_m: [f64; 3], range_m: f64, noise_m: f64) -> f64 {
    let usual_m = FINEST_SHARE * range_m;
    let (resolution_m, mut thinned) = (0.5 * usual_m, Vec::new());
    Thinner::default().thin(points_m, DRAWN_SHARE * resolution_m, &mut thinned);
    let mut map = SurfelMap::new(SurfelMapSettings { resolution_m, levels: 1, noise_m });
    map.draw(&thinned, origin_m, Pose3::identity(), Change::Add, 0);
    map.refresh();
    let is_dense = Matcher::default().judge(&map, &thinned, Pose3::identity()).known_share >= DENSE_SHARE;
    if is_dense { resolution_m } else { usual_m }
}

/// Rounded to two digits, that it may be told and asked for again.
fn two_digits(value: f64) -> f64 {
    let unit = 10_f64.powf(value.max(1e-3).log10().floor() - 1.0);
    (value / unit).round().max(1.0) * unit
}

impl Stored for Scale {
    fn put(&self, out: &mut Vec<u8>) {
        [self.range_m, self.resolution_m, self.noise_m].put(out);
        (self.levels as u32).put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let lengths: [f64; 3] = Stored::take(from)?;
        let levels = u32::take(from)? as usize;
        let [range_m, resolution_m, noise_m] = lengths;
        let is_sound = lengths.iter().all(|length| length.is_finite() && *length > 0.0);
        (is_sound && (1..=LEVELS_AT_MOST).contains(&levels)).then_some(Self { range_m, resolution_m, levels, noise_m })
    }
}
