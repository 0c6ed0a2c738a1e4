use super::*;
use mapwright_geom::Cov3;
use mapwright_record::SessionEdge;
use mapwright_sim::kidnapping;

/// Where all that a robot has seen on the way from where it was put down, 14 s ago, fits as well as where it is, on a floor
/// that is nearly the same turned by half a turn.
const WRONG: Pose2 = Pose2 { x: 19.676, y: -0.007, theta: -0.003 };

/// A lost robot is told that it is there.
fn find_at(mapper: &mut Mapper, local_from_robot: Pose2) {
    let past = mapper.store.past();
    let lost = mapper.localisation.lost().expect("it was carried away");
    let to = lost.newest().expect("it maps provisionally");
    let local_from_to = local_from_robot * lost.provisional().keyframe_from_robot(to).inverse();
    let away_m = |node: &NodeId| past.pose(*node).distance(local_from_to);
    let from = NodeId::first(mapper.store.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b))).expect("it mapped");
    let from_from_to = past.pose(from).between(local_from_to);
    let covariance = Cov3::from_diagonal(&[4e-4, 4e-4, 2e-5].into());
    lost.is_found(Found { from, to, from_from_to, covariance });
}

/// As after a drive without end: nothing keeps it from asking at every keyframe.
fn let_ask(mapper: &mut Mapper) {
    mapper.back.budget.earn_verification(0, 1_000_000_000_000);
}

#[test]
fn who_is_found_where_less_and_less_fits_is_lost_again_and_has_left_nothing() {
    let case = kidnapping(28_017);
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let since_s = |scan: &LaserScan| scan.stamp.secs_since(case.put_down);
    let (mut arrived, mut tracked, mut written, mut way_m) = (None, 0, 0, 0.0);
    for scan in case.drive().scans().map(|scan| scan.scan).take_while(|scan| since_s(scan) < 60.0) {
        let before = mapper.front.pose().local_from_robot();
        if arrived.is_none() && since_s(&scan) > 14.0 {
            find_at(&mut mapper, WRONG);
            arrived = Some(NodeId::at(mapper.store.len()));
        }
        let update = mapper.add_scan(&scan);
        if arrived.is_some() && update.status != Status::Lost {
            way_m += if tracked > 0 { before.distance(mapper.front.pose().local_from_robot()) } else { 0.0 };
            tracked += 1;
            written += usize::from(update.keyframe.is_some());
        }
    }
    let node = arrived.expect("it did");
    assert!(tracked > 10 && (0.5..8.0).contains(&way_m), "it has gone on there for {way_m} m");
    assert!(mapper.localisation.is_lost());
    assert_eq!(written, 0, "nobody was told of a keyframe");
    let (session, id) = (mapper.session(), mapper.store.id(node));
    assert!(session.drawn()[node.index()].is_none(), "nothing is drawn of the one where it was found");
    assert!(session.edges().all(|edge| edge.to != id && edge.from != id), "no edge leads there");
    let leads_there = |edge: &&SessionEdge<Pose2>| edge.recorded.edge.to == id;
    let withdrawn: Vec<bool> = session.recorded_edges().iter().filter(leads_there).map(|edge| edge.withdrawn).collect();
    assert_eq!(withdrawn, [true], "the one that did was withdrawn");
}

/// What was seen lately of a new corridor lies closely enough on the walls of a known one, seven answers long; not all three
/// of it, what was seen on the way, and the known one seen from there do.
#[test]
fn who_drives_along_a_corridor_like_a_known_one_is_not_found_there() {
    let case = kidnapping(41_031);
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let_ask(&mut mapper);
    let since_s = |scan: &LaserScan| scan.stamp.secs_since(case.put_down);
    let mut asked = 0;
    for scan in case.drive().scans().map(|scan| scan.scan).take_while(|scan| since_s(scan) < 16.0) {
        let update = mapper.add_scan(&scan);
        if since_s(&scan) > 5.0 {
            assert_eq!(update.status, Status::Lost, "{} s", since_s(&scan));
            asked = mapper.back.questions();
        }
    }
    assert!(asked > 20, "it has asked {asked} times");
}

#[test]
fn what_is_told_of_a_robot_that_was_lost_and_found_is_its_session() {
    let case = kidnapping(902);
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let_ask(&mut mapper);
    let (mut told, mut on_trial) = (Session::default(), 0);
    let since_s = |scan: &LaserScan| scan.stamp.secs_since(case.put_down);
    for scan in case.drive().scans().map(|scan| scan.scan).take_while(|scan| since_s(scan) < 15.0) {
        let update = mapper.add_scan(&scan);
        on_trial += usize::from(update.localisation == mapwright_record::Localisation::OnTrial);
        told.add_all(update.entries).expect("entries fit to those before");
    }
    assert!(on_trial > 0, "it was found");
    let arrival = |candidate: &&Candidate| candidate.verdict == Verdict::Accepted && candidate.from < candidate.to;
    assert!(mapper.candidates().iter().any(|candidate| arrival(&candidate)));
    assert!(told == *mapper.session() && told.encode() == mapper.session().encode());
}
