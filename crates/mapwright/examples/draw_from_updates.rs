//! A viewer that knows updates and nothing else: it keeps a session and a map of its own in step with a mapper.
//! `cargo run --release -p mapwright --example draw_from_updates`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{GlobalMap, Mapper, Session, Settings};
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::error::Error;

/// Updates between two pictures.
const DRAW_EVERY: u64 = 200;

fn main() -> Result<(), Box<dyn Error>> {
    let settings = Settings::default();
    let mut mapper = Mapper::new(settings)?;
    let (mut session, mut map): (Session, _) = (Session::default(), GlobalMap::new(&settings));
    for scan in Drive::new(worlds::rooms(3).into(), DriveSettings::default()).scans().take(1000) {
        let update = mapper.add_scan(&scan.scan);
        // This is all that a viewer, a file or another robot needs to be told.
        session.add_all(update.entries)?;
        if update.scan % DRAW_EVERY == 0 {
            let drawn = map.follow(&session, 2);
            let known = map.counts().known_cells().count();
            println!("scan {}: {drawn} keyframes drawn or moved, {known} cells known", update.scan);
        }
    }
    assert!(&session == mapper.session(), "the updates say everything");
    Ok(())
}
