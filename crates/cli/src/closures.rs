//! `closures.json`: every place the robot may have come back to, what speaks for it and what was decided.

use crate::failure::Failure;
use crate::foreign::kind_at;
use crate::session::{AnySession, is_session, read_any_session};
use mapwright::{Candidate, Cov3, Cov6, EdgeKind, Fragment, KeyframeId, Pose2, Pose3, Session, Verdict, WheelSlip};
use mapwright_geom::{Pose, Tangent};
use mapwright_record::Measurement;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// Its name in the folder of results.
pub(crate) const CLOSURES: &str = "closures.json";

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ClosureFile {
    /// How many keyframes there are, so that their numbers mean something.
    pub(crate) keyframes: usize,
    pub(crate) candidates: Vec<CandidateRecord>,
    /// Slips of the wheels that scans have told; older files have none.
    #[serde(default)]
    pub(crate) slips: Vec<SlipRecord>,
}

/// Where the wheels slipped, and by how much what was mapped since was moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SlipRecord {
    /// The first keyframe that was moved.
    pub(crate) from: u32,
    pub(crate) from_stamp_s: Option<f64>,
    /// The scan that settled it.
    pub(crate) scan: u64,
    pub(crate) metres: f64,
}

/// A candidate; what was never measured, or is not finite, is null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CandidateRecord {
    /// The old keyframe and the present one, in the run's order.
    pub(crate) from: u32,
    pub(crate) to: u32,
    pub(crate) from_stamp_s: Option<f64>,
    pub(crate) to_stamp_s: Option<f64>,
    pub(crate) detection: String,
    pub(crate) verdict: VerdictName,
    /// What speaks against it, in words.
    pub(crate) reason: Option<String>,
    pub(crate) evidence: EvidenceRecord,
    /// The best pose of `to` in the frame of `from`: metres, metres, radians.
    pub(crate) from_from_to: Option<[f64; 3]>,
    /// Its standard deviations: metres, metres, radians.
    pub(crate) sigmas: Option<[f64; 3]>,
    /// The fragments of `from` and `to` where a break lies between them: as a closure it joins them. Older files have none.
    #[serde(default)]
    pub(crate) joins: Option<[FragmentRecord; 2]>,
    /// Where the chain of edges gave way, if this is a closure that contradicted it. Older files have none.
    #[serde(default)]
    pub(crate) gave_way: Option<StrainedEdge>,
}

/// The edge of a chain that the final map contradicts most.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct StrainedEdge {
    pub(crate) from: u32,
    pub(crate) to: u32,
    pub(crate) to_stamp_s: Option<f64>,
    /// What it was made of.
    pub(crate) kind: String,
    /// How far the map differs from what it says, metres and radians, and by which chi-square.
    pub(crate) metres: f64,
    pub(crate) radians: f64,
    pub(crate) chi2: f64,
}

/// A fragment of the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct FragmentRecord {
    /// What came before it.
    pub(crate) start: String,
    /// Stamp of its first keyframe.
    pub(crate) stamp_s: Option<f64>,
}

/// A verdict without its reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) enum VerdictName {
    #[serde(rename = "accepted")]
    Accepted,
    #[serde(rename = "waiting")]
    Waiting,
    /// Older files call it "taken back".
    #[serde(rename = "withdrawn", alias = "taken back")]
    Withdrawn,
    #[serde(rename = "refused")]
    Refused,
}

impl VerdictName {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Waiting => "waiting",
            Self::Withdrawn => "withdrawn",
            Self::Refused => "refused",
        }
    }
}

impl From<Verdict> for VerdictName {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Accepted => Self::Accepted,
            Verdict::Waiting(_) => Self::Waiting,
            Verdict::Withdrawn(_) => Self::Withdrawn,
            Verdict::Refused(_) => Self::Refused,
        }
    }
}

/// The numbers, each as far as the checks came.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct EvidenceRecord {
    pub(crate) points: u32,
    pub(crate) score: Option<f64>,
    pub(crate) ambiguity: Option<f64>,
    pub(crate) overlap: Option<f64>,
    pub(crate) inlier_share: Option<f64>,
    pub(crate) contradiction: Option<f64>,
    pub(crate) cycle_chi2: Option<f64>,
    pub(crate) agreeing: u32,
}

impl ClosureFile {
    /// All candidates of a session in the order they were looked at.
    pub(crate) fn of<M: Measurement<Pose: Recorded>>(session: &Session<M>) -> Self {
        let slips = session.slips().iter().map(|&WheelSlip { scan, from, metres }| SlipRecord {
            from: place(session, from),
            from_stamp_s: stamp_s(session, from),
            scan,
            metres,
        });
        Self { keyframes: session.keyframes().len(), candidates: records(session), slips: slips.collect() }
    }

    /// Reads the file, or that of a folder of results; of one without it, as runs in space leave it, what its session says.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let is_without = path.is_dir() && !path.join(CLOSURES).exists();
        if is_without && is_session(path)? {
            return Ok(match read_any_session(path)?.0 {
                AnySession::Plane(session) => Self::of(&session),
                AnySession::Space(session) => Self::of(&session),
            });
        }
        let path = if path.is_dir() { path.join(CLOSURES) } else { path.to_owned() };
        let text = fs::read(&path).map_err(|error| Failure::open(&path, error))?;
        let file: Self = serde_json::from_slice(&text).map_err(|error| not_closures(&path, &error))?;
        match file.candidates.iter().position(|c| c.from.max(c.to) as usize >= file.keyframes) {
            None => Ok(file),
            Some(at) => {
                let (found, keyframes) = (file.candidates[at].from.max(file.candidates[at].to), file.keyframes);
                let cause = format!("candidate {at}: expected keyframes below {keyframes}, found {found}");
                Err(Failure::Candidates { path, cause })
            }
        }
    }
}

/// What a record holds of a pose.
pub(crate) trait Recorded: Pose {
    /// A true chain would be contradicted by more once in a thousand times: 99.9 % quantile of chi-square.
    const IMPROBABLE_CHI2: f64;

    /// Metres, metres, radians: in space of the rotation about z.
    fn in_plane(self) -> [f64; 3];
    /// The variances of these.
    fn variances(covariance: &Self::Matrix) -> [f64; 3];
}

impl Recorded for Pose2 {
    const IMPROBABLE_CHI2: f64 = 16.3;

    fn in_plane(self) -> [f64; 3] {
        [self.x, self.y, self.theta]
    }

    fn variances(covariance: &Cov3) -> [f64; 3] {
        [0, 1, 2].map(|k: usize| covariance[(k, k)])
    }
}

impl Recorded for Pose3 {
    const IMPROBABLE_CHI2: f64 = 22.5;

    fn in_plane(self) -> [f64; 3] {
        [self.translation.x, self.translation.y, self.rotation.scaled_axis().z]
    }

    fn variances(covariance: &Cov6) -> [f64; 3] {
        [0, 1, 5].map(|k: usize| covariance[(k, k)])
    }
}

/// All candidates of a session in the order they were looked at.
pub(crate) fn records<M: Measurement<Pose: Recorded>>(session: &Session<M>) -> Vec<CandidateRecord> {
    session.candidates().iter().map(|candidate| record(candidate, session)).collect()
}

/// What a file is that is no list of closures.
fn not_closures(path: &Path, error: &serde_json::Error) -> Failure {
    let expected = "a folder of results of `mapwright map`, or its closures.json";
    match kind_at(path).filter(|kind| !kind.is_json()) {
        Some(kind) => Failure::Log(kind.instead(&path.display().to_string(), expected)),
        None => Failure::Candidates {
            path: path.to_owned(),
            cause: format!("expected {expected}, found no such list: {error}"),
        },
    }
}

/// A keyframe's place in the session; the next one's where it is not there.
fn place<M: Measurement>(session: &Session<M>, id: KeyframeId) -> u32 {
    session.place(id).unwrap_or(session.keyframes().len()) as u32
}

fn stamp_s<M: Measurement>(session: &Session<M>, id: KeyframeId) -> Option<f64> {
    Some(session.keyframes()[session.place(id)?].stamp.as_secs_f64())
}

/// The fragments that a candidate joins, if a break lies between its keyframes.
fn joins<M: Measurement>(candidate: &Candidate<M::Pose>, session: &Session<M>) -> Option<[FragmentRecord; 2]> {
    let ends = [candidate.from, candidate.to].map(|id| place(session, id) as usize);
    let record = |fragment: Fragment| FragmentRecord {
        start: fragment.start.name().to_owned(),
        stamp_s: stamp_s(session, fragment.first),
    };
    session.joined_fragments(ends).map(|both| both.map(record))
}

/// Of the edges between a closure's keyframes that are no closures the one that the map strains most, where the closure contradicted
/// what they said together.
fn gave_way<M: Measurement<Pose: Recorded>>(
    candidate: &Candidate<M::Pose>,
    session: &Session<M>,
) -> Option<StrainedEdge> {
    let is_contradiction = candidate.evidence.cycle_chi2.is_some_and(|chi2| chi2 > M::Pose::IMPROBABLE_CHI2);
    if candidate.verdict != Verdict::Accepted || !is_contradiction {
        return None;
    }
    let within = place(session, candidate.from)..=place(session, candidate.to);
    let poses = session.map_from_keyframe();
    let chain = session.recorded_edges().iter().filter(|known| {
        let is_of_chain = known.recorded.edge.kind != EdgeKind::Closure && !known.withdrawn;
        is_of_chain && known.ends.iter().all(|end| within.contains(end))
    });
    let strained = chain.filter_map(|known| {
        let [from, to] = known.ends;
        let edge = &known.recorded.edge;
        let is = poses.get(from as usize)?.between(*poses.get(to as usize)?);
        let chi2 = edge.from_from_to.local(is).squared_by(&edge.information);
        let by = edge.from_from_to.between(is);
        let kind = if edge.kind == EdgeKind::Odometry { "odometry" } else { "match" };
        let (to_stamp_s, kind) = (stamp_s(session, edge.to), kind.to_owned());
        Some(StrainedEdge { from, to, to_stamp_s, kind, metres: by.length(), radians: by.angle(), chi2 })
    });
    strained.filter(|edge| edge.chi2.is_finite()).max_by(|a, b| a.chi2.total_cmp(&b.chi2).then(b.to.cmp(&a.to)))
}

fn record<M: Measurement<Pose: Recorded>>(candidate: &Candidate<M::Pose>, session: &Session<M>) -> CandidateRecord {
    let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
    let evidence = &candidate.evidence;
    let found = candidate.from_from_to.filter(|pose| pose.is_finite());
    let sigmas = <M::Pose as Recorded>::variances(&candidate.covariance).map(|variance| variance.max(0.0).sqrt());
    CandidateRecord {
        from: place(session, candidate.from),
        to: place(session, candidate.to),
        from_stamp_s: stamp_s(session, candidate.from),
        to_stamp_s: stamp_s(session, candidate.to),
        detection: candidate.detection.name().to_owned(),
        verdict: candidate.verdict.into(),
        reason: candidate.verdict.objection().map(|objection| objection.in_words().to_owned()),
        evidence: EvidenceRecord {
            points: evidence.points,
            score: finite(evidence.score),
            ambiguity: finite(evidence.ambiguity),
            overlap: finite(evidence.overlap),
            inlier_share: finite(evidence.inlier_share),
            contradiction: finite(evidence.contradiction),
            cycle_chi2: finite(evidence.cycle_chi2),
            agreeing: evidence.agreeing,
        },
        from_from_to: found.map(Recorded::in_plane),
        sigmas: found.and(Some(sigmas).filter(|sigmas| sigmas.iter().all(|sigma| sigma.is_finite()))),
        joins: joins(candidate, session),
        gave_way: gave_way(candidate, session),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright::{
        Cov3, Detection, Edge, Entry, Evidence, FragmentStart, Keyframe, LaserModel, Objection, Pose2, RecordedEdge,
        Run, RunId, Stamp, Sweep,
    };
    use std::sync::Arc;

    /// Forty keyframes, and a candidate between the third and the last.
    fn session(verdict: Verdict) -> Session {
        let run = RunId::of_robot("a");
        let mut session = Session::default();
        session.add(Entry::Run(Run { id: run, settings: String::new() })).unwrap();
        let sweep = Arc::new(Sweep::empty(&Arc::new(LaserModel::half_circle("front", 9))));
        for seq in 0..40 {
            let (id, sweep) = (run.keyframe(seq), Arc::clone(&sweep));
            let keyframe = Keyframe { id, stamp: Stamp(0), scan: 0, sweep, hardly_fits: false };
            session.add(Entry::Keyframe { keyframe: keyframe.into(), map_from_keyframe: Pose2::IDENTITY }).unwrap();
        }
        let candidate = Candidate {
            from: run.keyframe(3),
            to: run.keyframe(39),
            detection: Detection::Place,
            evidence: Evidence { points: 90, score: Some(0.5), overlap: Some(f64::NAN), ..Evidence::default() },
            verdict,
            from_from_to: Some(Pose2::new(1.0, 2.0, 0.5)),
            covariance: Cov3::from_diagonal_element(0.04),
        };
        session.add(Entry::Candidate(candidate)).unwrap();
        session
    }

    #[test]
    fn a_candidate_keeps_its_numbers_and_nothing_infinite() {
        let file = ClosureFile::of(&session(Verdict::Refused(Objection::Ambiguous)));
        let record = &file.candidates[0];
        assert_eq!((record.from, record.to, record.verdict), (3, 39, VerdictName::Refused));
        assert_eq!(record.from_stamp_s, Some(0.0));
        assert_eq!(record.reason.as_deref(), Some("another pose fits nearly as well"));
        assert_eq!((record.evidence.score, record.evidence.overlap), (Some(0.5), None));
        assert!((record.sigmas.unwrap()[2] - 0.2).abs() < 1e-12);
        let text = serde_json::to_string(record).unwrap();
        assert_eq!(&serde_json::from_str::<CandidateRecord>(&text).unwrap(), record);
    }

    #[test]
    fn a_candidate_over_a_break_names_the_fragments_that_it_joins() {
        let mut session = session(Verdict::Accepted);
        assert_eq!(ClosureFile::of(&session).candidates[0].joins, None);
        let (run, starts) = (RunId::of_robot("a"), [(0, FragmentStart::SwitchedOn), (30, FragmentStart::Blind)]);
        for (seq, start) in starts {
            session.add(Entry::Fragment(Fragment { first: run.keyframe(seq), start })).unwrap();
        }
        let joins = ClosureFile::of(&session).candidates[0].joins.clone().unwrap();
        assert_eq!(
            joins.map(|fragment| (fragment.start, fragment.stamp_s)),
            [("switched on".to_owned(), Some(0.0)), ("blind".to_owned(), Some(0.0))]
        );
    }

    #[test]
    fn a_closure_that_contradicted_the_chain_names_the_edge_that_gave_way() {
        let mut session = session(Verdict::Accepted);
        let run = RunId::of_robot("a");
        for to in 1..40 {
            // All keyframes lie at the origin; the step to the twentieth says otherwise, and most surely.
            let from_from_to = if to == 20 { Pose2::new(0.0, 0.1, 0.0) } else { Pose2::new(0.01, 0.0, 0.0) };
            let (from, to) = (run.keyframe(to - 1), run.keyframe(to));
            let information = Cov3::from_diagonal_element(100.0);
            let edge = Edge { from, to, kind: EdgeKind::Odometry, from_from_to, information };
            session.add(Entry::Edge(RecordedEdge { edge, candidate: None })).unwrap();
        }
        assert_eq!(
            ClosureFile::of(&session).candidates[0].gave_way,
            None,
            "nothing says that the chain was contradicted"
        );
        let mut candidate = session.candidates()[0];
        candidate.evidence.cycle_chi2 = Some(200.0);
        session.add(Entry::Candidate(candidate)).unwrap();
        let edge = ClosureFile::of(&session).candidates[1].gave_way.clone().unwrap();
        assert_eq!((edge.from, edge.to, edge.kind.as_str()), (19, 20, "odometry"));
        assert!((edge.metres - 0.1).abs() < 1e-12 && edge.radians.abs() < 1e-12 && (edge.chi2 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn older_files_call_what_was_withdrawn_taken_back() {
        let file = ClosureFile::of(&session(Verdict::Withdrawn(Objection::Outvoted)));
        let text = serde_json::to_string(&file).unwrap();
        let older = text.replace("withdrawn", "taken back");
        assert!(text != older && serde_json::from_str::<ClosureFile>(&older).unwrap() == file);
    }
}
