//! A map of its own, made while nobody knows where it belongs: a front end and a store, without loops.

use crate::front::FrontEnd;
use crate::settings::{LivePolicy, Settings};
use crate::store::{Link, Store};
use mapwright_geom::Pose2;
use mapwright_record::{MatchReport, NodeId, Past, RunId};
use mapwright_sensor::LaserScan;

/// A provisional map.
#[derive(Debug, Clone)]
pub(crate) struct Provisional {
    pub(super) front: FrontEnd,
    store: Store,
}

/// What a scan did to it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub(crate) matched: Option<MatchReport>,
    pub(crate) is_keyframe: bool,
}

impl Provisional {
    /// An empty one; wheels and gyroscope go on as in `front`.
    pub(super) fn new(front: &FrontEnd) -> Self {
        let mut settings: Settings = *front.settings();
        settings.live.policy = LivePolicy::Everything;
        Self { front: FrontEnd::going_on_from(front, settings), store: Store::new(RunId::default(), String::new()) }
    }

    pub(super) fn past(&self) -> Past<'_> {
        self.store.past()
    }

    /// Where the robot is relative to a keyframe.
    pub(crate) fn keyframe_from_robot(&self, node: NodeId) -> Pose2 {
        self.past().pose(node).between(self.front.pose().local_from_robot())
    }

    pub(super) fn add_scan(&mut self, scan: &LaserScan) -> Seen {
        let Self { front, store } = self;
        let prepared = front.prepare(scan);
        let matched = front.track(store.past(), scan, &prepared);
        front.settle(store.past(), scan, &prepared, matched.as_ref());
        let slipped = front.watch_slips(store.past(), prepared.step, matched.as_ref(), false, |_| false);
        if let Some(slipped) = slipped {
            let before = store.shift(&slipped, |_, _, _| false);
            front.slip(store.past(), &before, &slipped);
        }
        let new = front.new_keyframe(store.past(), scan, matched.as_ref());
        let written = new.as_ref().and_then(|new| store.add_keyframe(new, Link::Odometry, |_, _| true));
        if let (Some(new), Some(written)) = (&new, &written) {
            front.wrote(store.past(), new, written);
        }
        front.follow(store.past(), written.is_some());
        store.add_scan(scan.stamp, front.pose().local_from_robot(), front.pose().odom_from_robot());
        // Nobody is told.
        drop(store.take_fresh());
        Seen { matched: matched.map(|matched| matched.report), is_keyframe: written.is_some() }
    }
}
