//! `SONAR` lines.

use super::fields::{BadLine, Cursor, Tail};
use crate::number::parse_f64;
use crate::report::DropReason;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{OddHead, SONAR_REACH_MOST_M, Sonar, SonarReading, SonarRing};
use std::sync::Arc;

/// A line with a reading so large is in millimetres: 200 m are beyond any sonar, 0.2 m are not.
const MILLIMETRES_FROM: f64 = 200.0;
/// Where a line has an angle beyond one turn, its angles are degrees, radians.
const DEGREES_FROM: f64 = 6.3;
/// No ring has more sonars.
pub(super) const MAX_SONARS: usize = 1024;
/// Where nothing says how far the sonars hear: echoes from farther away are mostly detours, metres.
const RANGE_MAX_UNSAID_M: f64 = 5.0;
/// Where a line does not say how wide the cones are, as of the Polaroid sonars of those robots, radians (25 degrees).
const OPENING_UNSAID_RAD: f64 = 0.436;

/// What `PARAM` lines say about the sonars.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct SonarParams {
    pub(super) range_max_m: Option<f64>,
    pub(super) opening_rad: Option<f64>,
}

/// A line's numbers as they stand there.
struct Said {
    opening: Option<f64>,
    ranges: Vec<f64>,
    offsets: Vec<[f64; 3]>,
}

/// Reads the rest of a line into `reading`, whose ring is kept where it is the same; stamp and what was odd.
pub(super) fn read<'a>(
    mut cursor: Cursor<'a>,
    terminated: bool,
    params: SonarParams,
    reading: &mut SonarReading,
) -> Result<(Option<Stamp>, Vec<OddHead>), BadLine<'a>> {
    let line = cursor;
    let said = Said::read(&mut cursor)?;
    let tail = Tail::read(cursor, &[0], terminated)?;
    let mut odd = Vec::new();
    let is_millimetres = said.ranges.iter().any(|range| range.is_finite() && *range >= MILLIMETRES_FROM);
    let per_m = if is_millimetres { 1e-3 } else { 1.0 };
    if is_millimetres {
        odd.push(OddHead { what: "sonar ranges", words: "ranges are millimetres: used as such".to_owned() });
    }
    let is_degrees = said.offsets.iter().any(|offset| offset[2].abs() > DEGREES_FROM);
    let per_rad = if is_degrees { 1f64.to_radians() } else { 1.0 };
    if is_degrees {
        odd.push(OddHead { what: "sonar angles", words: "directions are degrees: used as such".to_owned() });
    }
    let opening_rad = match said.opening {
        Some(opening) => opening * per_rad,
        None => params.opening_rad.unwrap_or(OPENING_UNSAID_RAD),
    };
    if said.opening.or(params.opening_rad).is_none() {
        let words = format!("the width of the cones is not said: {:.0} degrees are used", opening_rad.to_degrees());
        odd.push(OddHead { what: "sonar cones", words });
    }
    let range_max_m = params.range_max_m.unwrap_or(RANGE_MAX_UNSAID_M);
    let sonar = |&[x, y, theta]: &[f64; 3]| Sonar {
        robot_from_sonar: Pose2::new(x, y, theta * per_rad),
        opening_rad,
        range_min_m: 0.0,
        range_max_m,
    };
    let ring = SonarRing { name: "SONAR".to_owned(), sonars: said.offsets.iter().map(sonar).collect() };
    if let Err(why) = ring.check() {
        let expected = why.split_once("expected ").and_then(|(_, rest)| rest.split(", found").next());
        let expected = expected.unwrap_or(&why).to_owned();
        return Err(BadLine::new(DropReason::BadNumber, expected, line.clone().word()));
    }
    if *reading.ring != ring {
        reading.ring = Arc::new(ring);
    }
    reading.ranges_m.clear();
    reading.ranges_m.extend(said.ranges.iter().map(|range| (range * per_m) as f32));
    reading.odom_from_robot = None;
    Ok((tail.stamp, odd))
}

impl Said {
    /// `cone_angle num_sonars ranges offsets`, or, of older logs, `num_sonars ranges num_offsets offsets`.
    fn read<'a>(cursor: &mut Cursor<'a>) -> Result<Self, BadLine<'a>> {
        let is_older = Self::counts_twice(*cursor);
        let opening = if is_older { None } else { Some(cursor.number("the width of the cones, in radians")?) };
        let count = sonars(cursor)?;
        let mut ranges = Vec::with_capacity(count);
        for _ in 0..count {
            ranges.push(cursor.number("a sonar's range")?);
        }
        if is_older {
            cursor.word();
        }
        let mut offsets = Vec::with_capacity(count);
        for _ in 0..count {
            let mut number = || cursor.number("where a sonar sits: x, y and direction");
            offsets.push([number()?, number()?, number()?]);
        }
        Ok(Self { opening, ranges, offsets })
    }

    /// Whether the line begins with a count, and the same count stands behind so many ranges.
    fn counts_twice(mut cursor: Cursor<'_>) -> bool {
        let count = |word: &[u8]| std::str::from_utf8(word).ok()?.parse::<usize>().ok();
        let Some(first) = count(cursor.word()).filter(|&first| first <= MAX_SONARS) else { return false };
        let are_numbers = (0..first).all(|_| parse_f64(cursor.word()).is_some());
        are_numbers && count(cursor.word()) == Some(first)
    }
}

fn sonars<'a>(cursor: &mut Cursor<'a>) -> Result<usize, BadLine<'a>> {
    let word = cursor.word();
    let count = std::str::from_utf8(word).ok().and_then(|word| word.parse::<usize>().ok());
    let expected = || format!("a number of sonars from 1 to {MAX_SONARS}");
    let reason = if word.is_empty() { DropReason::MissingField } else { DropReason::BeamCount };
    count.filter(|count| (1..=MAX_SONARS).contains(count)).ok_or_else(|| BadLine::new(reason, expected(), word))
}

/// The bounds of a parameter that says how far sonars hear, metres.
pub(super) const REACH_M: [f64; 2] = [0.1, SONAR_REACH_MOST_M];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CarmenReader, LogEvent};

    /// The readings of a log, and what was dropped.
    fn read(log: &str) -> (Vec<SonarReading>, Vec<String>) {
        let (mut reader, mut readings) = (CarmenReader::new(log.as_bytes()), Vec::new());
        while let Some(event) = reader.next_event().unwrap() {
            if let LogEvent::Sonar(reading) = event {
                readings.push(reading.clone());
            }
        }
        let report = reader.into_report();
        assert_eq!(report.sonar_readings, readings.len() as u64);
        let dropped = report.drops.values().flat_map(|drops| drops.first.iter().map(ToString::to_string)).collect();
        (readings, dropped)
    }

    #[test]
    fn both_forms_say_the_same() {
        let newer = "SONAR 0.436 2 1.25 5.00 0.10 0.00 0.0 0.00 0.10 1.57 12.5 host 0.1\n";
        let older = "SONAR 2 1.25 5.00 2 0.10 0.00 0.0 0.00 0.10 1.57 12.5 host 0.1\n";
        let (readings, dropped) = read(&format!("{newer}{older}"));
        assert!(dropped.is_empty(), "{dropped:?}");
        assert_eq!(readings[0], readings[1]);
        assert_eq!((readings[0].stamp.0, &readings[0].ranges_m[..]), (12_500_000_000, &[1.25, 5.0][..]));
        assert_eq!(readings[0].ring.sonars[1].robot_from_sonar, Pose2::new(0.0, 0.1, 1.57));
        assert!(Arc::ptr_eq(&readings[0].ring, &readings[0].ring));
    }

    #[test]
    fn millimetres_and_degrees_are_used_where_they_are_plain() {
        let (readings, dropped) = read("SONAR 25 2 5110 2320 0 0 0 0 0 90 1 host 1\nSONAR 0.4 1 0.5 0 0 0 1 host 1\n");
        assert!(dropped.is_empty(), "{dropped:?}");
        assert_eq!(readings[0].ranges_m, [5.11, 2.32]);
        assert!((readings[0].ring.sonars[1].robot_from_sonar.theta - std::f64::consts::FRAC_PI_2).abs() < 1e-4);
        assert!((readings[0].ring.sonars[0].opening_rad - 0.4363).abs() < 1e-4);
        assert_eq!(readings[1].ranges_m, [0.5]);
    }

    #[test]
    fn a_line_that_cannot_be_is_dropped_and_says_why() {
        let bad = [
            ("SONAR 0 1 1.0 0 0 0 1 host 1", "a cone that opens"),
            ("SONAR 3.2 1 1.0 0 0 0 1 host 1", "a cone that opens"),
            ("SONAR -0.4 1 1.0 0 0 0 1 host 1", "a cone that opens"),
            ("SONAR 0.4 0 1 host 1", "a number of sonars"),
            ("SONAR 0.4 2000 1 host 1", "a number of sonars"),
            ("SONAR 0.4 2 1.0 2.0 0 0 0 1 host 1", "where a sonar sits"),
            ("SONAR 0.4 2 1.0 two 0 0 0 0 0 0 1 host 1", "a sonar's range"),
            ("SONAR 0.4 1 1.0 5000 0 0 1 host 1", "a place within 1 km"),
            ("SONAR 0.4 1 1.0 0 0 0 1 host 1 more", "the end of the line"),
            ("SONAR", "width of the cones"),
        ];
        for (line, why) in bad {
            let (readings, dropped) = read(&format!("{line}\n"));
            assert!(readings.is_empty() && dropped.len() == 1 && dropped[0].contains(why), "{line}: {dropped:?}");
        }
    }

    #[test]
    fn parameters_say_reach_and_cones() {
        let log =
            "PARAM mapwright_sonar_range_max 3.5\nPARAM mapwright_sonar_opening 0.3\nSONAR 1 1.0 1 0 0 0 1 host 1\n";
        let sonar = read(log).0[0].ring.sonars[0].clone();
        assert_eq!((sonar.range_max_m, sonar.opening_rad), (3.5, 0.3));
    }
}
