//! Harder versions of a recording, simulated or real: adaptors on a stream of scans.
//!
//! ```
//! use mapwright_sim::{Drive, DriveSettings, PerturbScans, worlds};
//! let drive = Drive::new(worlds::three_rooms(1).into(), DriveSettings::default());
//! let harder: Vec<_> = drive.scans().every_nth(3).perturb_odometry(0.15, 7).take(10).collect();
//! assert_eq!(harder.len(), 10);
//! ```

use crate::drive::TrueScan;
use crate::math::{between, compose};
use crate::rng::Rng;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::LaserScan;

/// Whatever holds a scan: a scan alone, or one with its truth, which no perturbation touches.
pub trait HasScan {
    /// The scan.
    fn scan(&self) -> &LaserScan;
    /// The scan, to be changed.
    fn scan_mut(&mut self) -> &mut LaserScan;
}

impl HasScan for LaserScan {
    fn scan(&self) -> &LaserScan {
        self
    }

    fn scan_mut(&mut self) -> &mut LaserScan {
        self
    }
}

impl HasScan for TrueScan {
    fn scan(&self) -> &LaserScan {
        &self.scan
    }

    fn scan_mut(&mut self) -> &mut LaserScan {
        &mut self.scan
    }
}

/// Adaptors that make a stream of scans harder.
pub trait PerturbScans: Iterator + Sized
where
    Self::Item: HasScan,
{
    /// Each beam is replaced with probability `fraction` by a range uniform in 0 to 30 m.
    fn replace_beams_with_noise(self, fraction: f64, seed: u64) -> impl Iterator<Item = Self::Item> {
        let mut rng = Rng::keyed(seed, 0x0062_6561_6d73);
        self.map(move |mut item| {
            for range_m in &mut item.scan_mut().ranges_m {
                if rng.chance(fraction) {
                    *range_m = rng.uniform(0.0, 30.0) as f32;
                }
            }
            item
        })
    }

    /// Translation and rotation of each odometry increment are multiplied by `1 + N(0, relative_sigma)` each.
    fn perturb_odometry(self, relative_sigma: f64, seed: u64) -> impl Iterator<Item = Self::Item> {
        let mut rng = Rng::keyed(seed, 0x6f64_6f6d);
        let mut factor = move || 1.0 + rng.normal(relative_sigma);
        self.reintegrate_odometry(move |step| {
            let (along, turn) = (factor(), factor());
            Pose2::new(step.x * along, step.y * along, step.theta * turn)
        })
    }

    /// The translation of each odometry increment is multiplied by `factor`.
    fn scale_odometry(self, factor: f64) -> impl Iterator<Item = Self::Item> {
        self.reintegrate_odometry(move |step| Pose2::new(step.x * factor, step.y * factor, step.theta))
    }

    /// Odometry put together anew from changed increments from one scan that has it to the next.
    fn reintegrate_odometry(self, mut change: impl FnMut(Pose2) -> Pose2) -> impl Iterator<Item = Self::Item> {
        let mut last: Option<(Pose2, Pose2)> = None;
        self.map(move |mut item| {
            if let Some(given) = item.scan().odom_from_robot {
                let changed = match last {
                    Some((before, after)) => compose(after, change(between(before, given))),
                    None => given,
                };
                last = Some((given, changed));
                item.scan_mut().odom_from_robot = Some(changed);
            }
            item
        })
    }

    /// The first scan and every `n`th after it; all of them for zero.
    fn every_nth(self, n: usize) -> impl Iterator<Item = Self::Item> {
        self.step_by(n.max(1))
    }

    /// Without the scans from `from` up to, not including, `to`.
    fn drop_window(self, from: Stamp, to: Stamp) -> impl Iterator<Item = Self::Item> {
        self.filter(move |item| !(from..to).contains(&item.scan().stamp))
    }
}

impl<I: Iterator> PerturbScans for I where I::Item: HasScan {}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use crate::laser::LaserSettings;

    fn straight(count: i64) -> impl Iterator<Item = LaserScan> {
        let laser = LaserSettings::default().model;
        (0..count).map(move |k| LaserScan {
            stamp: Stamp(k),
            laser: laser.clone(),
            ranges_m: vec![40.0; 100],
            odom_from_robot: (k % 10 != 3).then(|| Pose2::new(0.1 * k as f64, 5.0, 0.0)),
        })
    }

    #[test]
    fn a_share_of_the_beams_is_noise() {
        let scans: Vec<_> = straight(500).replace_beams_with_noise(0.2, 1).collect();
        let noisy = scans.iter().flat_map(|s| &s.ranges_m).filter(|&&r| r < 30.0).count();
        assert!((noisy as f64 / 50_000.0 - 0.2).abs() < 5.0 * (0.16f64 / 50_000.0).sqrt());
    }

    #[test]
    fn increments_have_the_noise_asked_for() {
        let odom: Vec<_> = straight(5_000).perturb_odometry(0.15, 1).filter_map(|s| s.odom_from_robot).collect();
        let factors: Vec<f64> = odom.windows(2).map(|w| (w[1].x - w[0].x) / 0.1).filter(|f| *f < 1.7).collect();
        let mean = factors.iter().sum::<f64>() / factors.len() as f64;
        let sigma = (factors.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / factors.len() as f64).sqrt();
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
        assert!(odom.len() == 4_500 && sigma > 0.13, "{sigma}");
    }

    #[test]
    fn scale_thinning_and_windows() {
        let last = straight(11).scale_odometry(1.1).last().and_then(|s| s.odom_from_robot);
        assert!((last.unwrap().x - 1.1).abs() < 1e-9 && (last.unwrap().y - 5.0).abs() < 1e-9);
        let stamps: Vec<i64> = straight(10).every_nth(3).drop_window(Stamp(3), Stamp(6)).map(|s| s.stamp.0).collect();
        assert_eq!(stamps, [0, 6, 9]);
    }
}
