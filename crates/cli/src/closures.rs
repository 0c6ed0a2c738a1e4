//! `closures.json`: every place the robot may have come back to, what speaks for it and what was decided.

use crate::failure::Failure;
use mapwright::{Candidate, Keyframe, KeyframeId, Mapper, Mended, Verdict};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Its name in the folder of results.
pub(crate) const CLOSURES: &str = "closures.json";

/// Between which keyframes closures were taken back and none stands: the edges they once were say nothing any more.
pub(crate) fn taken_back(candidates: &[Candidate]) -> BTreeSet<[KeyframeId; 2]> {
    let between = |is: fn(Verdict) -> bool| {
        candidates.iter().filter(move |candidate| is(candidate.verdict)).map(|candidate| [candidate.from, candidate.to])
    };
    let standing: BTreeSet<_> = between(|verdict| verdict == Verdict::Accepted).collect();
    between(|verdict| matches!(verdict, Verdict::TakenBack(_))).filter(|pair| !standing.contains(pair)).collect()
}

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
}

/// A verdict without its reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) enum VerdictName {
    #[serde(rename = "accepted")]
    Accepted,
    #[serde(rename = "waiting")]
    Waiting,
    #[serde(rename = "taken back")]
    TakenBack,
    #[serde(rename = "refused")]
    Refused,
}

impl VerdictName {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Waiting => "waiting",
            Self::TakenBack => "taken back",
            Self::Refused => "refused",
        }
    }
}

impl From<Verdict> for VerdictName {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Accepted => Self::Accepted,
            Verdict::Waiting(_) => Self::Waiting,
            Verdict::TakenBack(_) => Self::TakenBack,
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
    /// All candidates of a run in the order they were looked at.
    pub(crate) fn of(mapper: &Mapper) -> Self {
        let keyframes = mapper.keyframes();
        let candidates = mapper.candidates().iter().map(|candidate| record(candidate, keyframes)).collect();
        let slips = mapper.slips().iter().map(|&Mended { scan, from, metres }| SlipRecord {
            from,
            from_stamp_s: keyframes.get(from as usize).map(|keyframe| keyframe.stamp.as_secs_f64()),
            scan,
            metres,
        });
        Self { keyframes: keyframes.len(), candidates, slips: slips.collect() }
    }

    /// Reads the file, or that of a folder of results.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let path = if path.is_dir() { path.join(CLOSURES) } else { path.to_owned() };
        let text = fs::read(&path).map_err(|error| Failure::open(&path, error))?;
        let file: Self = serde_json::from_slice(&text)
            .map_err(|error| Failure::Candidates { path: path.clone(), cause: error.to_string() })?;
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

fn record(candidate: &Candidate, keyframes: &[Keyframe]) -> CandidateRecord {
    let stamp_s = |id: KeyframeId| keyframes.get(id.seq as usize).map(|keyframe| keyframe.stamp.as_secs_f64());
    let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
    let evidence = &candidate.evidence;
    let found = candidate.from_from_to.filter(|pose| pose.is_finite());
    let sigmas = [0, 1, 2].map(|k: usize| candidate.covariance[(k, k)].max(0.0).sqrt());
    CandidateRecord {
        from: candidate.from.seq,
        to: candidate.to.seq,
        from_stamp_s: stamp_s(candidate.from),
        to_stamp_s: stamp_s(candidate.to),
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
        from_from_to: found.map(|pose| [pose.x, pose.y, pose.theta]),
        sigmas: found.and(Some(sigmas).filter(|sigmas| sigmas.iter().all(|sigma| sigma.is_finite()))),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright::{Cov3, Detection, Evidence, Objection, Pose2};

    fn candidate(from: u32, to: u32, verdict: Verdict) -> Candidate {
        let id = |seq| KeyframeId { robot: 0, session: 0, seq };
        Candidate {
            from: id(from),
            to: id(to),
            detection: Detection::Place,
            evidence: Evidence { points: 90, score: Some(0.5), overlap: Some(f64::NAN), ..Evidence::default() },
            verdict,
            from_from_to: Some(Pose2::new(1.0, 2.0, 0.5)),
            covariance: Cov3::from_diagonal_element(0.04),
        }
    }

    #[test]
    fn what_was_taken_back_is_gone_unless_it_was_found_again() {
        let gone = Verdict::TakenBack(Objection::Outvoted);
        let refused = Verdict::Refused(Objection::Improbable);
        let candidates = [
            candidate(1, 9, gone),
            candidate(1, 9, refused),
            candidate(2, 9, gone),
            candidate(2, 9, Verdict::Accepted),
            candidate(3, 9, refused),
        ];
        let gone: Vec<_> = taken_back(&candidates).into_iter().map(|[from, to]| [from.seq, to.seq]).collect();
        assert_eq!(gone, [[1, 9]]);
    }

    #[test]
    fn a_candidate_keeps_its_numbers_and_nothing_infinite() {
        let record = record(&candidate(3, 40, Verdict::Refused(Objection::Ambiguous)), &[]);
        assert_eq!((record.from, record.to, record.verdict), (3, 40, VerdictName::Refused));
        assert_eq!(record.from_stamp_s, None);
        assert_eq!(record.reason.as_deref(), Some("another pose fits nearly as well"));
        assert_eq!((record.evidence.score, record.evidence.overlap), (Some(0.5), None));
        assert!((record.sigmas.unwrap()[2] - 0.2).abs() < 1e-12);
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(serde_json::from_str::<CandidateRecord>(&text).unwrap(), record);
    }
}
