//! The pipeline in space with an inertial sensor.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

#[allow(dead_code, reason = "shared with an example")]
use crate::support::inertial as support;

use mapwright::{
    Checkpoint, Correction, Entry, ImuReading, ImuReport, ImuTaken, Pose3, Settings, SpaceMapper, SpaceSweep, Stamp,
};
use mapwright_record::{LogWriter, read_log};
use mapwright_sim::Rng;
use mapwright_sim::space::ImuSettings;
use nalgebra::Vector3;
use support::{Given, Wanted, mapped, mapped_with};

fn fast_turns() -> Wanted {
    Wanted { seed: 1, seconds: 30.0, every: 4, turn_rate_rad_per_s: 2.4, ..Wanted::default() }
}

#[test]
fn fast_turns_between_clouds_are_predicted_and_the_bias_is_found() {
    let (with, without) = (mapped(&fast_turns(), Given::Imu), mapped(&fast_turns(), Given::Nothing));
    println!("with {:?} {:?}, without {:?}", with.predicted_deg, with.report, without.predicted_deg);
    assert!(with.fastest_deg > 45.0, "{}", with.fastest_deg);
    assert!(with.predicted_deg[0] < 0.1 && with.predicted_deg[1] < 1.0, "{:?}", with.predicted_deg);
    assert!(without.predicted_deg[0] > 1.0 && without.predicted_deg[1] > 15.0, "{:?}", without.predicted_deg);
    let ate_m = [&with, &without].map(|found| found.errors.absolute.translation_m.rmse);
    assert!(ate_m[0] <= ate_m[1] && with.untracked == 0, "{ate_m:?} {}", with.untracked);
    let report = with.report;
    let truth = Vector3::from(ImuSettings::default().turn_rate_bias_rad_per_s);
    let off = Vector3::from(report.bias_rad_per_s) - truth;
    assert!(off.norm() < 0.2 * truth.norm() && off.norm() < 4.0 * report.bias_sigma_rad_per_s, "{report:?}");
    assert_eq!((report.unsound, report.late, report.set_back, report.contradicted), (0, 0, 0, 0));
    // a direction's stated deviation is that of its error
    assert!(with.gravity_sigmas[0] > 0.2 && with.gravity_sigmas[0] < 1.3, "{:?}", with.gravity_sigmas);
}

#[test]
fn gravity_bounds_roll_and_pitch_on_the_way_around() {
    // A map that leans by itself, of six beams: one that is level anyway shows nothing.
    let wanted = Wanted { seed: 6, seconds: 140.0, beams: 6, ..Wanted::default() };
    let unlevelled = || {
        let mut settings = Settings::default();
        settings.loops.correction = Correction::None;
        mapped_with(&wanted, Given::Imu, settings, |reading| vec![reading], |_| ())
    };
    let (with, turns, without) = (mapped(&wanted, Given::Imu), mapped(&wanted, Given::TurnsOnly), unlevelled());
    println!("{:?}, by turns alone {:?}, uncorrected {:?}", with.lean_deg, turns.lean_deg, without.lean_deg);
    assert!(with.lean_deg[1] < 0.7 && with.lean_deg[1] < turns.lean_deg[1], "{:?}", with.lean_deg);
    assert!(without.lean_deg[1] > 1.0 && with.lean_deg[1] < 0.6 * without.lean_deg[1], "{:?}", without.lean_deg);
    assert!(with.report.gravity > 15 && turns.report.gravity == 0, "{:?}", with.report);
    assert_eq!(with.mapper.session().gravity().len() as u64, with.report.gravity);
    let ate_m = [&with, &turns].map(|found| found.errors.absolute.translation_m.rmse);
    assert!(ate_m[0] < 1.1 * ate_m[1], "{ate_m:?}");
}

#[test]
fn readings_that_are_late_in_disorder_bad_or_missing_do_no_harm() {
    let wanted = Wanted { seconds: 12.0, ..Wanted::default() };
    let without = mapped(&wanted, Given::Nothing);
    let bad = |reading: ImuReading| {
        let number = reading.stamp.0 / 5_000_000;
        let nan = ImuReading { turn_rate_rad_per_s: Vector3::repeat(f64::NAN), ..reading };
        let late = ImuReading { stamp: Stamp(reading.stamp.0 - 600_000_000), ..reading };
        let far = ImuReading { stamp: Stamp(i64::MIN / 4), ..reading };
        match number {
            // nothing for two seconds
            800..1200 => Vec::new(),
            1500 => vec![far, reading],
            _ if number % 50 == 0 => vec![nan, late, reading],
            _ => vec![reading],
        }
    };
    let found = mapped_with(&wanted, Given::Imu, Settings::default(), bad, |_| ());
    println!("{:?}", found.report);
    let [with_m, without_m] = [&found, &without].map(|found| found.errors.absolute.translation_m.rmse);
    assert!(with_m < 1.2 * without_m && found.untracked == 0, "{with_m} {without_m}");
    let report = found.report;
    assert!(report.unsound > 20 && report.late > 20 && report.set_back > 0 && report.unread > 10, "{report:?}");
}

/// An inertial sensor that is not mounted as is said contradicts matches as soon as the robot turns, and is left aside.
#[test]
fn a_sensor_that_is_mounted_otherwise_is_not_believed() {
    let wanted = Wanted { seconds: 20.0, ..Wanted::default() };
    let without = mapped(&wanted, Given::Nothing);
    let upside_down = |reading: ImuReading| {
        let force = reading.specific_force_m_per_s2;
        vec![ImuReading {
            turn_rate_rad_per_s: -reading.turn_rate_rad_per_s,
            specific_force_m_per_s2: force,
            ..reading
        }]
    };
    let found = mapped_with(&wanted, Given::Imu, Settings::default(), upside_down, |_| ());
    let [with_m, without_m] = [&found, &without].map(|found| found.errors.absolute.translation_m.rmse);
    println!("{with_m} {without_m} {:?}", found.report);
    assert!(found.report.contradicted > 3 && found.untracked == 0, "{:?}", found.report);
    assert!(with_m < without_m + 0.02, "{with_m} {without_m}");
}

#[test]
fn the_same_readings_make_the_same_bytes_and_the_log_keeps_gravity() {
    let wanted = Wanted { seconds: 15.0, ..Wanted::default() };
    let log = || {
        let drive = support::drive(&wanted);
        let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
        let (mut writer, mut bytes) = (LogWriter::<SpaceSweep>::new(), Vec::new());
        let mut readings = drive.imu_readings().peekable();
        for taken in drive.clouds() {
            let end = Stamp(taken.cloud.stamp.0 + 100_000_000);
            while let Some(reading) = readings.next_if(|reading| reading.stamp <= end) {
                assert_eq!(mapper.add_imu(reading), ImuTaken::Kept);
            }
            for entry in mapper.add_cloud(&taken.cloud).entries {
                writer.append(&mut bytes, &entry).unwrap();
            }
        }
        writer.finish(&mut bytes);
        (mapper, bytes)
    };
    let ((mapper, bytes), (_, again)) = (log(), log());
    assert!(bytes == again && !mapper.session().gravity().is_empty());
    let (session, report) = read_log::<SpaceSweep>(&bytes).unwrap();
    assert!(report.losses.is_empty() && &session == mapper.session());
}

/// The map is levelled by graphs that are solved: jobs.
#[test]
fn jobs_that_are_handed_out_and_come_back_at_once_are_those_done_inline() {
    let drive = support::drive(&Wanted { seed: 2, seconds: 60.0, ..Wanted::default() });
    let map = |jobs: &str| {
        let mut settings = Settings::default();
        settings.set("loops.jobs", jobs).unwrap();
        let (mut mapper, mut done) = (SpaceMapper::new(settings).unwrap(), 0);
        let mut readings = drive.imu_readings().peekable();
        for taken in drive.clouds().step_by(2) {
            let end = Stamp(taken.cloud.stamp.0 + 100_000_000);
            while let Some(reading) = readings.next_if(|reading| reading.stamp <= end) {
                mapper.add_imu(reading);
            }
            mapper.add_cloud(&taken.cloud);
            while let Some(job) = mapper.next_job() {
                mapper.apply(job.run());
                done += 1;
            }
        }
        let poses: Vec<Pose3> = mapper.session().trajectory().map(|pose| pose.map_from_robot).collect();
        (poses, mapper.session().corrections(), done)
    };
    let (inline, handed_out) = (map("inline"), map("handed-out"));
    assert!(inline.2 == 0 && handed_out.2 > 0 && handed_out.1 > 0, "{} jobs", handed_out.2);
    assert!(inline.0 == handed_out.0 && inline.1 == handed_out.1);
}

/// What readings have told is part of what a run goes on with: the bias, where down is, whether matches have borne them out, and those
/// that wait for their cloud.
#[test]
fn a_run_with_readings_that_stopped_goes_on_to_the_bit() {
    let drive = support::drive(&Wanted { seconds: 24.0, turn_rate_rad_per_s: 2.4, ..Wanted::default() });
    let clouds: Vec<_> = drive.clouds().step_by(2).map(|taken| taken.cloud).collect();
    let readings: Vec<ImuReading> = drive.imu_readings().collect();
    // Readings come 30 ms ahead of what the cloud needs, as they may where a run is stopped.
    let map = |mapper: &mut SpaceMapper, numbers: std::ops::Range<usize>| {
        let told_by = |number: usize| Stamp(clouds[number].stamp.0 + 130_000_000);
        for number in numbers {
            let since = number.checked_sub(1).map_or(Stamp(i64::MIN), told_by);
            let due = readings.iter().filter(|reading| (since < reading.stamp) && reading.stamp <= told_by(number));
            due.for_each(|reading| assert_eq!(mapper.add_imu(*reading), ImuTaken::Kept));
            mapper.add_cloud(&mapwright::Cloud { odom_from_robot: None, ..clouds[number].clone() });
        }
    };
    let told = |mapper: &SpaceMapper| {
        let session = mapper.session();
        let poses: Vec<Pose3> = session.trajectory().map(|pose| pose.map_from_robot).collect();
        let ImuReport { bias_rad_per_s, bias_sigma_rad_per_s, .. } = mapper.imu_report();
        let down: Vec<_> = session.gravity().iter().map(|known| (known.down_in_keyframe, known.sigma_rad)).collect();
        (poses, down, session.corrections(), bias_rad_per_s, bias_sigma_rad_per_s)
    };
    let mut whole = SpaceMapper::new(Settings::default()).unwrap();
    map(&mut whole, 0..clouds.len());
    let report = whole.imu_report();
    assert!(report.gravity > 3 && report.predicted > 20, "{report:?}");
    for stop in [1, 7, clouds.len() / 2, clouds.len() - 20] {
        let mut first = SpaceMapper::new(Settings::default()).unwrap();
        map(&mut first, 0..stop);
        let log = first.session().encode();
        let (killed, _) = read_log::<SpaceSweep>(&log).unwrap();
        first.checkpoint();
        let (session, losses) = read_log::<SpaceSweep>(&first.session().encode()).unwrap();
        assert!(losses.losses.is_empty() && session.checkpoint().is_some());
        let mut resumed = SpaceMapper::resume(Settings::default(), session).unwrap();
        map(&mut resumed, stop..clouds.len());
        assert!(told(&resumed) == told(&whole), "stopped after {stop}: {:?}, {:?}", resumed.imu_report(), report);
        // Without a checkpoint the bias is learnt anew, so that it is the checkpoint that makes them equal.
        let mut anew = SpaceMapper::resume(Settings::default(), killed).unwrap();
        map(&mut anew, stop..clouds.len());
        assert!(stop < 10 || told(&anew).3 != report.bias_rad_per_s);
    }
}

#[test]
fn bytes_of_a_checkpoint_with_readings_that_are_damaged_do_no_harm() {
    let drive = support::drive(&Wanted { seconds: 6.0, turn_rate_rad_per_s: 2.4, ..Wanted::default() });
    let clouds: Vec<_> = drive.clouds().step_by(2).map(|taken| taken.cloud).collect();
    let mut readings = drive.imu_readings().peekable();
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    for cloud in &clouds[..clouds.len() - 2] {
        while let Some(reading) = readings.next_if(|reading| reading.stamp.0 <= cloud.stamp.0 + 100_000_000) {
            mapper.add_imu(reading);
        }
        mapper.add_cloud(cloud);
    }
    let rest: Vec<ImuReading> = readings.collect();
    mapper.checkpoint();
    let state = mapper.session().checkpoint().unwrap().state.to_vec();
    let mut rng = Rng::new(3);
    for _ in 0..150 {
        let mut damaged = state.clone();
        for _ in 0..=rng.below(2) {
            let at = rng.below(damaged.len());
            damaged[at] = rng.below(256) as u8;
        }
        let mut session = mapper.session().clone();
        session.add(Entry::Checkpoint(Checkpoint { state: damaged.into() })).unwrap();
        let mut resumed = SpaceMapper::resume(Settings::default(), session).unwrap();
        for reading in &rest {
            resumed.add_imu(*reading);
        }
        for cloud in &clouds[clouds.len() - 2..] {
            assert!(resumed.add_cloud(cloud).map_from_robot.is_finite());
        }
    }
}
