//! A session as bytes.

use super::{MAGIC, Session, VERSION};
use crate::keyframe::{Edge, EdgeKind, Keyframe, KeyframeId};
use mapwright_geom::{Cov3, Pose2};
use mapwright_sensor::LaserModel;
use std::collections::BTreeMap;
use std::sync::Arc;

impl Session {
    /// The session's bytes; what names a keyframe that is not in it is left out.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let codes: usize = self.keyframes.iter().map(|keyframe| keyframe.sweep.codes.len()).sum();
        let most = 64 * self.scans.len() + 128 * self.keyframes.len() + 2 * codes + 96 * self.edges.len();
        let mut out = Bytes(Vec::with_capacity(most + self.settings.len() + 1024));
        out.0.extend_from_slice(MAGIC);
        out.0.extend_from_slice(&VERSION.to_le_bytes());
        out.text(&self.settings);
        let lasers = Lasers::of(&self.keyframes);
        out.count(lasers.models.len());
        lasers.models.iter().for_each(|laser| out.laser(laser));
        out.count(self.scans.len());
        for scan in &self.scans {
            out.0.extend_from_slice(&scan.stamp.0.to_le_bytes());
            out.pose(scan.map_from_robot);
            out.pose(scan.odom_from_robot);
        }
        let keyframes: Vec<_> = self.keyframes.iter().zip(&self.map_from_keyframe).collect();
        out.count(keyframes.len());
        let mut place = BTreeMap::new();
        for (at, (keyframe, map_from_keyframe)) in keyframes.into_iter().enumerate() {
            place.insert(keyframe.id, at as u32);
            out.keyframe(keyframe, *map_from_keyframe, lasers.place(&keyframe.sweep.laser));
        }
        let ends = |edge: &Edge| Some([*place.get(&edge.from)?, *place.get(&edge.to)?]);
        let edges: Vec<_> = self.edges.iter().filter_map(|edge| Some((ends(edge)?, edge))).collect();
        out.count(edges.len());
        edges.into_iter().for_each(|(ends, edge)| out.edge(ends, edge));
        let checksum = crc32fast::hash(&out.0);
        out.0.extend_from_slice(&checksum.to_le_bytes());
        out.0
    }
}

/// The distinct lasers, in the order of their first keyframes.
struct Lasers<'a> {
    models: Vec<&'a Arc<LaserModel>>,
}

impl<'a> Lasers<'a> {
    fn of(keyframes: &'a [Keyframe]) -> Self {
        let mut lasers = Self { models: Vec::new() };
        for keyframe in keyframes {
            if lasers.find(&keyframe.sweep.laser).is_none() {
                lasers.models.push(&keyframe.sweep.laser);
            }
        }
        lasers
    }

    fn find(&self, laser: &Arc<LaserModel>) -> Option<usize> {
        // the newest is the likeliest
        self.models.iter().rposition(|model| Arc::ptr_eq(model, laser) || *model == laser)
    }

    fn place(&self, laser: &Arc<LaserModel>) -> usize {
        self.find(laser).unwrap_or(0)
    }
}

struct Bytes(Vec<u8>);

impl Bytes {
    /// Saturates; nothing in memory is longer than what the number can say but in theory.
    fn count(&mut self, count: usize) {
        self.0.extend_from_slice(&u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.count(text.len());
        self.0.extend_from_slice(text.as_bytes());
    }

    fn number(&mut self, value: f64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn pose(&mut self, pose: Pose2) {
        [pose.x, pose.y, pose.theta].into_iter().for_each(|value| self.number(value));
    }

    fn laser(&mut self, laser: &LaserModel) {
        self.text(&laser.name);
        let numbers =
            [laser.angle_min_rad, laser.angle_step_rad, laser.range_min_m, laser.range_max_m, laser.beam_period_s];
        numbers.into_iter().for_each(|value| self.number(value));
        self.pose(laser.robot_from_laser);
        self.0.push(u8::from(laser.inverted));
    }

    fn id(&mut self, id: KeyframeId) {
        self.0.extend_from_slice(&id.robot.to_le_bytes());
        self.0.extend_from_slice(&id.session.to_le_bytes());
        self.0.extend_from_slice(&id.seq.to_le_bytes());
    }

    fn keyframe(&mut self, keyframe: &Keyframe, map_from_keyframe: Pose2, laser: usize) {
        self.id(keyframe.id);
        self.0.extend_from_slice(&keyframe.stamp.0.to_le_bytes());
        self.0.extend_from_slice(&keyframe.scan.to_le_bytes());
        self.pose(map_from_keyframe);
        self.count(laser);
        self.number(keyframe.sweep.step_m);
        keyframe.sweep.twist_per_s.into_iter().for_each(|rate| self.number(rate));
        self.0.push(u8::from(keyframe.sweep.scatters));
        self.count(keyframe.sweep.codes.len());
        self.0.reserve(2 * keyframe.sweep.codes.len());
        keyframe.sweep.codes.iter().for_each(|code| self.0.extend_from_slice(&code.to_le_bytes()));
    }

    fn edge(&mut self, [from, to]: [u32; 2], edge: &Edge) {
        self.0.extend_from_slice(&from.to_le_bytes());
        self.0.extend_from_slice(&to.to_le_bytes());
        self.0.push(match edge.kind {
            EdgeKind::Odometry => 0,
            EdgeKind::Match => 1,
            EdgeKind::Closure => 2,
        });
        self.pose(edge.from_from_to);
        let information: &Cov3 = &edge.information;
        for row in 0..3 {
            (row..3).for_each(|column| self.number(information[(row, column)]));
        }
    }
}
