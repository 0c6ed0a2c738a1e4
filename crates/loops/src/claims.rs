//! What another robot says of its own way, looked at again by who has its readings: what it saw at a keyframe has to fit what it saw on the way
//! there. A robot that says how it moved and is wrong, whatever the reason, says where its readings do not fit each other.

use crate::closing::{NARROW_SUBMAP_M, WINDOW_M, WINDOW_RAD, WINDOW_SIGMAS};
use crate::plane::PlaneSubmaps;
use crate::submaps::{PoseOf, SUBMAP_M, Submaps, Window};
use crate::views::{View, views_along, views_up_to};
use mapwright_geom::{Cov3, Pose, Pose2, Tangent, TangentMatrix};
use mapwright_record::{EdgeKind, Measurement, NodeId, Objection, Past};

/// A keyframe is compared with so many views of the way up to it, from no farther back than this, metres.
const VIEWS: usize = 5;
const COMPARED_M: f64 = 8.0;

/// Of what was seen at a keyframe at least this share fits what was seen just before: half of the least on csail and fhw, whose keyframes are a metre apart
/// (docs/decisions/0038-liars.md).
const LEAST_SHARE: f64 = 0.15;
/// A keyframe that fits elsewhere by more than this chi-square is not where it is said to be: the 99.9 % quantile of three degrees of freedom, as for
/// any match. On csail and fhw the largest is 0.8.
const MOST_CHI2: f64 = 16.8;
/// How far off a way is gets measured once in so much of it, metres; between, end points alone may bear it out.
const MEASURED_M: f64 = 0.5;
/// Median of a chi-square with three degrees of freedom.
const MEDIAN_CHI2: f64 = 2.366;

/// What a robot says of its way, and what was seen there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SaidAndSeen {
    /// Share of what was seen at the keyframe that fits what was seen just before.
    pub share: f64,
    /// How far it fits better from where it was said to be: chi-square with as many degrees of freedom as a pose has.
    pub chi2: f64,
    /// The same in units of the fit's own covariance, by the median of what chance leaves, and that covariance. None where end points alone bear out
    /// what was said: that is measured every so often only ([`fit_where_said`]).
    pub measured: Option<(f64, Cov3)>,
}

impl SaidAndSeen {
    /// Whether what was seen bears out what was said.
    #[must_use]
    pub fn bears_out(&self) -> bool {
        self.share >= LEAST_SHARE && self.chi2 <= MOST_CHI2
    }
}

/// What was seen at a keyframe laid on what the same sensor saw just before it on its way, and at the keyframe that its robot has matched it with,
/// where the robot says that it was on the way. None where nothing can be compared.
pub fn fit_where_said(past: Past<'_>, to: NodeId, submaps: &mut PlaneSubmaps) -> Option<SaidAndSeen> {
    let before = past.before(to)?;
    let way = Said::up_to(past, to, before);
    let query = views_along(past, to, false, 0.0);
    let sensor = &query.first()?.sweep;
    let mut views = views_up_to(past, before, COMPARED_M, |node| way.pose(node).unwrap_or_default());
    views.truncate(VIEWS);
    views.extend(matched_with(past, to, before, &way));
    views.retain(|view| view.sweep.is_of_one_sensor_with(sensor));
    if views.is_empty() {
        return None;
    }
    let said = way.step;
    let is_measured =
        ((past.way_m[to.index()] / MEASURED_M).floor()) > (past.way_m[before.index()] / MEASURED_M).floor();
    if !is_measured && submaps.fits_plainly(&query, &views, said) {
        return Some(SaidAndSeen { share: 1.0, chi2: 0.0, measured: None });
    }
    let (target, query) = (submaps.draw(&views), submaps.draw(&query));
    let fit = submaps.fit_at(&query, &target, said);
    let share = |share: Option<f64>| share.unwrap_or(0.0);
    let [sigma_m, sigma_rad] = [WINDOW_M, WINDOW_RAD].map(|half| half / WINDOW_SIGMAS);
    let tolerance = Cov3::from_variances(sigma_m * sigma_m, sigma_rad * sigma_rad);
    // Where it lies no closer than where it was said to be it speaks for neither.
    let closeness = |at: Pose2| query.closeness(&target, at);
    let seen = fit.target_from_query.filter(|&seen| closeness(seen) > closeness(said)).unwrap_or(said);
    let error = said.local(seen);
    let chi2 = |covariance: Cov3| covariance.inverted().map(|by| error.squared_by(&by));
    Some(SaidAndSeen {
        share: share(fit.evidence.overlap) * share(fit.evidence.inlier_share),
        chi2: chi2(fit.covariance + tolerance).unwrap_or(f64::INFINITY),
        measured: Some((chi2(fit.covariance).map_or(1.0, |chi2| chi2 / MEDIAN_CHI2), fit.covariance)),
    })
}

/// The way up to a keyframe as odometry edges have it, whatever became of them since.
struct Said {
    /// From the keyframe before to it.
    step: Pose2,
    /// Keyframes before that, in the frame of the one before: the newest first.
    poses: Vec<(usize, Pose2)>,
}

impl Said {
    fn up_to(past: Past<'_>, to: NodeId, before: NodeId) -> Self {
        let step = |from: NodeId, node: NodeId| {
            let mut edges = past.session.edges_to(node.index());
            let odometry = edges.find(|known| known.recorded.edge.kind == EdgeKind::Odometry);
            let moved = || past.pose(from).between(past.pose(node));
            odometry.map_or_else(moved, |known| known.recorded.edge.from_from_to)
        };
        let mut poses = vec![(before.index(), Pose2::IDENTITY)];
        let (mut node, mut pose) = (before, Pose2::IDENTITY);
        let is_near = |earlier: &NodeId| past.way_m[before.index()] - past.way_m[earlier.index()] <= COMPARED_M;
        while let Some(earlier) = past.before(node).filter(is_near) {
            pose = pose * step(earlier, node).inverse();
            poses.push((earlier.index(), pose));
            node = earlier;
        }
        Self { step: step(before, to), poses }
    }

    fn pose(&self, node: usize) -> Option<Pose2> {
        self.poses.iter().find(|(of, _)| *of == node).map(|(_, pose)| *pose)
    }
}

/// What was seen at keyframes that a robot says it has matched this one with, in the frame of the one before it.
fn matched_with(past: Past<'_>, to: NodeId, before: NodeId, way: &Said) -> Vec<View> {
    let edges = past.session.edges_to(to.index());
    let matched = edges.filter(|known| known.recorded.edge.kind == EdgeKind::Match).map(|known| known.ends[0] as usize);
    let near = matched.filter(|&from| (0.0..=COMPARED_M).contains(&(past.way_m[before.index()] - past.way_m[from])));
    near.filter_map(|from| Some(View { sweep: past.drawn[from].clone()?, submap_from_keyframe: way.pose(from)? }))
        .collect()
}

/// Whether what was seen around a keyframe is found around another one, about where an edge between the two says it is.
pub fn is_found_where_said<S: Submaps>(
    past: Past<'_, S::Measurement>,
    [from, to]: [NodeId; 2],
    from_from_to: PoseOf<S>,
    submaps: &mut S,
) -> bool {
    let views = |at, both_sides, reach_m| views_along(past, at, both_sides, reach_m);
    let views_within = |reach_m| (views(from, true, reach_m), views(to, false, reach_m / 2.0));
    let near = views_within(NARROW_SUBMAP_M);
    if submaps.fits_plainly(&near.1, &near.0, from_from_to) {
        return true;
    }
    let (target, query) = views_within(SUBMAP_M);
    if submaps.fits_plainly(&query, &target, from_from_to) {
        return true;
    }
    let (target, query) = (submaps.draw(&target), submaps.draw(&query));
    let window = Window {
        target_from_query: from_from_to,
        half_width_m: WINDOW_M,
        half_height_m: WINDOW_M,
        half_width_rad: WINDOW_RAD,
    };
    submaps.look_for(&query, &target, &window).objection != Some(Objection::NoMatch)
}
