//! Any bytes as clouds, odometry and inertial readings, and as the checkpoint that the mapper goes on from: no panic, a finite pose,
//! every point accounted for, and nothing already mapped is lost. `cargo +nightly fuzz run space_mapper -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright::{Checkpoint, Cloud, Entry, ImuReading, Pose3, Settings, SpaceMapper, SpaceSensor, Stamp};
use std::sync::Arc;

/// Takes a number's bytes off the front; zeros where there are none left.
fn take<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
    let mut taken = [0; N];
    let (front, rest) = bytes.split_at(N.min(bytes.len()));
    taken[..front.len()].copy_from_slice(front);
    *bytes = rest;
    taken
}

/// Any number, or one of those that rooms are made of.
fn number(bytes: &mut &[u8], choice: u8) -> f64 {
    if choice & 1 == 0 {
        f64::from(i16::from_le_bytes(take(bytes))) / 1000.0
    } else {
        f64::from(f32::from_le_bytes(take(bytes)))
    }
}

fn pose(bytes: &mut &[u8], choice: u8) -> Pose3 {
    let translation = [(); 3].map(|()| number(bytes, choice));
    let rotation = [(); 4].map(|()| number(bytes, choice));
    Pose3::from_quaternion(translation, rotation)
        .unwrap_or(Pose3 { translation: translation.into(), ..Pose3::identity() })
}

fn sensor(bytes: &mut &[u8], choice: u8) -> Arc<SpaceSensor> {
    if choice & 1 == 0 {
        return Arc::new(SpaceSensor::lidar("fuzzed"));
    }
    let [range_min_m, range_max_m, range_sigma_m, range_sigma_per_m] = [(); 4].map(|()| number(bytes, choice));
    let robot_from_sensor = pose(bytes, choice);
    let name = "fuzzed".to_owned();
    Arc::new(SpaceSensor { name, range_min_m, range_max_m, robot_from_sensor, range_sigma_m, range_sigma_per_m })
}

/// A stamp, odometry (or none), times (or none, or too few), and points: those of the bytes, each so often beside itself that some make
/// surfaces.
fn cloud(bytes: &mut &[u8], sensor: &Arc<SpaceSensor>) -> Cloud {
    let [choice, points, copies] = take(bytes);
    let stamp = Stamp(if choice & 2 == 0 {
        i64::from(u32::from_le_bytes(take(bytes)))
    } else {
        i64::from_le_bytes(take(bytes))
    });
    let odom_from_robot = (choice & 4 == 0).then(|| pose(bytes, choice >> 7));
    let seen = (0..points % 64).map(|_| [(); 3].map(|()| number(bytes, choice >> 6) as f32));
    let beside = |[x, y, z]: [f32; 3]| {
        (0..=copies % 32).map(move |k| [x + 0.1 * f32::from(k % 6), y + 0.1 * f32::from(k / 6), z])
    };
    let points_m: Vec<[f32; 3]> = seen.flat_map(beside).collect();
    let times = if choice & 8 == 0 { 0 } else { points_m.len().saturating_sub(usize::from(choice >> 4 & 1)) };
    let times_s =
        (0..times).map(|k| if choice & 32 == 0 { k as f32 * 1e-4 } else { number(bytes, 1) as f32 }).collect();
    let colours = if points & 64 == 0 { Vec::new() } else { vec![[1, 2, 3]; usize::from(copies)] };
    Cloud { stamp, sensor: Arc::clone(sensor), points_m, times_s, colours, intensities: Vec::new(), odom_from_robot }
}

fn imu(bytes: &mut &[u8], choice: u8) -> ImuReading {
    let stamp = Stamp(i64::from(u32::from_le_bytes(take(bytes))));
    let [turn_rate, force] = [(); 2].map(|()| [(); 3].map(|()| number(bytes, choice)).into());
    ImuReading { stamp, turn_rate_rad_per_s: turn_rate, specific_force_m_per_s2: (choice & 2 == 0).then_some(force) }
}

/// A mapper that goes on from a checkpoint with some of its bytes changed, or replaced by any.
fn resumed(mut mapper: SpaceMapper, bytes: &mut &[u8]) -> SpaceMapper {
    let [choice, count] = take(bytes);
    mapper.checkpoint();
    let mut session = mapper.session().clone();
    let Some(state) = session.checkpoint().map(|checkpoint| checkpoint.state.to_vec()) else { return mapper };
    let mut state = if choice & 1 == 0 { state } else { (0..count).map(|_| take::<1>(bytes)[0]).collect() };
    for _ in 0..count % 4 {
        let at = usize::from(u16::from_le_bytes(take(bytes)));
        let [change] = take(bytes);
        let size = state.len().max(1);
        if let Some(byte) = state.get_mut(at % size) {
            *byte ^= change;
        }
    }
    session.add(Entry::Checkpoint(Checkpoint { state: state.into() })).expect("a checkpoint is any bytes");
    SpaceMapper::resume(Settings::default(), session).expect("valid")
}

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes;
    let [choice] = take(&mut bytes);
    let sensor = sensor(&mut bytes, choice);
    let mut mapper = SpaceMapper::new(Settings::default()).expect("valid");
    while !bytes.is_empty() {
        let [what] = take(&mut bytes);
        match what % 8 {
            0 | 1 => drop(mapper.add_imu(imu(&mut bytes, what >> 3))),
            2 => mapper = resumed(mapper, &mut bytes),
            _ => {
                let keyframes = mapper.session().keyframes().len();
                let cloud = cloud(&mut bytes, &sensor);
                let update = mapper.add_cloud(&cloud);
                let beams = update.beams;
                let counted = beams.returns + beams.no_return + beams.too_near + beams.not_a_number + beams.refused;
                assert_eq!(counted as usize, cloud.points_m.len(), "{beams:?}");
                let translation = update.map_from_robot.translation;
                assert!(update.map_from_robot.is_finite() && translation.amax() <= 1e6, "{translation:?}");
                assert!(mapper.session().keyframes().len() >= keyframes);
            }
        }
    }
});
