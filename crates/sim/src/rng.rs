//! The random stream: owned here, so that a seed means the same world for ever.

use crate::math::ln;
use mapwright_geom::sin_cos;
use std::f64::consts::TAU;

/// xoshiro256++ (Blackman and Vigna 2019), seeded through SplitMix64. Same seed, same stream, on every machine.
#[derive(Debug, Clone)]
pub struct Rng {
    state: [u64; 4],
    spare_normal: Option<f64>,
}

impl Rng {
    /// The stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut mix = seed;
        let state = [splitmix(&mut mix), splitmix(&mut mix), splitmix(&mut mix), splitmix(&mut mix)];
        Self { state, spare_normal: None }
    }

    /// One of many independent streams of a seed, chosen by a key such as a scan's index.
    #[must_use]
    pub fn keyed(seed: u64, key: u64) -> Self {
        let (mut a, mut b) = (seed, key ^ 0xa076_1d64_78bd_642f);
        Self::new(splitmix(&mut a) ^ splitmix(&mut b).rotate_left(23))
    }

    /// 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        let s = &mut self.state;
        let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        result
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in `0..count`; zero when `count` is zero.
    pub fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.next_u64()) * count as u128) >> 64) as usize
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Gaussian with zero mean (Box and Muller 1958).
    pub fn normal(&mut self, sigma: f64) -> f64 {
        if let Some(spare) = self.spare_normal.take() {
            return sigma * spare;
        }
        let radius = (-2.0 * ln(1.0 - self.unit())).sqrt();
        let (sin, cos) = sin_cos(TAU * self.unit());
        self.spare_normal = Some(radius * sin);
        sigma * radius * cos
    }
}

/// One step of SplitMix64 (Steele, Lea, Flood 2014).
fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_never_changes() {
        let mut rng = Rng::new(42);
        let first: Vec<u64> = (0..3).map(|_| rng.next_u64()).collect();
        assert_eq!(first, [0xd076_4d4f_4476_689f, 0x519e_4174_576f_3791, 0xfbe0_7cfb_0c24_ed8c]);
    }

    #[test]
    fn moments_are_those_asked_for() {
        let mut rng = Rng::new(1);
        let n = 200_000;
        let draws: Vec<f64> = (0..n).map(|_| rng.normal(2.0)).collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 5.0 * 2.0 / f64::from(n).sqrt());
        assert!((variance - 4.0).abs() < 5.0 * 4.0 * (2.0 / f64::from(n)).sqrt());
        let uniform_mean = (0..n).map(|_| rng.uniform(-1.0, 3.0)).sum::<f64>() / f64::from(n);
        assert!((uniform_mean - 1.0).abs() < 0.02);
    }

    #[test]
    fn keys_give_different_streams() {
        assert_ne!(Rng::keyed(7, 0).next_u64(), Rng::keyed(7, 1).next_u64());
        assert_ne!(Rng::keyed(7, 0).next_u64(), Rng::keyed(8, 0).next_u64());
    }
}
