//! The error that is expected of a map, and what is said of one that nothing speaks against.

use super::facts::Facts;
use crate::terminal::{count, metres};

/// What adds to the error that is expected of a map: such a share of the deviation of its keyframes, and metres for each whole share by which
/// wheels and scans differ beyond what is usual, of scans that fit badly, and of keyframes that are elsewhere.
const OF_SIGMA: f64 = 0.1;
const OF_ODOMETRY_M: f64 = 2.0;
const USUAL_ODOMETRY: f64 = 0.02;
const OF_DOUBTFUL_M: f64 = 1.0;
const OF_ELSEWHERE_M: f64 = 1.0;

/// A number that orders maps as their errors do, metres; none where there is no map.
pub(super) fn expected_error_m(facts: &Facts) -> Option<f64> {
    let beyond = |share: f64| (share.abs() - USUAL_ODOMETRY).max(0.0);
    let odometry = beyond(facts.way_of_odometry - 1.0)
        + beyond(facts.turns_of_odometry - 1.0)
        + beyond(facts.aside_deg.to_radians());
    let parts_m = [
        facts.moved_mean_m,
        OF_SIGMA * facts.mean_sigma_m,
        OF_ODOMETRY_M * odometry,
        OF_DOUBTFUL_M * (facts.degraded + facts.lost),
        OF_ELSEWHERE_M * facts.elsewhere,
    ];
    (facts.keyframes > 0).then(|| parts_m.iter().map(|part_m| part_m * part_m).sum::<f64>().sqrt())
}

/// Why nothing speaks against it.
pub(super) fn all_is_well(facts: &Facts) -> String {
    let certain = || format!("certain to {} in the mean", metres(facts.mean_sigma_m));
    match facts.compared {
        0 if facts.closures > 0 => {
            format!("{} recognised where the map has them; {}", count(facts.closures as u64, "old place"), certain())
        }
        0 => format!("wheels and scans agree; nothing was seen twice; {}", certain()),
        compared => {
            let fits = (compared - facts.misfits) as u64;
            format!(
                "{} seen again fit what was seen before, to {} in the mean",
                count(fits, "place"),
                metres(facts.moved_mean_m)
            )
        }
    }
}
