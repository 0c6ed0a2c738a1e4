//! Logs for tests: any sequence of steps, made into entries that fit.

use crate::*;
use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_sensor::{LaserModel, Sweep};
use proptest::prelude::*;
use std::sync::Arc;

/// What to add next, if it can be added.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) kind: u8,
    pub(crate) a: u32,
    pub(crate) b: u32,
    pub(crate) x: f64,
}

/// Kinds of steps.
pub(crate) const KINDS: u8 = 19;

pub(crate) fn steps(most: usize) -> impl Strategy<Value = Vec<Step>> {
    let step = (0..KINDS, any::<u32>(), any::<u32>(), -1e5..1e5_f64);
    prop::collection::vec(step.prop_map(|(kind, a, b, x)| Step { kind, a, b, x }), 0..most)
}

/// Entries, and the session that they amount to.
#[derive(Debug, Default)]
pub(crate) struct Story {
    pub(crate) entries: Vec<Entry>,
    pub(crate) session: Session,
    lasers: Vec<Arc<LaserModel>>,
}

pub(crate) fn pose(x: f64) -> Pose2 {
    Pose2::new(x, -0.3 * x, 0.01 * x)
}

fn matrix(x: f64) -> Cov3 {
    Cov3::new(4.0, 0.5, x, 0.5, 3.0, -1.0, x, -1.0, 9.0)
}

fn one_of<T: Copy>(choices: &[T], which: u32) -> T {
    choices[which as usize % choices.len()]
}

fn verdict(which: u32) -> Verdict {
    use Objection::*;
    let all = [NoMatch, LittleOverlap, Ambiguous, Unconstrained, Contradiction, Improbable, Alone, Outvoted];
    let why = one_of(&all, which / 4);
    one_of(&[Verdict::Accepted, Verdict::Waiting(why), Verdict::Refused(why), Verdict::Withdrawn(why)], which)
}

impl Story {
    pub(crate) fn of(steps: &[Step]) -> Self {
        let mut story = Self::default();
        story.add(Entry::Run(Run { id: RunId::of_robot("one"), settings: "{\"a\": 1}".to_owned() }));
        steps.iter().for_each(|step| story.step(*step));
        story
    }

    /// What comes after a session.
    pub(crate) fn after(session: Session) -> Self {
        Self { session, ..Self::default() }
    }

    /// One of each kind and more, with two lasers and two runs.
    pub(crate) fn small() -> Self {
        let kinds =
            [1, 3, 4, 1, 3, 5, 1, 3, 9, 3, 6, 5, 13, 1, 7, 10, 11, 12, 2, 8, 0, 1, 3, 4, 5, 11, 14, 12, 15, 17, 16];
        let step = |(k, kind)| Step { kind, a: k as u32, b: 3 * k as u32 + 1, x: 0.25 * k as f64 };
        Self::of(&kinds.into_iter().enumerate().map(step).collect::<Vec<_>>())
    }

    pub(crate) fn add(&mut self, entry: Entry) {
        self.session.add(entry.clone()).unwrap();
        self.entries.push(entry);
    }

    fn any_keyframe(&self, which: u32) -> Option<KeyframeId> {
        let keyframes = self.session.keyframes();
        (!keyframes.is_empty()).then(|| keyframes[which as usize % keyframes.len()].id)
    }

    pub(crate) fn keyframe(&mut self, Step { a, b, x, .. }: Step) -> Option<Entry> {
        if self.lasers.is_empty() {
            self.lasers = [31, 180].map(|beams| Arc::new(LaserModel::half_circle("front", beams))).to_vec();
        }
        let laser = &self.lasers[(a / 3 % 2) as usize];
        let sweep = Sweep {
            laser: Arc::clone(laser),
            codes: (0..a as u16 % 7).map(|beam| beam.wrapping_mul(4099)).collect(),
            step_m: 0.002,
            twist_per_s: [0.5, 0.0, x * 1e-5],
            scatters: a.is_multiple_of(2),
        };
        let keyframe = Keyframe {
            id: self.session.next_id()?,
            stamp: Stamp(i64::from(b) - 1000),
            scan: (self.session.scans().len() as u64).saturating_sub(u64::from(b % 3)),
            sweep: Arc::new(sweep),
            hardly_fits: b.is_multiple_of(2),
        };
        Some(Entry::Keyframe { keyframe: Arc::new(keyframe), map_from_keyframe: pose(x) })
    }

    fn edge(&self, Step { a, b, x, .. }: Step) -> Option<Entry> {
        let (from, to) = (self.any_keyframe(a)?, self.any_keyframe(b)?);
        let kind = one_of(&[EdgeKind::Odometry, EdgeKind::Match, EdgeKind::Closure], a);
        let edge = Edge { from, to, kind, from_from_to: pose(x), information: matrix(x) };
        let candidates = self.session.candidates().len() as u32;
        let candidate = (candidates > 0 && b.is_multiple_of(2)).then(|| a % candidates);
        (from != to).then_some(Entry::Edge(RecordedEdge { edge, candidate }))
    }

    fn candidate(&self, Step { a, b, x, .. }: Step) -> Option<Entry> {
        let to = if b.is_multiple_of(2) { self.session.next_id()? } else { self.any_keyframe(b)? };
        let some = |bit: u32| (b >> bit & 1 == 1).then_some(x + f64::from(bit));
        let evidence = Evidence {
            points: a,
            score: some(0),
            ambiguity: some(1),
            overlap: some(2),
            inlier_share: some(3),
            contradiction: some(4),
            cycle_chi2: some(5),
            agreeing: b,
        };
        Some(Entry::Candidate(Candidate {
            from: self.any_keyframe(a)?,
            to,
            detection: one_of(&[Detection::Pose, Detection::Place, Detection::Match], a),
            evidence,
            verdict: verdict(a),
            from_from_to: some(6).map(pose),
            covariance: matrix(x),
        }))
    }

    fn snapshot(&self, Step { a, b, x, .. }: Step) -> Option<Entry> {
        let some = self.session.keyframes().iter().skip(a as usize % 3).step_by(1 + b as usize % 3);
        let map_from_keyframe = some.enumerate().map(|(k, keyframe)| (keyframe.id, pose(x + k as f64))).collect();
        Some(Entry::Snapshot(Snapshot { number: self.session.corrections() + 1, map_from_keyframe }))
    }

    pub(crate) fn step(&mut self, step: Step) {
        let Step { kind, a, b, x } = step;
        let number = |count: usize| (count > 0).then(|| a % count as u32);
        let edge = number(self.session.recorded_edges().len());
        let start = one_of(
            &[
                FragmentStart::SwitchedOn,
                FragmentStart::Relocalised,
                FragmentStart::Resumed,
                FragmentStart::Uncertain,
                FragmentStart::Blind,
                FragmentStart::Lost,
                FragmentStart::Contradicted,
            ],
            a,
        );
        let reason =
            [LeftOutReason::InTheWay, LeftOutReason::ContradictsTheMap, LeftOutReason::OnTrial, LeftOutReason::Asked];
        let beams = if b.is_multiple_of(3) { Beams::All } else { Beams::These(vec![a % 5, 1, 900]) };
        let entry = match kind {
            0 => {
                let id = RunId { robot: u128::from(a) << 90, session: self.session.runs().count() as u32 };
                Some(Entry::Run(Run { id, settings: format!("größer {x}") }))
            }
            1 | 2 => Some(Entry::Scan(ScanPose {
                stamp: Stamp(i64::from(a)),
                keyframe: self.any_keyframe(a).filter(|_| !b.is_multiple_of(7)),
                keyframe_from_robot: pose(x),
                odom_from_robot: pose(-x),
            })),
            3 => self.keyframe(step),
            4 => self.any_keyframe(a).map(|first| Entry::Fragment(Fragment { first, start })),
            5 | 6 => self.edge(step),
            7 => edge.map(|number| Entry::Remeasured { number, from_from_to: pose(x), information: matrix(-x) }),
            8 => edge.map(|number| Entry::Withdrawn { number }),
            9 => self.candidate(step),
            10 => number(self.session.candidates().len()).map(|number| Entry::Verdict {
                number,
                verdict: verdict(b),
                agreeing: b,
            }),
            11 => self
                .any_keyframe(a)
                .map(|keyframe| Entry::LeftOut(LeftOut { keyframe, beams, reason: one_of(&reason, a) })),
            12 => {
                let from = if b.is_multiple_of(2) { self.session.next_id() } else { self.any_keyframe(b) };
                from.map(|from| Entry::WheelSlip(WheelSlip { scan: u64::from(a), from, metres: x }))
            }
            18 => Some(Entry::ResultTakenIn { scan: u64::from(a) }),
            15 if self.session.odometry_origins().last().is_none_or(|last| last.from_scan < u64::from(a)) => {
                let (from_scan, odom_from_start) = (u64::from(a), pose(x));
                Some(Entry::OdometryOrigin(OdometryOrigin { from_scan, odom_from_start }))
            }
            17 => self.any_keyframe(a).map(|keyframe| {
                let (sine, cosine) = (1e-5 * x).sin_cos();
                Entry::Gravity(Gravity { keyframe, down_in_keyframe: [sine, 0.0, -cosine], sigma_rad: 0.02 })
            }),
            16 => Some(Entry::Checkpoint(Checkpoint { state: vec![a as u8; b as usize % 40].into() })),
            _ => self.snapshot(step),
        };
        entry.into_iter().for_each(|entry| self.add(entry));
    }
}
