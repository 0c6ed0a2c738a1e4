//! A run is written to a log as it goes; another mapper goes on with what is in it, to the same poses.
//! `cargo run --release -p mapwright --example save_and_resume`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{Mapper, Session, Settings};
use mapwright_record::LogWriter;
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut scans = Drive::new(worlds::rooms(3).into(), DriveSettings::default()).scans();
    let mut mapper = Mapper::new(Settings::default())?;
    // `log` may be a file's buffer as well: it is only ever appended to.
    let (mut writer, mut log) = (LogWriter::new(), Vec::new());
    for scan in scans.by_ref().take(600) {
        for entry in mapper.add_scan(&scan.scan).entries {
            writer.append(&mut log, &entry)?;
        }
    }
    // With it the other one goes on as if this one had; a run that is killed has none.
    for entry in mapper.checkpoint().entries {
        writer.append(&mut log, &entry)?;
    }
    writer.finish(&mut log);
    println!("{} keyframes in {} bytes", mapper.keyframes().len(), log.len());

    let (session, report) = Session::read(&log)?;
    assert!(report.is_whole());
    let mut resumed = Mapper::resume(Settings::default(), session)?;
    for scan in scans.take(600) {
        resumed.add_scan(&scan.scan);
        mapper.add_scan(&scan.scan);
    }
    assert_eq!(mapper.keyframe_poses(), resumed.keyframe_poses(), "the same to the bit");
    for run in resumed.session().runs() {
        println!("session {}", run.id.session);
    }
    println!("{} keyframes", resumed.keyframes().len());
    Ok(())
}
