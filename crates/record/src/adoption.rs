//! What one session tells, as another one takes it in: of robots that drive at the same time and share one map.

use crate::closure::Candidate;
use crate::entry::{Entry, RecordedEdge};
use crate::id::RunId;
use crate::keyframe::{EdgeKind, Keyframe, Measurement};
use crate::session::Session;
use std::sync::Arc;

/// What grows by entries: a session, or a mapper's store around one.
pub trait Grows<M: Measurement> {
    /// As it is.
    fn session(&self) -> &Session<M>;

    /// Writes an entry; false where it does not fit.
    fn write(&mut self, entry: Entry<M>) -> bool;
}

impl<M: Measurement> Grows<M> for Session<M> {
    fn session(&self) -> &Session<M> {
        self
    }

    fn write(&mut self, entry: Entry<M>) -> bool {
        self.add(entry).is_ok()
    }
}

/// What the entries of a robot's own session are called in the session that takes them in, group by group.
///
/// A group is a keyframe with the entries after it up to the next one ([`groups`]). Edges and candidates get other numbers there, keyframes
/// other poses, and their scans are none; corrections and what the robot's mapper knew of itself stay with the robot.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Adoption {
    run: Option<RunId>,
    /// By their numbers in the robot's session; none where one was not taken in.
    edges: Vec<Option<u32>>,
    candidates: Vec<Option<u32>>,
}

/// The entries of a session by the keyframes that they came with; what stands before the first of them is a group without a keyframe.
pub fn groups<M: Measurement>(entries: &[Entry<M>]) -> impl Iterator<Item = &[Entry<M>]> {
    let mut left = entries;
    std::iter::from_fn(move || {
        let next = left.iter().skip(1).position(|entry| matches!(entry, Entry::Keyframe { .. }));
        let (group, rest) = left.split_at(next.map_or(left.len(), |at| at + 1));
        left = rest;
        (!group.is_empty()).then_some(group)
    })
}

/// Where the keyframe of a group lies in a session, by the edges that lead to it; as its robot has it where there are none.
#[must_use]
pub fn place_of<M: Measurement>(session: &Session<M>, group: &[Entry<M>]) -> Option<M::Pose> {
    let (id, own) = group.iter().find_map(|entry| match entry {
        Entry::Keyframe { keyframe, map_from_keyframe } => Some((keyframe.id, *map_from_keyframe)),
        _ => None,
    })?;
    let leads = |entry: &Entry<M>| match entry {
        Entry::Edge(RecordedEdge { edge, .. }) if edge.to == id && edge.kind != EdgeKind::Closure => {
            let map_from_from = *session.map_from_keyframe().get(session.place(edge.from)?)?;
            Some(map_from_from * edge.from_from_to)
        }
        _ => None,
    };
    Some(group.iter().find_map(leads).unwrap_or(own))
}

impl Adoption {
    /// Takes a group of a robot's entries in; its keyframe lies at `map_from_keyframe`. What does not fit is left out, and what refers to it;
    /// how many entries that were.
    pub fn take_in<M: Measurement>(
        &mut self,
        into: &mut impl Grows<M>,
        group: &[Entry<M>],
        map_from_keyframe: Option<M::Pose>,
    ) -> usize {
        let present = into.session().present_run();
        if let Some(run) = self.run.filter(|run| Some(*run) != present) {
            into.write(Entry::BackTo(run));
        }
        group.iter().filter(|entry| !self.take_in_entry(into, entry, map_from_keyframe)).count()
    }

    fn take_in_entry<M: Measurement>(
        &mut self,
        into: &mut impl Grows<M>,
        entry: &Entry<M>,
        map_from_keyframe: Option<M::Pose>,
    ) -> bool {
        match entry {
            Entry::Run(run) => {
                let has_begun = into.session().runs().any(|known| known.id == run.id);
                self.run = Some(run.id);
                into.write(if has_begun { Entry::BackTo(run.id) } else { Entry::Run(run.clone()) })
            }
            Entry::Keyframe { keyframe, map_from_keyframe: own } => {
                let keyframe = with_scan(keyframe, into.session().next_scan());
                let map_from_keyframe = map_from_keyframe.unwrap_or(*own);
                into.write(Entry::Keyframe { keyframe, map_from_keyframe })
            }
            Entry::Edge(RecordedEdge { edge, candidate }) => {
                let number = into.session().recorded_edges().len() as u32;
                let candidate = candidate.and_then(|number| self.candidate(number));
                let is_written = into.write(Entry::Edge(RecordedEdge { edge: *edge, candidate }));
                self.edges.push(is_written.then_some(number));
                is_written
            }
            Entry::Candidate(candidate) => {
                let number = into.session().candidates().len() as u32;
                let is_written = into.write(Entry::Candidate(Candidate { ..*candidate }));
                self.candidates.push(is_written.then_some(number));
                is_written
            }
            Entry::Remeasured { number, from_from_to, information } => self.edge(*number).is_some_and(|number| {
                let (from_from_to, information) = (*from_from_to, *information);
                into.write(Entry::Remeasured { number, from_from_to, information })
            }),
            Entry::Withdrawn { number } => {
                self.edge(*number).is_some_and(|number| into.write(Entry::Withdrawn { number }))
            }
            Entry::Verdict { number, verdict, agreeing } => self.candidate(*number).is_some_and(|number| {
                let (verdict, agreeing) = (*verdict, *agreeing);
                into.write(Entry::Verdict { number, verdict, agreeing })
            }),
            Entry::Fragment(_) | Entry::LeftOut(_) | Entry::Gravity(_) => into.write(entry.clone()),
            Entry::BackTo(_)
            | Entry::Scan(_)
            | Entry::WheelSlip(_)
            | Entry::ResultTakenIn { .. }
            | Entry::OdometryOrigin(_)
            | Entry::Snapshot(_)
            | Entry::Checkpoint(_) => true,
        }
    }

    fn edge(&self, number: u32) -> Option<u32> {
        *self.edges.get(number as usize)?
    }

    fn candidate(&self, number: u32) -> Option<u32> {
        *self.candidates.get(number as usize)?
    }
}

fn with_scan<M: Measurement>(keyframe: &Keyframe<M>, scan: u64) -> Arc<Keyframe<M>> {
    let Keyframe { id, stamp, ref sweep, hardly_fits, .. } = *keyframe;
    Arc::new(Keyframe { id, stamp, scan, sweep: Arc::clone(sweep), hardly_fits })
}
