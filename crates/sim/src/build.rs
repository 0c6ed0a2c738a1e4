//! The carpenter: walls with openings, doors, and furniture that keeps out of the robot's way.

use crate::math::{Point, add, cross, distance, dot, lerp, rotate, scale, sub, unit};
use crate::rng::Rng;
use crate::shape::{Circle, Segment};
use crate::world::{Door, Schedule, World};

/// Furniture keeps this far from the route, metres.
const CLEARANCE_M: f64 = 0.5;
/// Edge of the coarse grid in which furniture and route are looked up, metres.
const BIN_M: f64 = 4.0;

/// An opening in a wall: from here to there along it, metres.
pub(crate) type Gap = [f64; 2];

/// A right-angled frame: `u` along a wall, `v` away from it into the room; left- or right-handed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    pub(crate) origin: Point,
    pub(crate) u: Point,
    pub(crate) v: Point,
}

impl Frame {
    pub(crate) fn at(&self, u_m: f64, v_m: f64) -> Point {
        add(self.origin, add(scale(self.u, u_m), scale(self.v, v_m)))
    }

    pub(crate) fn moved(&self, u_m: f64, v_m: f64) -> Self {
        Self { origin: self.at(u_m, v_m), ..*self }
    }
}

/// A piece of furniture's footprint: a box turned by whatever angle, metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Footprint {
    pub(crate) center: Point,
    /// Unit vector along the box's length.
    pub(crate) along: Point,
    pub(crate) length_m: f64,
    pub(crate) depth_m: f64,
}

impl Footprint {
    pub(crate) fn corners(&self) -> [Point; 4] {
        let a = scale(self.along, 0.5 * self.length_m);
        let b = scale([-self.along[1], self.along[0]], 0.5 * self.depth_m);
        [
            sub(sub(self.center, a), b),
            sub(add(self.center, a), b),
            add(add(self.center, a), b),
            add(sub(self.center, a), b),
        ]
    }

    fn edges(&self) -> [Segment; 4] {
        let [a, b, c, d] = self.corners();
        [Segment { a, b }, Segment { a: b, b: c }, Segment { a: c, b: d }, Segment { a: d, b: a }]
    }

    /// Half the diagonal.
    fn reach_m(&self) -> f64 {
        0.5 * (self.length_m * self.length_m + self.depth_m * self.depth_m).sqrt()
    }

    fn axes(&self) -> [Point; 2] {
        [self.along, [-self.along[1], self.along[0]]]
    }

    /// Whether the two boxes share a point (separating axes).
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let apart = |axis: Point| {
            let gap = dot(sub(other.center, self.center), axis).abs();
            gap > half_extent(self, axis) + half_extent(other, axis)
        };
        !self.axes().into_iter().chain(other.axes()).any(apart)
    }
}

fn half_extent(footprint: &Footprint, axis: Point) -> f64 {
    let [a, b] = footprint.axes();
    0.5 * (footprint.length_m * dot(a, axis).abs() + footprint.depth_m * dot(b, axis).abs())
}

/// Things by their place in a coarse grid; found, never iterated.
#[derive(Debug, Clone)]
struct Bins<T> {
    bins: std::collections::BTreeMap<(i64, i64), Vec<T>>,
}

impl<T: Copy> Bins<T> {
    fn new() -> Self {
        Self { bins: std::collections::BTreeMap::new() }
    }

    fn insert(&mut self, low: Point, high: Point, thing: T) {
        for bin in bins_of(low, high) {
            self.bins.entry(bin).or_default().push(thing);
        }
    }

    fn any(&self, low: Point, high: Point, mut test: impl FnMut(T) -> bool) -> bool {
        bins_of(low, high).filter_map(|bin| self.bins.get(&bin)).flatten().any(|&thing| test(thing))
    }
}

fn bins_of(low: Point, high: Point) -> impl Iterator<Item = (i64, i64)> {
    let index = |value: f64| (value / BIN_M).floor() as i64;
    let (x0, x1, y0, y1) = (index(low[0]), index(high[0]), index(low[1]), index(high[1]));
    (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| (x, y)))
}

/// A world under construction.
#[derive(Debug, Clone)]
pub(crate) struct Builder {
    segments: Vec<Segment>,
    circles: Vec<Circle>,
    doors: Vec<Door>,
    ways: Bins<Segment>,
    furniture: Bins<Footprint>,
}

impl Builder {
    pub(crate) fn new() -> Self {
        Self { segments: vec![], circles: vec![], doors: vec![], ways: Bins::new(), furniture: Bins::new() }
    }

    pub(crate) fn build(self) -> World {
        World::new(self.segments, self.circles).with_doors(self.doors)
    }

    pub(crate) fn segment(&mut self, a: Point, b: Point) {
        self.segments.push(Segment { a, b });
    }

    pub(crate) fn polyline(&mut self, points: &[Point]) {
        points.windows(2).for_each(|pair| self.segment(pair[0], pair[1]));
    }

    /// A wall of some thickness around the line from `a` to `b`, with openings.
    pub(crate) fn wall(&mut self, a: Point, b: Point, thickness_m: f64, gaps: &[Gap]) {
        let length_m = distance(a, b);
        let mut gaps = gaps.to_vec();
        gaps.sort_by(|p, q| p[0].total_cmp(&q[0]));
        let mut from_m = -0.5 * thickness_m;
        for gap in gaps.into_iter().chain([[length_m + 0.5 * thickness_m, 0.0]]) {
            if gap[0] > from_m {
                self.wall_piece(a, b, [from_m / length_m, gap[0] / length_m], thickness_m);
            }
            from_m = gap[1];
        }
    }

    fn wall_piece(&mut self, a: Point, b: Point, share: [f64; 2], thickness_m: f64) {
        let (from, to) = (lerp(a, b, share[0]), lerp(a, b, share[1]));
        let piece = Footprint {
            center: lerp(from, to, 0.5),
            along: unit(sub(b, a)),
            length_m: distance(from, to),
            depth_m: thickness_m,
        };
        self.segments.extend(piece.edges());
        self.block(piece);
    }

    /// A door whose leaf swings about `hinge` from `shut_end` by `open_rad`.
    pub(crate) fn door(&mut self, hinge: Point, shut_end: Point, open_rad: f64, shut_when: Schedule) {
        let open_end = add(hinge, rotate(sub(shut_end, hinge), open_rad));
        let shut = Segment { a: hinge, b: shut_end };
        self.doors.push(Door { shut, open: Some(Segment { a: hinge, b: open_end }), shut_when });
    }

    /// Keeps furniture away from these legs.
    pub(crate) fn reserve(&mut self, way: &[Point]) {
        for pair in way.windows(2) {
            let (low, high) = box_around(pair[0], pair[1], CLEARANCE_M);
            self.ways.insert(low, high, Segment { a: pair[0], b: pair[1] });
        }
    }

    /// Keeps furniture out of a place.
    pub(crate) fn block(&mut self, place: Footprint) {
        let (low, high) = box_around(place.corners()[0], place.corners()[2], place.reach_m());
        self.furniture.insert(low, high, place);
    }

    /// Takes a place for furniture, unless it is in the way or taken; whether it was got.
    pub(crate) fn claim(&mut self, place: Footprint) -> bool {
        let reach_m = place.reach_m();
        let (low, high) = box_around(place.center, place.center, reach_m);
        let in_the_way = |leg: Segment| {
            place.edges().iter().any(|edge| edge.distance_to_segment(&leg) < CLEARANCE_M)
                || leg.distance_to_point(place.center) < CLEARANCE_M
        };
        if self.ways.any(low, high, in_the_way) || self.furniture.any(low, high, |other| other.overlaps(&place)) {
            return false;
        }
        self.block(place);
        true
    }

    /// A solid box, where there is room for it.
    pub(crate) fn solid(&mut self, place: Footprint) -> bool {
        let got = self.claim(place);
        if got {
            self.segments.extend(place.edges());
        }
        got
    }

    /// Round furniture, where there is room for it.
    pub(crate) fn round(&mut self, center: Point, radius_m: f64) -> bool {
        let place = Footprint { center, along: [1.0, 0.0], length_m: 2.0 * radius_m, depth_m: 2.0 * radius_m };
        let got = self.claim(place);
        if got {
            self.circles.push(Circle { center, radius_m });
        }
        got
    }

    /// Part of a piece of furniture whose place is already claimed.
    pub(crate) fn leg(&mut self, center: Point, radius_m: f64) {
        self.circles.push(Circle { center, radius_m });
    }

    /// A wall seen from one side, with niches, recessed doors, doors ajar and pilasters at irregular intervals of about
    /// `mean_gap_m`. `outward` points away from the corridor.
    pub(crate) fn feature_wall(&mut self, a: Point, b: Point, outward: Point, mean_gap_m: f64, rng: &mut Rng) {
        let length_m = distance(a, b);
        let frame = Frame { origin: a, u: unit(sub(b, a)), v: outward };
        let mut outline = vec![a];
        let mut at_m = rng.uniform(0.8, mean_gap_m);
        loop {
            let feature = Feature::draw(rng);
            if at_m + feature.width_m > length_m - 0.8 {
                break;
            }
            feature.add_to(&mut outline, &frame, at_m);
            self.feature_details(&feature, &frame.moved(at_m, feature.depth_m), rng);
            at_m += feature.width_m + rng.uniform(0.4 * mean_gap_m, 1.6 * mean_gap_m);
        }
        outline.push(b);
        self.polyline(&outline);
    }

    /// What stands in a niche, or the leaf of a door ajar.
    fn feature_details(&mut self, feature: &Feature, frame: &Frame, rng: &mut Rng) {
        match feature.kind {
            FeatureKind::Ajar => {
                let leaf = rotate(scale(frame.u, 0.9), rng.uniform(0.3, 0.9) * cross(frame.u, frame.v).signum());
                self.segment(frame.at(0.0, 0.15 - feature.depth_m), add(frame.at(0.0, 0.15 - feature.depth_m), leaf));
            }
            FeatureKind::Niche if feature.depth_m > 0.4 && rng.chance(0.6) => {
                self.leg(frame.at(rng.uniform(0.25, feature.width_m - 0.25), -0.2), rng.uniform(0.08, 0.18));
            }
            _ => {}
        }
    }
}

fn box_around(a: Point, b: Point, margin_m: f64) -> (Point, Point) {
    let low = [a[0].min(b[0]) - margin_m, a[1].min(b[1]) - margin_m];
    (low, [a[0].max(b[0]) + margin_m, a[1].max(b[1]) + margin_m])
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum FeatureKind {
    Niche,
    Recess,
    Ajar,
    Pilaster,
}

/// A departure from the straight wall; positive depth leads away from the corridor.
#[derive(Debug, Clone, Copy)]
struct Feature {
    kind: FeatureKind,
    width_m: f64,
    depth_m: f64,
}

impl Feature {
    fn draw(rng: &mut Rng) -> Self {
        let (kind, width_m, depth_m) = match rng.below(8) {
            0 | 1 => (FeatureKind::Niche, rng.uniform(0.8, 2.6), rng.uniform(0.25, 0.9)),
            2 => (FeatureKind::Ajar, 0.95, rng.uniform(1.4, 2.4)),
            3 | 4 => (FeatureKind::Pilaster, rng.uniform(0.3, 0.6), -rng.uniform(0.08, 0.22)),
            _ => (FeatureKind::Recess, rng.uniform(0.85, 1.1), rng.uniform(0.08, 0.16)),
        };
        Self { kind, width_m, depth_m }
    }

    fn add_to(&self, outline: &mut Vec<Point>, frame: &Frame, at_m: f64) {
        let end_m = at_m + self.width_m;
        let corners = [(at_m, 0.0), (at_m, self.depth_m), (end_m, self.depth_m), (end_m, 0.0)];
        outline.extend(corners.map(|(u_m, v_m)| frame.at(u_m, v_m)));
    }
}
