//! Wheels that slip in a bare corridor: scans that fall behind say so together, and what was mapped since is moved.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use mapwright::{Mapper, Pose2, Settings};
use mapwright_sim::{Drive, DriveSettings, worlds};

/// Keyframes before the first one that was moved, against which a pose is judged.
const BEFORE: usize = 10;

#[test]
fn a_slip_in_a_corridor_of_equal_doors_is_put_right_where_it_began() {
    let site = worlds::corridor_grid(103, 1900.0);
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let (mut truths, mut errors_m): (Vec<Pose2>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    let mut last = None;
    for scan in Drive::new(site.into(), DriveSettings::long_drive(103)).scans().take(2200) {
        let (mended, truth) = (mapper.session().slips().len(), scan.world_from_robot);
        let old_poses = mapper.keyframe_poses().to_vec();
        let update = mapper.add_scan(&scan.scan);
        if let Some(slip) = mapper.session().slips().get(mended) {
            let from = slip.from.seq as usize - BEFORE;
            let error_m = |keyframe: Pose2, robot: Pose2, truth: Pose2| {
                let error = truths[from].between(truth).between(keyframe.between(robot));
                error.x.hypot(error.y)
            };
            let (before, before_truth): (Pose2, Pose2) = last.expect("not the first scan");
            let after_m = error_m(mapper.keyframe_poses()[from], update.map_from_robot, truth);
            errors_m.push([error_m(old_poses[from], before, before_truth), after_m]);
            println!("{slip:?}: {:.3?} m", errors_m.last());
        }
        truths.resize(mapper.keyframes().len(), truth);
        last = Some((update.map_from_robot, truth));
    }
    let sum = |k: usize| errors_m.iter().map(|pair| pair[k]).sum::<f64>();
    assert!(errors_m.len() >= 2, "{} slips were seen", errors_m.len());
    assert!(sum(1) < 0.6 * sum(0), "{:.3} m are left of {:.3} m", sum(1), sum(0));
}
