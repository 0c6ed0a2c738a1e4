//! Which fragments are held together by more than odometry over a break, and which maps they make.

use super::{Session, SessionEdge};
use crate::entry::{Fragment, FragmentStart};
use crate::keyframe::{EdgeKind, Measurement};
use mapwright_geom::{Pose, TangentMatrix};
use std::ops::Range;

/// Odometry over a break whose position is less certain than this says nothing of where the robot is, metres: no closure is looked for in a
/// window that wide.
const ODOMETRY_AT_MOST_M: f64 = 8.0;
/// Standard deviation of a heading that may be any, radians: pi / sqrt(3). Odometry that knows no more says nothing either.
const ANY_HEADING_RAD: f64 = 1.813_799_364_234_217_7;

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
        if self.are_of_one_stretch_of_way(keyframes) {
            return None;
        }
        let way = Ways::of(self);
        let ends = keyframes.map(|place| way.at(place));
        let fragment = |at: usize| way.fragments.get(at)?.fragment;
        way.is_break_between(ends).then_some([fragment(ends[0])?, fragment(ends[1])?])
    }

    /// Whether two keyframes are of one run, and no fragment of it begins between them.
    fn are_of_one_stretch_of_way(&self, keyframes: [usize; 2]) -> bool {
        let [Some(a), Some(b)] = keyframes.map(|place| self.keyframes.get(place)) else { return false };
        let between = keyframes[0].min(keyframes[1]) + 1..=keyframes[0].max(keyframes[1]);
        let of_run = || self.fragments.iter().filter(|fragment| fragment.first.run() == a.id.run());
        a.id.run() == b.id.run()
            && !of_run().filter_map(|fragment| self.place(fragment.first)).any(|first| between.contains(&first))
    }

    /// The piece that each stretch of keyframes is of, by their places, in order: within one no fragment begins, and no other robot's come.
    #[must_use]
    pub fn stretches(&self) -> Vec<(Range<usize>, usize)> {
        Layout::of(self).stretches()
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
            let is_of_map = |at: usize| layout.piece(at).is_some_and(|piece| map.pieces.contains(&piece));
            map.keyframes = layout.ways.stretches().filter(|(at, _)| is_of_map(*at)).map(|(_, range)| range).collect();
        }
        let keyframes = |map: &SeparateMap| map.keyframes.iter().map(|range| range.len()).sum::<usize>();
        maps.sort_by_key(|map| std::cmp::Reverse(keyframes(map)));
        if maps.is_empty() {
            maps.push(SeparateMap::default());
        }
        maps
    }
}

/// The fragments of a session, and which keyframes are of each: of robots that drive at the same time those between which others stand.
struct Ways {
    /// In the order of their first keyframes.
    fragments: Vec<Known>,
    /// From this keyframe on all are of this fragment, in order.
    stretches: Vec<(usize, usize)>,
    keyframes: usize,
}

/// A fragment.
struct Known {
    fragment: Option<Fragment>,
    first: usize,
    /// Fragments with one number follow each other without a break.
    unbroken: usize,
}

impl Ways {
    fn of<M: Measurement>(session: &Session<M>) -> Self {
        let mut firsts: Vec<(usize, Option<Fragment>)> = session
            .fragments
            .iter()
            .filter_map(|fragment| Some((session.place(fragment.first)?, Some(*fragment))))
            .collect();
        firsts.sort_by_key(|(first, _)| *first);
        if firsts.is_empty() && !session.keyframes.is_empty() {
            firsts.push((0, None));
        }
        let mut ways = Self { fragments: Vec::new(), stretches: Vec::new(), keyframes: session.keyframes.len() };
        let mut returns = session.names.returns().peekable();
        let mut breaks = 0;
        for (first, fragment) in firsts {
            while let Some(place) = returns.next_if(|place| *place < first) {
                ways.go_on(session, place);
            }
            returns.next_if_eq(&first);
            let is_break = fragment
                .is_some_and(|fragment| fragment.start.is_break() || fragment.start == FragmentStart::SwitchedOn);
            let before = session.before(first).filter(|_| !ways.fragments.is_empty()).map(|before| ways.at(before));
            let followed = before.filter(|_| !is_break).and_then(|at| ways.fragments.get(at));
            let unbroken = followed.map_or(breaks, |known| known.unbroken);
            breaks += usize::from(followed.is_none());
            // Those that stand before the first one belong to it.
            ways.stretches.push((if ways.fragments.is_empty() { 0 } else { first }, ways.fragments.len()));
            ways.fragments.push(Known { fragment, first, unbroken });
        }
        returns.for_each(|place| ways.go_on(session, place));
        ways
    }

    /// A run goes on here, in the fragment in which it was.
    fn go_on<M: Measurement>(&mut self, session: &Session<M>, place: usize) {
        let at = session.before(place).map_or(0, |before| self.at(before));
        if !self.fragments.is_empty() {
            self.stretches.push((place, at));
        }
    }

    /// The fragment of a keyframe.
    fn at(&self, keyframe: usize) -> usize {
        let begun = self.stretches.partition_point(|(first, _)| *first <= keyframe);
        self.stretches.get(begun.saturating_sub(1)).map_or(0, |(_, fragment)| *fragment)
    }

    /// Fragments, and keyframes of each that stand one after the other, in order.
    fn stretches(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        let ends = self.stretches.iter().skip(1).map(|(first, _)| *first).chain([self.keyframes]);
        self.stretches.iter().zip(ends).map(|(&(first, fragment), end)| (fragment, first..end))
    }

    fn is_break_between(&self, ends: [usize; 2]) -> bool {
        let [a, b] = ends.map(|at| self.fragments.get(at).map(|known| known.unbroken));
        a != b
    }
}

/// The fragments, and the piece that each is of.
pub(super) struct Layout {
    ways: Ways,
    piece_of: Vec<usize>,
    pieces: usize,
}

impl Layout {
    pub(super) fn of<M: Measurement>(session: &Session<M>) -> Self {
        let ways = Ways::of(session);
        // Each fragment names an earlier one of its piece, the first one itself.
        let mut earlier: Vec<usize> = (0..ways.fragments.len()).collect();
        for known in session.edges.iter().filter(|known| !known.withdrawn) {
            let ends = known.ends.map(|end| ways.at(end as usize));
            if known.recorded.edge.kind == EdgeKind::Closure || !ways.is_break_between(ends) {
                let [a, b] = ends.map(|at| root(&earlier, at));
                earlier[a.max(b)] = a.min(b);
            }
        }
        let mut pieces: Vec<usize> = Vec::new();
        let mut piece_of = Vec::new();
        for at in 0..ways.fragments.len() {
            let root = root(&earlier, at);
            let piece = pieces.iter().position(|&first| first == root).unwrap_or(pieces.len());
            piece_of.push(piece);
            if piece == pieces.len() {
                pieces.push(root);
            }
        }
        Self { ways, piece_of, pieces: pieces.len() }
    }

    fn piece(&self, fragment: usize) -> Option<usize> {
        self.piece_of.get(fragment).copied()
    }

    /// The piece of each stretch of keyframes that stand one after the other, and where that begins, in order.
    pub(super) fn stretches(&self) -> Vec<(Range<usize>, usize)> {
        self.ways.stretches().filter_map(|(at, range)| Some((range, self.piece(at)?))).collect()
    }

    fn pieces<M: Measurement>(&self, session: &Session<M>) -> Vec<Piece> {
        let mut pieces = vec![Piece { fragments: Vec::new(), keyframes: 0, link: None }; self.pieces];
        for (known, &piece) in self.ways.fragments.iter().zip(&self.piece_of) {
            pieces[piece].fragments.extend(known.fragment);
        }
        for (range, piece) in self.stretches() {
            pieces[piece].keyframes += range.len();
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
        let [a, b] = ends.map(|end| self.ways.at(end));
        let (to, pieces) = (self.ways.fragments.get(b)?, [self.piece(a)?, self.piece(b)?]);
        let is_uncertain = to.fragment.is_some_and(|fragment| fragment.start == FragmentStart::Uncertain);
        if !is_uncertain || ends[1] != to.first || pieces[0] == pieces[1] {
            return None;
        }
        let covariance = known.recorded.edge.information.inverted()?;
        let (sigma_m, sigma_rad) =
            (covariance.position_variance_m2().sqrt(), covariance.rotation_variance_rad2().sqrt());
        let says_something = sigma_m <= ODOMETRY_AT_MOST_M && sigma_rad < ANY_HEADING_RAD;
        says_something.then_some(Link { pieces, sigma_m, sigma_rad })
    }

    /// The keyframes with which fragments begin that the robot reached unseen.
    pub(super) fn over_breaks(&self) -> impl Iterator<Item = usize> {
        let is_unseen = |known: &&Known| known.fragment.is_some_and(|fragment| fragment.start.is_break());
        self.ways.fragments.iter().filter(is_unseen).map(|known| known.first)
    }

    /// Whether two keyframes are held together.
    pub(super) fn is_one_piece(&self, keyframes: [usize; 2]) -> bool {
        let [a, b] = keyframes.map(|keyframe| self.piece(self.ways.at(keyframe)));
        a.is_some() && a == b
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

fn root(earlier: &[usize], mut at: usize) -> usize {
    while earlier[at] < at {
        at = earlier[at];
    }
    at
}
