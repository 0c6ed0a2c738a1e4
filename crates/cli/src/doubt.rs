//! Where a run came into doubt, for how long, and why.

use crate::terminal::{count, grouped};
use mapwright::{DOUBT_SHARE, DOUBT_SIGMAS, KNOWN_SHARE, LOST_SHARE, MatchReport, Stamp, Status, Update};
use serde_json::{Value, json};
use std::fmt::Write;

/// So many scans in a row must be tracked before a spell of doubt is over.
const OVER_AFTER: u64 = 20;
/// More time than this between two scans is a gap, seconds.
const GAP_S: f64 = 1.0;
/// A gap may be the cause of what goes wrong up to so many scans later.
const BLAMED_FOR: u64 = 100;

/// A scan that was not tracked.
#[derive(Debug, Clone, Copy)]
struct DoubtfulScan {
    scan: u64,
    stamp: Stamp,
    status: Status,
    matched: Option<MatchReport>,
    refused: Option<&'static str>,
    gap: Option<Gap>,
    by_odometry: bool,
}

/// A time without a scan, seconds, and the scan that ended it.
#[derive(Debug, Clone, Copy)]
struct Gap {
    seconds: f64,
    scan: u64,
}

/// Scans close to each other that were not tracked.
#[derive(Debug, Clone, Copy)]
struct Spell {
    first: DoubtfulScan,
    last_scan: u64,
    scans: u64,
    lost: u64,
    least_inlier_share: f64,
}

/// The first spell of doubt, the one with most doubtful scans, and the first scan that was lost.
#[derive(Debug, Clone, Default)]
pub(crate) struct Doubts {
    spells: u64,
    scans: u64,
    first: Option<Spell>,
    worst: Option<Spell>,
    open: Option<Spell>,
    first_lost: Option<DoubtfulScan>,
    last_stamp: Option<Stamp>,
    /// Whether the last scan was tracked.
    is_over: bool,
    last_gap: Option<Gap>,
}

impl Doubts {
    /// Takes note of a scan; `by_odometry` says what predicted its pose.
    pub(crate) fn add(&mut self, update: &Update, by_odometry: bool) {
        let seconds = self.last_stamp.map_or(0.0, |last| update.stamp.secs_since(last));
        self.last_stamp = Some(update.stamp);
        if seconds > GAP_S {
            self.last_gap = Some(Gap { seconds, scan: update.scan });
        }
        self.is_over = update.status == Status::Tracking;
        if self.is_over {
            return;
        }
        let Update { scan, stamp, status, matched, refused, .. } = *update;
        let gap = self.last_gap.filter(|gap| scan - gap.scan <= BLAMED_FOR);
        let doubtful = DoubtfulScan { scan, stamp, status, matched, refused, gap, by_odometry };
        if status == Status::Lost {
            self.first_lost.get_or_insert(doubtful);
        }
        self.scans += 1;
        self.extend(doubtful);
    }

    fn extend(&mut self, doubtful: DoubtfulScan) {
        let open = self.open.filter(|spell| doubtful.scan - spell.last_scan <= OVER_AFTER);
        self.spells += u64::from(open.is_none());
        let spell = open.map_or(Spell::of(doubtful), |spell| spell.and(&Spell::of(doubtful)));
        self.open = Some(spell);
        if self.spells == 1 {
            self.first = Some(spell);
        }
        if self.worst.is_none_or(|worst| spell.scans > worst.scans) {
            self.worst = Some(spell);
        }
    }

    /// For `report.json`.
    pub(crate) fn report(&self) -> Value {
        json!({
            "spells": self.spells,
            "first": self.first.map(|spell| spell.report()),
            "worst": self.worst.map(|spell| spell.report()),
            "first_lost": self.first_lost.map(|doubtful| doubtful.report()),
        })
    }

    /// For people; empty where every scan was tracked.
    pub(crate) fn words(&self) -> String {
        let (Some(first), Some(worst)) = (self.first, self.worst) else { return String::new() };
        let over = match self.spells {
            _ if !self.is_over => "",
            1 => "; tracking went on afterwards",
            _ => "; each time tracking went on afterwards",
        };
        let mut text = format!("doubt    {} in {}{over}\n", count(self.scans, "scan"), count(self.spells, "spell"));
        let _ = writeln!(text, "         first: {}", first.words());
        if worst.first.scan != first.first.scan {
            let _ = writeln!(text, "         worst: {}", worst.words());
        }
        if let Some(lost) = self.first_lost.filter(|lost| lost.scan != first.first.scan) {
            let _ = writeln!(text, "         lost:  {}: {}", lost.place(), lost.why());
        }
        text
    }
}

impl Spell {
    fn of(first: DoubtfulScan) -> Self {
        let lost = u64::from(first.status == Status::Lost);
        let least_inlier_share = first.matched.map_or(0.0, |report| report.inlier_share);
        Self { first, last_scan: first.scan, scans: 1, lost, least_inlier_share }
    }

    fn and(&self, later: &Self) -> Self {
        Self {
            first: self.first,
            last_scan: later.last_scan,
            scans: self.scans + later.scans,
            lost: self.lost + later.lost,
            least_inlier_share: self.least_inlier_share.min(later.least_inlier_share),
        }
    }

    fn report(&self) -> Value {
        let mut report = self.first.report();
        report["last_scan"] = json!(self.last_scan);
        report["scans"] = json!(self.scans);
        report["lost_scans"] = json!(self.lost);
        report["least_inlier_share"] = json!(self.least_inlier_share);
        report
    }

    fn words(&self) -> String {
        let mut text = self.first.place();
        if self.scans > 1 {
            let (until, percent) = (grouped(self.last_scan), 100.0 * self.least_inlier_share);
            let _ = write!(text, ", {} until {until}, down to {percent:.0} % of the beams", count(self.scans, "scan"));
        }
        text + ": " + &self.first.why()
    }
}

impl DoubtfulScan {
    fn report(&self) -> Value {
        json!({
            "scan": self.scan,
            "stamp_s": self.stamp.as_secs_f64(),
            "status": self.status.name(),
            "why": self.why(),
            "inlier_share": self.matched.map(|report| report.inlier_share),
            "known_share": self.matched.map(|report| report.known_share),
            "prediction_sigmas": self.matched.map(|report| report.odometry_sigmas),
            "restarts": self.matched.map(|report| report.restarts),
            "searched": self.matched.map(|report| report.searched),
            "gap_before": self.gap.map(|gap| json!({ "scan": gap.scan, "seconds": gap.seconds })),
        })
    }

    fn place(&self) -> String {
        format!("{} from scan {} at {:.3}", self.status.name(), grouped(self.scan), self.stamp.as_secs_f64())
    }

    /// What was found and what was expected.
    fn why(&self) -> String {
        let Some(report) = &self.matched else {
            return self.refused.map_or("not one beam returned".to_owned(), |reason| format!("refused, {reason}"));
        };
        let mut why = Vec::new();
        let least = if self.status == Status::Lost { LOST_SHARE } else { DOUBT_SHARE };
        if report.inlier_share < least {
            let [share, known, least] = [report.inlier_share, report.known_share, least].map(|share| 100.0 * share);
            why.push(format!(
                "{share:.1} % of the beams fit the map, {least:.0} % expected ({known:.0} % end where it is known)"
            ));
        }
        if report.known_share < KNOWN_SHARE {
            let [known, least] = [report.known_share, KNOWN_SHARE].map(|share| 100.0 * share);
            why.push(format!("{known:.0} % of the beams end where the map is known, {least:.0} % expected"));
        }
        if report.odometry_sigmas > DOUBT_SIGMAS {
            let (sigmas, by) =
                (report.odometry_sigmas, if self.by_odometry { "odometry" } else { "constant velocity" });
            why.push(format!("{sigmas:.1} sigmas from the prediction by {by}, at most {DOUBT_SIGMAS:.0} expected"));
        }
        if report.unconfirmed && report.inlier_share >= DOUBT_SHARE {
            why.push("it fits only what was mapped since a scan that did not fit".to_owned());
        }
        if let Some(gap) = self.gap {
            why.push(format!("{:.1} s without a scan before scan {}", gap.seconds, grouped(gap.scan)));
        }
        if report.restarts > 0 {
            why.push(format!("{} tried", count(u64::from(report.restarts), "other start")));
        }
        if report.searched {
            why.push("all poses around searched".to_owned());
        }
        why.join("; ")
    }
}
