//! The pipeline in space on simulated buildings.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use mapwright::{Cloud, EdgeKind, Pose3, Settings, SpaceMapper, SpaceSensor, SpaceSweep, Stamp, Status};
use mapwright_eval::{Alignment, RpeSettings, SpaceErrors, space_errors};
use mapwright_record::{Checkpoint, Entry, LogWriter, read_log};
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use std::sync::Arc;

fn drive(seed: u64, duration_s: f64) -> SpaceDrive {
    let lidar = LidarSettings { columns: 360, ..LidarSettings::spinning(16) };
    let settings = SpaceDriveSettings { lidar, seed, duration_s, ..SpaceDriveSettings::default() };
    SpaceDrive::new(Arc::new(worlds::two_storey(seed)), settings)
}

/// Maps a drive; the errors, and how many clouds were not tracked.
fn mapped(drive: &SpaceDrive, change: impl Fn(&mut Cloud)) -> (SpaceMapper, SpaceErrors, usize) {
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    let (mut truth, mut untracked) = (Vec::<(Stamp, Pose3)>::new(), 0);
    for taken in drive.clouds() {
        let mut cloud = taken.cloud;
        change(&mut cloud);
        truth.push((cloud.stamp, taken.world_from_robot));
        untracked += usize::from(mapper.add_cloud(&cloud).status != Status::Tracking);
    }
    let way: Vec<(Stamp, Pose3)> =
        mapper.session().trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
    let errors = space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default()).unwrap();
    (mapper, errors, untracked)
}

#[test]
fn a_building_is_mapped_with_and_without_wheels() {
    for with_wheels in [true, false] {
        let (mapper, errors, untracked) = mapped(&drive(3, 30.0), |cloud| {
            cloud.odom_from_robot = cloud.odom_from_robot.filter(|_| with_wheels);
        });
        let (absolute, relative) = (errors.absolute.translation_m, errors.relative.translation_m);
        assert!(absolute.rmse < 0.06 && relative.median < 0.006, "{absolute:?} {relative:?}");
        assert_eq!(untracked, 0);
        let session = mapper.session();
        assert!(session.keyframes().len() > 20);
        assert!(session.edges().any(|edge| edge.kind == EdgeKind::Match));
        let points = mapwright::points_of(session, 0.1);
        assert!(points.points_m.len() > 5000 && points.colours.is_empty());
    }
}

#[test]
fn the_same_clouds_make_the_same_bytes_and_the_log_is_the_session() {
    let drive = drive(5, 6.0);
    let log = || {
        let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
        let (mut writer, mut bytes) = (LogWriter::<SpaceSweep>::new(), Vec::new());
        for taken in drive.clouds() {
            for entry in mapper.add_cloud(&taken.cloud).entries {
                writer.append(&mut bytes, &entry).unwrap();
            }
        }
        writer.finish(&mut bytes);
        (mapper, bytes)
    };
    let ((mapper, bytes), (_, again)) = (log(), log());
    assert!(bytes == again && bytes.len() > 10_000);
    let (session, report) = read_log::<SpaceSweep>(&bytes).unwrap();
    assert!(report.losses.is_empty() && &session == mapper.session());
}

#[test]
fn clouds_of_any_kind_are_used_or_counted() {
    let sensor = Arc::new(SpaceSensor::lidar("top"));
    let cloud = |points_m: Vec<[f32; 3]>| Cloud {
        stamp: Stamp(0),
        sensor: Arc::clone(&sensor),
        points_m,
        times_s: Vec::new(),
        colours: Vec::new(),
        intensities: Vec::new(),
        sigmas_m: Vec::new(),
        odom_from_robot: None,
    };
    let plane = || (0..900).map(|k| [5.0 + 0.1 * (k % 30) as f32, 0.1 * (k / 30) as f32, 0.0]).collect::<Vec<_>>();
    let line: Vec<[f32; 3]> = (0..500).map(|k| [1.0 + 0.1 * k as f32, 0.0, 0.0]).collect();
    let mut odd = vec![
        cloud(Vec::new()),
        cloud(vec![[f32::NAN; 3]; 200]),
        cloud(vec![[f32::INFINITY, 0.0, 0.0]; 200]),
        cloud(vec![[1e30, 1e30, 1e30]; 200]),
        cloud(vec![[0.01, 0.0, 0.0]; 200]),
        cloud(vec![[3.0, 1.0, 0.5]]),
        cloud(vec![[3.0, 1.0, 0.5]; 300]),
        cloud(line),
        cloud(plane()),
    ];
    odd.push(Cloud { times_s: vec![0.0; 3], ..cloud(plane()) });
    odd.push(Cloud { times_s: vec![f32::NAN; 900], ..cloud(plane()) });
    odd.push(Cloud { times_s: vec![1e30; 900], ..cloud(plane()) });
    odd.push(Cloud { colours: vec![[1, 2, 3]; 5], ..cloud(plane()) });
    odd.push(Cloud { intensities: vec![1.0; 5], ..cloud(plane()) });
    odd.push(Cloud { sigmas_m: vec![0.1; 5], ..cloud(plane()) });
    odd.push(Cloud { sigmas_m: vec![f32::NAN; 900], ..cloud(plane()) });
    odd.push(Cloud { sigmas_m: vec![-1e30; 900], ..cloud(plane()) });
    odd.push(Cloud { sigmas_m: vec![9.0; 900], ..cloud(plane()) });
    let far = Pose3 { translation: [1e300, 0.0, f64::NAN].into(), ..Pose3::identity() };
    odd.push(Cloud { odom_from_robot: Some(far), ..cloud(plane()) });
    let bad = SpaceSensor { range_sigma_m: f64::NAN, ..SpaceSensor::lidar("bad") };
    odd.push(Cloud { sensor: Arc::new(bad), ..cloud(plane()) });
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    let mut stamp = 0;
    for _ in 0..3 {
        for cloud in &odd {
            stamp += 100_000_000;
            // Every other stamp runs backwards.
            let stamp = Stamp(if stamp % 200_000_000 == 0 { stamp } else { -stamp });
            let update = mapper.add_cloud(&Cloud { stamp, ..cloud.clone() });
            let beams = update.beams;
            let counted =
                beams.returns + beams.no_return + beams.too_near + beams.not_a_number + beams.refused + beams.uncertain;
            assert_eq!(counted as usize, cloud.points_m.len(), "{beams:?}");
            assert!(update.map_from_robot.is_finite() && update.unwritten.is_empty());
        }
    }
    assert_eq!(mapper.session().scans().len(), 3 * odd.len());
}

/// Maps clouds of a drive from one number to another; what goes into its log.
fn log_of(
    mapper: &mut SpaceMapper,
    drive: &SpaceDrive,
    clouds: std::ops::Range<u64>,
    earlier: Option<&[u8]>,
) -> Vec<u8> {
    let mut bytes = earlier.map_or_else(Vec::new, <[u8]>::to_vec);
    let mut writer = earlier.map_or_else(LogWriter::<SpaceSweep>::new, |bytes| {
        LogWriter::resume(&read_log::<SpaceSweep>(bytes).unwrap().0)
    });
    for cloud in clouds.map_while(|number| drive.cloud(number)) {
        for entry in mapper.add_cloud(&cloud.cloud).entries {
            writer.append(&mut bytes, &entry).unwrap();
        }
    }
    writer.finish(&mut bytes);
    bytes
}

#[test]
fn a_run_that_stopped_goes_on_to_the_bit_and_one_that_was_killed_goes_on() {
    let drive = drive(4, 14.0);
    let poses =
        |mapper: &SpaceMapper| mapper.session().trajectory().map(|pose| pose.map_from_robot).collect::<Vec<_>>();
    let mut whole = SpaceMapper::new(Settings::default()).unwrap();
    log_of(&mut whole, &drive, 0..u64::MAX, None);
    let whole = poses(&whole);
    let truth: Vec<_> = drive.clouds().map(|taken| (taken.cloud.stamp, taken.world_from_robot)).collect();
    let ate_m = |poses: &[Pose3]| {
        let way: Vec<_> = truth.iter().zip(poses).map(|((stamp, _), pose)| (*stamp, *pose)).collect();
        space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default()).unwrap().absolute.translation_m.rmse
    };
    for stop in [1, 60, 100] {
        let mut first = SpaceMapper::new(Settings::default()).unwrap();
        let mut log = log_of(&mut first, &drive, 0..stop, None);
        let killed_log = log.clone();
        let killed = read_log::<SpaceSweep>(&log).unwrap().0;
        let mut writer = LogWriter::resume(&killed);
        for entry in first.checkpoint().entries {
            writer.append(&mut log, &entry).unwrap();
        }
        writer.finish(&mut log);
        let (session, report) = read_log::<SpaceSweep>(&log).unwrap();
        assert!(report.losses.is_empty() && session.checkpoint().is_some());
        let mut resumed = SpaceMapper::resume(Settings::default(), session).unwrap();
        let log = log_of(&mut resumed, &drive, stop..u64::MAX, Some(&log));
        assert!(poses(&resumed) == whole, "stopped after {stop}");
        assert_eq!(&read_log::<SpaceSweep>(&log).unwrap().0, resumed.session());

        let mut resumed = SpaceMapper::resume(Settings::default(), killed).unwrap();
        log_of(&mut resumed, &drive, stop..u64::MAX, Some(&killed_log));
        let (killed_m, whole_m) = (ate_m(&poses(&resumed)), ate_m(&whole));
        assert!(killed_m < whole_m + 0.01, "{stop}: {killed_m}, without a stop {whole_m}");
    }
}

#[test]
fn bytes_of_a_checkpoint_that_are_damaged_do_no_harm() {
    let drive = drive(4, 6.0);
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    log_of(&mut mapper, &drive, 0..u64::MAX, None);
    mapper.checkpoint();
    let state = mapper.session().checkpoint().unwrap().state.to_vec();
    let step = state.len() / 40;
    for place in (0..state.len()).step_by(step.max(1)) {
        let mut damaged = state.clone();
        damaged[place] ^= 0x55;
        let mut session = mapper.session().clone();
        session.add(Entry::Checkpoint(Checkpoint { state: damaged.into() })).unwrap();
        let mut resumed = SpaceMapper::resume(Settings::default(), session).unwrap();
        resumed.add_cloud(&drive.cloud(30).unwrap().cloud);
    }
}

/// What is matched against does not grow with the way: keyframes that are no longer certain relative to the robot leave.
#[test]
fn the_local_map_does_not_grow_with_the_way() {
    let lidar = LidarSettings { columns: 180, ..LidarSettings::spinning(8) };
    let settings = SpaceDriveSettings { lidar, seed: 2, ..SpaceDriveSettings::default() };
    let drive = SpaceDrive::new(Arc::new(worlds::growing_halls(2, 150.0)), settings);
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    let mut voxels = Vec::new();
    for number in (0..).step_by(4) {
        let Some(taken) = drive.cloud(number) else { break };
        mapper.add_cloud(&taken.cloud);
        voxels.push(mapper.local_map_voxels());
    }
    let quarter = voxels.len() / 4;
    let mean = |part: &[usize]| part.iter().sum::<usize>() as f64 / part.len() as f64;
    let (second, last) = (mean(&voxels[quarter..2 * quarter]), mean(&voxels[3 * quarter..]));
    assert!(second > 500.0 && last < 1.5 * second, "{second} voxels, then {last}");
    assert!(mapper.session().keyframes().len() > 100, "{}", mapper.session().keyframes().len());
}
