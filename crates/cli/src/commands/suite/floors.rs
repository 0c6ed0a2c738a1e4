//! What must hold over all worlds.

use mapwright_eval::ErrorStats;
use serde_json::{Value, json};

/// Something that must hold.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Floor {
    pub(super) what: &'static str,
    pub(super) found: String,
    pub(super) holds: bool,
}

impl Floor {
    /// At most so many, in all worlds together.
    pub(super) fn none(what: &'static str, found: usize) -> Self {
        Self { what, found: found.to_string(), holds: found == 0 }
    }

    /// At least this share; holds where there is nothing to have a share of.
    pub(super) fn share(what: &'static str, least: f64, count: usize, of: usize) -> Self {
        Self { what, found: percent(count, of), holds: count as f64 >= least * of as f64 }
    }

    pub(super) fn to_json(&self) -> Value {
        json!({ "floor": self.what, "found": self.found, "holds": self.holds })
    }
}

/// One line for each.
pub(super) fn in_words(floors: &[Floor]) -> String {
    let verdict = |floor: &Floor| if floor.holds { "holds" } else { "MISSED" };
    floors.iter().map(|floor| format!("floor    {}: {}, {}\n", floor.what, floor.found, verdict(floor))).collect()
}

/// A number of the worlds: its name, its unit, what it is of a world.
pub(super) type Number<W> = (&'static str, &'static str, fn(&W) -> f64);

/// One line for each number of the worlds.
pub(super) fn stats_in_words<W>(worlds: &[W], numbers: &[Number<W>]) -> String {
    let line = |(what, unit, pick): &Number<W>| {
        let stats = stats(worlds, *pick)?;
        let (mean, median, worst) = (stats.mean, stats.median, stats.max);
        Some(format!("{what:8} mean {mean:.3}{unit}, median {median:.3}{unit}, worst {worst:.3}{unit}\n"))
    };
    numbers.iter().filter_map(line).collect()
}

/// Of a number of the worlds; none without worlds.
pub(super) fn stats<W>(worlds: &[W], pick: fn(&W) -> f64) -> Option<ErrorStats> {
    ErrorStats::of(&worlds.iter().map(pick).collect::<Vec<_>>())
}

/// `91.2 % (31 of 34)`.
pub(super) fn percent(count: usize, of: usize) -> String {
    if of == 0 {
        return "nothing to count".to_owned();
    }
    format!("{:.1} % ({count} of {of})", 100.0 * count as f64 / of as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_hold_from_their_least_on() {
        assert!(Floor::share("", 0.8, 8, 10).holds && !Floor::share("", 0.8, 7, 10).holds);
        assert!(Floor::share("", 1.0, 0, 0).holds && Floor::none("", 0).holds && !Floor::none("", 1).holds);
        assert_eq!(percent(1, 8), "12.5 % (1 of 8)");
    }
}
