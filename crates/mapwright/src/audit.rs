//! Whether the map that another robot says it has found is one: who holds the readings looks again at what it is made of.

use crate::mapper::{WaysSeen, weigh_ways};
use crate::settings::Settings;
use crate::store::Store;
use mapwright_geom::Pose2;
use mapwright_grid::Matcher;
use mapwright_loops::{PlaneSubmaps, Solving, VerifySettings, fit_where_said, is_found_where_said};
use mapwright_record::{Detection, EdgeKind, FragmentStart, NodeId, RunId, Session};

/// What speaks against a map ([`audit`]).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Audit {
    /// Closures that were looked at, and those that the readings contradict.
    pub closures: [usize; 2],
    /// Ways to keyframes, and matches, that were called contradicted, and those of them that the readings bear out.
    pub contradictions: [usize; 2],
    /// How far keyframes lie from where the closures that hold have them, each piece of the map by itself: mean, metres. None where that cannot be
    /// said.
    pub moved_m: Option<f64>,
}

/// Looks at each closure again (`ways` knows what was compared before), and at each way that was called contradicted, and solves the graph once more with the closures that hold.
#[must_use]
pub fn audit(settings: &Settings, session: &Session, ways: &mut WaysSeen) -> Audit {
    let mut store = Store::resume(session.clone(), RunId::of_robot("audit"), String::new());
    let matcher = Matcher { settings: settings.matcher() };
    let mut submaps = PlaneSubmaps::new(settings.submaps(), VerifySettings::default(), matcher.settings);
    weigh_ways(&mut store, &mut submaps, ways);
    let mut audit = Audit::default();
    let (mut graph, mut holding) = (store.graph(), store.closures());
    for (number, known) in session.recorded_edges().iter().enumerate() {
        let edge = &known.recorded.edge;
        let ends = known.ends.map(NodeId::new);
        let candidate = known.recorded.candidate.and_then(|number| session.candidates().get(number as usize));
        if candidate.is_some_and(|candidate| candidate.detection == Detection::Sighting) {
            // Readings say nothing of it.
            continue;
        }
        let is_called = known.withdrawn && edge.kind == EdgeKind::Match && !store.is_over_break(ends);
        if !is_called && (known.withdrawn || edge.kind != EdgeKind::Closure) {
            continue;
        }
        let is_wrong = !is_found_where_said(store.past(), ends, edge.from_from_to, &mut submaps);
        if is_called {
            audit.contradictions[0] += 1;
            audit.contradictions[1] += usize::from(!is_wrong);
            continue;
        }
        audit.closures[0] += 1;
        if is_wrong {
            audit.closures[1] += 1;
            graph.edges[number].information.fill(0.0);
            holding.retain(|closure| *closure != number);
        }
    }
    for fragment in session.fragments().iter().filter(|fragment| fragment.start == FragmentStart::Contradicted) {
        let first = session.place(fragment.first).map(NodeId::at);
        let Some(fit) = first.and_then(|first| fit_where_said(store.past(), first, &mut submaps)) else { continue };
        audit.contradictions[0] += 1;
        audit.contradictions[1] += usize::from(fit.bears_out());
    }
    let solved = Solving::of::<PlaneSubmaps>(graph, holding).run();
    audit.moved_m = solved.and_then(|solved| moved_m(session, &solved.map_from_keyframe));
    audit
}

/// Mean distance of keyframes from where others have them, with the middle keyframe of each piece where it is; of none 0.
fn moved_m(session: &Session, elsewhere: &[Pose2]) -> Option<f64> {
    let here = session.map_from_keyframe();
    if here.is_empty() {
        return Some(0.0);
    }
    let stretches = session.stretches();
    let (mut sum_m, mut count) = (0.0, 0_usize);
    let pieces = stretches.iter().map(|(_, piece)| *piece).max()?;
    for piece in 0..=pieces {
        let of_piece = || stretches.iter().filter(|(_, of)| *of == piece).flat_map(|(range, _)| range.clone());
        let middle = of_piece().nth(of_piece().count() / 2)?;
        let here_from_there = *here.get(middle)? * elsewhere.get(middle)?.inverse();
        for place in of_piece() {
            sum_m += here.get(place)?.distance(here_from_there * *elsewhere.get(place)?);
            count += 1;
        }
    }
    (count > 0).then(|| sum_m / count as f64)
}
