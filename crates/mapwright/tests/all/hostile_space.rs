//! Whatever arrives in space, the mapper goes on: no panic, a finite pose, every point accounted for, nothing already mapped is lost.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use mapwright::{Checkpoint, Cloud, Entry, ImuReading, Pose3, Settings, SpaceMapper, SpaceSensor, Stamp};
use mapwright_geom::FARTHEST_M;
use mapwright_sim::Rng;
use std::sync::Arc;

const INPUTS: u64 = 300;
/// Clouds, readings and resumptions of an input at most.
const STEPS: usize = 12;
/// What may stand where a number is expected.
const STRANGE: [f64; 10] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, 1e300, -1e300, 1e-320, 3e38, 1e6];

/// A number within so much of zero, or once in `strange_every` any.
fn number(rng: &mut Rng, within: f64, strange_every: usize) -> f64 {
    match rng.below(strange_every) {
        0 => STRANGE[rng.below(STRANGE.len())],
        1 => f64::from_bits(rng.next_u64()),
        _ => rng.uniform(-within, within),
    }
}

fn pose(rng: &mut Rng, strange_every: usize) -> Pose3 {
    let translation = [(); 3].map(|()| number(rng, 2.0, strange_every));
    let rotation = [(); 4].map(|()| number(rng, 1.0, strange_every));
    let odd = Pose3 { translation: translation.into(), ..Pose3::identity() };
    Pose3::from_quaternion(translation, rotation).unwrap_or(odd)
}

fn sensor(rng: &mut Rng) -> Arc<SpaceSensor> {
    if rng.below(3) > 0 {
        return Arc::new(SpaceSensor::lidar("hostile"));
    }
    let [range_min_m, range_max_m, range_sigma_m, range_sigma_per_m] =
        [1.0, 100.0, 0.1, 0.01].map(|v| number(rng, v, 8));
    let robot_from_sensor = pose(rng, 20);
    let name = "hostile".to_owned();
    Arc::new(SpaceSensor { name, range_min_m, range_max_m, robot_from_sensor, range_sigma_m, range_sigma_per_m })
}

/// Patches of surfaces around the robot, or points anywhere.
fn points_m(rng: &mut Rng) -> Vec<[f32; 3]> {
    let strange_every = [4, 1000, 1_000_000][rng.below(3)];
    let mut points_m = Vec::new();
    for _ in 0..rng.below(30) {
        let corner = [(); 3].map(|()| number(rng, 12.0, strange_every));
        let (side, fixed) = (rng.below(8), rng.below(3));
        for k in 0..side * side {
            let mut point = corner;
            point[(fixed + 1) % 3] += 0.1 * (k % side) as f64;
            point[(fixed + 2) % 3] += 0.1 * (k / side) as f64;
            points_m.push(point.map(|v| v as f32));
        }
    }
    points_m
}

fn cloud(rng: &mut Rng, number_of_cloud: i64, sensor: &Arc<SpaceSensor>) -> Cloud {
    let points_m = points_m(rng);
    let stamp = Stamp(if rng.below(5) > 0 { 100_000_000 * number_of_cloud } else { rng.next_u64() as i64 });
    let times = [0, points_m.len(), points_m.len(), points_m.len() / 2][rng.below(4)];
    let times_every = [3, 1_000_000][rng.below(2)];
    let times_s = (0..times).map(|_| number(rng, 0.1, times_every) as f32).collect();
    let colours = vec![[1, 2, 3]; [0, points_m.len(), 5][rng.below(3)]];
    let odom_from_robot = (rng.below(3) > 0).then(|| pose(rng, 20));
    Cloud {
        stamp,
        sensor: Arc::clone(sensor),
        points_m,
        times_s,
        colours,
        intensities: Vec::new(),
        sigmas_m: Vec::new(),
        odom_from_robot,
    }
}

fn imu(rng: &mut Rng, number_of_cloud: i64) -> ImuReading {
    let stamp = if rng.below(5) > 0 { 100_000_000 * number_of_cloud + 1 } else { rng.next_u64() as i64 };
    let turn_rate_rad_per_s = [(); 3].map(|()| number(rng, 1.0, 10)).into();
    let force = [(); 3].map(|()| number(rng, 10.0, 10)).into();
    ImuReading {
        stamp: Stamp(stamp),
        turn_rate_rad_per_s,
        specific_force_m_per_s2: (rng.below(2) > 0).then_some(force),
    }
}

/// A mapper that goes on from bytes that are nearly its checkpoint's, or any.
fn resumed(mut mapper: SpaceMapper, rng: &mut Rng) -> SpaceMapper {
    mapper.checkpoint();
    let mut session = mapper.session().clone();
    let checkpoint = session.checkpoint().expect("it was taken down");
    let mut state = checkpoint.state.to_vec();
    match rng.below(4) {
        0 => state.truncate(rng.below(state.len())),
        1 => state = (0..rng.below(300)).map(|_| rng.next_u64() as u8).collect(),
        _ => {
            for _ in 0..rng.below(4) {
                let at = rng.below(state.len());
                state[at] ^= rng.next_u64() as u8;
            }
        }
    }
    session.add(Entry::Checkpoint(Checkpoint { state: state.into() })).expect("a checkpoint is any bytes");
    SpaceMapper::resume(Settings::default(), session).expect("valid")
}

fn check(mapper: &mut SpaceMapper, cloud: &Cloud) {
    let keyframes = mapper.session().keyframes().len();
    let update = mapper.add_cloud(cloud);
    let beams = update.beams;
    let counted = beams.returns + beams.no_return + beams.too_near + beams.not_a_number + beams.refused;
    assert_eq!(counted as usize, cloud.points_m.len(), "{beams:?}");
    let pose = update.map_from_robot;
    assert!(pose.is_finite() && pose.translation.amax() <= FARTHEST_M, "{pose:?}");
    assert!(mapper.session().keyframes().len() >= keyframes);
}

#[test]
fn arbitrary_clouds_readings_and_checkpoints_are_survived() {
    let mut keyframes = 0;
    for seed in 0..INPUTS {
        let rng = &mut Rng::new(seed);
        let sensor = sensor(rng);
        let mut mapper = SpaceMapper::new(Settings::default()).expect("valid");
        for step in 0..rng.below(STEPS) as i64 {
            match rng.below(8) {
                0 | 1 => drop(mapper.add_imu(imu(rng, step))),
                2 => mapper = resumed(mapper, rng),
                _ => check(&mut mapper, &cloud(rng, step, &sensor)),
            }
        }
        keyframes += mapper.session().keyframes().len();
    }
    // Not all of it is refused at the door.
    assert!(keyframes > INPUTS as usize / 2, "{keyframes} keyframes");
}
