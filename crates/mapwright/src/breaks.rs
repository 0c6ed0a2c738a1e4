//! Breaks: where the robot may be so far from where it is predicted that nothing of what it knows can be matched against. A match
//! always finds something, and after a break it is soon the wrong corridor. So a fragment begins there, mapped at full quality, and
//! detection looks for a join ([`mapwright_loops::Closing`]). Written once for the plane and for space.

use crate::front_end::{CovarianceOf, FrontEnd, Maps, MatchedOf, PreparedOf, Reading};
use crate::settings::LivePolicy;
use mapwright_geom::{Pose, TangentMatrix};
use mapwright_record::{FragmentStart, Past};

/// After so many scans in a row that fit nowhere it is not where it is thought to be.
const LOST_SCANS: u32 = 10;
/// After so many scans that saw nothing, or usual periods in which nothing was said, and so many seconds, a robot may have been carried away.
const BLIND_SCANS: u32 = 20;
const BLIND_S: f64 = 4.0;
/// Variances of where it is then, m^2 and rad^2.
const ANYWHERE: [f64; 2] = [1e4, 10.0];

/// Covariance of where a robot is of which nothing is known.
pub(crate) fn anywhere<P: Pose>() -> P::Matrix {
    let [m2, rad2] = ANYWHERE;
    P::Matrix::from_variances(m2, rad2)
}

/// That of the link over a break, where odometry and velocity say that it is so uncertain.
pub(crate) fn over_break<M: Maps>(start: FragmentStart, by_motion: CovarianceOf<M>) -> CovarianceOf<M> {
    match start {
        FragmentStart::Lost | FragmentStart::SwitchedOn => anywhere::<M::Pose>(),
        _ => by_motion,
    }
}

/// The scan that was just prepared, matched; or why a fragment begins with it, and then nothing that is known is matched against any more.
/// `switched_on` where one begins as soon as something is seen.
pub(crate) fn match_or_begin<M: Maps>(
    front: &mut M::FrontEnd,
    past: Past<'_, M>,
    scan: &M::Scan,
    prepared: &mut PreparedOf<M>,
    switched_on: Option<FragmentStart>,
) -> Result<Option<MatchedOf<M>>, FragmentStart> {
    if let Some(why) = switched_on.filter(|_| past.newest().is_some() && front.sees()) {
        front.leave();
        return Err(why);
    }
    let why = match may_be_elsewhere::<M>(front, past, scan, prepared) {
        Some(why) => why,
        None => {
            let matched = front.track(past, scan, prepared);
            let keeps_everything = front.settings().live.policy == LivePolicy::Everything;
            let is_nowhere = matched.as_ref().is_some_and(|matched| front.is_found_nowhere(prepared, matched));
            if keeps_everything || !is_nowhere {
                return Ok(matched);
            }
            FragmentStart::Lost
        }
    };
    if front.is_known_to_be(past, scan, prepared, why) {
        return Ok(front.track(past, scan, prepared));
    }
    front.leave();
    Err(why)
}

/// Why the robot may be far from where it is predicted, if it may, by what is known before the scan is matched.
fn may_be_elsewhere<M: Maps>(
    front: &M::FrontEnd,
    past: Past<'_, M>,
    scan: &M::Scan,
    prepared: &PreparedOf<M>,
) -> Option<FragmentStart> {
    let keeps_everything = front.settings().live.policy == LivePolicy::Everything;
    if past.newest().is_none() || !front.sees() || keeps_everything {
        return None;
    }
    let (watch, stamp) = (*front.watch(), scan.stamp());
    let (blank, blind_s) = watch.blind(stamp);
    let is_long = |seconds: f64| seconds > BLIND_S.max(f64::from(BLIND_SCANS) * front.usual_period_s());
    // Without returns it may have been carried, whatever the wheels say; and where they said nothing either, or that it stands: while they
    // say that it drives they are believed, for there are logs with a scan every metre, and a quarter of a minute between two.
    let is_blind = blank >= BLIND_SCANS && blind_s > BLIND_S
        || is_long(watch.silence_s(stamp))
        || is_long(blind_s) && front.has_stood(prepared);
    let may_have_strayed = watch.misfits > 0 || front.is_after_gap(prepared);
    if watch.misfits >= LOST_SCANS {
        Some(FragmentStart::Lost)
    } else if is_blind {
        Some(FragmentStart::Blind)
    } else if may_have_strayed && front.has_strayed(prepared) {
        Some(FragmentStart::Uncertain)
    } else {
        None
    }
}
