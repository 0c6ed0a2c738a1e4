//! Whether a map of space can be used, by what its run knows of itself (docs/decisions/0027-verdict.md).

use super::tally::{FitOfCloud, Tally, median};
use super::visits::Revisits;
use crate::terminal::{count, metres};
use crate::verdict::{
    MOTIONS_AT_LEAST, Reason, Usability, Usable, beyond, doubtful, lost, moved, odometry_off, uncertain, unheeded,
    unheeded_places,
};
use crate::wheels::Wheels;
use mapwright::{EdgeKind, KeyframeId, MISFIT_M, MatchReport, Session, SpaceMapper, SpaceSweep, Status, visit_pairs};
use mapwright_eval::RevisitFit;
use mapwright_geom::TangentMatrix;
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::json;
use std::f64::consts::TAU;

/// A match that was in doubt, so that other starts were tried, is doubtful still where a smaller share of the known points fits it.
const CLEAR_SHARE: f64 = 0.94;
/// So many doubtful clouds at least, before their share counts.
const DOUBTFUL_AT_LEAST: usize = 3;
/// and so many, before they make a map unusable: a few clouds tell too little.
const UNUSABLE_AT_LEAST: usize = 10;
/// So many times the usual time between two clouds is a pause.
const PAUSE: f64 = 5.0;
/// The first cloud after a pause fits by so much less than clouds usually do, or lies with less than such a share of it where something is
/// known: it may be anywhere.
const PAUSE_DROP: f64 = 0.03;
const PAUSE_KNOWN: f64 = 0.4;
/// A match so far from its prediction contradicts it, standard deviations: the 99 % quantile of six degrees of freedom. Contradictions
/// count from as much as two of these together on.
const JUMP_SIGMAS: f64 = 4.1;
const JUMPS_SIGMAS: f64 = 2.0 * JUMP_SIGMAS;
/// How far points lie off surfaces, the median of the clouds' medians, of how far the sensor sees.
const OFF_SHARE: [f64; 2] = [0.005, f64::INFINITY];

/// Maps beside the first, of the clouds.
const TORN_SHARE: [f64; 2] = [0.02, 0.1];

/// Wheels and clouds differ by more than this share of the way or of turns: ranges of a lidar are exact to a thousandth, wheels and tyres to
/// a few hundredths.
const WHEELS_OFF: f64 = 0.07;
/// Pairs of visits that are compared at most: registering one takes as long as mapping a cloud.
const VISITS: usize = 40;

/// Directions around the sensor, and the share of them in which nothing was ever seen from which on it may be covered, where at least
/// that share of its beams returned nothing: a sensor that looks one way has no beams there, open sky has some everywhere.
const DIRECTIONS: usize = 72;
const COVERED: f64 = 1.0 / 3.0;

impl FitOfCloud {
    /// Whether it was in doubt, and fits no better than this.
    fn is_below(&self, clear_share: f64) -> bool {
        let is_unclear = |matched: MatchReport| matched.restarts > 0 && matched.inlier_share < clear_share;
        self.status != Status::Tracking || self.matched.is_some_and(is_unclear)
    }

    /// By how many standard deviations it contradicts its prediction; none where it does not.
    fn jump_sigmas(&self) -> Option<f64> {
        self.matched.map(|matched| matched.odometry_sigmas).filter(|sigmas| *sigmas > JUMP_SIGMAS)
    }

    /// Whether, as the first after a pause, it may be anywhere.
    fn is_anywhere(&self, usual_share: f64) -> bool {
        let hangs_loose = self.matched.is_some_and(|matched| matched.known_share < PAUSE_KNOWN);
        hangs_loose || self.jump_sigmas().is_some() || self.is_below(usual_share - PAUSE_DROP)
    }
}

/// What was seen of a run and its map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Facts {
    clouds: usize,
    doubtful: usize,
    lost: usize,
    /// Over which a match that may be anywhere alone carries the map, seconds.
    pauses_s: Vec<f64>,
    /// By how much each match that contradicts its prediction does, standard deviations.
    jumps_sigmas: Vec<f64>,
    /// How far points lie off surfaces, in the median, and how far the sensor sees, metres.
    off_m: f64,
    range_m: f64,
    /// Share of the directions around the sensor in which nothing was ever seen, and of the beams that returned nothing.
    unseen: f64,
    no_return: f64,
    /// Of places of the map relative to where the robot is, metres.
    mean_sigma_m: f64,
    worst_sigma_m: f64,
    /// Places that were recognised where the map does not have them.
    unheeded: usize,
    closures: usize,
    /// Motions of which wheels and clouds both tell; what clouds say, as a multiple of what the wheels say, of turns, of ways; and the
    /// direction of the way beside theirs, degrees.
    wheel_motions: usize,
    turns_of_odometry: f64,
    way_of_odometry: f64,
    aside_deg: f64,
    /// Pairs of visits to a place that were compared, by how much they would have to be moved to fit each other in the mean, and nine of ten
    /// by less, metres.
    compared: usize,
    moved_mean_m: f64,
    moved_90_m: f64,
    /// Maps that nothing holds together.
    maps: usize,
    /// What casts doubt on the recording as it was read, in words.
    doubts: Vec<String>,
}

impl Facts {
    pub(crate) fn of(tally: &Tally, mapper: &mut SpaceMapper) -> Self {
        let fits = tally.fits.as_slice();
        // Of the map in which the robot is: of others nothing says where they lie.
        let maps = mapper.session().maps();
        let newest = mapper.session().keyframes().len().saturating_sub(1);
        let present = maps.iter().find(|map| map.has(newest));
        let certainty = mapper.certainty();
        let session = mapper.session();
        let is_here = |id: KeyframeId| session.place(id).zip(present).is_none_or(|(place, map)| map.has(place));
        let known = certainty.into_iter().filter(|(id, _)| is_here(*id));
        let sigmas_m: Vec<f64> =
            known.map(|(_, covariance)| covariance.position_variance_m2().max(0.0).sqrt()).collect();
        let wheels = wheels(session, tally);
        let (compared, [moved_mean_m, moved_90_m]) = visits(session);
        Self {
            clouds: fits.len(),
            doubtful: fits.iter().filter(|fit| fit.is_below(CLEAR_SHARE)).count(),
            lost: fits.iter().filter(|fit| fit.status == Status::Lost).count(),
            pauses_s: loose_pauses_s(fits),
            jumps_sigmas: fits.iter().filter_map(FitOfCloud::jump_sigmas).collect(),
            off_m: median(fits.iter().filter_map(|fit| fit.matched?.off_m)).unwrap_or(0.0),
            range_m: mapper.range_m().unwrap_or(0.0),
            unseen: unseen(session),
            no_return: tally.no_return_share(),
            mean_sigma_m: sigmas_m.iter().sum::<f64>() / sigmas_m.len().max(1) as f64,
            worst_sigma_m: sigmas_m.iter().copied().fold(0.0, f64::max),
            unheeded: session.maps().first().map_or(0, |map| unheeded(session, map)),
            closures: session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count(),
            wheel_motions: wheels.motions,
            turns_of_odometry: wheels.turns,
            way_of_odometry: wheels.way,
            aside_deg: wheels.aside_rad.to_degrees(),
            compared,
            moved_mean_m,
            moved_90_m,
            maps: maps.len(),
            doubts: Vec::new(),
        }
    }

    /// The same of a recording that was read with doubts.
    pub(crate) fn doubting(self, doubts: &[String]) -> Self {
        Self { doubts: doubts.to_vec(), ..self }
    }

    pub(crate) fn judged(&self) -> Usable {
        let share = |count: usize| count as f64 / self.clouds.max(1) as f64;
        let counted = |reason: Option<Reason>| {
            let most = if self.doubtful < UNUSABLE_AT_LEAST { Usability::Check } else { Usability::Unusable };
            let reason = reason.filter(|_| self.doubtful >= DOUBTFUL_AT_LEAST)?;
            Some(Reason { word: reason.word.min(most), ..reason })
        };
        let reasons = [
            counted(doubtful(share(self.doubtful), "clouds")),
            counted(lost(share(self.lost), "clouds")),
            self.covered(),
            self.paused(),
            self.jumped(),
            self.blurred(),
            self.torn(),
            moved(self.compared, [self.moved_mean_m, self.moved_90_m]),
            uncertain(self.mean_sigma_m, self.worst_sigma_m),
            unheeded_places(self.unheeded),
            odometry_off(&self.wheels(), WHEELS_OFF),
            self.untested(),
            self.misread(),
        ];
        Usable::by(reasons, None, self.all_is_well())
    }

    fn wheels(&self) -> Wheels {
        Wheels {
            motions: self.wheel_motions,
            turns: self.turns_of_odometry,
            way: self.way_of_odometry,
            aside_rad: self.aside_deg.to_radians(),
            lever_m: 0.0,
        }
    }

    fn misread(&self) -> Option<Reason> {
        (!self.doubts.is_empty()).then(|| Reason {
            word: Usability::Check,
            what: "input",
            words: self.doubts.join("; "),
            evidence: json!({ "doubts": self.doubts }),
        })
    }

    fn paused(&self) -> Option<Reason> {
        let longest_s = self.pauses_s.iter().copied().reduce(f64::max)?;
        Some(Reason {
            word: Usability::Check,
            what: "pause",
            words: format!("over a pause of {longest_s:.1} s one doubtful match alone holds the map together"),
            evidence: json!({ "pauses": self.pauses_s.len(), "longest_s": longest_s }),
        })
    }

    fn jumped(&self) -> Option<Reason> {
        let (matches, sigmas) = (self.jumps_sigmas.len(), self.jumps_sigmas.iter().sum::<f64>());
        (sigmas >= JUMPS_SIGMAS).then(|| Reason {
            word: Usability::Check,
            what: "jumps",
            words: format!(
                "where {} found, it should not have been by what was before: {sigmas:.0} standard deviations off",
                if matches == 1 {
                    "1 cloud was".to_owned()
                } else {
                    format!("{} were", count(matches as u64, "cloud"))
                },
            ),
            evidence: json!({ "matches": matches, "sigmas": sigmas, "bound": JUMPS_SIGMAS }),
        })
    }

    fn blurred(&self) -> Option<Reason> {
        let share = self.off_m / self.range_m.max(f64::MIN_POSITIVE);
        Some(Reason {
            word: beyond(share, OFF_SHARE)?,
            what: "blurred",
            words: format!(
                "points lie {:.2} m off the surfaces: are the ranges noisy, or voxels (`space.resolution_m`) too large?",
                self.off_m
            ),
            evidence: json!({ "off_m": self.off_m, "range_m": self.range_m, "bound": OFF_SHARE[0] }),
        })
    }

    /// A recording or two are a map or two; one of which every few clouds begin another fits itself nowhere.
    fn torn(&self) -> Option<Reason> {
        let share = self.maps.saturating_sub(1) as f64 / self.clouds.max(1) as f64;
        Some(Reason {
            word: beyond(share, TORN_SHARE).filter(|_| self.clouds > 0)?,
            what: "torn",
            words: format!(
                "it is torn into {} maps that nothing holds together: are the times of points or stamps right?",
                self.maps
            ),
            evidence: json!({ "maps": self.maps, "clouds": self.clouds, "bounds": TORN_SHARE }),
        })
    }

    /// A single cloud is laid on nothing, and of sessions that were merged it is not known here how their clouds have fitted.
    fn untested(&self) -> Option<Reason> {
        (self.clouds <= 1).then(|| Reason {
            word: Usability::Check,
            what: "untested",
            words: match self.clouds {
                0 => "made of sessions alone, which does not say how clouds have fitted: the report of each does"
                    .to_owned(),
                _ => "one cloud tells nothing: nothing tests the map".to_owned(),
            },
            evidence: json!({ "clouds": self.clouds }),
        })
    }

    fn covered(&self) -> Option<Reason> {
        (self.unseen >= COVERED && self.no_return >= self.unseen).then(|| Reason {
            word: Usability::Check,
            what: "covered",
            words: format!(
                "over {:.0} degrees around the sensor nothing was ever seen, though beams go there: is it covered?",
                360.0 * self.unseen
            ),
            evidence: json!({ "unseen": self.unseen, "no_return": self.no_return, "bound": COVERED }),
        })
    }

    /// Why nothing speaks against it, and what was not asked.
    fn all_is_well(&self) -> String {
        let loops = match self.closures {
            0 => "no loop was closed that would tell drift".to_owned(),
            closures => format!("{} closed", count(closures as u64, "loop")),
        };
        let asks_wheels = self.wheel_motions >= MOTIONS_AT_LEAST;
        let wheels = if asks_wheels { "; wheels say the same way" } else { "" };
        let visits = match self.compared {
            0 => String::new(),
            compared => {
                let seen = count(compared as u64, "pair");
                format!("; {seen} of visits fit each other, to {} in the mean", metres(self.moved_mean_m))
            }
        };
        let not_asked = [(!asks_wheels, "wheels, scale"), (self.compared == 0, "how visits agree")];
        let not_asked: Vec<&str> = not_asked.into_iter().filter(|(is_so, _)| *is_so).map(|(_, what)| what).collect();
        let not_asked =
            if not_asked.is_empty() { String::new() } else { format!("; not asked: {}", not_asked.join(", ")) };
        format!(
            "clouds fit the map, certain to {} in the mean; {loops}{wheels}{visits}{not_asked}",
            metres(self.mean_sigma_m)
        )
    }
}

/// What wheels and clouds say of the same motions.
fn wheels(session: &Session<SpaceSweep>, tally: &Tally) -> Wheels {
    let mapped: Vec<_> = session.trajectory().map(|pose| pose.map_from_robot).collect();
    let pair = |&(scan, odom_from_robot)| Some((odom_from_robot, *mapped.get(session.scan_place(scan)?)?));
    Wheels::in_space(tally.wheels.iter().filter_map(pair))
}

/// How many pairs of visits of the first map were compared, and by how much they are off each other, as in the plane: in the mean, and nine of
/// ten by less, metres.
fn visits(session: &Session<SpaceSweep>) -> (usize, [f64; 2]) {
    let pairs = session.maps().first().map(|map| visit_pairs(session, map, VISITS)).unwrap_or_default();
    let fits = Revisits::of(session).map(|revisits| revisits.fits(&pairs)).unwrap_or_default();
    let moved = |fit: &RevisitFit| match *fit {
        RevisitFit::Moved { metres, .. } => Some(metres.min(MISFIT_M)),
        RevisitFit::Misfit => Some(MISFIT_M),
        RevisitFit::LittleInCommon | RevisitFit::Loose => None,
    };
    let mut moves_m: Vec<f64> = fits.iter().filter_map(moved).collect();
    moves_m.sort_unstable_by(f64::total_cmp);
    let percentile_90_m = moves_m.get(moves_m.len() * 9 / 10).copied().unwrap_or(0.0);
    (moves_m.len(), [moves_m.iter().sum::<f64>() / moves_m.len().max(1) as f64, percentile_90_m])
}

/// Share of the directions around the sensor in which no keyframe saw anything.
fn unseen(session: &Session<SpaceSweep>) -> f64 {
    let mut is_seen = [false; DIRECTIONS];
    for keyframe in session.keyframes() {
        let sensor_from_robot = keyframe.sweep.sensor.robot_from_sensor.inverse();
        for point in keyframe.sweep.points_m() {
            let at = sensor_from_robot.rotation * Vector3::from(point.map(f64::from)) + sensor_from_robot.translation;
            let turns = at.y.atan2(at.x) / TAU + 0.5;
            is_seen[((turns * DIRECTIONS as f64) as usize).min(DIRECTIONS - 1)] = true;
        }
    }
    is_seen.iter().filter(|is_seen| !**is_seen).count() as f64 / DIRECTIONS as f64
}

/// Pauses after which the first cloud may be anywhere.
fn loose_pauses_s(fits: &[FitOfCloud]) -> Vec<f64> {
    let step_s = |pair: &[FitOfCloud]| pair[1].stamp.secs_since(pair[0].stamp);
    let usual_s = median(fits.windows(2).map(step_s)).unwrap_or(f64::INFINITY);
    let usual_share = median(fits.iter().filter_map(|fit| Some(fit.matched?.inlier_share))).unwrap_or(0.0);
    let is_loose = |pair: &&[FitOfCloud]| step_s(pair) > PAUSE * usual_s && pair[1].is_anywhere(usual_share);
    fits.windows(2).filter(is_loose).map(step_s).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright::Stamp;

    fn sound() -> Facts {
        Facts {
            clouds: 100,
            doubtful: 1,
            lost: 0,
            pauses_s: Vec::new(),
            jumps_sigmas: vec![5.0],
            off_m: 0.02,
            range_m: 10.0,
            unseen: 0.0,
            no_return: 0.4,
            mean_sigma_m: 0.02,
            worst_sigma_m: 0.05,
            unheeded: 0,
            closures: 3,
            wheel_motions: 0,
            turns_of_odometry: 1.0,
            way_of_odometry: 1.0,
            aside_deg: 0.0,
            compared: 0,
            moved_mean_m: 0.0,
            moved_90_m: 0.0,
            maps: 1,
            doubts: Vec::new(),
        }
    }

    #[test]
    fn a_sound_map_is_good_and_says_what_was_not_asked() {
        let good = sound().judged();
        assert!(good.word == Usability::Good && good.words().contains("3 loops closed; not asked"), "{}", good.words());
        let two = Facts { maps: 2, ..sound() }.judged();
        assert!(two.word == Usability::Good, "{}", two.words());
        let few = Facts { clouds: 20, doubtful: 2, lost: 1, ..sound() }.judged();
        assert!(few.word == Usability::Good, "{}", few.words());
        let camera = Facts { unseen: 0.8, no_return: 0.3, ..sound() }.judged();
        assert!(camera.word == Usability::Good, "{}", camera.words());
    }

    #[test]
    fn each_reason_is_told() {
        let cases = [
            (Facts { doubtful: 20, ..sound() }, Usability::Check, "20 % of the clouds fit the map badly"),
            (Facts { clouds: 20, doubtful: 3, ..sound() }, Usability::Check, "15 % of the clouds fit the map badly"),
            (Facts { clouds: 10, doubtful: 9, ..sound() }, Usability::Check, "90 % of the clouds fit the map badly"),
            (Facts { doubtful: 60, ..sound() }, Usability::Unusable, "60 % of the clouds fit the map badly"),
            (Facts { doubtful: 3, lost: 1, ..sound() }, Usability::Check, "1.0 % of the clouds fit nowhere"),
            (Facts { pauses_s: vec![2.0, 6.0], ..sound() }, Usability::Check, "over a pause of 6.0 s"),
            (Facts { jumps_sigmas: vec![5.0, 7.0], ..sound() }, Usability::Check, "where 2 clouds were found"),
            (Facts { jumps_sigmas: vec![54.0], ..sound() }, Usability::Check, "54 standard deviations off"),
            (Facts { off_m: 0.2, ..sound() }, Usability::Check, "points lie 0.20 m off the surfaces"),
            (Facts { unseen: 0.5, no_return: 0.5, ..sound() }, Usability::Check, "over 180 degrees around the sensor"),
            (Facts { mean_sigma_m: 2.0, worst_sigma_m: 4.0, ..sound() }, Usability::Check, "certain to 2.0 m only"),
            (Facts { maps: 4, ..sound() }, Usability::Check, "torn into 4 maps"),
            (Facts { way_of_odometry: 1.12, ..sound() }, Usability::Check, "scans say 1.12 times the way of odometry"),
            (Facts { way_of_odometry: 0.91, ..sound() }, Usability::Check, "scans say 0.91 times the way of odometry"),
            (Facts { compared: 9, moved_mean_m: 0.3, ..sound() }, Usability::Check, "walls lie 0.30 m apart"),
            (Facts { maps: 15, ..sound() }, Usability::Unusable, "torn into 15 maps"),
            (Facts { clouds: 1, ..sound() }, Usability::Check, "one cloud tells nothing"),
            (Facts { clouds: 0, doubtful: 0, ..sound() }, Usability::Check, "made of sessions alone"),
            (sound().doubting(&["the camera is assumed".to_owned()]), Usability::Check, "the camera is assumed"),
            (Facts { unheeded: 2, ..sound() }, Usability::Check, "2 places looked like another"),
        ];
        for (facts, word, words) in cases {
            let usable = facts.judged();
            assert!(usable.word == word && usable.words().contains(words), "{}", usable.words());
        }
    }

    /// A cloud that was in doubt, at a time, with shares of points that fit and that lie where something is known, and so far from its
    /// prediction.
    fn fit(s: i64, inlier_share: f64, known_share: f64, odometry_sigmas: f64) -> FitOfCloud {
        let matched = MatchReport {
            beams: 1000,
            inlier_share,
            off_m: Some(0.01),
            known_share,
            odometry_sigmas,
            evaluations: 1,
            restarts: 1,
            searched: false,
            unconfirmed: false,
        };
        FitOfCloud { stamp: Stamp(s * 1_000_000_000), status: Status::Tracking, matched: Some(matched) }
    }

    #[test]
    fn a_pause_counts_where_the_cloud_after_it_may_be_anywhere() {
        let after = |last: FitOfCloud| {
            let before: Vec<_> = (0..10).map(|s| fit(s, 0.98, 0.9, 0.5)).collect();
            loose_pauses_s(&[before, vec![last]].concat())
        };
        assert_eq!(after(fit(20, 0.94, 0.9, 0.5)), [11.0]);
        assert_eq!(after(fit(20, 0.98, 0.3, 0.5)), [11.0]);
        assert_eq!(after(fit(20, 0.98, 0.9, 5.0)), [11.0]);
        assert!(after(fit(20, 0.96, 0.9, 0.5)).is_empty());
        assert!(after(fit(12, 0.94, 0.3, 5.0)).is_empty(), "three steps are no pause");
        assert_eq!(after(FitOfCloud { status: Status::Lost, matched: None, ..fit(20, 1.0, 1.0, 0.0) }), [11.0]);
        assert!(loose_pauses_s(&[]).is_empty());
    }

    #[test]
    fn a_cloud_is_doubtful_where_doubt_was_not_cleared() {
        let doubted = fit(0, 0.9, 0.9, 0.0);
        let sure = doubted.matched.map(|matched| MatchReport { restarts: 0, ..matched });
        assert!(doubted.is_below(CLEAR_SHARE) && !fit(0, 0.95, 0.9, 0.0).is_below(CLEAR_SHARE));
        assert!(!FitOfCloud { matched: sure, ..doubted }.is_below(CLEAR_SHARE));
        assert!(FitOfCloud { status: Status::Degraded, ..fit(0, 1.0, 1.0, 0.0) }.is_below(CLEAR_SHARE));
    }
}
