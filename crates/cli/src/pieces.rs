//! What a session's map consists of, what holds its pieces, and how surely, in words and for `report.json`.

use crate::maps::map_file;
use crate::terminal::count;
use mapwright::{EdgeKind, Fragment, OdometryLink, Piece, Session};
use mapwright_record::Measurement;
use serde_json::{Value, json};
use std::fmt::Write;

/// The pieces of a session.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pieces {
    pieces: Vec<Known>,
    fragments: usize,
    breaks: usize,
    maps: usize,
}

/// A piece, the map that it is in, its fragments and what joins these.
#[derive(Debug, Clone)]
struct Known {
    piece: Piece,
    map: usize,
    fragments: Vec<Value>,
    joins: Joins,
}

/// The closures over breaks, and the least and the largest disagreement of their cycles with the graph: chi-square with three degrees of
/// freedom.
#[derive(Debug, Clone, Copy, Default)]
struct Joins {
    closures: u64,
    cycle_chi2: Option<[f64; 2]>,
}

impl Joins {
    /// With others.
    fn and(self, other: Self) -> Self {
        let both = [self.cycle_chi2, other.cycle_chi2].into_iter().flatten();
        let cycle_chi2 = both.reduce(|[a, b], [least, largest]| [a.min(least), b.max(largest)]);
        Self { closures: self.closures + other.closures, cycle_chi2 }
    }
}

impl Pieces {
    pub(crate) fn of<M: Measurement>(session: &Session<M>) -> Self {
        let maps = session.maps();
        let map_of = |piece: usize| maps.iter().position(|map| map.pieces.contains(&piece)).unwrap_or(0);
        let known = |(at, piece): (usize, Piece)| Known {
            map: map_of(at),
            fragments: piece.fragments.iter().map(|fragment| fragment_report(session, fragment)).collect(),
            joins: Joins::default(),
            piece,
        };
        let mut pieces: Vec<Known> = session.pieces().into_iter().enumerate().map(known).collect();
        let closures = session.recorded_edges().iter().filter(|known| !known.withdrawn);
        for closure in closures.filter(|known| known.recorded.edge.kind == EdgeKind::Closure) {
            let Some([joined, _]) = session.joined_fragments(closure.ends.map(|end| end as usize)) else { continue };
            // Of a closure in a damaged log nothing more may be known.
            let candidate = closure.recorded.candidate.and_then(|number| session.candidates().get(number as usize));
            let chi2 = candidate.and_then(|candidate| candidate.evidence.cycle_chi2).filter(|chi2| chi2.is_finite());
            if let Some(of) = pieces.iter_mut().find(|known| known.piece.fragments.contains(&joined)) {
                of.joins = of.joins.and(Joins { closures: 1, cycle_chi2: chi2.map(|chi2| [chi2, chi2]) });
            }
        }
        let breaks = session.fragments().iter().filter(|fragment| session.is_break(fragment)).count();
        Self { pieces, fragments: session.fragments().len(), breaks, maps: maps.len() }
    }

    /// For `report.json`: of each piece its fragments, its map, and what holds it.
    pub(crate) fn to_json(&self) -> Value {
        let odometry =
            |link: &OdometryLink| json!({ "to_piece": link.to, "sigma_m": link.sigma_m, "sigma_rad": link.sigma_rad });
        let piece = |(at, known): (usize, &Known)| {
            let Known { piece, map, fragments, joins } = known;
            json!({
                "keyframes": piece.keyframes,
                "fragments": fragments,
                "map": map_file(*map, "png"),
                "joined_by": {
                    "closures": joins.closures,
                    "least_cycle_chi2": joins.cycle_chi2.map(|[least, _]| least),
                    "worst_cycle_chi2": joins.cycle_chi2.map(|[_, worst]| worst),
                },
                "held_by": match (at, piece.link) {
                    (0, None) => "the beginning",
                    (_, None) => "nothing",
                    (_, Some(_)) => "odometry",
                },
                "odometry": piece.link.as_ref().map(odometry),
            })
        };
        self.pieces.iter().enumerate().map(piece).collect()
    }

    /// A line for people; empty where there was no break.
    pub(crate) fn words(&self) -> String {
        if self.breaks == 0 {
            return String::new();
        }
        let (fragments, breaks) = (count(self.fragments as u64, "fragment"), count(self.breaks as u64, "break"));
        let mut text = format!("pieces   {}, of {fragments} ({breaks})", self.pieces.len());
        let all = self.pieces.iter().fold(Joins::default(), |all, known| all.and(known.joins));
        if all.closures > 0 {
            let _ = write!(text, "; {} over breaks", count(all.closures, "closure"));
        }
        if let Some([_, worst]) = all.cycle_chi2 {
            let _ = write!(text, ", with a cycle chi-square of at most {worst:.1}");
        }
        let [linked, unlinked] = [self.on_odometry().count(), self.on_nothing().count()];
        if linked > 0 {
            let [sigma_m, sigma_rad] = self.worst_sigmas();
            let degrees = sigma_rad.to_degrees();
            let _ = write!(text, "; on odometry alone: {linked}, to {sigma_m:.2} m and {degrees:.1} deg");
        }
        if unlinked > 0 {
            let _ = write!(text, "; held by nothing: {unlinked}");
        }
        text + "\n"
    }

    /// What is apart, in words.
    pub(crate) fn losses(&self) -> Vec<String> {
        let apart = |pieces: Vec<&Known>| {
            let keyframes: usize = pieces.iter().map(|known| known.piece.keyframes).sum();
            let words = [count(pieces.len() as u64, "piece"), count(keyframes as u64, "keyframe")];
            (!pieces.is_empty()).then(|| format!("{} of the map, {}", words[0], words[1]))
        };
        let linked = apart(self.on_odometry().collect()).map(|pieces| {
            let [sigma_m, _] = self.worst_sigmas();
            format!("{pieces}, drawn where odometry over a break has it, within {sigma_m:.2} m (one sigma), for nothing joins them")
        });
        let unlinked = apart(self.on_nothing().collect()).map(|pieces| {
            let files: Vec<String> = (1..self.maps).map(|map| map_file(map, "png")).collect();
            format!("{pieces}, written as maps of their own, for nothing holds them: {}", files.join(" "))
        });
        linked.into_iter().chain(unlinked).collect()
    }

    /// Those that odometry over a break alone holds.
    fn on_odometry(&self) -> impl Iterator<Item = &Known> {
        self.pieces.iter().filter(|known| known.piece.link.is_some())
    }

    /// Those that maps of their own begin with.
    fn on_nothing(&self) -> impl Iterator<Item = &Known> {
        self.pieces.iter().skip(1).filter(|known| known.piece.link.is_none())
    }

    /// The largest deviations that odometry over a break has of a piece, metres and radians.
    fn worst_sigmas(&self) -> [f64; 2] {
        let links = self.on_odometry().filter_map(|known| known.piece.link);
        links.fold([0.0, 0.0], |[m, rad], link| [m.max(link.sigma_m), rad.max(link.sigma_rad)])
    }
}

fn fragment_report<M: Measurement>(session: &Session<M>, fragment: &Fragment) -> Value {
    let keyframe = session.place(fragment.first).and_then(|place| session.keyframes().get(place));
    json!({
        "start": fragment.start.name(),
        "scan": keyframe.map(|keyframe| keyframe.scan),
        "stamp_s": keyframe.map(|keyframe| keyframe.stamp.as_secs_f64()),
    })
}
