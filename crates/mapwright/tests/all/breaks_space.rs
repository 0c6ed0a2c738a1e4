//! Breaks in space: robots that were carried, gaps, and drives of which nobody knows how they belong together.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use mapwright::{
    Cloud, FragmentStart, Localisation, Pose3, RunId, Session, Settings, SpaceMapper, SpaceSweep, Stamp, Status,
};
use mapwright_eval::{Alignment, RpeSettings, space_errors};
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use std::convert::Infallible;
use std::sync::Arc;

/// Clouds of a drive without wheels, five a second, each with its true pose.
fn clouds(seed: u64, duration_s: f64) -> Vec<(Cloud, Pose3)> {
    let lidar = LidarSettings { columns: 360, ..LidarSettings::spinning(32) };
    let settings = SpaceDriveSettings { lidar, seed, duration_s, ..SpaceDriveSettings::default() };
    let drive = SpaceDrive::new(Arc::new(worlds::two_storey(seed)), settings);
    let taken = (0..).step_by(2).map_while(|number| drive.cloud(number));
    taken.map(|taken| (Cloud { odom_from_robot: None, ..taken.cloud }, taken.world_from_robot)).collect()
}

/// The same clouds as they came one after the other.
fn as_they_came(clouds: impl Iterator<Item = (Cloud, Pose3)>) -> Vec<(Cloud, Pose3)> {
    let stamped =
        |(k, (cloud, truth)): (i64, (Cloud, Pose3))| (Cloud { stamp: Stamp(k * 200_000_000), ..cloud }, truth);
    (0..).zip(clouds).map(stamped).collect()
}

fn mapped(clouds: &[(Cloud, Pose3)]) -> SpaceMapper {
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    clouds.iter().for_each(|(cloud, _)| {
        mapper.add_cloud(cloud);
    });
    mapper
}

/// How far a session's way lies from the truth, root mean square, metres.
fn ate_m(session: &Session<SpaceSweep>, clouds: &[(Cloud, Pose3)]) -> f64 {
    let truth: Vec<(Stamp, Pose3)> = clouds.iter().map(|(cloud, truth)| (cloud.stamp, *truth)).collect();
    let way: Vec<(Stamp, Pose3)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
    space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default()).unwrap().absolute.translation_m.rmse
}

fn breaks(session: &Session<SpaceSweep>) -> Vec<FragmentStart> {
    session.fragments().iter().filter(|fragment| session.is_break(fragment)).map(|fragment| fragment.start).collect()
}

#[test]
fn a_robot_that_was_carried_is_told_and_found_where_it_was_put_down() {
    let all = clouds(3, 40.0);
    let (third, half) = (all.len() / 3, all.len() * 2 / 3);
    // Carried ahead, and at the end to where it had been taken away.
    let order = (0..third).chain(half..all.len()).chain(third..half);
    let carried = as_they_came(order.map(|k| all[k].clone()));
    let mapper = mapped(&carried);
    let session = mapper.session();
    assert!(!breaks(session).is_empty());
    assert_eq!(session.maps().len(), 1, "{:?}", breaks(session));
    // The cloud that a fragment begins with may hang on nothing else; all others are where they are.
    let way: Vec<Pose3> = session.trajectory().map(|pose| pose.map_from_robot).collect();
    let error_m = |k: usize| (way[0].inverse() * way[k]).distance(carried[0].1.inverse() * carried[k].1);
    let off: Vec<usize> = (0..way.len()).filter(|&k| error_m(k) > 0.1).collect();
    assert!(off.len() <= breaks(session).len(), "{off:?} {:?}", breaks(session));
}

#[test]
fn a_gap_in_a_known_place_costs_nothing() {
    let mut all = clouds(3, 30.0);
    all.drain(70..85);
    let mapper = mapped(&all);
    let ate_m = ate_m(mapper.session(), &all);
    assert!(mapper.session().maps().len() == 1 && ate_m < 0.05, "{:?} {ate_m}", breaks(mapper.session()));
}

#[test]
fn a_gap_of_years_is_looked_over_like_one_of_seconds() {
    let mut all = clouds(3, 30.0);
    all.drain(70..85);
    for (cloud, _) in &mut all[70..] {
        cloud.stamp = Stamp(cloud.stamp.0 + 1_000_000_000_000_000_000);
    }
    let mapper = mapped(&all);
    assert!(mapper.session().maps().len() == 1 && ate_m(mapper.session(), &all) < 0.05);
}

#[test]
fn two_buildings_in_one_recording_are_two_maps() {
    let both = as_they_came(clouds(3, 10.0).into_iter().chain(clouds(8, 10.0)));
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    let said: Vec<Localisation> = both.iter().map(|(cloud, _)| mapper.add_cloud(cloud).localisation).collect();
    let session = mapper.session();
    assert_eq!((session.maps().len(), breaks(session).len()), (2, 1), "{:?}", breaks(session));
    assert_eq!(said.iter().filter(|said| **said == Localisation::Apart).count(), both.len() / 2);
}

#[test]
fn drives_of_which_nobody_knows_how_they_belong_together_make_one_map() {
    let all = clouds(3, 40.0);
    let (first, second) = all.split_at(all.len() / 2 + 10);
    let second = [&all[all.len() / 2 - 10..all.len() / 2 + 10], second].concat();
    let mut merged = SpaceMapper::resume(Settings::default(), mapped(first).session().clone()).unwrap();
    let told = |_| Ok::<(), Infallible>(());
    let Ok(()) = merged.import(mapped(&second).session(), told);
    let session = merged.session();
    assert_eq!(session.maps().len(), 1, "{:?}", session.candidates().iter().map(|c| c.verdict).collect::<Vec<_>>());
    let way: Vec<(Cloud, Pose3)> = first.iter().chain(&second).cloned().collect();
    assert_eq!(session.scans().len(), way.len());
    let truth = session.trajectory().zip(&way).collect::<Vec<_>>();
    let (begin, end) = (truth[0].0.map_from_robot, truth[way.len() - 1].0.map_from_robot);
    let error = begin.inverse() * end;
    let true_step = way[0].1.inverse() * way[way.len() - 1].1;
    assert!(error.distance(true_step) < 0.2, "{error:?} {true_step:?}");
}

#[test]
fn a_robot_is_located_in_a_finished_map_which_stays_as_it_is() {
    let all = clouds(3, 40.0);
    let map = mapped(&all);
    let before = map.session().map_from_keyframe().to_vec();
    let mut mapper = SpaceMapper::localising(Settings::default(), map.session().clone()).unwrap();
    let mut errors_m = Vec::new();
    for (cloud, truth) in &all[all.len() / 2..] {
        let update = mapper.add_cloud(cloud);
        assert!(update.localisation == Localisation::Joined || update.status == Status::Lost);
        if update.localisation == Localisation::Joined {
            let map_from_world = map.session().trajectory().next().unwrap().map_from_robot * all[0].1.inverse();
            errors_m.push((map_from_world * *truth).distance(update.map_from_robot));
        }
    }
    assert!(errors_m.len() > 10 && errors_m.iter().all(|error_m| *error_m < 0.3), "{errors_m:?}");
    assert_eq!(mapper.session().map_from_keyframe()[..before.len()], before[..]);
    let run = RunId::of_robot("robot");
    assert!(mapper.session().runs().all(|known| known.id.robot == run.robot));
}
