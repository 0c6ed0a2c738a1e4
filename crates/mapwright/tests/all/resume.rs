//! A run that is stopped and resumed goes on as if it had never stopped, and no bytes of a checkpoint make it panic.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{
    Beams, Checkpoint, EdgeKind, Entry, Jobs, LeftOut, LeftOutReason, LivePolicy, Localisation, Mapper, Pose2, Session,
    Settings, TurnRate, Update,
};
use mapwright_record::LogWriter;
use mapwright_sim::{Drive, DriveSettings, Event, Rng, Site, TrueScan, kidnapping, worlds};
use std::sync::Arc;
use support::{in_parallel, is_right};

/// What a mapper is given, scan by scan: what wheels and gyroscope said before it, and the scan.
type Events = Vec<Event>;

/// A run, and the log that it writes.
struct Run {
    mapper: Mapper,
    writer: LogWriter,
    log: Vec<u8>,
}

impl Run {
    fn new(settings: Settings) -> Self {
        Self { mapper: Mapper::new(settings).expect("valid"), writer: LogWriter::new(), log: Vec::new() }
    }

    /// What comes of a scan.
    fn give(&mut self, event: &Event) -> Option<Update> {
        match event {
            Event::Odometry(odometry) => {
                self.mapper.add_odometry(odometry);
                self.mapper.add_turn_rate(&TurnRate { stamp: odometry.stamp, rad_per_s: 0.01 });
                None
            }
            Event::Scan(taken) => {
                let update = self.mapper.add_scan(&taken.scan);
                self.write(&update);
                Some(update)
            }
        }
    }

    /// Poses and variances at these scans; nothing is written.
    fn alone(&mut self, events: &[Event]) -> Vec<[f64; 4]> {
        let scans =
            events.iter().filter_map(|event| if let Event::Scan(taken) = event { Some(&taken.scan) } else { None });
        let said = |update: Update| {
            let Pose2 { x, y, theta } = update.map_from_robot;
            [x, y, theta, update.covariance[(0, 0)]]
        };
        scans.map(|scan| said(self.mapper.add_scan(scan))).collect()
    }

    fn write(&mut self, update: &Update) {
        for entry in &update.entries {
            self.writer.append(&mut self.log, entry).expect("what fits a session fits a log");
        }
    }

    /// Stops and goes on from the log. Whether it could be told all.
    fn resume(&mut self) -> bool {
        let update = self.mapper.checkpoint();
        self.write(&update);
        self.writer.finish(&mut self.log);
        let (session, report) = Session::read(&self.log).expect("a log");
        assert!(report.is_whole() && session == *self.mapper.session());
        let tells_all = session.checkpoint().is_some();
        self.mapper = Mapper::resume(*self.mapper.settings(), session).expect("valid");
        tells_all
    }

    /// What an update says, but for the names of keyframes, which tell of the runs.
    fn said(&self, mut update: Update) -> (Update, [Option<usize>; 2]) {
        let places = [update.anchor.take(), update.keyframe.take()].map(|id| self.mapper.session().place(id?));
        update.entries.clear();
        (update, places)
    }
}

/// Maps in one go and in several, and compares every update and all that lasts.
fn check(settings: Settings, events: &[Event], stops: &[usize]) -> Mapper {
    let (mut whole, mut resumed) = (Run::new(settings), Run::new(settings));
    for (number, event) in events.iter().enumerate() {
        if stops.contains(&number) {
            assert!(resumed.resume(), "{number}");
        }
        let [expected, found] = [whole.give(event), resumed.give(event)];
        let (Some(expected), Some(found)) = (expected, found) else { continue };
        assert_eq!(resumed.said(found), whole.said(expected), "event {number}");
    }
    let (whole, resumed) = (whole.mapper, resumed.mapper);
    let bits = |mapper: &Mapper| mapper.trajectory().map(|pose| pose.map_from_robot.log().map(f64::to_bits)).collect();
    let [a, b]: [Vec<[u64; 3]>; 2] = [&whole, &resumed].map(bits);
    assert!(a == b);
    assert_eq!(whole.keyframe_poses(), resumed.keyframe_poses());
    assert!(whole.local_map().counts().to_bytes() == resumed.local_map().counts().to_bytes());
    let [a, b] = [&whole, &resumed].map(|mapper| mapper.edges().map(|edge| (edge.from_from_to, edge.information)));
    assert!(a.eq(b));
    assert_eq!(resumed.session().runs().len(), 1 + stops.len());
    whole
}

fn scans(site: impl Into<Arc<Site>>, settings: DriveSettings, most: usize) -> Events {
    Drive::new(site.into(), settings).scans().take(most).map(Event::Scan).collect()
}

#[test]
fn among_people_it_goes_on_to_the_same_bits() {
    let office = scans(worlds::office_floor(41).with_people(6, 41), DriveSettings::default(), 900);
    let mapper = check(Settings::default(), &office, &[1, 2, 50, 333, 334, 612, 777]);
    assert!(mapper.keyframes().len() > 100);
}

#[test]
fn over_closures_it_goes_on_to_the_same_bits() {
    let events = scans(worlds::loop_of(3, 150.0), DriveSettings::long_drive(3), usize::MAX);
    let stops: Vec<usize> = (1..12).map(|k| events.len() * k / 12).collect();
    let mapper = check(Settings::default(), &events, &stops);
    assert!(mapper.edges().any(|edge| edge.kind == EdgeKind::Closure));
}

#[test]
fn over_slips_in_corridors_it_goes_on_to_the_same_bits() {
    let events = scans(worlds::corridor_grid(103, 1900.0), DriveSettings::long_drive(103), 2200);
    let stops: Vec<usize> = (1..15).map(|k| 150 * k).collect();
    let mapper = check(Settings::default(), &events, &stops);
    assert!(mapper.session().slips().len() >= 2);
}

#[test]
fn without_odometry_it_goes_on_to_the_same_bits() {
    let mut settings = Settings::default();
    settings.motion.use_odometry = false;
    let office = scans(worlds::office_floor(306), DriveSettings::default(), 700);
    check(settings, &office, &[100, 350, 500]);
}

#[test]
fn with_a_map_of_everything_it_goes_on_to_the_same_bits() {
    let mut settings = Settings::default();
    settings.live.policy = LivePolicy::Everything;
    settings.loops.by_pose = false;
    check(settings, &scans(worlds::rooms(3), DriveSettings::default(), 600), &[10, 200, 400]);
}

/// What wheels and a gyroscope say between scans tells of the motion during a sweep.
#[test]
fn with_sweeps_that_take_time_it_goes_on_to_the_same_bits() {
    let mut settings = DriveSettings { seed: 5, duration_s: 60.0, ..DriveSettings::default() };
    Arc::make_mut(&mut settings.laser.model).beam_period_s = 0.05 / settings.laser.beams as f64;
    let events: Events = Drive::new(worlds::rooms(5).into(), settings).collect();
    let stops: Vec<usize> = (1..8).map(|k| events.len() * k / 8).collect();
    check(Settings::default(), &events, &stops);
}

#[test]
fn jobs_that_wait_are_done_before_and_one_that_is_out_is_waited_for() {
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let mut run = Run::new(settings);
    for event in scans(worlds::office_floor(900), DriveSettings::long_drive(900), 3000) {
        run.give(&event);
        if let Some(job) = run.mapper.next_job() {
            assert!(run.mapper.checkpoint().entries.is_empty(), "one is out");
            run.mapper.apply(job.run());
            assert!(matches!(run.mapper.checkpoint().entries[..], [.., Entry::Checkpoint(_)]));
            return;
        }
    }
    panic!("no old place was looked for");
}

/// A robot that is carried away, until so long after it was put down, seconds: after 30 s what it maps is joined with the rest.
fn carried(until_s: f64) -> Events {
    let case = kidnapping(902);
    let lasts = |taken: &TrueScan| taken.scan.stamp.secs_since(case.put_down) < until_s;
    case.drive().scans().take_while(lasts).map(Event::Scan).collect()
}

/// Whether what is mapped is joined with the rest, event by event.
fn localisations(run: &mut Run, events: &[Event]) -> Vec<Localisation> {
    events.iter().filter_map(|event| run.give(event)).map(|update| update.localisation).collect()
}

#[test]
fn while_apart_it_goes_on_to_the_same_bits() {
    let events = carried(30.0);
    let said = localisations(&mut Run::new(Settings::default()), &events);
    let apart: Vec<usize> = (0..said.len()).filter(|&at| said[at] == Localisation::Apart).collect();
    let [first, last] = [apart[0], apart[apart.len() - 1]];
    assert!(last - first > 20 && said.last() == Some(&Localisation::Joined), "{first} to {last} of {}", said.len());
    // After the first scan that was apart, within, before the one that joins, and after it.
    let stops = [first + 1, first + (last - first) / 2, last, last + 1, last + 2];
    let mapper = check(Settings::default(), &events, &stops);
    assert!(mapper.session().recorded_edges().iter().any(|known| known.withdrawn), "odometry has misled");
}

/// Its log has no checkpoint: that it is apart the fragments and edges say.
#[test]
fn who_was_killed_while_apart_is_apart_and_joined_later() {
    let case = kidnapping(902);
    let events = carried(60.0);
    let mut run = Run::new(Settings::default());
    let (mut known, mut resumed_at, mut said) = (Vec::new(), None, Vec::new());
    for (number, event) in events.iter().enumerate() {
        let Event::Scan(taken) = event else { continue };
        let since_s = taken.scan.stamp.secs_since(case.put_down);
        let update = run.give(event).expect("a scan");
        if taken.scan.stamp < case.taken {
            known.resize(run.mapper.keyframes().len(), taken.world_from_robot);
        }
        let right = is_right(&run.mapper, &known, update.map_from_robot, taken.world_from_robot);
        if resumed_at.is_some() {
            said.push((update.localisation, right));
        } else if since_s > 2.0 {
            assert_eq!(update.localisation, Localisation::Apart);
            let session = run.mapper.session().clone();
            assert!(session.checkpoint().is_none());
            run.mapper = Mapper::resume(Settings::default(), session).expect("valid");
            resumed_at = Some(number);
        }
    }
    let apart = said.iter().take_while(|(localisation, _)| *localisation == Localisation::Apart).count();
    println!("{apart} of {} scans apart after it was resumed", said.len());
    assert!(apart > 0 && apart < said.len());
    assert!(said[apart..].iter().all(|said| *said == (Localisation::Joined, true)), "joined where it is");
}

/// A checkpoint is for the same settings alone, even where others would have led to the same map.
#[test]
fn with_other_settings_it_learns_again() {
    let events = scans(worlds::rooms(3), DriveSettings::default(), 121);
    let (mut run, mut other) = (Run::new(Settings::default()), Settings::default());
    events[..120].iter().for_each(|event| drop(run.give(event)));
    run.mapper.checkpoint();
    other.loops.by_place = !other.loops.by_place;
    let session = run.mapper.session().clone();
    let goes_on = run.alone(&events[120..]);
    let [same, other] = [Settings::default(), other].map(|settings| {
        run.mapper = Mapper::resume(settings, session.clone()).expect("valid");
        run.alone(&events[120..])
    });
    assert!(same == goes_on && other != goes_on);
}

/// What the map that is made in the end leaves out is taken out of what scans are matched against.
#[test]
fn what_was_left_out_since_is_dropped() {
    let events = scans(worlds::rooms(3), DriveSettings::default(), 200);
    let mut run = Run::new(Settings::default());
    events[..160].iter().for_each(|event| drop(run.give(event)));
    run.mapper.checkpoint();
    let mut session = run.mapper.session().clone();
    for keyframe in [3, 20].map(|k| session.keyframes()[k].id) {
        let (beams, reason) = (Beams::All, LeftOutReason::ContradictsTheMap);
        session.add(Entry::LeftOut(LeftOut { keyframe, beams, reason })).expect("there is such a keyframe");
        assert!(run.mapper.drop_keyframe(keyframe));
    }
    let mut resumed = Run::new(Settings::default());
    resumed.mapper = Mapper::resume(Settings::default(), session).expect("valid");
    assert_eq!(resumed.alone(&events[160..]), run.alone(&events[160..]));
    let [a, b] = [&run, &resumed].map(|run| run.mapper.local_map().counts().to_bytes());
    assert!(a == b);
}

/// Flips, replaces and cuts bytes of a checkpoint.
fn corrupt(state: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut state = state.to_vec();
    for _ in 0..1 + rng.below(3) {
        let at = rng.below(state.len());
        match rng.below(32) {
            0 => state.truncate(at.max(1)),
            1 => drop(state.remove(at)),
            2 => state.insert(at, rng.next_u64() as u8),
            3..8 => state[at] = [0, 1, 0x7f, 0x80, 0xff][rng.below(5)],
            8..12 => state[at] = state[at].wrapping_add(1),
            _ => state[at] ^= 1 << rng.below(8),
        }
    }
    state
}

#[test]
fn no_bytes_of_a_checkpoint_make_it_panic() {
    let recorded = scans(worlds::office_floor(41).with_people(6, 41), DriveSettings::default(), 320);
    let (before, after) = recorded.split_at(300);
    let mut run = Run::new(Settings::default());
    before.iter().for_each(|event| drop(run.give(event)));
    run.mapper.checkpoint();
    let checkpoint = run.mapper.session().checkpoint().expect("it tracks").clone();
    let gone_on = |session: Session| {
        let mut run = Run::new(Settings::default());
        run.mapper = Mapper::resume(Settings::default(), session).expect("valid");
        run.alone(after)
    };
    let with = |state: Vec<u8>| {
        let mut session = run.mapper.session().clone();
        session.add(Entry::Checkpoint(Checkpoint { state: state.into() })).expect("any bytes will do");
        gone_on(session)
    };
    let (whole, learnt) = (gone_on(run.mapper.session().clone()), with(Vec::new()));
    let results = in_parallel(600, |number| {
        let found = with(corrupt(&checkpoint.state, &mut Rng::keyed(7, number as u64)));
        assert!(found.iter().flatten().all(|number| number.is_finite()));
        [found == whole, found == learnt]
    });
    let [same, refused] = [0, 1].map(|k| results.iter().filter(|result| result[k]).count());
    let bytes = checkpoint.state.len();
    println!("of {} corruptions of {bytes} bytes {refused} are refused, {same} change nothing", results.len());
    assert!(whole != learnt && refused > 50 && refused + same < results.len());
}
