//! Requests as rclpy (Kilted, Fast DDS) wrote them, and what is answered; and any bytes at all.

use super::asked::{Asked, Said, Start, Why, offered};
use super::bond::{Bond, BondState, PERIOD};
use super::diagnostics::Diagnostics;
use super::lifecycle::{self, Lifecycle, Outcome, Question, State, Turn};
use super::parameters::{ParameterFile, ParameterService, ParameterValue, Parameters, Setting};
use super::{NodeError, NodeName, bytes_of, decode};
use crate::tally::{Reason, Tally};
use mapwright_geom::Stamp;
use mapwright_ros::Fixed;
use mapwright_ros::messages::lifecycle::{
    ChangeStateResponse, GetAvailableStatesResponse, GetAvailableTransitionsResponse, GetStateResponse, TransitionEvent,
};
use mapwright_ros::messages::parameters::{
    DescribeParametersResponse, GetParametersResponse, ListParametersResponse, ParameterEvent, ParameterNames,
    SetParametersAtomicallyResponse, SetParametersResponse,
};
use mapwright_ros::messages::services::{
    DeserializePoseGraphRequest, DeserializePoseGraphRequest3D, GetMapResponse, LoadMapResponse, Nothing, Pose2D,
    SaveMapRequest, SetInitialPoseRequest,
};
use mapwright_ros::messages::{
    BondStatus, DiagnosticArray, Header, OccupancyGrid, Point, Pose, PoseWithCovariance, PoseWithCovarianceStamped,
    Quaternion,
};
use proptest::prelude::*;
use std::time::Duration;

const NOW: Stamp = Stamp(1_500_000_000);

fn node() -> NodeName {
    NodeName::new("/slam_toolbox").unwrap()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect()
}

/// What a service of this name makes of a request, and what it answers.
fn ask(name: &str, request: &[u8], said: Said<'_>) -> (Option<Asked>, Vec<u8>, Option<String>) {
    let services = offered(&node());
    let service = services.iter().find(|service| service.name == name).unwrap();
    let mut asked = None;
    let answer = service.answer(request, |what| {
        asked = Some(what);
        said
    });
    (asked, answer.bytes, answer.refusal)
}

#[test]
fn services_have_the_names_of_those_they_stand_for() {
    let services = offered(&node());
    let names: Vec<_> = services.iter().map(|service| &*service.name).collect();
    for name in [
        "/slam_toolbox/save_map",
        "/slam_toolbox/dynamic_map",
        "/slam_toolbox/pause_new_measurements",
        "/reinitialize_global_localization",
        "/set_initial_pose",
        "/request_nomotion_update",
        "/map_server/load_map",
    ] {
        assert!(names.contains(&name), "{name} in {names:?}");
    }
    let here = offered(&NodeName::new("/robot1/mapwright").unwrap());
    assert!(here.iter().any(|service| service.name == "/robot1/mapwright/serialize_map"));
    assert!(here.iter().any(|service| service.name == "/robot1/set_initial_pose"));
}

#[test]
fn what_is_asked_is_told_and_what_is_said_is_answered() {
    let empty = bytes("0001000000550000"); // std_srvs/Empty
    assert_eq!(ask("/reinitialize_global_localization", &empty, Said::Done).0, Some(Asked::FindAnew));
    assert_eq!(ask("/request_nomotion_update", &empty[..5], Said::Done).1, [0, 1, 0, 0, 0]);
    let (asked, response, _) = ask("/slam_toolbox/pause_new_measurements", &empty[..4], Said::Paused(true));
    assert_eq!((asked, &response[4..]), (Some(Asked::Pause), &[1][..]), "done, not on");

    let save = bytes_of(&SaveMapRequest { name: mapwright_ros::messages::Text { data: "hall".into() } });
    let refused = |why| Said::Refused(why, "because".to_owned());
    let (asked, response, refusal) = ask("/slam_toolbox/save_map", &save, refused(Why::NoMap));
    assert_eq!((asked, response[4]), (Some(Asked::SaveMap { name: "hall".to_owned() }), 1));
    assert_eq!(refusal.unwrap(), "/slam_toolbox/save_map: because");
    assert_eq!(ask("/slam_toolbox/save_map", &save, refused(Why::Unwritable)).1[4], 255);
    assert_eq!(ask("/slam_toolbox/save_map", &save, Said::Done).1, [0, 1, 0, 0, 0]);

    let load = bytes("000100000f00000066696c653a2f2f2f6d2e79616d6c00");
    let cells = [-1, 0, 100];
    let grid = OccupancyGrid { data: cells[..].into(), ..OccupancyGrid::default() };
    let (asked, response, _) = ask("/map_server/load_map", &load, Said::Map(grid.clone()));
    assert_eq!(asked, Some(Asked::LoadMap { url: "file:///m.yaml".to_owned() }));
    assert_eq!(decode::<LoadMapResponse<'_>>(&response).unwrap(), LoadMapResponse { map: grid.clone(), result: 0 });
    let response = ask("/map_server/load_map", &load, refused(Why::WrongDescription)).1;
    assert_eq!(decode::<LoadMapResponse<'_>>(&response).unwrap().result, 3);
    let response = ask("/slam_toolbox/dynamic_map", &empty, Said::Map(grid.clone())).1;
    assert_eq!(decode::<GetMapResponse<'_>>(&response).unwrap().map, grid);
}

#[test]
fn a_torn_request_is_refused_with_the_code_of_its_service() {
    let (asked, response, refusal) = ask("/slam_toolbox/serialize_map", &[0, 1, 0, 0, 9, 0, 0, 0, b'a'], Said::Done);
    assert_eq!((asked, response[4]), (None, 255));
    let words = "/slam_toolbox/serialize_map: byte 8, field `filename`: expected 9 bytes, found 1";
    assert_eq!(refusal.unwrap(), words);
    assert_eq!(ask("/slam_toolbox/pause_new_measurements", &[0, 7, 0, 0, 0], Said::Done).1[4], 0);
}

#[test]
fn a_session_is_continued_from_poses_of_the_plane_and_of_space() {
    let initial_pose = Pose2D { x: 1.0, y: -2.0, theta: 0.5 };
    for name in ["a", "ab", "abcdef"] {
        let planar =
            DeserializePoseGraphRequest { filename: name.into(), match_type: 2, initial_pose: initial_pose.clone() };
        let (position, orientation) = (
            Point { x: 1.0, y: -2.0, z: 0.0 },
            Quaternion { z: 0.25_f64.sin(), w: 0.25_f64.cos(), ..Default::default() },
        );
        let spatial = DeserializePoseGraphRequest3D {
            filename: name.into(),
            match_type: 2,
            initial_pose: Pose { position, orientation },
        };
        for mut request in [bytes_of(&planar), bytes_of(&spatial)] {
            request.resize(request.len().next_multiple_of(4), 0xaa);
            let asked = ask("/slam_toolbox/deserialize_map", &request, Said::Done).0.unwrap();
            let Asked::Deserialize { file, start: Start::At { map_from_robot } } = asked else { panic!("{asked:?}") };
            let seen = mapwright_ros::planar(&map_from_robot);
            assert!(file == name && seen.distance(mapwright_geom::Pose2::new(1.0, -2.0, 0.5)) < 1e-9, "{seen:?}");
            assert!((mapwright_geom::wrap_angle(seen.theta - 0.5)).abs() < 1e-9);
        }
    }
    let wrong = DeserializePoseGraphRequest { match_type: 7, ..DeserializePoseGraphRequest::default() };
    let (_, response, refusal) = ask("/slam_toolbox/deserialize_map", &bytes_of(&wrong), Said::Done);
    assert_eq!(response[4], 255);
    assert!(refusal.unwrap().ends_with("match_type: expected a number from 0 to 3, found 7"));
}

#[test]
fn a_pose_that_is_none_is_refused() {
    let request = |w: f64, first: f64| {
        let pose = Pose { orientation: Quaternion { w, ..Quaternion::default() }, ..Pose::default() };
        let mut covariance = Fixed([0.25; 36]);
        covariance.0[0] = first;
        let pose = PoseWithCovariance { pose, covariance };
        bytes_of(&SetInitialPoseRequest { pose: PoseWithCovarianceStamped { header: Header::new(NOW, "/map"), pose } })
    };
    let Some(Asked::SetPose(given)) = ask("/set_initial_pose", &request(1.0, 0.5), Said::Done).0 else { panic!("one") };
    assert_eq!((&*given.frame, given.covariance[0], given.covariance[35]), ("map", 0.5, 0.25));
    for (w, first, what) in [(0.0, 0.5, "the pose: "), (1.0, f64::NAN, "the pose's covariance: ")] {
        let (asked, response, refusal) = ask("/set_initial_pose", &request(w, first), Said::Done);
        assert_eq!((asked, response), (None, vec![0, 1, 0, 0, 0]));
        assert!(refusal.unwrap().contains(what));
    }
}

/// `rclpy.lifecycle.LifecycleNode('x')._state_machine.transition_graph`, Kilted.
const GRAPH: &str = "1 configure 1 unconfigured 10 configuring
10 transition_success 10 configuring 2 inactive
11 transition_failure 10 configuring 1 unconfigured
12 transition_error 10 configuring 15 errorprocessing
2 cleanup 2 inactive 11 cleaningup
20 transition_success 11 cleaningup 1 unconfigured
21 transition_failure 11 cleaningup 2 inactive
22 transition_error 11 cleaningup 15 errorprocessing
3 activate 2 inactive 13 activating
30 transition_success 13 activating 3 active
31 transition_failure 13 activating 2 inactive
32 transition_error 13 activating 15 errorprocessing
4 deactivate 3 active 14 deactivating
40 transition_success 14 deactivating 2 inactive
41 transition_failure 14 deactivating 3 active
42 transition_error 14 deactivating 15 errorprocessing
5 shutdown 1 unconfigured 12 shuttingdown
6 shutdown 2 inactive 12 shuttingdown
7 shutdown 3 active 12 shuttingdown
50 transition_success 12 shuttingdown 4 finalized
51 transition_failure 12 shuttingdown 4 finalized
52 transition_error 12 shuttingdown 15 errorprocessing
60 transition_success 15 errorprocessing 1 unconfigured
61 transition_failure 15 errorprocessing 4 finalized
62 transition_error 15 errorprocessing 4 finalized
";

#[test]
fn states_and_transitions_are_rcls() {
    let lifecycle = Lifecycle::new(false);
    let request = bytes("0001000000550000");
    let graph = lifecycle.answer(Question::Graph, &request).bytes;
    let lines = |bytes: &[u8]| -> String {
        let response: GetAvailableTransitionsResponse<'_> = decode(bytes).unwrap();
        let line = |way: &mapwright_ros::messages::lifecycle::TransitionDescription<'_>| {
            let (by, from, to) = (&way.transition, &way.start_state, &way.goal_state);
            format!("{} {} {} {} {} {}\n", by.id, by.label, from.id, from.label, to.id, to.label)
        };
        response.available_transitions.iter().map(line).collect()
    };
    assert_eq!(lines(&graph), GRAPH);
    // the bytes that rclpy wrote, but for those that align
    let real = "0001000002000000011c1f7c0a000000636f6e6669677572650001770d000000756e636f6e66696775726564000a00000c000000636f\
                6e6669677572696e6700055ffb770900000073687574646f776e0001fc000d000000756e636f6e66696775726564000c00000d00000073\
                68757474696e67646f776e00";
    let available = lifecycle.answer(Question::Transitions, &request).bytes;
    assert_eq!(lines(&available), lines(&bytes(&real.replace(' ', ""))));
    let states = lifecycle.answer(Question::States, &request).bytes;
    let states: GetAvailableStatesResponse<'_> = decode(&states).unwrap();
    let ids: Vec<_> = states.available_states.iter().map(|state| state.id).collect();
    assert_eq!(ids, [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]);
}

fn state_of(lifecycle: &Lifecycle) -> u8 {
    let bytes = lifecycle.answer(Question::State, &[0, 1, 0, 0, 0]).bytes;
    decode::<GetStateResponse<'_>>(&bytes).unwrap().current_state.id
}

#[test]
fn a_manager_brings_a_node_to_work() {
    let mut lifecycle = Lifecycle::new(false);
    assert_eq!(lifecycle.due(), None);
    // by its number, as Nav2's manager asks
    let turn = lifecycle.change(&bytes("00010000015500000100000000"), NOW).unwrap();
    assert_eq!((turn, lifecycle.state(), state_of(&lifecycle)), (Turn::Configure, State::Configuring, 10));
    let twice = lifecycle.change(&bytes("00010000015500000100000000"), NOW).unwrap_err();
    assert_eq!(twice.bytes, [0, 1, 0, 0, 0]);
    assert!(twice.refusal.unwrap().contains("none before the one that goes on has ended, found number 1"));
    lifecycle.end(Outcome::Success, NOW);
    // by its name, as `ros2 lifecycle set` may
    let turn = lifecycle.change(&bytes("000100000355000009000000616374697661746500"), NOW).unwrap();
    lifecycle.end(Outcome::Success, NOW);
    assert_eq!((turn, lifecycle.state(), state_of(&lifecycle)), (Turn::Activate, State::Active, 3));
    assert!(decode::<ChangeStateResponse>(&lifecycle::changed(Outcome::Success)).unwrap().success);
    assert!(!decode::<ChangeStateResponse>(&lifecycle::changed(Outcome::Failure)).unwrap().success);
    let events = lifecycle.events();
    let seen: Vec<_> = events.iter().map(|event| decode::<TransitionEvent<'_>>(event).unwrap().transition.id).collect();
    assert_eq!(seen, [1, 10, 3, 30]);
    let event: TransitionEvent<'_> = decode(&events[3]).unwrap();
    assert_eq!((event.timestamp, event.start_state.id, event.goal_state.id), (1_500_000_000, 13, 3));
    assert!(lifecycle.events().is_empty());
}

#[test]
fn turns_that_fail_lead_back_or_to_an_end() {
    let mut lifecycle = Lifecycle::new(true);
    assert_eq!(lifecycle.due(), Some(Turn::Configure));
    lifecycle.begin(Turn::Configure, NOW).unwrap();
    assert_eq!(lifecycle.due(), None);
    lifecycle.end(Outcome::Success, NOW);
    assert_eq!(lifecycle.due(), Some(Turn::Activate));
    lifecycle.begin(Turn::Activate, NOW).unwrap();
    lifecycle.end(Outcome::Failure, NOW);
    assert_eq!((lifecycle.state(), lifecycle.due()), (State::Inactive, None), "it tries once");
    lifecycle.end(Outcome::Error { is_clean: false }, NOW);
    assert_eq!(lifecycle.state(), State::Inactive, "nothing was begun");
    assert!(lifecycle.begin(Turn::Deactivate, NOW).is_err());
    lifecycle.begin(Turn::Activate, NOW).unwrap();
    lifecycle.end(Outcome::Success, NOW);
    lifecycle.begin(Turn::Deactivate, NOW).unwrap();
    lifecycle.end(Outcome::Error { is_clean: true }, NOW);
    assert_eq!(lifecycle.state(), State::Unconfigured);
    lifecycle.begin(Turn::Shutdown, NOW).unwrap();
    lifecycle.end(Outcome::Failure, NOW);
    assert_eq!((lifecycle.state(), lifecycle.due()), (State::Finalized, None));
}

fn heartbeat(instance: &str, active: bool) -> Vec<u8> {
    let status =
        BondStatus { id: "slam_toolbox".into(), instance_id: instance.into(), active, ..BondStatus::default() };
    bytes_of(&status)
}

#[test]
fn a_bond_is_kept_alive_and_ended() {
    let at = Duration::from_millis;
    let mut bond = Bond::new(&node(), "us", PERIOD, at(0));
    let first = bond.due(at(0), NOW).unwrap();
    let status: BondStatus<'_> = decode(&first).unwrap();
    assert_eq!((&*status.id, &*status.instance_id, status.active), ("slam_toolbox", "us", true));
    assert_eq!((status.heartbeat_timeout, status.heartbeat_period), (4.0, 0.25));
    assert_eq!((bond.due(at(249), NOW), bond.next()), (None, Some(at(250))));
    assert!(bond.due(at(260), NOW).is_some());
    assert_eq!(bond.next(), Some(at(500)), "in step");
    bond.hear(&first, at(260)).unwrap();
    assert_eq!(bond.state(), BondState::Waiting, "that was this side");
    bond.hear(&heartbeat("them", true), at(300)).unwrap();
    assert_eq!(bond.state(), BondState::Alive);
    bond.leave(at(400));
    assert!(!decode::<BondStatus<'_>>(&bond.due(at(400), NOW).unwrap()).unwrap().active);
    assert!(bond.due(at(450), NOW).is_some(), "until it is confirmed");
    bond.hear(&heartbeat("them", false), at(460)).unwrap();
    assert_eq!((bond.state(), bond.due(at(500), NOW), bond.next()), (BondState::Ended, None, None));
}

#[test]
fn a_bond_ends_when_the_other_side_is_silent_or_leaves() {
    let at = Duration::from_millis;
    let mut bond = Bond::new(&node(), "us", PERIOD, at(0));
    bond.hear(&heartbeat("them", true), at(100)).unwrap();
    assert!(bond.due(at(4_000), NOW).is_some());
    assert_eq!((bond.due(at(4_100), NOW), bond.state()), (None, BondState::Ended));
    let mut bond = Bond::new(&node(), "us", PERIOD, at(0));
    bond.hear(&heartbeat("them", false), at(100)).unwrap();
    assert!(!decode::<BondStatus<'_>>(&bond.due(at(100), NOW).unwrap()).unwrap().active, "confirmed once");
    assert_eq!((bond.due(at(100), NOW), bond.next()), (None, None));
    let mut bond = Bond::new(&node(), "us", PERIOD, at(0));
    assert_eq!((bond.due(at(10_000), NOW), bond.state()), (None, BondState::Ended), "nobody answered");
}

#[test]
fn diagnostics_say_what_was_dropped_since_last_time() {
    let mut tally = Tally::default();
    tally.arrive(5);
    tally.use_one();
    tally.drop_many(Reason::Overtaken, 2);
    let mut diagnostics = Diagnostics::default();
    let bytes = diagnostics.report(&node(), NOW, [("/scan", &tally)].into_iter(), &[]);
    let array: DiagnosticArray<'_> = decode(&bytes).unwrap();
    let [whole, scan] = &array.status[..] else { panic!("two") };
    assert_eq!((whole.level, &*whole.name, &*whole.message), (0, "slam_toolbox", "nothing is missing"));
    assert_eq!((scan.level, &*scan.name), (1, "slam_toolbox: /scan"));
    assert_eq!(scan.message, "5 arrived since last time, 1 used, 2 dropped");
    let values: Vec<_> = scan.values.iter().map(|value| (&*value.key, &*value.value)).collect();
    let expected = [("arrived", "5"), ("used", "1"), ("waiting", "2"), ("dropped: overtaken by newer ones", "2")];
    assert_eq!(values, expected);
    tally.drop_one(Reason::NoMount);
    let missing = ["/scan arrives and has not been used for 2.0 s: no transform".to_owned()];
    let bytes = diagnostics.report(&node(), NOW, [("/scan", &tally)].into_iter(), &missing);
    let array: DiagnosticArray<'_> = decode(&bytes).unwrap();
    let levels: Vec<_> = array.status.iter().map(|status| status.level).collect();
    assert_eq!((levels, &*array.status[0].message), (vec![2, 2], &*missing[0]));
}

fn names(wanted: &[&'static str]) -> Vec<u8> {
    bytes_of(&ParameterNames { names: wanted.iter().map(|name| (*name).into()).collect() })
}

/// A request that sets parameters.
fn wanted(values: &[(&'static str, ParameterValue)]) -> Vec<u8> {
    let parameters = values.iter().map(|(name, value)| super::parameters::message(name, value)).collect();
    bytes_of(&mapwright_ros::messages::parameters::SetParametersRequest { parameters })
}

#[test]
fn parameters_are_read_by_either_name() {
    let mut parameters = Parameters::default();
    parameters.set("base_frame_id", ParameterValue::Text("base_footprint".to_owned())).unwrap();
    // as rclpy asks for `resolution` and `map_frame`
    let request = bytes("00010000020000000b0000007265736f6c7574696f6e005f0a0000006d61705f6672616d6500");
    let answered = parameters.answer(ParameterService::Get, &request);
    let values: GetParametersResponse<'_> = decode(&answered.bytes).unwrap();
    assert_eq!((values.values[0].double_value, &*values.values[1].string_value), (0.05, "map"));
    let answered = parameters.answer(ParameterService::Get, &names(&["base_frame", "no_such"]));
    let values: GetParametersResponse<'_> = decode(&answered.bytes).unwrap();
    assert_eq!((&*values.values[0].string_value, values.values[1].r#type), ("base_footprint", 0));
    assert_eq!(
        parameters.answer(ParameterService::Types, &names(&["resolution", "no_such", "mode"])).bytes[8..],
        [3, 0, 4]
    );
    parameters.set_configured(true);
    let answered =
        parameters.answer(ParameterService::Describe, &names(&["resolution", "map_update_interval", "mode"]));
    let described: DescribeParametersResponse<'_> = decode(&answered.bytes).unwrap();
    let [resolution, interval, mode] = &described.descriptors[..] else { panic!("three") };
    assert_eq!((resolution.read_only, resolution.floating_point_range[0].to_value), (true, 1.0));
    assert_eq!(
        (interval.read_only, &*mode.additional_constraints),
        (false, "mapping or localization; read when the node is configured")
    );
}

#[test]
fn names_are_listed_as_rclpy_lists_them() {
    let mut parameters = Parameters::default();
    // prefix `initial_pose`, depth 2
    let request = bytes("00010000010000000d000000696e697469616c5f706f7365006573700200000000000000");
    let answered = parameters.answer(ParameterService::List, &request);
    let listed = decode::<ListParametersResponse<'_>>(&answered.bytes).unwrap().result;
    assert_eq!(listed.names, ["initial_pose.x", "initial_pose.y", "initial_pose.yaw", "initial_pose.z"]);
    assert_eq!(listed.prefixes, ["initial_pose"]);
    let list = |depth: u64| {
        let request = mapwright_ros::messages::parameters::ListParametersRequest { prefixes: Vec::new(), depth };
        let bytes = parameters.clone().answer(ParameterService::List, &bytes_of(&request)).bytes;
        decode::<ListParametersResponse<'_>>(&bytes).unwrap().result.names.len()
    };
    assert_eq!(list(0), list(1) + 4, "depth 1 has no groups");
}

#[test]
fn a_refusal_says_why() {
    let mut parameters = Parameters::default();
    parameters.set_configured(true);
    let request = wanted(&[
        ("map_update_interval", ParameterValue::Integer(2)),
        ("map_updat_interval", ParameterValue::Double(2.0)),
        ("resolution", ParameterValue::Double(0.1)),
        ("tf_broadcast", ParameterValue::Text("no".to_owned())),
        ("transform_publish_period", ParameterValue::Double(-1.0)),
        ("paused_new_measurements", ParameterValue::Bool(true)),
        ("alpha1", ParameterValue::Double(0.1)),
        ("tf_broadcast", ParameterValue::NotSet),
    ]);
    let answered = parameters.answer(ParameterService::Set, &request);
    let results = decode::<SetParametersResponse<'_>>(&answered.bytes).unwrap().results;
    let reasons: Vec<_> = results.iter().map(|result| &*result.reason).collect();
    assert_eq!(
        reasons,
        [
            "",
            "no parameter `map_updat_interval` here; is `map_update_interval` meant?",
            "`resolution` is read when the node is configured: it can be set before that or in a parameter file",
            "`tf_broadcast`: expected a bool, found a string",
            "`transform_publish_period`: expected a number from 0 to 10, found -1",
            "`paused_new_measurements` says what is and cannot be set",
            "`alpha1` has no meaning here; slam_toolbox or AMCL need it",
            "`tf_broadcast`: expected a bool, found nothing; it cannot be removed",
        ]
    );
    assert_eq!((results[0].successful, results[1].successful, answered.refusals.len()), (true, false, 7));
    assert_eq!(parameters.number(Setting::MapInterval), 2.0);
    let event = Parameters::event(&node(), NOW, &answered.changes);
    let event: ParameterEvent<'_> = decode(&event).unwrap();
    assert_eq!((&*event.node, event.changed_parameters.len()), ("/slam_toolbox", 1));
    assert_eq!(event.changed_parameters[0].value.double_value, 2.0);
}

#[test]
fn all_or_none_are_set() {
    let mut parameters = Parameters::default();
    let good = ("transform_publish_period", ParameterValue::Double(0.05));
    let request = wanted(&[good.clone(), ("mode", ParameterValue::Text("dreaming".to_owned()))]);
    let answered = parameters.answer(ParameterService::SetAtomically, &request);
    let result = decode::<SetParametersAtomicallyResponse<'_>>(&answered.bytes).unwrap().result;
    assert_eq!(
        (result.successful, &*result.reason),
        (false, "`mode`: expected mapping or localization, found `dreaming`")
    );
    assert_eq!((answered.changes.len(), parameters.number(Setting::TransformPeriod)), (0, 0.02));
    let answered = parameters.answer(ParameterService::SetAtomically, &wanted(&[good]));
    assert_eq!((answered.changes.len(), parameters.number(Setting::TransformPeriod)), (1, 0.05));
}

const FILE: &str = "# of several nodes
/**:
  ros__parameters:
    use_sim_time: True
    qos_overrides:
      /tf.publisher.depth: 10
slam_toolbox:
  ros__parameters:
    solver_plugin: solver_plugins::CeresSolver
    base_frame: base_footprint
    resolution: 1
    map_start_pose: [1, 2.0, 0.5]
    mode: mapping #localization
    made_up: 3
robot1:
  amcl:
    ros__parameters:
      initial_pose: {x: 1.5, yaw: -1.0}
      set_initial_pose: yes
bt_navigator:
  ros__parameters:
    plugins: [a, 1, {b: c}]
    empty:
";

#[test]
fn a_parameter_file_is_taken_as_it_is() {
    let file = ParameterFile::parse(FILE).unwrap();
    let mut parameters = Parameters::default();
    let taken = parameters.take(&file, &node()).unwrap();
    assert_eq!(
        taken.words(),
        [
            "parameters without a meaning here are ignored: qos_overrides./tf.publisher.depth, solver_plugin",
            "parameters that nobody knows: made_up",
        ]
    );
    assert!(parameters.flag(Setting::SimTime) && !parameters.flag(Setting::SetInitialPose));
    assert_eq!((parameters.text(Setting::RobotFrame), parameters.number(Setting::Resolution)), ("base_footprint", 1.0));
    assert_eq!(parameters.get(Setting::StartPose), &ParameterValue::Doubles(vec![1.0, 2.0, 0.5]));
    let mut parameters = Parameters::default();
    parameters.take(&file, &NodeName::new("/robot1/amcl").unwrap()).unwrap();
    assert!(parameters.flag(Setting::SetInitialPose) && parameters.flag(Setting::SimTime));
    assert_eq!((parameters.number(Setting::InitialX), parameters.number(Setting::InitialYaw)), (1.5, -1.0));
}

#[test]
fn a_file_that_is_none_says_where() {
    let words = |text: &str| {
        let taken = ParameterFile::parse(text).and_then(|file| Parameters::default().take(&file, &node()));
        match taken {
            Err(error @ NodeError::File { .. }) => error.to_string(),
            other => panic!("{text}: {other:?}"),
        }
    };
    let below = |text: &str| words(&format!("slam_toolbox:\n  ros__parameters:\n    {text}\n"));
    assert_eq!(below("resolution: fine"), "parameter file, line 3: expected a double as `resolution`, found a string");
    assert_eq!(
        below("base_frame_id: 5"),
        "parameter file, line 3: expected a string as `base_frame_id`, found an integer"
    );
    assert_eq!(
        below("resolution: .nan"),
        "parameter file, line 3: expected a number from 0.005 to 1 as `resolution`, found NaN"
    );
    assert_eq!(
        below("map_start_pose: [a, 1]"),
        "parameter file, line 3: expected a list of values of one kind, found a list of 2"
    );
    assert_eq!(below("mode:"), "parameter file, line 3: expected a value of `mode`, found none");
    assert_eq!(
        words("ros__parameters:\n  a: 1\n"),
        "parameter file, line 2: expected a node's name or `/**` above `ros__parameters`, found none"
    );
    assert_eq!(
        words("slam_toolbox:\n  mode: mapping\n"),
        "parameter file, line 2: expected `ros__parameters:` below `mode`, found `mapping`"
    );
    assert!(words("slam_toolbox: [\n").starts_with("parameter file, line "));
    for empty in ["", "# nothing\n", "---\n"] {
        assert_eq!(ParameterFile::parse(empty).unwrap(), ParameterFile::default(), "{empty}");
    }
}

#[test]
fn nodes_are_meant_by_patterns() {
    for (pattern, is_meant) in [
        ("/**", true),
        ("/*/amcl", true),
        ("/robot1/*", true),
        ("/robot1/**", true),
        ("/**/amcl", true),
        ("robot1/amcl", true),
        ("/**/robot1/**/amcl", true),
        ("/*", false),
        ("amcl", false),
        ("/robot1", false),
        ("/robot1/amcl/x", false),
        ("/**/x", false),
    ] {
        let file = ParameterFile::parse(&format!("{pattern}:\n  ros__parameters:\n    mode: localization\n")).unwrap();
        let mut parameters = Parameters::default();
        parameters.take(&file, &NodeName::new("/robot1/amcl").unwrap()).unwrap();
        assert_eq!(parameters.text(Setting::Mode) == "localization", is_meant, "{pattern}");
    }
}

/// Requests of all kinds, some torn or damaged, and bytes of no meaning.
fn any_request() -> impl Strategy<Value = Vec<u8>> {
    let real = prop_oneof![
        Just(bytes("000100000355000009000000616374697661746500")),
        Just(bytes("00010000010000000d000000696e697469616c5f706f7365006573700200000000000000")),
        Just(names(&["resolution", "mode", "x"])),
        Just(wanted(&[
            ("mode", ParameterValue::Texts(vec!["a".to_owned()])),
            ("resolution", ParameterValue::Double(f64::NAN))
        ])),
        Just(bytes_of(&SetInitialPoseRequest::default())),
        Just(bytes_of(&DeserializePoseGraphRequest { filename: "a".into(), match_type: 2, ..Default::default() })),
        Just(heartbeat("them", true)),
        Just(bytes_of(&Nothing::default())),
    ];
    let damaged =
        (real, prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4), any::<prop::sample::Index>());
    let damaged = damaged.prop_map(|(mut bytes, changes, end)| {
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(end.index(bytes.len() + 1).max(bytes.len() / 2));
        bytes
    });
    let headed = prop::collection::vec(any::<u8>(), 0..300).prop_map(|body| [&[0, 1, 0, 0][..], &body].concat());
    prop_oneof![damaged, headed, prop::collection::vec(any::<u8>(), 0..100)]
}

proptest! {
    #[test]
    fn any_bytes_are_answered(requests in prop::collection::vec(any_request(), 1..8)) {
        use ParameterService::{Describe, Get, List, Set, SetAtomically, Types};
        let mut parameters = Parameters::default();
        let mut lifecycle = Lifecycle::new(true);
        let mut bond = Bond::new(&node(), "us", PERIOD, Duration::ZERO);
        for request in &requests {
            for service in offered(&node()) {
                let answer = service.answer(request, |_| Said::Done);
                prop_assert!(answer.bytes.len() >= 5 && answer.bytes.len() < 200, "{}", service.name);
            }
            for service in [Get, Types, Describe, List, Set, SetAtomically] {
                let answered = parameters.answer(service, request);
                prop_assert!(answered.bytes.len() >= 5 && answered.bytes.len() < 2000 + 200 * request.len());
            }
            for question in [Question::State, Question::States, Question::Transitions, Question::Graph] {
                prop_assert!(lifecycle.answer(question, request).bytes.len() < 4000);
            }
            if lifecycle.change(request, NOW).is_ok() {
                lifecycle.end(Outcome::Success, NOW);
            }
            let _ = bond.hear(request, Duration::ZERO);
            let _ = ParameterFile::parse(&String::from_utf8_lossy(request));
        }
        prop_assert!(lifecycle.events().len() <= 100);
    }

    #[test]
    fn any_text_is_a_file_or_refused(text in "(/\\*\\*|a|ros__parameters|mode|resolution|: |:\n|\n|  |- |\\[|\\]|\\{|\\}|,|&x |\\*x |!!int |1|.5|yes|\"|'|#|\t|<<: ){0,40}") {
        if let Ok(file) = ParameterFile::parse(&text) {
            let _ = Parameters::default().take(&file, &node());
        }
    }
}
