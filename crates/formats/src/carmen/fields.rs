//! The fields of one line.

use crate::number::{parse_f32, parse_f64, parse_stamp, short_range};
use crate::report::DropReason;
use mapwright_geom::{FARTHEST_M, Pose2, Stamp};
use std::borrow::Cow;

/// Beams that no planar laser exceeds.
const MAX_BEAMS: usize = 65_536;

/// Why a line is no event.
#[derive(Debug)]
pub(super) struct BadLine<'a> {
    pub(super) reason: DropReason,
    pub(super) expected: Cow<'static, str>,
    pub(super) found: &'a [u8],
}

impl<'a> BadLine<'a> {
    pub(super) fn new(reason: DropReason, expected: impl Into<Cow<'static, str>>, found: &'a [u8]) -> Self {
        Self { reason, expected: expected.into(), found }
    }

    /// A field that is missing where nothing was found, and otherwise no number.
    fn field(expected: impl Into<Cow<'static, str>>, found: &'a [u8]) -> Self {
        let reason = if found.is_empty() { DropReason::MissingField } else { DropReason::BadNumber };
        Self::new(reason, expected, found)
    }
}

#[inline]
fn is_space(byte: u8) -> bool {
    byte == b' ' || byte == b'\t'
}

/// Walks over the fields of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub(super) fn new(line: &'a [u8]) -> Self {
        Self { rest: line }
    }

    /// The next field; empty at the end of the line.
    #[inline]
    pub(super) fn word(&mut self) -> &'a [u8] {
        let from = self.rest.iter().position(|&b| !is_space(b)).unwrap_or(self.rest.len());
        let trimmed = &self.rest[from..];
        let to = trimmed.iter().position(|&b| is_space(b)).unwrap_or(trimmed.len());
        let (word, rest) = trimmed.split_at(to);
        self.rest = rest;
        word
    }

    pub(super) fn number(&mut self, what: &'static str) -> Result<f64, BadLine<'a>> {
        let word = self.word();
        parse_f64(word).ok_or_else(|| BadLine::field(what, word))
    }

    /// A count of readings that the rest of the line can hold.
    fn count(&mut self, what: &'static str) -> Result<usize, BadLine<'a>> {
        let word = self.word();
        let count = std::str::from_utf8(word).ok().and_then(|w| w.parse::<usize>().ok());
        match count {
            Some(count) if count > MAX_BEAMS => Err(BadLine::new(DropReason::BeamCount, what, word)),
            Some(count) if count > self.rest.len() / 2 => Err(BadLine::new(
                DropReason::MissingField,
                format!("{count} readings, as the line announces"),
                &self.rest[self.rest.len().saturating_sub(24)..],
            )),
            Some(count) => Ok(count),
            None => Err(BadLine::field(what, word)),
        }
    }

    /// A count and that many ranges, which replace those in `ranges_m`; returns how many of them are not finite.
    pub(super) fn ranges(&mut self, ranges_m: &mut Vec<f32>) -> Result<u64, BadLine<'a>> {
        let counted = *self;
        let count = self.count("a number of beams from 1 to 65536")?;
        if count == 0 {
            return Err(BadLine::new(DropReason::BeamCount, "at least one beam", counted.clone().word()));
        }
        ranges_m.resize(count, 0.0);
        let mut non_finite = 0;
        for (beam, range_m) in ranges_m.iter_mut().enumerate() {
            *range_m = match self.short_range() {
                Some(value) => value,
                None => self.long_range(beam, count, &mut non_finite)?,
            };
        }
        Ok(non_finite)
    }

    /// The common form: one space, then `d.dd` or `dd.dd`, then a space.
    #[inline]
    fn short_range(&mut self) -> Option<f32> {
        let (head, _) = self.rest.split_first_chunk::<9>()?;
        let [b' ', number @ ..] = *head else { return None };
        let (value, length) = short_range(number)?;
        self.rest = &self.rest[1 + length..];
        Some(value)
    }

    /// Any other form.
    fn long_range(&mut self, beam: usize, count: usize, non_finite: &mut u64) -> Result<f32, BadLine<'a>> {
        let word = self.word();
        let Some(value) = parse_f32(word) else {
            return Err(BadLine::field(format!("the range of beam {} of {count}", beam + 1), word));
        };
        *non_finite += u64::from(!value.is_finite());
        Ok(value)
    }

    /// Steps over a count and that many values.
    pub(super) fn skip_remissions(&mut self) -> Result<(), BadLine<'a>> {
        for _ in 0..self.count("a number of remissions")? {
            self.word();
        }
        Ok(())
    }
}

/// What stands behind the ranges: numbers, then `ipc_timestamp host logger_timestamp`, of which old logs lack some.
#[derive(Debug)]
pub(super) struct Tail<'a> {
    words: [&'a [u8]; Tail::MAX_WORDS],
    /// Numbers before the stamp.
    numbers: usize,
    /// The stamp, where there is one.
    pub(super) stamp: Option<Stamp>,
}

impl<'a> Tail<'a> {
    const MAX_WORDS: usize = 16;

    /// Reads to the end of the line. `layouts` lists how many numbers may stand before the stamp, the fullest first.
    ///
    /// The third field from the end is the stamp where the line is complete. Otherwise the first field that is no
    /// number is the host, and the stamp stands before it; where there is none, the stamp is last or missing, whichever
    /// fits the fullest layout.
    pub(super) fn read(mut cursor: Cursor<'a>, layouts: &[usize], terminated: bool) -> Result<Self, BadLine<'a>> {
        let most = layouts[0];
        let mut words = [&b""[..]; Self::MAX_WORDS];
        let mut count = 0;
        loop {
            let word = cursor.word();
            if word.is_empty() {
                break;
            }
            if count == most + 3 {
                return Err(BadLine::new(DropReason::SurplusFields, "the end of the line", word));
            }
            words[count] = word;
            count += 1;
        }
        let numbers = Self::numbers_before_stamp(&words[..count], layouts)?;
        // In a line cut short even the last number may be cut.
        if !terminated && count < numbers + 2 {
            return Err(BadLine::field("a host name behind the stamp", b""));
        }
        let stamp = if count > numbers { Some(Self::stamp(words[numbers])?) } else { None };
        Ok(Self { words, numbers, stamp })
    }

    fn numbers_before_stamp(words: &[&'a [u8]], layouts: &[usize]) -> Result<usize, BadLine<'a>> {
        if words.len() == layouts[0] + 3 {
            return Ok(layouts[0]);
        }
        let host = words.iter().position(|w| parse_f64(w).is_none());
        let fits = |&n: &usize| match host {
            Some(host) => host == n + 1 && words.len() <= n + 3,
            None => words.len() == n || words.len() == n + 1,
        };
        layouts.iter().copied().find(|n| fits(n)).ok_or_else(|| {
            let found = words.last().copied().unwrap_or_default();
            BadLine::new(DropReason::MissingField, "a pose, odometry, a stamp, a host and a second stamp", found)
        })
    }

    /// Refuses a layout shorter than the fullest seen before, which it becomes otherwise: a line that has lost fields,
    /// or whose count of readings is too large, can look like one of an older log.
    pub(super) fn not_shorter_than(&self, fullest: &mut usize) -> Result<(), BadLine<'a>> {
        if self.numbers < *fullest {
            let expected = format!("{fullest} numbers before the stamp, as in the lines before");
            return Err(BadLine::new(DropReason::MissingField, expected, self.words[0]));
        }
        *fullest = self.numbers;
        Ok(())
    }

    fn stamp(word: &'a [u8]) -> Result<Stamp, BadLine<'a>> {
        parse_stamp(word).ok_or_else(|| BadLine::new(DropReason::StampRefused, "a stamp in seconds", word))
    }

    /// Numbers before the stamp.
    pub(super) fn numbers(&self) -> usize {
        self.numbers
    }

    /// The pose whose three numbers begin at `at`.
    pub(super) fn pose(&self, at: usize) -> Result<PoseField, BadLine<'a>> {
        let [x, y, theta] = [self.number(at, "x")?, self.number(at + 1, "y")?, self.number(at + 2, "theta")?];
        Ok(PoseField::new(x, y, theta))
    }

    fn number(&self, at: usize, what: &'static str) -> Result<f64, BadLine<'a>> {
        let word = self.words[at];
        parse_f64(word).ok_or_else(|| BadLine::field(what, word))
    }

    /// A field as it stands in the line.
    pub(super) fn word(&self, at: usize) -> &'a [u8] {
        self.words[at]
    }
}

/// Three numbers that may be a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PoseField {
    /// A pose.
    Usable(Pose2),
    /// A pose beyond 10^6 m, as coordinates of UTM are.
    Far(Pose2),
    /// All three are NaN: the log says that there is none.
    Absent,
    /// Not finite, or of no place on earth.
    Refused,
}

impl PoseField {
    fn new(x: f64, y: f64, theta: f64) -> Self {
        // Headings, before they are wrapped, as far as positions.
        let within = |v: f64| v.abs() <= FARTHEST_M;
        if within(x) && within(y) && within(theta) {
            Self::Usable(Pose2::new(x, y, theta))
        } else if x.is_finite() && y.is_finite() && within(theta) {
            Self::Far(Pose2::new(x, y, theta))
        } else if x.is_nan() && y.is_nan() && theta.is_nan() {
            Self::Absent
        } else {
            Self::Refused
        }
    }
}
