//! Version 1 of a session's file: one block of settings, lasers, scans, keyframes and edges, with one checksum at its end.

use super::bytes::{Cursor, text};
use super::{CHECKSUM_BYTES, HEADER_BYTES, LogError, sweep};
use crate::entry::{Entry, RecordedEdge, Run, ScanPose};
use crate::error::EntryError;
use crate::id::{KeyframeId, RunId};
use crate::keyframe::{Edge, Keyframe};
use crate::session::Session;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserModel, Sweep};
use std::sync::Arc;

/// The version.
pub(super) const VERSION: u16 = 1;

/// The session of a file whose first bytes are those of version 1.
///
/// Its scans hang on no keyframe; their poses are those in the map, with every correction that was made.
pub(super) fn read(bytes: &[u8]) -> Result<Session, LogError> {
    let body = checked(bytes)?;
    let mut cursor = Cursor::new(body.get(HEADER_BYTES..).unwrap_or_default());
    let mut old = Old { cursor: &mut cursor, session: Session::default(), lasers: Vec::new(), ids: Vec::new() };
    match old.all() {
        Ok(()) => Ok(old.session),
        Err(EntryError { expected, found }) => {
            Err(LogError::Value { offset_bytes: body.len() - cursor.left_bytes(), expected, found })
        }
    }
}

/// All but the checksum, which is right.
fn checked(bytes: &[u8]) -> Result<&[u8], LogError> {
    let (body, checksum) = bytes.split_last_chunk::<CHECKSUM_BYTES>().ok_or(LogError::Cut { bytes: bytes.len() })?;
    let (expected, found) = (u32::from_le_bytes(*checksum), crc32fast::hash(body));
    if expected == found { Ok(body) } else { Err(LogError::Checksum { expected, found }) }
}

struct Old<'a, 'b> {
    cursor: &'a mut Cursor<'b>,
    session: Session,
    lasers: Vec<Arc<LaserModel>>,
    ids: Vec<KeyframeId>,
}

impl Old<'_, '_> {
    fn all(&mut self) -> Result<(), EntryError> {
        let settings = self.text("the settings")?;
        self.each("the lasers", Self::laser)?;
        self.each("the scans", Self::scan)?;
        let mut settings = Some(settings);
        self.each("the keyframes", |old| old.keyframe(&mut settings))?;
        if let Some(settings) = settings {
            self.session.add(Entry::Run(Run { id: RunId::default(), settings }))?;
        }
        self.each("the edges", Self::edge)?;
        self.cursor.end()
    }

    /// A counted list; nothing is set aside for a count that is only claimed.
    fn each(
        &mut self,
        expected: &'static str,
        mut item: impl FnMut(&mut Self) -> Result<(), EntryError>,
    ) -> Result<(), EntryError> {
        let count = self.cursor.u32(expected)?;
        (0..count).try_for_each(|_| item(self))
    }

    fn text(&mut self, expected: &'static str) -> Result<String, EntryError> {
        let length = self.cursor.u32(expected)? as usize;
        text(self.cursor.take(length, expected)?, expected)
    }

    fn laser(&mut self) -> Result<(), EntryError> {
        let name = self.text("a laser's name")?;
        self.lasers.push(Arc::new(LaserModel { name, ..sweep::geometry(self.cursor)? }));
        Ok(())
    }

    fn stamp(&mut self) -> Result<Stamp, EntryError> {
        Ok(Stamp(i64::from_le_bytes(self.cursor.array("a stamp")?)))
    }

    fn scan(&mut self) -> Result<(), EntryError> {
        let stamp = self.stamp()?;
        let [map_from_robot, odom_from_robot] = [self.cursor.pose()?, self.cursor.pose()?];
        let scan = ScanPose { stamp, keyframe: None, keyframe_from_robot: map_from_robot, odom_from_robot };
        self.session.add(Entry::Scan(scan))
    }

    /// The first keyframe of a run begins it; the first run has the settings.
    fn keyframe(&mut self, settings: &mut Option<String>) -> Result<(), EntryError> {
        let robot = u128::from_le_bytes(self.cursor.array("a keyframe's robot")?);
        let [session, seq] = [self.cursor.u32("a keyframe's session")?, self.cursor.u32("a keyframe's place")?];
        let id = KeyframeId { robot, session, seq };
        if self.session.next_id().map(KeyframeId::run) != Some(id.run()) {
            self.session.add(Entry::Run(Run { id: id.run(), settings: settings.take().unwrap_or_default() }))?;
        }
        let (stamp, scan) = (self.stamp()?, self.cursor.u64("a keyframe's scan")?);
        let map_from_keyframe: Pose2 = self.cursor.pose()?;
        let sweep = Arc::new(self.sweep()?);
        let keyframe = Keyframe { id, stamp, scan, sweep, hardly_fits: false };
        self.session.add_keyframe(Arc::new(keyframe), map_from_keyframe)?;
        self.ids.push(id);
        Ok(())
    }

    fn sweep(&mut self) -> Result<Sweep, EntryError> {
        let expected = "the number of one of the lasers";
        let number = self.cursor.u32(expected)?;
        let laser = self.lasers.get(number as usize);
        let laser = laser.ok_or_else(|| EntryError { expected, found: number.to_string() })?;
        let sweep = sweep::without_beams(laser, self.cursor)?;
        let beams = self.cursor.u32("a sweep's beams")? as usize;
        let codes = sweep::codes(self.cursor.take(beams.saturating_mul(2), "a sweep's beams")?)?;
        Ok(Sweep { codes, ..sweep })
    }

    fn edge(&mut self) -> Result<(), EntryError> {
        let [from, to] = [self.end_of_edge()?, self.end_of_edge()?];
        let kind = self.cursor.coded("an edge's kind, 0 to 2")?;
        let (from_from_to, information) = (self.cursor.pose()?, self.cursor.upper_triangle::<Pose2>()?);
        let edge = Edge { from, to, kind, from_from_to, information };
        self.session.add(Entry::Edge(RecordedEdge { edge, candidate: None }))
    }

    fn end_of_edge(&mut self) -> Result<KeyframeId, EntryError> {
        let expected = "the number of one of the keyframes";
        let number = self.cursor.u32(expected)?;
        let id = self.ids.get(number as usize).copied();
        id.ok_or_else(|| EntryError { expected, found: number.to_string() })
    }
}
