//! What holds a map together by a single step: where that is wrong the map is bent, and nothing else in it tells.

use mapwright::{EdgeKind, Session};

/// The largest part of a map that hangs on one step.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub(crate) struct Hanging {
    /// Share of the keyframes on the smaller of the two sides.
    pub(crate) share: f64,
    /// Stamp of the first keyframe behind the step, seconds.
    pub(crate) from_s: f64,
}

impl Hanging {
    /// By the steps of odometry from each keyframe to the next that no match and no closure spans. Over breaks [`Session::pieces`] says
    /// what holds.
    pub(crate) fn on_odometry(session: &Session) -> Self {
        let spanned = spanned(session, |kind| kind != EdgeKind::Odometry);
        let is_odometry = odometry_steps(session);
        let steps = (1..session.keyframes().len()).filter(|&to| is_odometry[to] && !spanned[to]);
        Self::behind(session, steps)
    }

    /// By where a lost robot was found unconfirmed or elsewhere than was predicted ([`crate::tally::Tally::found`]), which no closure
    /// spans: matches from there on are with what is known around, and would be in a wrong place too.
    pub(crate) fn on_finding(session: &Session, found: &[u64]) -> Self {
        let spanned = spanned(session, |kind| kind == EdgeKind::Closure);
        let first_from = |scan: &u64| session.keyframes().iter().position(|keyframe| keyframe.scan >= *scan);
        Self::behind(session, found.iter().filter_map(first_from).filter(|&to| !spanned[to]))
    }

    fn behind(session: &Session, steps: impl Iterator<Item = usize>) -> Self {
        let keyframes = session.keyframes();
        let smaller = |to: usize| to.min(keyframes.len() - to);
        let Some(worst) = steps.max_by_key(|&to| smaller(to)) else { return Self::default() };
        Self { share: smaller(worst) as f64 / keyframes.len() as f64, from_s: keyframes[worst].stamp.as_secs_f64() }
    }
}

/// For each keyframe, by its place, whether an edge of such a kind leads from one before to it or beyond.
fn spanned(session: &Session, counts: impl Fn(EdgeKind) -> bool) -> Vec<bool> {
    let mut begun = vec![0_i64; session.keyframes().len() + 1];
    for edge in session.edges().filter(|edge| counts(edge.kind)) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright::{
        Cov3, Edge, Entry, Fragment, FragmentStart, Keyframe, LaserModel, Pose2, RecordedEdge, Run, RunId, ScanPose,
        Stamp, Sweep,
    };
    use std::sync::Arc;

    /// Forty keyframes a second and five scans apart; odometry links each to the next, a match all but the pairs after `unmatched`.
    fn session(unmatched: &[u32], closures: &[[u32; 2]], fragments: &[(u32, FragmentStart)]) -> Session {
        let run = RunId::of_robot("a");
        let mut session = Session::default();
        session.add(Entry::Run(Run { id: run, settings: String::new() })).unwrap();
        let sweep = Arc::new(Sweep::empty(&Arc::new(LaserModel::half_circle("front", 9))));
        for seq in 0..40 {
            let (id, sweep, stamp) = (run.keyframe(seq), Arc::clone(&sweep), Stamp::from_secs_f64(f64::from(seq)));
            let pose = Pose2::IDENTITY;
            let scan = ScanPose { stamp, keyframe: None, keyframe_from_robot: pose, odom_from_robot: pose };
            (0..5).for_each(|_| session.add(Entry::Scan(scan)).unwrap());
            let keyframe = Keyframe { id, stamp, scan: 5 * u64::from(seq), sweep, hardly_fits: false };
            session.add(Entry::Keyframe { keyframe: keyframe.into(), map_from_keyframe: Pose2::IDENTITY }).unwrap();
        }
        for &(first, start) in fragments {
            session.add(Entry::Fragment(Fragment { first: run.keyframe(first), start })).unwrap();
        }
        let steps = |kind, left_out: &[u32]| -> Vec<([u32; 2], EdgeKind)> {
            (0..39).filter(|from| !left_out.contains(from)).map(|from| ([from, from + 1], kind)).collect()
        };
        let closures = closures.iter().map(|&ends| (ends, EdgeKind::Closure)).collect();
        for ([from, to], kind) in
            [steps(EdgeKind::Odometry, &[]), steps(EdgeKind::Match, unmatched), closures].into_iter().flatten()
        {
            let (from, to) = (run.keyframe(from), run.keyframe(to));
            let edge =
                Edge { from, to, kind, from_from_to: Pose2::IDENTITY, information: Cov3::from_diagonal_element(100.0) };
            session.add(Entry::Edge(RecordedEdge { edge, candidate: None })).unwrap();
        }
        session
    }

    #[test]
    fn a_step_that_nothing_else_spans_holds_what_lies_behind_it() {
        assert_eq!(Hanging::on_odometry(&Session::default()), Hanging::default());
        assert_eq!(Hanging::on_odometry(&session(&[], &[], &[])), Hanging::default());
        assert_eq!(Hanging::on_odometry(&session(&[9, 35], &[], &[])), Hanging { share: 0.25, from_s: 10.0 });
        assert_eq!(Hanging::on_odometry(&session(&[9, 35], &[[5, 30]], &[])), Hanging { share: 0.1, from_s: 36.0 });
        // What odometry says over a break is told of pieces.
        let broken = session(&[9], &[], &[(0, FragmentStart::SwitchedOn), (10, FragmentStart::Blind)]);
        assert_eq!(Hanging::on_odometry(&broken), Hanging::default());
    }

    #[test]
    fn so_does_where_a_lost_robot_was_found_unless_a_closure_spans_it() {
        let found = [47, 175];
        assert_eq!(Hanging::on_finding(&Session::default(), &found), Hanging::default());
        assert_eq!(Hanging::on_finding(&session(&[], &[], &[]), &[]), Hanging::default());
        assert_eq!(Hanging::on_finding(&session(&[], &[], &[]), &found), Hanging { share: 0.25, from_s: 10.0 });
        let closed = session(&[], &[[5, 30]], &[]);
        assert_eq!(Hanging::on_finding(&closed, &found), Hanging { share: 0.125, from_s: 35.0 });
        // After the last keyframe nothing hangs on it.
        assert_eq!(Hanging::on_finding(&closed, &[200]), Hanging::default());
    }
}
