use super::*;

/// A robot that turns about these axes, unevenly, for so long; read by a sensor that is turned by `robot_from_told`, late and biased, a
/// hundred times a second, and matched every tenth of a second with noise.
struct Made {
    axes: [Vector3<f64>; 3],
    robot_from_told: UnitQuaternion<f64>,
    lag_s: f64,
    bias: Vector3<f64>,
    noise_rad: f64,
}

impl Made {
    fn rate(&self, s: f64) -> Vector3<f64> {
        let [a, b, c] = self.axes;
        a * (0.9 * (1.3 * s).sin() + 0.4 * (4.1 * s).cos()) + b * (1.1 * s).cos() + c * (0.8 * (2.3 * s).sin())
    }

    fn calibrator(&self, seconds: f64) -> ImuCalibrator {
        let mut made = ImuCalibrator::default();
        let mut rotation = UnitQuaternion::identity();
        let mut random = 12345_u32;
        let mut noise = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (f64::from(random >> 8) / f64::from(1 << 24) - 0.5) * 3.46
        };
        for k in 0..(1000.0 * seconds) as i32 {
            let s = 1e-3 * f64::from(k);
            if k % 10 == 0 {
                let turn_rate_rad_per_s = self.robot_from_told.inverse() * self.rate(s) + self.bias;
                let stamp = Stamp::from_secs_f64(100.0 + s + self.lag_s);
                made.add_reading(ImuReading { stamp, turn_rate_rad_per_s, specific_force_m_per_s2: None });
            }
            if k % 100 == 0 {
                let off = Vector3::new(noise(), noise(), noise()) * self.noise_rad;
                made.add_pose(Stamp::from_secs_f64(100.0 + s), rotation * UnitQuaternion::from_scaled_axis(off));
            }
            rotation *= UnitQuaternion::from_scaled_axis(self.rate(s + 5e-4) * 1e-3);
        }
        made
    }
}

const IN_ALL: [Vector3<f64>; 3] =
    [Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.0, 0.3, 0.1), Vector3::new(0.25, 0.0, 0.0)];

#[test]
fn rotation_lag_and_bias_are_found_within_what_is_said() {
    let turned = [[0.0, 0.0, 0.0], [3.1, 0.02, -0.01], [0.4, -1.1, 2.0]]
        .map(|[r, p, y]| UnitQuaternion::from_euler_angles(r, p, y));
    for (robot_from_told, lag_s) in turned.into_iter().zip([0.0, 0.05, -0.137]) {
        let bias = Vector3::new(0.02, -0.01, 0.015);
        let made = Made { axes: IN_ALL, robot_from_told, lag_s, bias, noise_rad: 0.004 };
        let found = made.calibrator(40.0).fit().unwrap();
        let off = (found.robot_from_told * robot_from_told.inverse()).scaled_axis();
        let sigmas = (off.dot(&(found.rotation_covariance_rad2.try_inverse().unwrap() * off))).sqrt();
        assert!(off.norm() < 0.01 && sigmas < 4.0 && found.knows_rotation(), "{off} {sigmas} {found:?}");
        assert!((found.lag_s - lag_s).abs() < 3.5 * found.lag_sigma_s && found.lag_sigma_s < 0.003, "{found:?}");
        for axis in 0..3 {
            let off = found.bias_rad_per_s[axis] - bias[axis];
            assert!(off.abs() < 4.0 * found.bias_sigma_rad_per_s[axis] && off.abs() < 0.005, "{axis}: {found:?}");
        }
        // of two poses
        assert!((found.residual_rad / (0.004 * 2f64.sqrt()) - 1.0).abs() < 0.3, "{found:?}");
    }
}

#[test]
fn about_one_axis_the_turn_about_it_stays_unknown_and_the_lag_is_found() {
    let about_z = [Vector3::z(), Vector3::zeros(), Vector3::zeros()];
    let down = UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.7);
    for robot_from_told in [UnitQuaternion::identity(), down] {
        let made = Made { axes: about_z, robot_from_told, lag_s: 0.08, bias: Vector3::zeros(), noise_rad: 0.003 };
        let found = made.calibrator(40.0).fit().unwrap();
        let (axis, sigma_rad) = found.least_known();
        assert!(!found.knows_rotation() && axis.z.abs() > 0.99 && sigma_rad > 0.2, "{axis} {sigma_rad} {found:?}");
        assert!(found.knows_lag() && (found.lag_s - 0.08).abs() < 0.005, "{found:?}");
        let up = robot_from_told.inverse() * Vector3::z();
        assert!((found.robot_from_told * up).z > 0.999, "which way is up is told: {found:?}");
    }
}

#[test]
fn an_even_turn_tells_no_lag() {
    let mut made = ImuCalibrator::default();
    let rate = Vector3::new(0.1, 0.0, 1.0);
    for k in 0..2000 {
        let stamp = Stamp::from_secs_f64(0.01 * f64::from(k));
        made.add_reading(ImuReading { stamp, turn_rate_rad_per_s: rate, specific_force_m_per_s2: None });
        if k % 10 == 0 {
            made.add_pose(stamp, UnitQuaternion::from_scaled_axis(0.01 * f64::from(k) * rate));
        }
    }
    assert!(!made.fit().unwrap().knows_lag());
}

#[test]
fn what_tells_nothing_and_what_no_mount_explains_is_refused() {
    let none = ImuCalibrator::default().fit().unwrap_err();
    assert!(none.contains("found 0 and 0.0 rad"), "{none}");
    let still = Made {
        axes: [Vector3::zeros(); 3],
        robot_from_told: UnitQuaternion::identity(),
        lag_s: 0.0,
        bias: Vector3::zeros(),
        noise_rad: 0.003,
    };
    assert!(still.calibrator(20.0).fit().is_err());
    let late = Made { axes: IN_ALL, lag_s: 0.8, ..still };
    assert!(late.calibrator(30.0).fit().is_err());
    let sound = Made { lag_s: 0.0, ..late };
    let (mut in_degrees, mut mirrored) = (sound.calibrator(30.0), sound.calibrator(30.0));
    in_degrees.readings = ImuReadings::keeping(READINGS_KEPT);
    mirrored.readings = ImuReadings::keeping(READINGS_KEPT);
    for k in 0..3000 {
        let s = 0.01 * f64::from(k);
        let read = |rate: Vector3<f64>| ImuReading {
            stamp: Stamp::from_secs_f64(100.0 + s),
            turn_rate_rad_per_s: rate,
            specific_force_m_per_s2: None,
        };
        in_degrees.add_reading(read(sound.rate(s).map(f64::to_degrees)));
        mirrored.add_reading(read(sound.rate(3.0 * s + 1.0)));
    }
    let reason = in_degrees.fit().unwrap_err();
    assert!(reason.contains("degrees"), "{reason}");
    let reason = mirrored.fit().unwrap_err();
    assert!(reason.contains("no mount explains"), "{reason}");
}

#[test]
fn the_slope_of_a_rotations_vector_is_that_of_differences() {
    let rad = Vector3::new(0.4, -0.9, 0.7);
    for axis in 0..3 {
        let step = Vector3::ith(axis, 1e-6);
        let more = UnitQuaternion::from_scaled_axis(rad) * UnitQuaternion::from_scaled_axis(step);
        let numeric = (more.scaled_axis() - rad) / 1e-6;
        assert!((numeric - log_slope(&rad).column(axis)).norm() < 1e-5);
    }
}
