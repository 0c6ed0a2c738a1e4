//! A run over time, there and back.

use crate::client::{Client, records};
use crate::rooms::{Rooms, objection};
use crate::{PATIENCE, PEN, pose};
use mapwright_geom::Pose2;
use mapwright_record::Verdict;
use mapwright_viewer::{Replay, ReplayMaker, Settings, Viewer};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Sixty keyframes, a closure that is proposed, refused and accepted, a correction.
pub(crate) fn run() -> Replay {
    let (mut rooms, mut maker) = (Rooms::new(360), ReplayMaker::default());
    let mut updates = Vec::new();
    for number in 0..60 {
        updates.push(rooms.keyframe(pose(number), pose(number)));
        match number {
            20 => updates.push(rooms.candidate(2, 20, Verdict::Waiting(mapwright_record::Objection::Alone))),
            25 => updates.push(rooms.candidate(3, 25, Verdict::Refused(objection(0)))),
            30 => updates.push(rooms.candidate(2, 20, Verdict::Accepted)),
            31 => updates
                .push(rooms.correct(|number, pose| Pose2::new(pose.x, pose.y + 0.01 * number as f64, pose.theta))),
            _ => {}
        }
    }
    for entry in updates.into_iter().flat_map(|update| update.entries) {
        maker.add(entry).unwrap();
    }
    maker.finish()
}

/// What a page knows: by kind and place, tiles by both numbers.
#[derive(Default, PartialEq)]
struct Page(BTreeMap<(u32, Vec<u8>), Vec<u8>>);

impl Page {
    fn take(&mut self, message: &[u8]) {
        for (kind, bytes) in records(message) {
            let named = match kind {
                2 => 8,
                3 | 4 | 9 => 4,
                _ => 0,
            };
            self.0.insert((kind, bytes[..named].to_vec()), bytes.to_vec());
        }
    }

    fn of(&self, kind: u32) -> Vec<&Vec<u8>> {
        self.0.iter().filter(|((known, _), _)| *known == kind).map(|(_, bytes)| bytes).collect()
    }

    fn clock(&self) -> [f32; 2] {
        let clock = self.of(8);
        [0, 4].map(|at| clock.first().map_or(-1.0, |clock| f32::from_le_bytes(clock[at..at + 4].try_into().unwrap())))
    }

    fn keyframes(&self) -> u32 {
        self.of(10).first().map_or(0, |totals| u32::from_le_bytes(totals[..4].try_into().unwrap()))
    }

    /// Cells of the map that are no blank tiles.
    fn map(&self) -> Vec<Vec<u8>> {
        let is_blank = |tile: &Vec<u8>| tile[8..].chunks(2).all(|run| run[1] == 128);
        self.of(2).into_iter().filter(|tile| !is_blank(tile)).cloned().collect()
    }
}

/// Goes to a time and reads on until all is told.
fn go_to(client: &mut Client, page: &mut Page, at_s: f32) {
    client.ask("pause");
    client.ask(&format!("seek {at_s}"));
    let begun = Instant::now();
    let mut quiet = 0;
    while page.clock()[0] != at_s || quiet < 4 {
        match client.next(Duration::from_millis(150)) {
            Some(message) => {
                page.take(&message);
                quiet = 0;
            }
            None => quiet += 1,
        }
        assert!(begun.elapsed() < PATIENCE, "waited for {at_s} s, at {:?}", page.clock());
    }
}

#[test]
fn a_run_is_the_same_whichever_way_one_comes_there() {
    let replay = run();
    assert!((replay.duration_s() - 5.9).abs() < 1e-9 && replay.len() >= 60);
    let viewer = Viewer::replay(Settings::default(), PEN, replay).unwrap();
    let mut client = Client::connect(viewer.address(), "").unwrap();
    let mut page = Page::default();
    go_to(&mut client, &mut page, 2.5);
    let (early, keyframes, closures) = (page.map(), page.keyframes(), page.of(4)[0].len());
    assert!(early.len() > 10 && (25..=26).contains(&keyframes), "{} tiles, {keyframes} keyframes", early.len());
    assert!(closures >= 4 + 12);
    go_to(&mut client, &mut page, 5.75);
    assert!(page.keyframes() >= 57 && page.map().len() > early.len());
    go_to(&mut client, &mut page, 2.5);
    assert_eq!(page.keyframes(), keyframes);
    assert!(page.map() == early, "the map is another one on the way back");
    let mut late = Client::connect(viewer.address(), "").unwrap();
    let mut fresh = Page::default();
    go_to(&mut late, &mut fresh, 2.5);
    assert!(fresh.map() == early, "who comes late gets another map");
}

#[test]
fn what_a_run_lacks_is_not_made_up() {
    let empty = Replay::new([]);
    assert!(empty.is_empty() && empty.duration_s() == 0.0);
    let viewer = Viewer::replay(Settings::default(), PEN, empty).unwrap();
    let mut client = Client::connect(viewer.address(), "").unwrap();
    let message = client.next(PATIENCE).unwrap();
    assert!(records(&message).any(|(kind, _)| kind == 1) && records(&message).all(|(kind, _)| kind != 2 && kind != 6));
}
