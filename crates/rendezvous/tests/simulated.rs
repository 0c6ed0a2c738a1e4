//! Pairs of simulated robots whose truth is known: whether covariances are honest, and what must wait or be refused.
#![allow(clippy::unwrap_used, reason = "tests may")]

use mapwright_eval::Nees;
use mapwright_geom::{Pose2, Stamp, wrap_angle};
use mapwright_rendezvous::{
    DeadReckoning, Encounter, Kind, Noise, PairResult, RefusalReason, Settings, Sighting, Velocity, WaitReason, meet,
    meet_all,
};

const STEP_S: f64 = 0.05;
const RANGE_SIGMA_M: f64 = 0.1;
const BEARING_SIGMA_RAD: f64 = 0.01;

/// Seeded standard normal numbers: sums of twelve uniform ones.
struct Normals(u64);

impl Normals {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Errors of one robot's sensor: a part that lasts and a part that is new each time, standard deviation 1 together.
struct SensorError {
    lasting: f64,
}

impl SensorError {
    fn next(&mut self, after_s: f64, noise: &Noise, normals: &mut Normals) -> f64 {
        let kept = (-std::f64::consts::LN_2 * after_s / noise.likeness.half_life_s).exp();
        self.lasting = kept * self.lasting + (1.0 - kept * kept).sqrt() * normals.next();
        let share = noise.likeness.lasting_share;
        share.sqrt() * self.lasting + (1.0 - share).sqrt() * normals.next()
    }
}

/// A robot that drives what it says but for noise: its odometry, and where it truly is after each step.
struct Robot {
    wheels: DeadReckoning,
    world_from_robot: Vec<Pose2>,
}

fn stamp(step: usize) -> Stamp {
    Stamp::from_secs_f64(1000.0 + STEP_S * step as f64)
}

/// Drives with a velocity for each step.
fn drive(start: Pose2, steps: usize, velocity: impl Fn(f64) -> [f64; 2], normals: &mut Normals) -> Robot {
    let noise = Noise::default().odometry;
    let drift = noise.drift_rad_per_s * normals.next();
    let (mut truth, mut velocities) = (vec![start], Vec::new());
    for step in 0..steps {
        let [forward_m_per_s, turn_rad_per_s] = velocity(STEP_S * step as f64);
        velocities.push(Velocity { stamp: stamp(step), forward_m_per_s, turn_rad_per_s });
        let (way_m, turned_rad) = (forward_m_per_s.abs() * STEP_S, turn_rad_per_s.abs() * STEP_S);
        let position_m = (noise.position_m2_per_s * STEP_S + noise.position_m2_per_m * way_m).sqrt();
        let heading_rad = (noise.heading_rad2_per_s * STEP_S + noise.heading_rad2_per_rad * turned_rad).sqrt();
        let error =
            [position_m * normals.next(), position_m * normals.next(), heading_rad * normals.next() + drift * STEP_S];
        let said = Pose2::exp([forward_m_per_s * STEP_S, 0.0, turn_rad_per_s * STEP_S]);
        truth.push(*truth.last().unwrap() * said * Pose2::exp(error));
    }
    let wheels = DeadReckoning::from_velocities(&velocities);
    Robot { wheels, world_from_robot: truth }
}

/// What `observer` sees of `observed` every so many steps.
fn look(names: [u32; 2], [observer, observed]: [&Robot; 2], every: usize, normals: &mut Normals) -> Vec<Sighting> {
    let noise = Noise::default();
    let mut errors = [SensorError { lasting: normals.next() }, SensorError { lasting: normals.next() }];
    let first = (normals.uniform() * every as f64) as usize;
    let steps = (first..observer.world_from_robot.len() - 1).step_by(every);
    let mut see = |step: usize| {
        let seen = observer.world_from_robot[step].between(observed.world_from_robot[step]);
        let [range, bearing] = [0, 1].map(|k| errors[k].next(STEP_S * every as f64, &noise, normals));
        Sighting {
            observer: names[0],
            observed: Some(names[1]),
            stamp: stamp(step),
            range_m: Some((seen.x.hypot(seen.y) + RANGE_SIGMA_M * range).max(0.0)),
            bearing_rad: Some(wrap_angle(seen.y.atan2(seen.x) + BEARING_SIGMA_RAD * bearing)),
            range_sigma_m: RANGE_SIGMA_M,
            bearing_sigma_rad: BEARING_SIGMA_RAD,
        }
    };
    steps.map(&mut see).collect()
}

/// Two robots 2 to 4 m apart that drive arcs, each at its own pace.
fn two_robots(seconds: f64, normals: &mut Normals) -> [Robot; 2] {
    let steps = (seconds / STEP_S) as usize;
    let mut any = |least: f64, most: f64| least + (most - least) * normals.uniform();
    let (from, away_m, headings) = (any(-3.0, 3.0), any(2.5, 4.0), [any(-3.1, 3.1), any(-3.1, 3.1)]);
    let starts = [Pose2::new(0.0, 0.0, headings[0]), Pose2::new(away_m * from.cos(), away_m * from.sin(), headings[1])];
    let speeds = [[any(0.05, 0.2), any(-0.3, 0.3)], [any(0.05, 0.2), any(-0.3, 0.3)]];
    [0, 1].map(|k| drive(starts[k], steps, |_| speeds[k], normals))
}

fn meet_pair(robots: &[Robot; 2], sightings: &[Sighting]) -> PairResult {
    meet([1, 2], sightings, [&robots[0].wheels, &robots[1].wheels], &Settings::default())
}

/// The truth at an encounter, between two steps of the simulation.
fn truth(robots: &[Robot; 2], encounter: &Encounter) -> Pose2 {
    let at = encounter.stamp.secs_since(stamp(0)) / STEP_S;
    let [a, b] = [0, 1].map(|k| {
        let way = &robots[k].world_from_robot;
        let step = way[at as usize].between(way[at as usize + 1]).log();
        way[at as usize] * Pose2::exp(step.map(|component| component * at.fract()))
    });
    a.between(b)
}

fn add(nees: &mut Nees, robots: &[Robot; 2], encounter: &Encounter) {
    nees.add(truth(robots, encounter), encounter.a_from_b, &encounter.covariance);
}

fn middle(encounters: &[Encounter]) -> &Encounter {
    &encounters[encounters.len() / 2]
}

#[test]
fn mutual_encounters_have_honest_covariances() {
    let mut nees = Nees::default();
    for seed in 0..300 {
        let mut normals = Normals(seed);
        let robots = two_robots(10.0, &mut normals);
        let [one, two] = [&robots[0], &robots[1]];
        let mut sightings = look([1, 2], [one, two], 7, &mut normals);
        sightings.extend(look([2, 1], [two, one], 11, &mut normals));
        let result = meet_pair(&robots, &sightings);
        assert!(result.encounters.iter().all(|encounter| encounter.kind == Kind::Mutual));
        assert_eq!(result.encounters.iter().filter(|encounter| encounter.is_join).count(), 1, "one group");
        add(&mut nees, &robots, middle(&result.encounters));
    }
    assert!(nees.is_consistent(0.999), "{:?} outside {:?}", nees.mean(), nees.mean_interval(0.999));
}

#[test]
fn one_sided_sightings_wait_for_the_seen_robot_to_move() {
    let mut nees = Nees::default();
    for seed in 0..100 {
        let mut normals = Normals(1000 + seed);
        let start = Pose2::new(2.5, 1.0, 6.0 * normals.uniform());
        let stands = drive(start, 600, |_| [0.0, 0.0], &mut normals);
        let moves = drive(start, 600, |_| [0.25, 0.1], &mut normals);
        let mut watch = |seen: Robot| {
            let watcher = drive(Pose2::IDENTITY, 600, |_| [0.05, 0.02], &mut normals);
            let sightings = look([1, 2], [&watcher, &seen], 8, &mut normals);
            let robots = [watcher, seen];
            (meet_pair(&robots, &sightings), robots)
        };
        let (result, _) = watch(stands);
        assert!(result.encounters.is_empty(), "seed {seed}: {:?}", result.encounters);
        assert!(result.waiting.len() > 60, "seed {seed}");
        let (result, robots) = watch(moves);
        let first = result.encounters.first().unwrap_or_else(|| panic!("seed {seed}: {:?}", result.waiting.last()));
        assert_eq!(first.kind, Kind::Gathered);
        assert!(first.stamp.secs_since(stamp(0)) > 1.0, "not before it moved");
        add(&mut nees, &robots, first);
    }
    assert!(nees.is_consistent(0.999), "{:?} outside {:?}", nees.mean(), nees.mean_interval(0.999));
}

#[test]
fn sightings_of_another_robot_are_refused_and_counted() {
    let (mut nees, mut counts) = (Nees::default(), [[0; 2]; 2]);
    for seed in 0..200 {
        let mut normals = Normals(2000 + seed);
        let robots = two_robots(6.0, &mut normals);
        let mut sightings = look([1, 2], [&robots[0], &robots[1]], 6, &mut normals);
        sightings.extend(look([2, 1], [&robots[1], &robots[0]], 6, &mut normals));
        sightings.sort_by_key(|sighting| sighting.stamp);
        // One in ten is of somebody at least a metre and a radian elsewhere.
        let is_wrong: Vec<bool> = sightings.iter().map(|_| normals.uniform() < 0.1).collect();
        for (sighting, _) in sightings.iter_mut().zip(&is_wrong).filter(|(_, is_wrong)| **is_wrong) {
            sighting.range_m = sighting.range_m.map(|m| m + 1.0 + 2.0 * normals.uniform());
            sighting.bearing_rad = sighting.bearing_rad.map(|rad| wrap_angle(rad + 1.0 + 4.0 * normals.uniform()));
        }
        let result = meet_pair(&robots, &sightings);
        for (index, is_wrong) in is_wrong.into_iter().enumerate() {
            let is_refused = result.refused.contains(&(index, RefusalReason::Contradicted));
            counts[usize::from(is_wrong)][usize::from(is_refused)] += 1;
        }
        if let Some(encounter) = result.encounters.iter().find(|encounter| encounter.is_join) {
            add(&mut nees, &robots, encounter);
        }
    }
    assert!(nees.count > 190 && nees.mean().unwrap() < 4.0, "{nees:?} {:?}", nees.mean());
    let [right, wrong] = counts;
    assert!(right[1] * 100 < right[0], "right ones kept and refused: {right:?}");
    assert!(wrong[1] > 2 * wrong[0], "wrong ones kept and refused: {wrong:?}");
}

#[test]
fn ranges_alone_wait_while_the_mirror_image_fits() {
    let (mut unique, mut right) = (0, 0);
    for seed in 0..8 {
        let mut normals = Normals(3000 + seed);
        let mut ranges = |velocity: fn(f64) -> [f64; 2]| {
            let watcher = drive(Pose2::IDENTITY, 500, |_| [0.0, 0.0], &mut normals);
            let seen = drive(Pose2::new(2.0, 1.0, 0.3), 500, velocity, &mut normals);
            let mut sightings = look([1, 2], [&watcher, &seen], 6, &mut normals);
            sightings.iter_mut().for_each(|sighting| sighting.bearing_rad = None);
            let robots = [watcher, seen];
            (meet_pair(&robots, &sightings), robots)
        };
        // Whoever stands and hears but distances never knows from where: any turn about it fits.
        let (result, _) = ranges(|_| [0.2, 0.0]);
        assert!(result.encounters.is_empty(), "seed {seed}: {:?}", result.encounters);
        let mut normals = Normals(4000 + seed);
        let one = drive(Pose2::IDENTITY, 500, |s| [0.3, if s < 12.0 { 0.25 } else { -0.25 }], &mut normals);
        let two = drive(Pose2::new(2.0, 1.0, 2.0), 500, |s| [0.3, if s < 8.0 { -0.4 } else { 0.2 }], &mut normals);
        let mut sightings = look([1, 2], [&one, &two], 4, &mut normals);
        sightings.iter_mut().for_each(|sighting| sighting.bearing_rad = None);
        let robots = [one, two];
        if let Some(encounter) = meet_pair(&robots, &sightings).encounters.first() {
            let error = encounter.a_from_b.between(truth(&robots, encounter));
            unique += 1;
            right += usize::from(error.x.hypot(error.y) < 1.0 && error.theta.abs() < 1.0);
        }
    }
    assert!(unique >= 2 && right == unique, "{unique} unique, {right} right");
}

#[test]
fn what_cannot_be_used_is_refused_with_its_reason() {
    let mut normals = Normals(7);
    let robots = two_robots(5.0, &mut normals);
    let mut sightings = look([1, 2], [&robots[0], &robots[1]], 10, &mut normals);
    sightings[0].range_m = Some(f64::NAN);
    sightings[1].bearing_sigma_rad = 0.0;
    sightings[2].stamp = Stamp(5);
    let result = meet_pair(&robots, &sightings);
    let count = |reason: RefusalReason| result.refused.iter().filter(|(_, r)| *r == reason).count();
    assert_eq!((count(RefusalReason::Unsound), count(RefusalReason::NoOdometry)), (2, 1));
    assert_eq!(result.sightings, sightings.len());
    sightings[3].observed = None;
    sightings[4].observed = Some(1);
    sightings[5].observed = Some(9);
    let all = meet_all(&[(2, &robots[1].wheels), (1, &robots[0].wheels)], &sightings, &Settings::default());
    assert_eq!(all.refused, [(4, RefusalReason::Itself), (5, RefusalReason::Stranger)]);
    assert_eq!(all.waiting, [(3, WaitReason::Unidentified)]);
    assert_eq!((all.pairs[0].0, all.pairs[0].1.sightings), ([1, 2], sightings.len() - 3));
    assert!(meet_pair(&robots, &[]).encounters.is_empty());
}
