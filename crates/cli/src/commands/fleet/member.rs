//! A robot's part in the team while its own thread maps: what it hears, says and works on.

use super::told::{self, Held, SUBJECT, Told};
use crate::interrupt::Interrupt;
use crate::terminal::say;
use mapwright::{Stamp, Update};
use mapwright_fleet::{Chain, ChainId, Kind, Team};
use mapwright_net::Wire;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};

/// The robot hears and speaks at least so often.
const TICK: Duration = Duration::from_millis(20);
/// Messages that are taken in before it is time for other things.
const AT_ONCE: usize = 512;
/// Keyframes that the robot that solves takes in before it hears again: some tenths of a second, for others take it for dead after three.
const KEYFRAMES_AT_ONCE: usize = 2;
/// What the robot says of itself is sent so often, seconds.
const TOLD_EVERY_S: f64 = 1.0;
/// A robot that is done answers others for so long without solving any more: longer than they need to see that all are done.
const LINGER_S: f64 = 5.0;
/// Other robots of which what they say of themselves is kept, and the differences that are told.
const KEPT: usize = 1000;

/// A robot whose links stand and that hears nothing over them for so long opens them anew, seconds: twenty beats.
const DEAF_S: f64 = 10.0;

/// Opens the robot's wire; none where that fails.
pub(super) type OpenWire<'a> = Box<dyn Fn() -> Option<Wire> + Send + 'a>;

/// How to end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stay {
    /// When nothing new has come for so long after the log, seconds;
    pub(super) quiet_s: f64,
    /// and at most so long after it.
    pub(super) at_most_s: f64,
}

/// A robot in its team.
pub(super) struct Member<'a> {
    pub(super) team: Team,
    pub(super) wire: Option<Wire>,
    open: OpenWire<'a>,
    /// When something came last.
    heard_s: f64,
    pub(super) settings: BTreeMap<String, String>,
    pub(super) keyframes: u64,
    pub(super) is_quiet: bool,
    started: Instant,
    /// What others say of themselves, and when.
    pub(super) told: BTreeMap<String, (f64, Told)>,
    said: BTreeSet<String>,
    hears: Option<Vec<String>>,
    last_told_s: f64,
    /// What is held, and since when all who are heard hold the same.
    holds: Vec<Held>,
    level_since_s: f64,
    /// Records of what was mapped, and since when there were as many; the same of keyframes in the map of all.
    pub(super) mapped: Since,
    pub(super) in_map: Since,
    pub(super) log_over_s: Option<f64>,
}

/// How many there are, and since when.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Since {
    pub(super) count: u64,
    /// Seconds since the robot was switched on.
    at_s: f64,
}

impl Since {
    fn set(&mut self, count: u64, now_s: f64) {
        if count != self.count {
            *self = Self { count, at_s: now_s };
        }
    }
}

/// How it ended.
pub(super) struct Ended<'a> {
    pub(super) member: Member<'a>,
    /// After the log, until all were seen to hold the same; none where they were not.
    pub(super) settled_s: Option<f64>,
}

impl<'a> Member<'a> {
    pub(super) fn new(
        team: Team,
        wire: Option<Wire>,
        open: OpenWire<'a>,
        settings: BTreeMap<String, String>,
        is_quiet: bool,
    ) -> Self {
        Self {
            team,
            wire,
            open,
            heard_s: 0.0,
            settings,
            keyframes: 0,
            is_quiet,
            started: Instant::now(),
            told: BTreeMap::new(),
            said: BTreeSet::new(),
            hears: None,
            last_told_s: f64::NEG_INFINITY,
            holds: Vec::new(),
            level_since_s: 0.0,
            mapped: Since::default(),
            in_map: Since::default(),
            log_over_s: None,
        }
    }

    fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    pub(super) fn now(&self) -> Stamp {
        Stamp::from_secs_f64(self.seconds())
    }

    /// Until the log is over and all hold the same, or the user ends it.
    pub(super) fn run(mut self, updates: &Receiver<Update>, interrupt: &Interrupt, stay: Stay) -> Ended<'a> {
        loop {
            self.take_updates(updates);
            self.hear();
            self.speak();
            let now_s = self.seconds();
            let quiet_s = self.quiet_s(now_s);
            let over_s = self.log_over_s.map(|over_s| now_s - over_s);
            let is_done = over_s.is_some() && quiet_s >= stay.quiet_s;
            if !is_done && self.team.work(self.now(), KEYFRAMES_AT_ONCE) {
                self.level_since_s = self.seconds();
            }
            self.tell();
            let settled_s = over_s.filter(|_| quiet_s >= stay.quiet_s + LINGER_S).map(|s| (s - quiet_s).max(0.0));
            let is_late = over_s.is_some_and(|s| s > stay.at_most_s);
            if settled_s.is_some() || is_late || (interrupt.came() && over_s.is_some()) {
                self.speak();
                return Ended { member: self, settled_s };
            }
        }
    }

    /// What the robot has mapped, as long as there is some; waits a little for it.
    fn take_updates(&mut self, updates: &Receiver<Update>) {
        let wait = if self.log_over_s.is_some() { None } else { Some(updates.recv_timeout(TICK)) };
        match wait {
            None => std::thread::sleep(TICK),
            Some(Ok(update)) => {
                self.take(&update);
                for update in updates.try_iter().take(AT_ONCE) {
                    self.take(&update);
                }
            }
            Some(Err(RecvTimeoutError::Timeout)) => {}
            Some(Err(RecvTimeoutError::Disconnected)) => {
                self.log_over_s = Some(self.seconds());
                self.team.finish();
            }
        }
    }

    fn take(&mut self, update: &Update) {
        let is_keyframe = |entry: &&mapwright::Entry| matches!(entry, mapwright::Entry::Keyframe { .. });
        self.keyframes += update.entries.iter().filter(is_keyframe).count() as u64;
        let now = self.now();
        self.team.tell(now, update);
    }

    fn hear(&mut self) {
        let now = self.now();
        for _ in 0..AT_ONCE {
            let Some(arrival) = self.wire.as_ref().and_then(|wire| wire.receive(Duration::ZERO)) else { return };
            self.heard_s = self.seconds();
            if arrival.subject != SUBJECT {
                self.team.receive(now, &arrival.bytes);
            } else if let Some(told) = Told::decode(&arrival.bytes)
                && (self.told.len() < KEPT || self.told.contains_key(&arrival.from))
            {
                for difference in self.of_itself().differences(&told, &arrival.from) {
                    self.say_once(&difference);
                }
                self.told.insert(arrival.from, (self.seconds(), told));
            }
        }
    }

    /// A link that carries nothing is of no use, whatever is the matter with it.
    fn open_anew(&mut self, now_s: f64) {
        let own = self.team.node().me().rank;
        let is_other = |name: &str| self.team.node().roster().rank(name).is_some_and(|rank| rank != own);
        let has_links = |wire: &Wire| wire.links().iter().any(|link| is_other(&link.name));
        if now_s - self.heard_s < DEAF_S || !self.wire.as_ref().is_none_or(has_links) {
            return;
        }
        if self.wire.take().is_some() {
            self.say(&format!("! {now_s:.0} s: links stand and nothing comes over them: opened anew"));
        }
        self.wire = (self.open)();
        self.heard_s = self.seconds();
    }

    fn speak(&mut self) {
        let now = self.now();
        let outgoing = self.team.poll(now);
        let Some(wire) = &self.wire else { return };
        for out in outgoing {
            match out.to {
                None => wire.send(None, out.bytes),
                Some(rank) => {
                    if let Some(name) = self.team.node().roster().name(rank) {
                        wire.send(Some(name), out.bytes);
                    }
                }
            }
        }
    }

    /// For so long all who are heard have held what this robot holds, seconds.
    fn quiet_s(&mut self, now_s: f64) -> f64 {
        let node = self.team.node();
        let now = Stamp::from_secs_f64(now_s);
        let own: BTreeMap<ChainId, u32> = node.chains().iter().map(|(id, chain)| (*id, chain.next())).collect();
        let liars: BTreeSet<u16> = node.equivocators().map(|(rank, _)| rank).collect();
        let said = |holds: &BTreeMap<ChainId, u32>| -> Vec<(ChainId, u32)> {
            let counts = |(id, next): &(&ChainId, &u32)| **next > 0 && !liars.contains(&id.rank);
            holds.iter().filter(counts).map(|(id, next)| (*id, *next)).collect()
        };
        let own = said(&own);
        let mut others = (0..node.roster().members().len() as u16).filter(|rank| *rank != node.me().rank);
        let is_level = others.all(|rank| {
            let is_heard = node.is_alive(rank, now) && !liars.contains(&rank);
            !is_heard || node.heard(rank).is_none_or(|(_, holds)| said(holds) == own)
        });
        let holds = told::held(&self.team);
        if holds != self.holds {
            let records = node.chains().values().flat_map(Chain::records);
            self.mapped.set(records.filter(|record| record.kind == Kind::Entries).count() as u64, now_s);
        }
        self.in_map.set(self.team.map().map_or(0, |map| map.keyframes().len() as u64), now_s);
        if !is_level || holds != self.holds {
            self.holds = holds;
            self.level_since_s = now_s;
        }
        now_s - self.level_since_s
    }

    /// What the robot says of itself.
    pub(super) fn of_itself(&self) -> Told {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let wire = self.wire.as_ref();
        Told {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            session: self.team.node().me().session,
            settings: self.settings.clone(),
            keyframes: self.keyframes,
            in_map: self.in_map.count,
            solves: self.team.is_solving(),
            log_is_over: self.log_over_s.is_some(),
            clock_s: since.as_secs_f64(),
            holds: told::held(&self.team),
            hears: told::heard(&self.team, self.now()),
            links: wire.map_or_else(Vec::new, |wire| wire.links().into_iter().map(|link| link.name).collect()),
            refused: told::refused(&self.team),
            early: self.team.node().early(),
            dropped: wire.map_or([0, 0], Wire::dropped),
        }
    }

    /// Seconds since 1970 since when it is so.
    pub(super) fn clock_s(&self, since: Since) -> f64 {
        self.clock_at(since.at_s)
    }

    /// Seconds since 1970 of a time of the robot's own.
    pub(super) fn clock_at(&self, at_s: f64) -> f64 {
        self.of_itself().clock_s - (self.seconds() - at_s)
    }

    /// To others what it says of itself, and to the user what has changed.
    fn tell(&mut self) {
        let now_s = self.seconds();
        if now_s - self.last_told_s < TOLD_EVERY_S {
            return;
        }
        self.last_told_s = now_s;
        self.open_anew(now_s);
        let told = self.of_itself();
        let now = self.now();
        let alive = |name: &&String| {
            let rank = self.team.node().roster().rank(name);
            rank.is_some_and(|rank| self.team.node().is_alive(rank, now))
        };
        let hears: Vec<String> = told.hears.iter().map(|heard| &heard.robot).filter(alive).cloned().collect();
        if self.hears.as_ref() != Some(&hears) {
            let words = if hears.is_empty() { "nobody yet".to_owned() } else { hears.join(", ") };
            self.say(&format!("{now_s:.0} s: hears {words}"));
            self.hears = Some(hears);
        }
        for refused in &told.refused {
            let of = refused.of.as_ref().map_or(String::new(), |of| format!(", {of}"));
            self.say_once(&format!("refused{of}: {}", refused.why));
        }
        for problem in self.wire_problems() {
            self.say_once(&problem);
        }
        if let Some(wire) = &self.wire {
            wire.send_as(SUBJECT, told.encode());
        }
    }

    /// Who was refused before a word of it came in.
    pub(super) fn wire_problems(&self) -> Vec<String> {
        let Some(wire) = &self.wire else { return Vec::new() };
        let refused =
            wire.complaints().into_iter().filter(|complaint| complaint.is_refusal).map(|refused| refused.what);
        let strangers = wire.links().into_iter().filter(|link| !link.is_of_team).map(|link| {
            format!(
                "{} has a certificate of the authority and is not in team.toml: nothing of it gets in",
                told::plain(&link.name)
            )
        });
        refused.chain(strangers).collect()
    }

    fn say_once(&mut self, text: &str) {
        if self.said.len() < KEPT && self.said.insert(text.to_owned()) {
            self.say(&format!("! {text}"));
        }
    }

    fn say(&self, line: &str) {
        if !self.is_quiet {
            let _ = say(&format!("{line}\n")); // a reader that went away is no reason to stop
        }
    }

    /// All that was said of others, refused or different.
    pub(super) fn remarks(&self) -> impl Iterator<Item = &String> {
        self.said.iter()
    }
}
