//! What is said of a calibration.

use super::{Calibration, Estimate};
use mapwright::Pose2;
use serde_json::{Value, json};

/// Values smaller than so many standard deviations may as well be zero.
pub(crate) const CLEAR_SIGMAS: f64 = 3.0;

/// Of a planar laser.
pub(crate) fn to_words(name: &str, found: &Calibration, presumed: Pose2) -> String {
    format!("{name}: your laser sits {}\n{}", place_in_words(found), lines("laser", found, presumed))
}

/// Place and wheels in lines, of a laser or a lidar.
pub(crate) fn lines(what: &str, found: &Calibration, presumed: Pose2) -> String {
    let lag = |lag: Estimate| format!("they lag {} ms", plus_minus(lag, 1000.0, 0));
    let no_lag = || "the scans' stamps come in bursts or seconds apart, and tell no lag".to_owned();
    let scale =
        |estimate: Estimate| format!("{:+.2} +- {:.2} %", 100.0 * (estimate.value - 1.0), 100.0 * estimate.sigma);
    format!(
        "{what:<9}x {} m, y {} m, yaw {} deg (the log says {:.3}, {:.3}, {:.2})\n\
         wheels   true distance is {} of theirs, true turn {}, unreported drift {} deg/m; {}\n\
         from     {} stretches of half a metre or a turn of 23 deg at most; +- is one standard deviation\n",
        plus_minus(found.x_m, 1.0, 4),
        plus_minus(found.y_m, 1.0, 4),
        plus_minus(found.yaw_rad, DEGREES, 2),
        presumed.x,
        presumed.y,
        presumed.theta.to_degrees(),
        scale(found.translation_scale),
        scale(found.rotation_scale),
        plus_minus(found.drift_rad_per_m, DEGREES, 3),
        found.lag_s.map_or_else(no_lag, lag),
        found.stretches
    )
}

/// In a radian.
pub(crate) const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// A value and its deviation in some unit.
pub(crate) fn plus_minus(estimate: Estimate, unit: f64, decimals: usize) -> String {
    format!("{:+.decimals$} +- {:.decimals$}", unit * estimate.value, unit * estimate.sigma)
}

/// Where it sits, as one would say it.
pub(crate) fn place_in_words(found: &Calibration) -> String {
    let place = |estimate: Estimate, plus: &str, minus: &str| {
        let clear = estimate.value.abs() > CLEAR_SIGMAS * estimate.sigma;
        let side = if estimate.value > 0.0 { plus } else { minus };
        clear.then(|| format!("{:.1} cm {side}", 100.0 * estimate.value.abs()))
    };
    let mut parts: Vec<_> = [place(found.x_m, "ahead", "behind"), place(found.y_m, "to the left", "to the right")]
        .into_iter()
        .flatten()
        .collect();
    if parts.is_empty() {
        parts.push("over the robot's centre".to_owned());
    }
    if found.yaw_rad.value.abs() > CLEAR_SIGMAS * found.yaw_rad.sigma {
        let side = if found.yaw_rad.value > 0.0 { "left" } else { "right" };
        parts.push(format!("turned {:.2} deg to the {side}", DEGREES * found.yaw_rad.value.abs()));
    }
    parts.join(", ")
}

/// As JSON.
pub(crate) fn to_json(name: &str, found: &Calibration, presumed: Pose2) -> Value {
    json!({
        "log": name,
        "presumed": [presumed.x, presumed.y, presumed.theta],
        "x_m": of_estimate(found.x_m),
        "y_m": of_estimate(found.y_m),
        "yaw_rad": of_estimate(found.yaw_rad),
        "translation_scale": of_estimate(found.translation_scale),
        "rotation_scale": of_estimate(found.rotation_scale),
        "drift_rad_per_m": of_estimate(found.drift_rad_per_m),
        "lag_s": found.lag_s.map(of_estimate),
        "stretches": found.stretches,
    })
}

/// A value and its deviation as JSON.
pub(crate) fn of_estimate(estimate: Estimate) -> Value {
    json!({ "value": estimate.value, "sigma": estimate.sigma })
}
