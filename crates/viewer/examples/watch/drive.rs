//! Robots that drive through simulated worlds.

use mapwright::{Job, JobResult, Jobs, LaserScan, Mapper, Settings as MapSettings, SpaceMapper, Update};
use mapwright_sim::space::{SpaceDrive, SpaceDriveSettings, worlds as space_worlds};
use mapwright_sim::{Drive, DriveSettings, Event, LaserSettings, worlds};
use mapwright_viewer::{Pen, Replay, ReplayMaker, Settings, View, Viewer, ViewerError};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

/// In real time, with the view.
pub(crate) fn watch(seconds: f64) -> Result<(), ViewerError> {
    let mut settings = MapSettings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let mut viewer = Viewer::start(view_settings(), pen(&settings))?;
    let mut mapper = Mapper::new(settings).expect("valid");
    println!("{}", viewer.url());
    let worker = Worker::new();
    let (mut is_busy, mut scans, mut took) = (false, 0_u64, Duration::ZERO);
    let mut last = None;
    let begun = Instant::now();
    for event in drive(seconds, 1440, 40.0) {
        let scan = match event {
            Event::Odometry(odometry) => {
                mapper.add_odometry(&odometry);
                continue;
            }
            Event::Scan(taken) => taken.scan,
        };
        thread::sleep(Duration::from_secs_f64(scan.stamp.as_secs_f64()).saturating_sub(begun.elapsed()));
        let mut updates = vec![mapper.add_scan(&scan)];
        if is_busy && let Ok(result) = worker.results.try_recv() {
            is_busy = false;
            updates.push(mapper.apply(result));
        }
        if !is_busy && let Some(job) = mapper.next_job() {
            is_busy = worker.jobs.send(job).is_ok();
        }
        scans += 1;
        let shown = Instant::now();
        viewer.scan(|| points(&scan));
        viewer.status(&[
            ("scans".into(), format!("{scans} mapped, none dropped")),
            ("laser".into(), format!("{} beams at 40 Hz", scan.ranges_m.len())),
        ]);
        updates.iter().for_each(|update| viewer.show(update, mapper.session()));
        took += shown.elapsed();
        last = updates.pop();
    }
    println!("{scans} scans; the view took {:.1} microseconds of each", took.as_secs_f64() * 1e6 / scans.max(1) as f64);
    if let Some(update) = last {
        viewer.finish(&update, mapper.session());
    }
    println!("the run is over; Ctrl-C ends the view");
    viewer.wait();
    Ok(())
}

/// A run that is over.
pub(crate) fn replay(seconds: f64) -> Result<(), ViewerError> {
    let settings = MapSettings::default();
    let pen = pen(&settings);
    let mut mapper = Mapper::new(settings).expect("valid");
    let mut maker = ReplayMaker::default();
    for event in drive(seconds, 360, 10.0) {
        match event {
            Event::Odometry(odometry) => mapper.add_odometry(&odometry),
            Event::Scan(taken) => take(&mut maker, mapper.add_scan(&taken.scan)),
        }
    }
    play(pen, maker.finish())
}

/// A lidar that climbs to another storey.
pub(crate) fn space(seconds: f64) -> Result<(), ViewerError> {
    let settings = MapSettings::default();
    let pen = pen(&settings);
    let mut mapper = SpaceMapper::new(settings).expect("valid");
    let mut maker = ReplayMaker::default();
    let drive = SpaceDriveSettings { duration_s: seconds, ..SpaceDriveSettings::default() };
    for taken in SpaceDrive::new(space_worlds::two_storey(3).into(), drive).clouds() {
        take(&mut maker, mapper.add_cloud(&taken.cloud));
    }
    play(pen, maker.finish())
}

fn take<M: View>(maker: &mut ReplayMaker<M>, update: Update<M>) {
    update.entries.into_iter().for_each(|entry| maker.add(entry).expect("a mapper's entries fit"));
}

fn play(pen: Pen, replay: Replay) -> Result<(), ViewerError> {
    println!("{} moments, {:.1} s", replay.len(), replay.duration_s());
    let viewer = Viewer::replay(view_settings(), pen, replay)?;
    println!("{}", viewer.url());
    viewer.wait();
    Ok(())
}

/// The port may be said, so that a page finds it again.
fn view_settings() -> Settings {
    let mut settings = Settings::default();
    if let Some(port) = std::env::var("PORT").ok().and_then(|port| port.parse().ok()) {
        settings.address.set_port(port);
    }
    settings
}

fn pen(settings: &MapSettings) -> Pen {
    Pen {
        resolution_m: settings.map.resolution_m,
        free_range_m: settings.scan.free_range_m,
        passes_per_hit: settings.map.passes_per_hit,
    }
}

fn drive(seconds: f64, beams: usize, scan_rate_hz: f64) -> Drive {
    let laser = LaserSettings::with_field_of_view(std::f64::consts::PI * 1.5, beams);
    let settings =
        DriveSettings { duration_s: seconds, scan_rate_hz, odometry_rate_hz: 100.0, laser, ..DriveSettings::default() };
    Drive::new(worlds::loop_of(1, 60.0).into(), settings)
}

/// End points of a scan in the robot's frame.
fn points(scan: &LaserScan) -> Vec<[f32; 3]> {
    let seen = scan.ranges_m.iter().enumerate().filter(|(_, range_m)| f64::from(**range_m) < scan.laser.range_max_m);
    let end = |(beam, &range_m): (usize, &f32)| {
        let (sin, cos) = scan.laser.bearing_in_robot(beam).sin_cos();
        let at = scan.laser.robot_from_laser;
        [at.x as f32 + range_m * cos as f32, at.y as f32 + range_m * sin as f32, 0.0]
    };
    seen.map(end).collect()
}

/// Jobs on another thread.
struct Worker {
    jobs: Sender<Job>,
    results: Receiver<JobResult>,
}

impl Worker {
    fn new() -> Self {
        let ((jobs, to_do), (done, results)) = (channel::<Job>(), channel());
        thread::spawn(move || to_do.into_iter().map(Job::run).try_for_each(|result| done.send(result)));
        Self { jobs, results }
    }
}
