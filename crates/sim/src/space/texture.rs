//! What surfaces look like: a pattern that is the same from wherever it is seen.

use super::solid::Solid;

/// Wavelengths of the pattern, metres, and how far grey values go to either side by each: stains of a wall, plaster, grain. What is finer than
/// two pixels is seen as its mean.
const OCTAVES: [(f64, f64); 4] = [(0.9, 22.0), (0.27, 24.0), (0.08, 26.0), (0.025, 26.0)];
/// Grey value of a surface that is lit from the side, and by how much more or less those are seen that face up or to one side.
const BASE_GREY: f64 = 118.0;
const FACING_GREY: [f64; 3] = [14.0, -12.0, 22.0];
/// So many pixels a wavelength needs to be seen at all, and to be seen as it is.
const SEEN_PX: [f64; 2] = [2.0, 4.0];

/// Grey value of a solid's surface at a point of the world, metres, as a pixel sees it that covers so many metres there.
pub(super) fn grey(seed: u64, solid: (usize, &Solid), at: [f64; 3], pixel_m: f64) -> f64 {
    let (number, solid) = solid;
    let normal = solid.normal_at(at);
    let facing: f64 = (0..3).map(|k| normal[k] * FACING_GREY[k]).sum();
    let octaves = OCTAVES.iter().enumerate().map(|(k, (wave_m, amplitude))| {
        let [gone, whole] = SEEN_PX.map(|pixels| pixels * pixel_m);
        let share = ((wave_m - gone) / (whole - gone)).clamp(0.0, 1.0);
        if share <= 0.0 {
            return 0.0;
        }
        let key = mixed(seed ^ mixed(8 * number as u64 + k as u64));
        share * amplitude * noise(key, at.map(|v| v / wave_m))
    });
    BASE_GREY + facing + octaves.sum::<f64>()
}

/// Values from -1 to 1 at whole numbers, and between them smooth.
fn noise(key: u64, at: [f64; 3]) -> f64 {
    let low = at.map(f64::floor);
    let share = [0, 1, 2].map(|k| {
        let t = at[k] - low[k];
        t * t * (3.0 - 2.0 * t)
    });
    let cell = low.map(|v| v as i64);
    let value = |corner: usize| {
        let place = [0, 1, 2].map(|k| cell[k].wrapping_add(((corner >> k) & 1) as i64) as u64);
        let hash = mixed(
            key ^ place[0].wrapping_mul(0x9e37_79b9_7f4a_7c15)
                ^ place[1].wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
                ^ place[2].wrapping_mul(0x1656_67b1_9e37_79f9),
        );
        (hash >> 11) as f64 * (2.0 / (1_u64 << 53) as f64) - 1.0
    };
    let between = |share: f64, a: f64, b: f64| a + share * (b - a);
    let along = |first: usize| between(share[0], value(first), value(first + 1));
    let over = |first: usize| between(share[1], along(first), along(first + 2));
    between(share[2], over(0), over(4))
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014): every bit depends on every bit.
fn mixed(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pattern_is_of_the_world_and_differs_from_place_to_place() {
        let wall = Solid::aligned([2.0, -5.0, 0.0], [3.0, 5.0, 3.0]);
        let at = |y: f64, pixel_m| grey(3, (7, &wall), [2.0, y, 1.0], pixel_m);
        assert_eq!(at(0.31, 0.001).to_bits(), at(0.31, 0.001).to_bits());
        let values = |pixel_m| (0..2000).map(|k| at(0.005 * f64::from(k) - 5.0, pixel_m)).collect::<Vec<_>>();
        let spread = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
        };
        let (near, far) = (values(0.001), values(0.05));
        assert!(spread(&near) > 10.0 && spread(&far) < spread(&near) && spread(&far) > 3.0);
        assert!(near.iter().all(|v| (0.0..255.0).contains(v)));
        let rough = |values: &[f64]| values.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        assert!(rough(&far) < 0.5 * rough(&near), "{} {}", rough(&far), rough(&near));
    }
}
