//! A reliable writer (8.4.9): what it has told, and what each reader has of it.

use crate::ids::{ANY, EntityId, Guid, Prefix};
use crate::message::{FRAGMENT_BYTES, Missing, Sample};
use crate::packets::Packets;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::SocketAddrV4;
use std::time::Duration;

/// Samples that are kept of a writer for who has not confirmed them, and their bytes, but for the last one.
const SAMPLES_MOST: usize = 256;
const BYTES_MOST: usize = 32 << 20;
/// Readers of one writer.
const READERS_MOST: usize = 1000;
/// Who has not confirmed is asked so soon, and twice as late each time, up to the second.
const ASKED_AFTER: Duration = Duration::from_millis(20);
const ASKED_AT_LAST: Duration = Duration::from_millis(500);
/// Fragments go in bursts with pauses between, so that a receive buffer of 212 kB, which is what Linux has, is read meanwhile.
const BURST: usize = 24;
const PAUSE: Duration = Duration::from_millis(1);

/// What is told, and whom it is for.
#[derive(Debug)]
struct Told {
    sample: Sample,
    /// The one participant that wants it; all where it is none.
    to: Option<Prefix>,
}

/// A reader as the writer knows it.
#[derive(Debug)]
struct Reader {
    to: Vec<SocketAddrV4>,
    is_reliable: bool,
    has_answered: bool,
    /// The first sample that is for it.
    start: i64,
    /// All before have been confirmed.
    acked: i64,
    /// All before have been sent, or told not to come.
    told: i64,
    /// Fragments that are to be sent.
    fragments: BTreeSet<(i64, u32)>,
    fragments_at: Duration,
    ask_at: Option<Duration>,
    wait: Duration,
}

#[derive(Debug)]
pub(crate) struct Writer {
    guid: Guid,
    /// Which of the others' readers hear it; any that has matched.
    reader: EntityId,
    /// Who comes later gets what was told before.
    is_durable: bool,
    first: i64,
    told: VecDeque<Told>,
    bytes: usize,
    readers: BTreeMap<Guid, Reader>,
    heartbeats: u32,
}

impl Writer {
    /// One whose readers come and go, and get what is told while they are there.
    pub(crate) fn new(guid: Guid) -> Self {
        Self {
            guid,
            reader: ANY,
            is_durable: false,
            first: 1,
            told: VecDeque::new(),
            bytes: 0,
            readers: BTreeMap::new(),
            heartbeats: 0,
        }
    }

    /// One that finds others, for the readers of that number.
    pub(crate) fn builtin(guid: Guid, reader: EntityId) -> Self {
        Self { reader, is_durable: true, ..Self::new(guid) }
    }

    pub(crate) fn guid(&self) -> Guid {
        self.guid
    }

    fn end(&self) -> i64 {
        self.first + self.told.len() as i64
    }

    fn at(&self, number: i64) -> Option<&Told> {
        number.checked_sub(self.first).and_then(|at| usize::try_from(at).ok()).and_then(|at| self.told.get(at))
    }

    /// Whether a participant has a reader of it.
    pub(crate) fn reaches(&self, prefix: Prefix) -> bool {
        self.readers.keys().any(|reader| reader.prefix == prefix)
    }

    /// Whether a reader has said anything yet; asked again at once where it has not.
    pub(crate) fn is_heard_by(&mut self, guid: Guid, now: Duration) -> bool {
        let Some(reader) = self.readers.get_mut(&guid) else { return true };
        if !reader.has_answered && reader.ask_at.is_some() {
            (reader.ask_at, reader.wait) = (Some(now), ASKED_AFTER);
        }
        reader.has_answered
    }

    /// A reader has come, or says anew where it hears.
    pub(crate) fn matched(
        &mut self,
        guid: Guid,
        to: Vec<SocketAddrV4>,
        is_reliable: bool,
        now: Duration,
        out: &mut Packets,
    ) {
        if let Some(reader) = self.readers.get_mut(&guid) {
            reader.to = to;
            return;
        }
        if self.readers.len() >= READERS_MOST {
            return;
        }
        let start = if self.is_durable { self.first } else { self.end() };
        let (fragments, wait) = (BTreeSet::new(), ASKED_AFTER);
        let reader = Reader {
            to,
            is_reliable,
            has_answered: false,
            start,
            acked: start,
            told: start,
            fragments,
            fragments_at: now,
            ask_at: None,
            wait,
        };
        self.readers.insert(guid, reader);
        self.tell(guid, now, out);
    }

    pub(crate) fn gone(&mut self, is_gone: impl Fn(Guid) -> bool) {
        self.readers.retain(|guid, _| !is_gone(*guid));
    }

    /// Tells a sample to the readers of a participant, or to all.
    pub(crate) fn write(&mut self, sample: Sample, to: Option<Prefix>, now: Duration, out: &mut Packets) {
        self.bytes += sample.payload.len();
        self.told.push_back(Told { sample, to });
        while !self.is_durable && (self.told.len() > SAMPLES_MOST || self.told.len() > 1 && self.bytes > BYTES_MOST) {
            self.forget();
        }
        let readers: Vec<Guid> =
            self.readers.keys().filter(|guid| to.is_none_or(|prefix| prefix == guid.prefix)).copied().collect();
        readers.into_iter().for_each(|guid| self.tell(guid, now, out));
    }

    fn forget(&mut self) {
        if let Some(told) = self.told.pop_front() {
            self.first += 1;
            self.bytes -= told.sample.payload.len();
        }
    }

    /// Sends a reader what it has not been told.
    fn tell(&mut self, guid: Guid, now: Duration, out: &mut Packets) {
        let end = self.end();
        let Some(reader) = self.readers.get_mut(&guid) else { return };
        let from = reader.told.max(self.first);
        reader.told = end;
        self.send(guid, from..end, now, out);
    }

    /// Sends a reader samples, or tells it that they will not come, and asks what it has.
    fn send(&mut self, guid: Guid, numbers: impl IntoIterator<Item = i64>, now: Duration, out: &mut Packets) {
        let Some(mut reader) = self.readers.remove(&guid) else { return };
        let names = [self.reader_of(guid), self.guid.entity];
        let mut gap: Option<[i64; 2]> = None;
        for number in numbers {
            let is_for_it = number >= reader.start
                && self.at(number).is_some_and(|told| told.to.is_none_or(|to| to == guid.prefix));
            match self.at(number).filter(|_| is_for_it) {
                None => match &mut gap {
                    Some([_, end]) if *end == number => *end = number + 1,
                    _ => {
                        self.close(&mut gap, &reader, guid, out);
                        gap = Some([number, number + 1]);
                    }
                },
                Some(told) => {
                    self.close(&mut gap, &reader, guid, out);
                    if told.sample.payload.len() > FRAGMENT_BYTES {
                        let fragments = told.sample.payload.len().div_ceil(FRAGMENT_BYTES) as u32;
                        // What is under way is not begun again.
                        if !reader.fragments.iter().any(|(of, _)| *of == number) {
                            reader.fragments.extend((1..=fragments).map(|fragment| (number, fragment)));
                        }
                    } else {
                        out.send(&reader.to, self.guid.prefix, guid.prefix, |message| {
                            message.data(names, number, &told.sample)
                        });
                    }
                }
            }
        }
        self.close(&mut gap, &reader, guid, out);
        if reader.is_reliable && reader.acked < self.end() {
            reader.wait = ASKED_AFTER;
            reader.ask_at = Some(now);
        }
        self.readers.insert(guid, reader);
        self.turn_of(guid, now, out);
    }

    fn close(&self, gap: &mut Option<[i64; 2]>, reader: &Reader, guid: Guid, out: &mut Packets) {
        if let Some([first, end]) = gap.take() {
            let names = [self.reader_of(guid), self.guid.entity];
            out.send(&reader.to, self.guid.prefix, guid.prefix, |message| message.gap(names, first, end));
        }
    }

    fn reader_of(&self, guid: Guid) -> EntityId {
        if self.reader == ANY { guid.entity } else { self.reader }
    }

    /// A reader says what it lacks.
    pub(crate) fn acknack(&mut self, guid: Guid, missing: Missing, is_final: bool, now: Duration, out: &mut Packets) {
        let end = self.end();
        let Some(reader) = self.readers.get_mut(&guid) else { return };
        reader.has_answered = true;
        // Who has begun anew asks from the start again.
        reader.acked = missing.base.clamp(1, end);
        let acked = reader.acked;
        let lacks: Vec<i64> = missing.numbers().filter(|number| *number >= 1 && *number < end).collect();
        if acked >= end {
            reader.ask_at = None;
            reader.fragments.clear();
        }
        if lacks.is_empty() && acked < end && acked < reader.start.max(self.first) {
            let until = reader.start.max(self.first);
            return self.send(guid, acked..until, now, out);
        }
        if !lacks.is_empty() {
            return self.send(guid, lacks, now, out);
        }
        if !is_final {
            self.ask(guid, now, out);
        }
        self.trim();
    }

    /// Forgets what all have.
    fn trim(&mut self) {
        let least = self.readers.values().filter(|reader| reader.is_reliable).map(|reader| reader.acked).min();
        while !self.is_durable && self.first < least.unwrap_or(i64::MAX) && !self.told.is_empty() {
            self.forget();
        }
    }

    /// A reader says which fragments of a sample it lacks.
    pub(crate) fn nack_fragments(
        &mut self,
        guid: Guid,
        number: i64,
        missing: Missing,
        now: Duration,
        out: &mut Packets,
    ) {
        let Some(told) = self.at(number) else { return };
        let fragments = told.sample.payload.len().div_ceil(FRAGMENT_BYTES) as i64;
        let is_for_it = told.to.is_none_or(|to| to == guid.prefix);
        let Some(reader) = self.readers.get_mut(&guid).filter(|_| is_for_it) else { return };
        let wanted = missing.numbers().filter(|fragment| (1..=fragments).contains(fragment));
        reader.fragments.extend(wanted.map(|fragment| (number, fragment as u32)));
        reader.ask_at = Some(now);
        self.turn_of(guid, now, out);
    }

    fn ask(&mut self, guid: Guid, now: Duration, out: &mut Packets) {
        let (numbers, names) = ([self.first, self.end() - 1], [self.reader_of(guid), self.guid.entity]);
        self.heartbeats = self.heartbeats.wrapping_add(1);
        let Some(reader) = self.readers.get_mut(&guid) else { return };
        let count = self.heartbeats;
        out.send(&reader.to, self.guid.prefix, guid.prefix, |message| message.heartbeat(names, numbers, count));
        if reader.acked < numbers[1] + 1 {
            reader.ask_at = Some(now + reader.wait);
            reader.wait = (2 * reader.wait).min(ASKED_AT_LAST);
        }
    }

    /// Sends what is due, and says when something is next.
    pub(crate) fn turn(&mut self, now: Duration, out: &mut Packets) -> Option<Duration> {
        let due: Vec<Guid> = self.readers.keys().copied().collect();
        due.into_iter().filter_map(|guid| self.turn_of(guid, now, out)).min()
    }

    fn turn_of(&mut self, guid: Guid, now: Duration, out: &mut Packets) -> Option<Duration> {
        let names = [self.reader_of(guid), self.guid.entity];
        let first = self.first;
        let reader = self.readers.get_mut(&guid)?;
        reader.fragments.retain(|(number, _)| *number >= first);
        if !reader.fragments.is_empty() {
            if reader.fragments_at > now {
                return Some(reader.fragments_at);
            }
            reader.fragments_at = now + PAUSE;
            let to = reader.to.clone();
            let burst: Vec<(i64, u32)> = reader.fragments.iter().take(BURST).copied().collect();
            burst.iter().for_each(|fragment| {
                reader.fragments.remove(fragment);
            });
            let (is_all, at) = (reader.fragments.is_empty(), reader.fragments_at);
            for (number, fragment) in burst {
                let Some(told) = self.at(number) else { continue };
                out.send(&to, self.guid.prefix, guid.prefix, |message| {
                    message.fragment(names, number, &told.sample, fragment)
                });
            }
            if !is_all {
                return Some(at);
            }
        }
        let ask_at = self.readers.get(&guid)?.ask_at?;
        if ask_at > now {
            return Some(ask_at);
        }
        self.ask(guid, now, out);
        self.readers.get(&guid)?.ask_at
    }
}
