//! What counts say.

/// Log-odds of a hit, probability 0.7, and of a pass, 0.4: `ln(p / (1 - p))`, as OctoMap has them (Hornung et al. 2013, "OctoMap: an
/// efficient probabilistic 3D mapping framework", section 3.2).
const HIT: f64 = 0.847_297_860_387_203_6;
const PASS: f64 = -0.405_465_108_108_164_4;
/// A voxel is never surer than this: 3.5 and -2 in that paper, probability 0.97 and 0.12; OctoMap's `OcTree` has 0.971 and 0.1192.
pub(crate) const OCCUPIED_MOST: f32 = 3.511_030_7;
pub(crate) const FREE_LEAST: f32 = -2.000_028;

/// The logarithm of the odds that a voxel is occupied, with OctoMap's probabilities: 0.7 a hit, 0.4 a pass, clamped to 0.1192 and
/// 0.971.
/// OctoMap clamps after each observation and so forgets the older ones; here the sum is clamped, so that order does not
/// matter. Above zero is occupied.
#[must_use]
pub fn log_odds(hits: u32, passes: u32) -> f32 {
    let sum = HIT * f64::from(hits) + PASS * f64::from(passes);
    (sum as f32).clamp(FREE_LEAST, OCCUPIED_MOST)
}
