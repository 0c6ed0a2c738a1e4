//! What another robot says of its own way, looked at again by who has its readings: what it saw at a keyframe has to fit what it saw on the way
//! there. A robot that says how it moved and is wrong, whatever the reason, says where its readings do not fit each other.

use crate::cascade::Finding;
use crate::closing::{SUBMAP_M, WINDOW_M, WINDOW_RAD, WINDOW_SIGMAS};
use crate::submaps::{PoseOf, Submaps, Window};
use crate::views::views_along;
use mapwright_geom::{Pose, Tangent, TangentMatrix};
use mapwright_record::{Measurement, NodeId, Past};

/// A keyframe is compared with so many views of the way up to it, from no farther back than this, metres.
const VIEWS: usize = 5;
const COMPARED_M: f64 = 8.0;

/// Of what was seen at a keyframe at least this share fits what was seen just before: half of the least on csail and fhw, whose keyframes are a metre apart
/// (docs/decisions/0038-liars.md).
const LEAST_SHARE: f64 = 0.15;
/// A keyframe that fits elsewhere by more than this chi-square is not where it is said to be: the 99.9 % quantile of three degrees of freedom, as for
/// any match. On csail and fhw the largest is 0.8.
const MOST_CHI2: f64 = 16.8;

/// What a robot says of its way, and what was seen there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SaidAndSeen {
    /// Share of what was seen at the keyframe that fits what was seen just before.
    pub share: f64,
    /// How far it fits best from where it was said to be: chi-square with as many degrees of freedom as a pose has.
    pub chi2: f64,
}

impl SaidAndSeen {
    /// Whether what was seen bears out what was said.
    #[must_use]
    pub fn bears_out(&self) -> bool {
        self.share >= LEAST_SHARE && self.chi2 <= MOST_CHI2
    }
}

/// What was seen at a keyframe laid on what the same sensor saw just before it on its way, where the robot says it was (where the poses have it if
/// nothing else is said). None where nothing can be compared.
pub fn fit_where_said<S: Submaps>(
    past: Past<'_, S::Measurement>,
    to: NodeId,
    said: Option<PoseOf<S>>,
    submaps: &mut S,
) -> Option<SaidAndSeen> {
    let before = past.before(to)?;
    let query = views_along(past, to, false, 0.0);
    let sensor = &query.first()?.sweep;
    let mut views = views_along(past, before, false, COMPARED_M);
    views.retain(|view| view.sweep.is_of_one_sensor_with(sensor));
    views.truncate(VIEWS);
    if views.is_empty() {
        return None;
    }
    let said = said.unwrap_or_else(|| past.pose(before).between(past.pose(to)));
    let (target, query) = (submaps.draw(&views), submaps.draw(&query));
    let fit = submaps.fit_at(&query, &target, said);
    let share = |share: Option<f64>| share.unwrap_or(0.0);
    let [sigma_m, sigma_rad] = [WINDOW_M, WINDOW_RAD].map(|half| half / WINDOW_SIGMAS);
    let tolerance = TangentMatrix::from_variances(sigma_m * sigma_m, sigma_rad * sigma_rad);
    let error = fit.target_from_query.map(|seen| said.local(seen));
    let chi2 = error.zip((fit.covariance + tolerance).inverted()).map(|(error, by)| error.squared_by(&by));
    Some(SaidAndSeen {
        share: share(fit.evidence.overlap) * share(fit.evidence.inlier_share),
        chi2: chi2.unwrap_or(f64::INFINITY),
    })
}

/// What was seen around a keyframe looked for around another one, about where an edge between the two says it is.
pub fn look_where_said<S: Submaps>(
    past: Past<'_, S::Measurement>,
    [from, to]: [NodeId; 2],
    from_from_to: PoseOf<S>,
    submaps: &mut S,
) -> Finding<PoseOf<S>> {
    let views = |at, both_sides, reach_m| views_along(past, at, both_sides, reach_m);
    let (target, query) = (submaps.draw(&views(from, true, SUBMAP_M)), submaps.draw(&views(to, false, SUBMAP_M / 2.0)));
    let window = Window {
        target_from_query: from_from_to,
        half_width_m: WINDOW_M,
        half_height_m: WINDOW_M,
        half_width_rad: WINDOW_RAD,
    };
    submaps.look_for(&query, &target, &window)
}
