//! An inertial sensor in the robot's origin, its axes those of the robot.

use super::turn::{rows, turned};
use crate::rng::Rng;
use crate::robot::{TICK_NS, TICK_S};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::{ImuReading, STANDARD_GRAVITY_M_PER_S2};

/// What an inertial sensor gets wrong, and how often it reads.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuSettings {
    /// Readings a second; kept within 0.1 to 10,000.
    pub rate_hz: f64,
    /// Standard deviation of each angular velocity, radians a second.
    pub turn_rate_sigma_rad_per_s: f64,
    /// What is added to every angular velocity, radians a second.
    pub turn_rate_bias_rad_per_s: [f64; 3],
    /// Standard deviation of each specific force, metres per second squared.
    pub force_sigma_m_per_s2: f64,
    /// What is added to every specific force, metres per second squared.
    pub force_bias_m_per_s2: [f64; 3],
}

impl Default for ImuSettings {
    /// A cheap one: 200 Hz, 0.3 degrees a second, biases of 0.006 rad/s (0.01 in all) and 0.03 m/s^2.
    fn default() -> Self {
        Self {
            rate_hz: 200.0,
            turn_rate_sigma_rad_per_s: 0.005,
            turn_rate_bias_rad_per_s: [0.006, -0.006, 0.005],
            force_sigma_m_per_s2: 0.05,
            force_bias_m_per_s2: [0.03, -0.02, 0.03],
        }
    }
}

/// A reading by its number of a robot whose pose is asked for at times of the drive, nanoseconds; `None` before and after it.
///
/// The way is simulated in ticks of 20 ms: the angular velocity is the mean over a tick about the reading, and the acceleration the
/// second difference over two.
pub(crate) fn reading(
    world_from_robot_at: impl Fn(i64) -> Option<Pose3>,
    settings: &ImuSettings,
    seed: u64,
    number: u64,
) -> Option<ImuReading> {
    let stamp_ns = crate::drive::stamp_ns(number, settings.rate_hz.clamp(0.1, 10_000.0));
    let here = world_from_robot_at(stamp_ns)?;
    let beside = |by_ns: i64| world_from_robot_at(stamp_ns + by_ns).unwrap_or(here);
    let [half_before, half_after] = [beside(-TICK_NS / 2), beside(TICK_NS / 2)];
    let (before, after) = (world_from_robot_at(stamp_ns - TICK_NS), world_from_robot_at(stamp_ns + TICK_NS));
    let push = before.zip(after).map_or([0.0; 3], |(before, after)| {
        let [before, after] = [before, after].map(|at| at.translation);
        ((after - here.translation * 2.0 + before) / (TICK_S * TICK_S)).into()
    });
    let world_force = [push[0], push[1], push[2] + STANDARD_GRAVITY_M_PER_S2];
    let force = turned(&rows(&here.inverse()), world_force);
    let rate = turn(half_before, half_after).map(|turn_rad| turn_rad / TICK_S);
    let mut rng = Rng::keyed(seed, number);
    let mut noisy = |value: [f64; 3], bias: [f64; 3], sigma: f64| {
        std::array::from_fn::<f64, 3, _>(|axis| value[axis] + bias[axis] + rng.normal(sigma))
    };
    let turn_rate = noisy(rate, settings.turn_rate_bias_rad_per_s, settings.turn_rate_sigma_rad_per_s);
    let force = noisy(force, settings.force_bias_m_per_s2, settings.force_sigma_m_per_s2);
    Some(ImuReading {
        stamp: Stamp(stamp_ns),
        turn_rate_rad_per_s: turn_rate.into(),
        specific_force_m_per_s2: Some(force.into()),
    })
}

/// The rotation vector from one pose to another that is turned by less than half a radian: twice the arc sine of the quaternion's
/// vector part, by its series, so that it is the same on every CPU.
fn turn(from: Pose3, to: Pose3) -> [f64; 3] {
    let between = from.between(to).rotation.coords;
    let sign = if between.w < 0.0 { -1.0 } else { 1.0 };
    let sine2 = between.x * between.x + between.y * between.y + between.z * between.z;
    let scale = 2.0 * sign * (1.0 + sine2 / 6.0 + 3.0 * sine2 * sine2 / 40.0);
    [between.x, between.y, between.z].map(|v| scale * v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::{SpaceDrive, SpaceDriveSettings, Wobble, worlds};

    const EXACT: ImuSettings = ImuSettings {
        rate_hz: 200.0,
        turn_rate_sigma_rad_per_s: 0.0,
        turn_rate_bias_rad_per_s: [0.0; 3],
        force_sigma_m_per_s2: 0.0,
        force_bias_m_per_s2: [0.0; 3],
    };

    fn drive(imu: ImuSettings, wobble: Wobble) -> SpaceDrive {
        let settings = SpaceDriveSettings { imu, wobble, seed: 4, duration_s: 20.0, ..SpaceDriveSettings::default() };
        SpaceDrive::new(worlds::two_storey(4).into(), settings)
    }

    #[test]
    fn readings_add_up_to_the_true_motion() {
        let drive = drive(EXACT, Wobble::default());
        let mut readings: Vec<ImuReading> = drive.imu_readings().collect();
        assert!((readings.len() as f64 / (200.0 * drive.duration_s()) - 1.0).abs() < 0.01);
        // the last tick has none after it to be the mean with
        readings.truncate(readings.len() - 10);
        let start = drive.world_from_robot(Stamp(0)).unwrap();
        let (mut rotation, mut velocity, mut position) = (start.rotation, start.translation * 0.0, start.translation);
        for pair in readings.windows(2) {
            let elapsed_s = pair[1].stamp.secs_since(pair[0].stamp);
            let mean = (pair[0].turn_rate_rad_per_s + pair[1].turn_rate_rad_per_s) * 0.5;
            let mut push = rotation * pair[0].specific_force_m_per_s2.unwrap();
            push.z -= STANDARD_GRAVITY_M_PER_S2;
            position += velocity * elapsed_s + push * (0.5 * elapsed_s * elapsed_s);
            velocity += push * elapsed_s;
            let [x, y, z] = (mean * elapsed_s).into();
            rotation *= Pose3::exp([0.0, 0.0, 0.0, x, y, z].into()).rotation;
        }
        let end = drive.world_from_robot(readings[readings.len() - 1].stamp).unwrap();
        assert!((end.translation - start.translation).norm() > 10.0);
        assert!(rotation.angle_to(&end.rotation) < 0.002, "{}", rotation.angle_to(&end.rotation));
        assert!((position - end.translation).norm() < 0.5, "{position:?} {:?}", end.translation);
    }

    #[test]
    fn noise_and_bias_are_those_asked_for_and_the_seed_decides() {
        let readings: Vec<ImuReading> = drive(ImuSettings::default(), Wobble::NONE).imu_readings().collect();
        let exact: Vec<ImuReading> = drive(EXACT, Wobble::NONE).imu_readings().collect();
        let again: Vec<ImuReading> = drive(ImuSettings::default(), Wobble::NONE).imu_readings().collect();
        assert!(readings == again && readings.len() == exact.len());
        let errors = readings.iter().zip(&exact).map(|(a, b)| a.turn_rate_rad_per_s.x - b.turn_rate_rad_per_s.x);
        let errors: Vec<f64> = errors.collect();
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let sigma = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt();
        assert!((mean - 0.006).abs() < 5.0 * 0.005 / n.sqrt() && (sigma / 0.005 - 1.0).abs() < 0.05, "{mean} {sigma}");
    }
}
