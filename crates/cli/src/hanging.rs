//! What holds a map together by a single step of odometry: where that step is wrong the map is bent, and nothing else in it tells.

use mapwright::{EdgeKind, Session};

/// The largest part of a map that hangs on one such step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Hanging {
    /// Share of the keyframes on the smaller of the two sides.
    pub(crate) share: f64,
    /// Stamp of the first keyframe behind the step, seconds.
    pub(crate) from_s: f64,
}

impl Hanging {
    /// Looks at the steps from each keyframe to the next that no match and no closure spans. Over breaks [`Session::pieces`] says what
    /// holds.
    pub(crate) fn of(session: &Session) -> Self {
        let keyframes = session.keyframes();
        let spanned = spanned(session);
        let is_odometry = odometry_steps(session);
        let steps = (1..keyframes.len()).filter(|&to| is_odometry[to] && !spanned[to]);
        let smaller = |to: usize| to.min(keyframes.len() - to);
        let Some(worst) = steps.max_by_key(|&to| smaller(to)) else { return Self::default() };
        Self { share: smaller(worst) as f64 / keyframes.len() as f64, from_s: keyframes[worst].stamp.as_secs_f64() }
    }
}

/// For each keyframe, by its place, whether a match or a closure leads from one before to it or beyond.
fn spanned(session: &Session) -> Vec<bool> {
    let mut begun = vec![0_i64; session.keyframes().len() + 1];
    for edge in session.edges().filter(|edge| edge.kind != EdgeKind::Odometry) {
        let Some([a, b]) = places(session, edge) else { continue };
        begun[a.min(b) + 1] += 1;
        begun[a.max(b) + 1] -= 1;
    }
    let mut open = 0;
    let spans = begun.iter().map(|change| {
        open += change;
        open > 0
    });
    spans.collect()
}

/// For each keyframe whether odometry links it to the one before, without a break.
fn odometry_steps(session: &Session) -> Vec<bool> {
    let mut steps = vec![false; session.keyframes().len()];
    for edge in session.edges().filter(|edge| edge.kind == EdgeKind::Odometry) {
        places(session, edge).into_iter().for_each(|[a, b]| steps[a.max(b)] = true);
    }
    let breaks = session.fragments().iter().filter(|fragment| session.is_break(fragment));
    breaks.filter_map(|fragment| session.place(fragment.first)).for_each(|first| steps[first] = false);
    steps
}

fn places(session: &Session, edge: &mapwright::Edge) -> Option<[usize; 2]> {
    Some([session.place(edge.from)?, session.place(edge.to)?])
}
