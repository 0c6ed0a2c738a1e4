//! Which places seen before look like the one here, without any pose.
//!
//! A place is the end points around a keyframe. Those of a single scan will do where the robot comes back the way it
//! went; a laser that looks half around and comes back the other way needs a submap of the last 7 m or so. A hit is a
//! candidate and no more: corridors look alike. [0009](../../../docs/decisions/0009-places.md) has what it is worth.

mod signature;

use mapwright_geom::Stored;
use mapwright_record::NodeId;
use signature::{Describer, Likeness, Query, Signature, is_signature};

/// A hit stands for so many places added right before and after it.
const NEIGHBOURS: usize = 4;
/// The share of a place that is no hit.
const OUT: f32 = 0.0;

/// A place that looks like the one asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceHit {
    /// The node it was added with.
    pub node: NodeId,
    /// 0 for the same place, 1 for nothing in common.
    pub distance: f64,
    /// Heading of the query's frame in the node's, between `-pi/2` and `pi/2`; **half a turn more is as likely**. `None` where the
    /// place looks much the same in all directions.
    pub heading_rad: Option<f64>,
}

/// All places so far, about 390 bytes each.
///
/// ```
/// use mapwright_loops::PlaceIndex;
/// use mapwright_record::NodeId;
/// // An L-shaped wall and a post, and the same seen from elsewhere.
/// let wall = (0..40).map(|k| 0.1 * f64::from(k));
/// let mut here: Vec<_> = wall.clone().map(|m| [2.0, m]).chain(wall.map(|m| [0.7 * m, 3.0])).collect();
/// here.push([-1.0, -1.0]);
/// let moved: Vec<_> = here.iter().map(|[x, y]| [0.5 - y, x - 1.0]).collect();
///
/// let mut places = PlaceIndex::default();
/// places.add(NodeId::new(7), &here);
/// let hit = places.query(&moved, 1, |_| true)[0];
/// assert!(hit.node == NodeId::new(7) && hit.distance < 0.1);
/// ```
#[derive(Debug, Clone, Default)]
pub struct PlaceIndex {
    nodes: Vec<NodeId>,
    signatures: Vec<Signature>,
    describer: Describer,
    /// How alike each is to what is asked for.
    shares: Vec<f32>,
}

impl PlaceIndex {
    /// How many places there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The nodes that they were added with.
    #[must_use]
    pub fn nodes(&self) -> &[NodeId] {
        &self.nodes
    }

    /// Adds a place: end points in its frame, metres. Those farther than 8 m and those that are not numbers do not count;
    /// a place with hardly any is never found.
    pub fn add(&mut self, node: NodeId, points: &[[f64; 2]]) {
        let signature = self.describer.describe(points);
        self.nodes.push(node);
        self.signatures.push(signature);
    }

    /// The places most like this one among those allowed, best first, the earlier first among equals.
    ///
    /// All are compared, at every turn. A hit stands for four places added before and after it too, which are left out.
    #[must_use]
    pub fn query(&mut self, points: &[[f64; 2]], at_most: usize, allow: impl Fn(NodeId) -> bool) -> Vec<PlaceHit> {
        let mut hits = Vec::new();
        let Some(query) = Query::new(self.describer.describe(points)) else { return hits };
        let table = &self.describer.table;
        let places = self.nodes.iter().zip(&self.signatures);
        self.shares.clear();
        self.shares.extend(places.map(|(&node, place)| if allow(node) { query.share(place, table) } else { OUT }));
        while hits.len() < at_most
            && let Some(best) = most_alike(&self.shares)
        {
            let Likeness { share, turn_rad } = query.likeness(&self.signatures[best], table);
            let distance = (1.0 - f64::from(share)).clamp(0.0, 1.0);
            hits.push(PlaceHit { node: self.nodes[best], distance, heading_rad: turn_rad });
            let beyond = self.shares.len().min(best + NEIGHBOURS + 1);
            self.shares[best.saturating_sub(NEIGHBOURS)..beyond].fill(OUT);
        }
        hits
    }
}

impl Stored for PlaceIndex {
    fn put(&self, out: &mut Vec<u8>) {
        self.nodes.put(out);
        self.signatures.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let (nodes, signatures): (Vec<NodeId>, Vec<Signature>) = Stored::take(from)?;
        let are_sound = nodes.len() == signatures.len() && signatures.iter().all(is_signature);
        are_sound.then(|| Self { nodes, signatures, ..Self::default() })
    }
}

/// The first of the greatest shares, of those that have anything in common.
fn most_alike(shares: &[f32]) -> Option<usize> {
    let most = shares.iter().fold(OUT, |a, &b| if b > a { b } else { a });
    (most > OUT).then(|| shares.iter().position(|&share| share == most)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::{Pose2, wrap_angle};
    use mapwright_sim::{Drive, DriveSettings, LaserSettings, Rng, worlds};
    use proptest::prelude::*;
    use std::f64::consts::{PI, TAU};

    /// Rooms as a laser sees them that looks all around.
    fn views(count: usize) -> Vec<Vec<[f64; 2]>> {
        let laser = LaserSettings::with_field_of_view(TAU, 360);
        let settings = DriveSettings { laser, scan_rate_hz: 0.25, seed: 3, ..DriveSettings::default() };
        let scans = Drive::new(worlds::rooms(3).into(), settings).scans().take(count);
        let ends = |beam: usize, range_m: f32, step_rad: f64| {
            let angle_rad = -PI + step_rad * beam as f64;
            [f64::from(range_m) * angle_rad.cos(), f64::from(range_m) * angle_rad.sin()]
        };
        let view = |ranges_m: Vec<f32>| {
            let step_rad = TAU / ranges_m.len() as f64;
            ranges_m.iter().enumerate().map(|(beam, &range_m)| ends(beam, range_m, step_rad)).collect()
        };
        scans.map(|s| view(s.scan.ranges_m)).collect()
    }

    fn index(views: &[Vec<[f64; 2]>]) -> PlaceIndex {
        let mut places = PlaceIndex::default();
        views.iter().enumerate().for_each(|(k, view)| places.add(NodeId::at(10 * k), view));
        places
    }

    #[test]
    fn a_place_is_found_from_beside_it_and_turned() {
        let views = views(60);
        let mut places = index(&views);
        let mut rng = Rng::new(5);
        let (mut found, mut asked) = (0, 0);
        for (k, view) in views.iter().enumerate() {
            let turn_rad = rng.uniform(-PI, PI);
            let node_from_query = Pose2::new(rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), turn_rad);
            let query_from_node = node_from_query.inverse();
            let seen: Vec<_> = view.iter().map(|&p| query_from_node.transform(p)).collect();
            let hit = places.query(&seen, 1, |_| true)[0];
            let right = (hit.node.index() / 10).abs_diff(k) <= 1;
            asked += 1;
            found += u32::from(right);
            if hit.node.index() == 10 * k {
                let off_rad = 0.5 * wrap_angle(2.0 * (hit.heading_rad.unwrap() - turn_rad));
                assert!(off_rad.abs() < 0.1, "{off_rad} at {k}");
            }
        }
        assert!(found * 10 >= asked * 9, "{found} of {asked}");
    }

    #[test]
    fn hits_are_ordered_allowed_and_not_crowded() {
        let views = views(60);
        let mut places = index(&views);
        assert!(places.len() == 60 && !places.is_empty());
        let hits = places.query(&views[50], 8, |node| node.index() < 400);
        assert!(!hits.is_empty() && hits.len() <= 8);
        assert!(hits.iter().all(|hit| hit.node.index() < 400));
        assert!(hits.windows(2).all(|w| w[0].distance <= w[1].distance));
        for (k, a) in hits.iter().enumerate() {
            assert!(hits[..k].iter().all(|b| a.node.index().abs_diff(b.node.index()) > 10 * NEIGHBOURS));
        }
        assert_eq!(hits, places.query(&views[50], 8, |node| node.index() < 400));
        assert_eq!(hits, index(&views).query(&views[50], 8, |node| node.index() < 400));
        assert!(places.query(&views[50], 0, |_| true).is_empty());
    }

    #[test]
    fn places_that_were_written_down_are_found_as_before() {
        let views = views(30);
        let (mut places, mut bytes) = (index(&views), Vec::new());
        places.put(&mut bytes);
        let mut read = PlaceIndex::take(&mut &bytes[..]).unwrap();
        assert_eq!(read.nodes(), places.nodes());
        assert_eq!(read.query(&views[20], 8, |_| true), places.query(&views[20], 8, |_| true));
        // A signature longer than any would make sums overflow.
        let long = (vec![1_u32], vec![[[[i16::MAX; 2]; 12]; 8]]);
        bytes.clear();
        long.put(&mut bytes);
        assert!(PlaceIndex::take(&mut &bytes[..]).is_none());
    }

    #[test]
    fn nothing_is_found_where_nothing_is_seen() {
        let views = views(3);
        let mut places = index(&views);
        for nothing in [&[][..], &[[f64::NAN, 1.0]; 50], &[[1e300, -1e300]; 50], &[[1.0, 1.0]; 50]] {
            assert!(places.query(nothing, 5, |_| true).is_empty());
            places.add(NodeId::new(99), nothing);
        }
        assert!(places.query(&views[0], 10, |node| node.index() == 99).is_empty());
        assert_eq!(places.query(&views[0], 10, |_| true)[0].node.index(), 0);
    }

    fn any_points() -> impl Strategy<Value = Vec<[f64; 2]>> {
        let value = prop_oneof![8 => -10.0..10.0, 1 => proptest::num::f64::ANY];
        prop::collection::vec([value.clone(), value], 0..300)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn any_points_may_come(a in any_points(), b in any_points()) {
            let mut places = PlaceIndex::default();
            places.add(NodeId::new(1), &a);
            places.add(NodeId::new(2), &b);
            let hits = places.query(&a, 3, |_| true);
            for hit in &hits {
                prop_assert!((0.0..=1.0).contains(&hit.distance));
                prop_assert!(hit.heading_rad.is_none_or(|rad| rad > -0.5 * PI - 0.05 && rad <= 0.5 * PI + 0.05));
            }
            prop_assert_eq!(places.query(&a, 3, |_| true), hits);
        }

        #[test]
        fn order_of_points_does_not_matter(points in any_points()) {
            let mut places = PlaceIndex::default();
            places.add(NodeId::new(1), &points);
            let reversed: Vec<_> = points.iter().rev().copied().collect();
            for hit in places.query(&reversed, 1, |_| true) {
                prop_assert!(hit.distance < 1e-3, "{}", hit.distance);
            }
        }
    }

    #[test]
    fn a_crowd_of_points_is_thinned() {
        let mut rng = Rng::new(1);
        let crowd: Vec<_> = (0..50_000).map(|_| [rng.uniform(-8.0, 8.0), rng.uniform(-8.0, 8.0)]).collect();
        let mut places = PlaceIndex::default();
        places.add(NodeId::new(1), &crowd);
        assert!(places.query(&crowd, 1, |_| true)[0].distance < 1e-3);
    }
}
