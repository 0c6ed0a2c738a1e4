//! How certain the map is and where to drive next, in words and for `report.json`.

use crate::terminal::without_negative_zeros;
use mapwright::{Advice, Place, SeparateMap, Session};
use serde_json::{Value, json};
use std::fmt::Write;

/// What the picture's tint is made of: where each keyframe of a map is and its standard deviation.
pub(crate) fn seen_from(session: &Session, map: &SeparateMap, advice: &Advice) -> Vec<([f64; 2], f64)> {
    let poses = map.places().filter_map(|place| session.map_from_keyframe().get(place));
    let places = poses.map(|pose| [pose.x, pose.y]);
    places.zip(advice.keyframe_sigmas_m.iter().copied()).collect()
}

/// The places' numbers in the picture are their order.
pub(crate) fn numbered(advice: &Advice) -> Vec<[f64; 2]> {
    advice.places.iter().map(|place| place.at).collect()
}

/// For `report.json`.
pub(crate) fn report(advice: &Advice) -> Value {
    let place = |place: &Place| {
        json!({
            "at_m": place.at,
            "keyframe": place.keyframe.seq,
            "away_m": place.away_m,
            "known_way_m": place.way_m(),
            "known_way": place.way,
            "mean_sigma_after_m": place.mean_sigma_after_m,
            "words": words_of(advice, place),
        })
    };
    json!({
        "mean_sigma_m": advice.mean_sigma_m,
        "worst_sigma_m": advice.worst_sigma_m,
        "unlinked_keyframes": advice.keyframe_sigmas_m.iter().filter(|sigma| !sigma.is_finite()).count(),
        "drive_next": advice.places.iter().map(place).collect::<Vec<_>>(),
    })
}

/// For people; empty where there is no map.
pub(crate) fn words(advice: &Advice) -> String {
    if advice.keyframe_sigmas_m.is_empty() {
        return String::new();
    }
    format!(
        "certain  to {:.3} m in the mean, {:.3} m at worst, relative to where the map begins\n",
        advice.mean_sigma_m, advice.worst_sigma_m
    )
}

/// Where to drive next, for people, by the numbers in a picture; empty where there is nothing to be gained.
pub(crate) fn next_words(advice: &Advice, picture: &str) -> String {
    let mut text = String::new();
    for (index, place) in advice.places.iter().enumerate() {
        let head = if index == 0 { "next     drive to" } else { "         or to" };
        let _ = writeln!(text, "{head} place {} in {picture}, {}", index + 1, words_of(advice, place));
    }
    text
}

/// What a place is and what would be gained there.
pub(crate) fn words_of(advice: &Advice, place: &Place) -> String {
    let [x, y] = place.at;
    let way = place.way_m().map_or(String::new(), |way_m| format!(" ({way_m:.0} m along the known way)"));
    let words = format!(
        "at ({x:.1}, {y:.1}), {:.0} m from here{way}: that would bring the map's mean uncertainty from {:.3} to {:.3} m",
        place.away_m, advice.mean_sigma_m, place.mean_sigma_after_m
    );
    without_negative_zeros(&words).into_owned()
}
