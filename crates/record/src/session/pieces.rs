//! Which fragments are held together by more than odometry over a break, and which maps they make.

use super::{Session, SessionEdge};
use crate::entry::{Fragment, FragmentStart};
use crate::keyframe::{EdgeKind, Measurement};
use mapwright_geom::{Pose, TangentMatrix};
use std::ops::Range;

/// Odometry over a break whose position is less certain than this says nothing of where the robot is, metres: no closure is looked for in a
/// window that wide.
const ODOMETRY_AT_MOST_M: f64 = 8.0;

/// Fragments that matches and closures hold together.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// In the order of the way.
    pub fragments: Vec<Fragment>,
    /// Keyframes of all of them.
    pub keyframes: usize,
    /// The odometry over a break that says where it lies relative to what was mapped before; none where its map begins with it.
    pub link: Option<OdometryLink>,
}

/// What odometry over a break says of a piece: the link with the smallest deviation, where there are several.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryLink {
    /// The piece that it hangs on, by its place among [`Session::pieces`].
    pub to: usize,
    /// Standard deviation of the position in the direction in which it is least certain, metres.
    pub sigma_m: f64,
    /// Standard deviation of the heading, in space of the rotation about the axis about which it is least certain, radians.
    pub sigma_rad: f64,
}

/// A map: a piece, and those that hang on it by odometry over a break. Nothing says where it lies relative to other maps, so that they are not
/// to be drawn over each other.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SeparateMap {
    /// Places of its pieces among [`Session::pieces`], in order.
    pub pieces: Vec<usize>,
    /// Places of its keyframes among [`Session::keyframes`], in order.
    pub keyframes: Vec<Range<usize>>,
}

impl SeparateMap {
    /// Whether it has the keyframe at this place of the session.
    #[must_use]
    pub fn has(&self, keyframe: usize) -> bool {
        let begun = self.keyframes.partition_point(|range| range.start <= keyframe);
        begun.checked_sub(1).and_then(|at| self.keyframes.get(at)).is_some_and(|range| range.contains(&keyframe))
    }

    /// Places of its keyframes.
    pub fn places(&self) -> impl Iterator<Item = usize> {
        self.keyframes.iter().cloned().flatten()
    }
}

impl<M: Measurement> Session<M> {
    /// Whether the robot went on unseen before a fragment: after what [`FragmentStart::is_break`] says, and where another robot or another log
    /// begins.
    #[must_use]
    pub fn is_break(&self, fragment: &Fragment) -> bool {
        let is_later = |place: usize| self.fragments.iter().filter_map(|f| self.place(f.first)).any(|f| f < place);
        let begins_another = || fragment.start == FragmentStart::SwitchedOn;
        fragment.start.is_break() || begins_another() && self.place(fragment.first).is_some_and(is_later)
    }

    /// The fragments of two keyframes, by their places, if a break lies between these: a closure there is a join.
    #[must_use]
    pub fn joined_fragments(&self, keyframes: [usize; 2]) -> Option<[Fragment; 2]> {
        let begun = |place: usize| {
            let firsts = self.fragments.iter().filter_map(|fragment| Some((self.place(fragment.first)?, fragment)));
            firsts.filter(|(first, _)| *first <= place).max_by_key(|(first, _)| *first).map(|(_, fragment)| *fragment)
        };
        let [earlier, later] = [keyframes[0].min(keyframes[1]), keyframes[0].max(keyframes[1])];
        let lies_between = |first: usize| earlier < first && first <= later;
        let is_between = |fragment: &&Fragment| self.place(fragment.first).is_some_and(lies_between);
        let is_over_break = self.fragments.iter().filter(is_between).any(|fragment| self.is_break(fragment));
        let [a, b] = keyframes.map(begun);
        is_over_break.then_some([a?, b?])
    }

    /// The pieces that the map consists of, in the order of the way; one without fragments where the session has none.
    ///
    /// Over a break only closures hold fragments together: odometry is a claim there, and a match with what lies beyond is made only after a
    /// join, and is worth no more than that.
    #[must_use]
    pub fn pieces(&self) -> Vec<Piece> {
        Layout::of(self).pieces(self)
    }

    /// The maps that the pieces make, that of the most keyframes first and else in the order of the way; at least one, be it empty.
    #[must_use]
    pub fn maps(&self) -> Vec<SeparateMap> {
        let layout = Layout::of(self);
        let pieces = layout.pieces(self);
        let mut map_of: Vec<Option<usize>> = vec![None; pieces.len()];
        let mut maps: Vec<SeparateMap> = Vec::new();
        for piece in 0..pieces.len() {
            // Links lead to where a map begins, which may be a later piece than the one that hangs on it.
            let first = std::iter::successors(Some(piece), |&at| pieces.get(at)?.link.map(|link| link.to)).last();
            let first = first.unwrap_or(piece);
            let map = map_of[first].unwrap_or(maps.len());
            map_of[first] = Some(map);
            if map == maps.len() {
                maps.push(SeparateMap::default());
            }
            maps[map].pieces.push(piece);
        }
        for map in &mut maps {
            let ranges = layout.fragments.iter().filter(|known| map.pieces.contains(&known.piece));
            map.keyframes = ranges.map(|known| known.keyframes.clone()).collect();
        }
        let keyframes = |map: &SeparateMap| map.keyframes.iter().map(|range| range.len()).sum::<usize>();
        maps.sort_by_key(|map| std::cmp::Reverse(keyframes(map)));
        if maps.is_empty() {
            maps.push(SeparateMap::default());
        }
        maps
    }
}

/// The fragments of a session in the order of the way.
pub(super) struct Layout {
    fragments: Vec<Known>,
    pieces: usize,
}

/// A fragment, its keyframes, and the piece that it is of.
struct Known {
    fragment: Option<Fragment>,
    is_break: bool,
    keyframes: Range<usize>,
    piece: usize,
}

impl Layout {
    pub(super) fn of<M: Measurement>(session: &Session<M>) -> Self {
        let mut layout = Self { fragments: in_order(session), pieces: 0 };
        // Each fragment names an earlier one of its piece, the first one itself.
        let mut earlier: Vec<usize> = (0..layout.fragments.len()).collect();
        for known in session.edges.iter().filter(|known| !known.withdrawn) {
            let ends = known.ends.map(|end| layout.at(end as usize));
            if known.recorded.edge.kind == EdgeKind::Closure || !layout.is_break_between(ends) {
                let [a, b] = ends.map(|at| root(&earlier, at));
                earlier[a.max(b)] = a.min(b);
            }
        }
        let mut pieces: Vec<usize> = Vec::new();
        for (at, known) in layout.fragments.iter_mut().enumerate() {
            let root = root(&earlier, at);
            known.piece = pieces.iter().position(|&first| first == root).unwrap_or(pieces.len());
            if known.piece == pieces.len() {
                pieces.push(root);
            }
        }
        layout.pieces = pieces.len();
        layout
    }

    fn pieces<M: Measurement>(&self, session: &Session<M>) -> Vec<Piece> {
        let mut pieces = vec![Piece { fragments: Vec::new(), keyframes: 0, link: None }; self.pieces];
        for known in &self.fragments {
            let piece = &mut pieces[known.piece];
            piece.fragments.extend(known.fragment);
            piece.keyframes += known.keyframes.len();
        }
        let links: Vec<Link> = session.edges.iter().filter_map(|known| self.link(known)).collect();
        let mut is_placed = vec![false; pieces.len()];
        for first in 0..pieces.len() {
            if is_placed[first] {
                continue;
            }
            is_placed[first] = true;
            // From where a map begins always over the most certain link that leads farther (Prim).
            while let Some((piece, link)) = next(&links, &is_placed) {
                is_placed[piece] = true;
                pieces[piece].link = Some(link);
            }
        }
        pieces
    }

    /// What odometry says over a break, if it says anything.
    fn link<P: Pose>(&self, known: &SessionEdge<P>) -> Option<Link> {
        if known.withdrawn || known.recorded.edge.kind != EdgeKind::Odometry || self.pieces < 2 {
            return None;
        }
        let ends = known.ends.map(|end| end as usize);
        let [a, b] = ends.map(|end| self.at(end));
        let (from, to) = (self.fragments.get(a)?, self.fragments.get(b)?);
        let is_uncertain = to.fragment.is_some_and(|fragment| fragment.start == FragmentStart::Uncertain);
        if !is_uncertain || ends[1] != to.keyframes.start || from.piece == to.piece {
            return None;
        }
        let covariance = known.recorded.edge.information.inverted()?;
        let (sigma_m, sigma_rad) =
            (covariance.position_variance_m2().sqrt(), covariance.rotation_variance_rad2().sqrt());
        (sigma_m <= ODOMETRY_AT_MOST_M).then_some(Link { pieces: [from.piece, to.piece], sigma_m, sigma_rad })
    }

    /// The keyframes with which fragments begin that the robot reached unseen.
    pub(super) fn over_breaks(&self) -> impl Iterator<Item = usize> {
        let is_unseen = |known: &&Known| known.fragment.is_some_and(|fragment| fragment.start.is_break());
        self.fragments.iter().filter(is_unseen).map(|known| known.keyframes.start)
    }

    /// Whether two keyframes are held together.
    pub(super) fn is_one_piece(&self, keyframes: [usize; 2]) -> bool {
        let [a, b] = keyframes.map(|keyframe| self.fragments.get(self.at(keyframe)).map(|known| known.piece));
        a.is_some() && a == b
    }

    /// The fragment of a keyframe.
    fn at(&self, keyframe: usize) -> usize {
        self.fragments.partition_point(|known| known.keyframes.start <= keyframe).saturating_sub(1)
    }

    fn is_break_between(&self, [a, b]: [usize; 2]) -> bool {
        let between = self.fragments.get(a.min(b) + 1..=a.max(b)).unwrap_or_default();
        between.iter().any(|known| known.is_break)
    }
}

/// Odometry over a break, and its deviations, metres and radians.
struct Link {
    pieces: [usize; 2],
    sigma_m: f64,
    sigma_rad: f64,
}

/// The most certain link between a piece that is placed and one that is not.
fn next(links: &[Link], is_placed: &[bool]) -> Option<(usize, OdometryLink)> {
    let leads = |link: &&Link| is_placed[link.pieces[0]] != is_placed[link.pieces[1]];
    let link = links.iter().filter(leads).min_by(|a, b| a.sigma_m.total_cmp(&b.sigma_m))?;
    let [a, b] = link.pieces;
    let (piece, to) = if is_placed[a] { (b, a) } else { (a, b) };
    Some((piece, OdometryLink { to, sigma_m: link.sigma_m, sigma_rad: link.sigma_rad }))
}

/// All keyframes by fragment; those that stand before the first one belong to it.
fn in_order<M: Measurement>(session: &Session<M>) -> Vec<Known> {
    let mut firsts: Vec<(usize, Option<Fragment>)> = session
        .fragments
        .iter()
        .filter_map(|fragment| Some((session.place(fragment.first)?, Some(*fragment))))
        .collect();
    firsts.sort_by_key(|(first, _)| *first);
    if firsts.is_empty() && !session.keyframes.is_empty() {
        firsts.push((0, None));
    }
    let end = |at: usize| firsts.get(at + 1).map_or(session.keyframes.len(), |(next, _)| *next);
    let known = |(at, &(first, fragment)): (usize, &(usize, Option<Fragment>))| Known {
        fragment,
        is_break: at > 0
            && fragment
                .is_some_and(|fragment| fragment.start.is_break() || fragment.start == FragmentStart::SwitchedOn),
        keyframes: if at == 0 { 0 } else { first }..end(at),
        piece: 0,
    };
    firsts.iter().enumerate().map(known).collect()
}

fn root(earlier: &[usize], mut at: usize) -> usize {
    while earlier[at] < at {
        at = earlier[at];
    }
    at
}
