//! Scans are fed on one thread, jobs run on another: no scan waits for a loop to be closed.
//! `cargo run --release -p mapwright --example jobs_on_a_worker`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{Entry, Job, JobResult, Jobs, Mapper, Settings, Update};
use mapwright_sim::{Drive, DriveSettings, worlds};
use std::error::Error;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;

fn main() -> Result<(), Box<dyn Error>> {
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let mut mapper = Mapper::new(settings)?;
    let (to_worker, jobs): (Sender<Job>, Receiver<Job>) = mpsc::channel();
    let (to_mapper, results): (Sender<JobResult>, Receiver<JobResult>) = mpsc::channel();
    let worker = thread::spawn(move || jobs.into_iter().try_for_each(|job| to_mapper.send(job.run())));
    let mut corrections = 0;
    for scan in Drive::new(worlds::loop_of(1, 120.0).into(), DriveSettings::default()).scans() {
        // What the worker has finished meanwhile is taken in between two scans.
        for result in results.try_iter() {
            corrections += usize::from(has_moved(&mapper.apply(result)));
        }
        mapper.add_scan(&scan.scan);
        while let Some(job) = mapper.next_job() {
            to_worker.send(job)?;
        }
    }
    drop(to_worker);
    for result in results {
        corrections += usize::from(has_moved(&mapper.apply(result)));
    }
    worker.join().map_err(|_| "a job panicked")??;
    println!("{} keyframes, corrected {corrections} times", mapper.keyframes().len());
    Ok(())
}

fn has_moved(update: &Update) -> bool {
    update.entries.iter().any(|entry| matches!(entry, Entry::Snapshot(_)))
}
