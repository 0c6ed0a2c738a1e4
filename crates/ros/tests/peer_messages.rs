//! Bytes that rclpy (Kilted, Fast DDS) wrote, without what it leaves behind their ends. What lies between fields for alignment is whatever was there.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests may")]

use mapwright_geom::Stamp;
use mapwright_ros::messages::lifecycle::{
    ChangeStateRequest, GetAvailableTransitionsResponse, GetStateResponse, State, TransitionEvent,
};
use mapwright_ros::messages::parameters::{
    DescribeParametersResponse, GetParameterTypesResponse, GetParametersResponse, ListParametersRequest,
    ListParametersResponse, ParameterEvent, ParameterNames, SetParametersAtomicallyResponse, SetParametersRequest,
    SetParametersResponse,
};
use mapwright_ros::messages::services::{GetMapResponse, LoadMapRequest, LoadMapResponse, Nothing};
use mapwright_ros::messages::{Clock, DiagnosticArray, Kind};
use mapwright_ros::{Channel, Decoder, Encoding, encode};

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect()
}

/// Reads it straight through and by name, writes it, reads that; hands it on to look at.
fn check<K: Kind>(type_name: &str, hex: &str, look: impl FnOnce(K::Message<'_>))
where
    for<'m> K::Message<'m>: PartialEq + std::fmt::Debug,
{
    let real = bytes(hex);
    let channel = Channel::new(type_name, Encoding::Cdr, None).unwrap();
    let mut decoder = Decoder::<K>::new(&channel).unwrap();
    assert!(K::is(type_name) && decoder.fit().exact, "{type_name}: {:?}", decoder.fit());
    let message = decoder.decode(&real).unwrap();
    assert_eq!(message, decoder.decode_by_name(&real).unwrap(), "{type_name}");
    let ours = encode(&message, Encoding::Cdr).unwrap();
    // Fast DDS fills up to a multiple of four
    assert_eq!(ours.len().next_multiple_of(4), real.len().next_multiple_of(4), "{type_name}");
    assert_eq!(encode(&decoder.decode(&ours).unwrap(), Encoding::Cdr).unwrap(), ours, "{type_name}");
    look(message);
}

#[test]
fn services_of_maps_are_as_a_peer_writes_them() {
    for name in ["std_srvs/Empty_Request", "std_srvs/Empty_Response", "nav_msgs/GetMap_Request"] {
        check::<Nothing>(name, "0001000000000000", |_| ());
    }
    check::<LoadMapRequest<'_>>(
        "nav2_msgs/LoadMap_Request",
        "000100000f00000066696c653a2f2f2f6d2e79616d6c00",
        |request| {
            assert_eq!(request.map_url, "file:///m.yaml");
        },
    );
    check::<GetMapResponse<'_>>(
        "nav_msgs/GetMap_Response",
        "000100000000000000000000040000006d6170000000000000000000cdcc4c3d03000000010000000200000000000000\
        000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000\
        0000f03f03000000ff0064",
        |response| {
            assert_eq!(response.map.data.to_vec(), [-1, 0, 100]);
        },
    );
    // nav_msgs' and Nav2's are the same
    check::<LoadMapResponse<'_>>(
        "nav2_msgs/LoadMap_Response",
        "000100000000000000000000040000006d6170000000000000000000cdcc4c3d03000000010000000200000000000000\
        000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000\
        0000f03f03000000ff006402",
        |response| {
            assert_eq!((response.result, response.map.info.width), (2, 3));
        },
    );
}

#[test]
fn managed_nodes_are_as_a_peer_writes_them() {
    check::<Nothing>("lifecycle_msgs/GetState_Request", "0001000000550000", |_| ());
    check::<ChangeStateRequest<'_>>(
        "lifecycle_msgs/ChangeState_Request",
        "000100000355000009000000616374697661746500",
        |request| {
            assert_eq!((request.transition.id, &*request.transition.label), (3, "activate"));
        },
    );
    check::<GetStateResponse<'_>>(
        "lifecycle_msgs/GetState_Response",
        "00010000035500000700000061637469766500",
        |response| {
            assert_eq!(response.current_state, State { id: 3, label: "active".into() });
        },
    );
    let hex = "0001000002000000011c1f7c0a000000636f6e6669677572650001770d000000756e636f6e66696775726564000a0000\
        0c000000636f6e6669677572696e6700055ffb770900000073687574646f776e0001fc770d000000756e636f6e666967\
        75726564000c00000d0000007368757474696e67646f776e00";
    check::<GetAvailableTransitionsResponse<'_>>("lifecycle_msgs/GetAvailableTransitions_Response", hex, |response| {
        assert_eq!(response.available_transitions[1].goal_state, State { id: 12, label: "shuttingdown".into() });
    });
    check::<TransitionEvent<'_>>(
        "lifecycle_msgs/TransitionEvent",
        "00010000002f6859000000001e7f0000130000007472616e736974696f6e5f73756363657373000d0b00000061637469\
        766174696e6700030700000061637469766500",
        |event| {
            assert_eq!((event.timestamp, event.transition.id, event.goal_state.id), (1_500_000_000, 30, 3));
        },
    );
}

#[test]
fn parameters_are_as_a_peer_writes_them() {
    check::<ParameterNames<'_>>(
        "rcl_interfaces/GetParameters_Request",
        "00010000020000000b0000007265736f6c7574696f6e005f0a0000006d61705f6672616d6500",
        |request| {
            assert_eq!(request.names, ["resolution", "map_frame"]);
        },
    );
    check::<SetParametersRequest<'_>>(
        "rcl_interfaces/SetParameters_Request",
        "000100000900000002000000620001017202000000000000000000000000000000000000010000000000000000000000\
        000000000000000000000000000000000200000069000200ab040000f9ffffffffffffff000000000000000001000000\
        00000000000000000000000000000000000000000000000002000000640003000000000000000000000000009a999999\
        9999a93f0100000000040000000000000000000000000000000000000000000002000000730004007d067c0500000000\
        0000000000000000000000000a000000626173655f6c696e6b00ab000000000000000000000000000000000000000000\
        020000007900050000000000000000000000000000000000000000000100000000487c000200000001ff000000000000\
        000000000000000000000000020000004200060000000000000000000000000000000000010000000000000000000000\
        030000000100010000000000000000000000000002000000490007000000000000000000000000000000000001000000\
        00006a02000000000000000002000000000000000100000000000000feffffffffffffff000000000000000002000000\
        440008000000000000000000000000000000000001000000000000000000000000000000000000000300000000000000\
        0000f03f0000000000000040000000000000e03f00000000020000005300090000000000000000000000000000000000\
        0000000001000000000000000000000000000000000000000000000003000000020000006100af19010000000000a005\
        050000006f646f6d00",
        |request| {
            let kinds: Vec<_> =
                request.parameters.iter().map(|parameter| (&*parameter.name, parameter.value.r#type)).collect();
            assert_eq!(kinds, ["b", "i", "d", "s", "y", "B", "I", "D", "S"].into_iter().zip(1..).collect::<Vec<_>>());
        },
    );
    check::<GetParametersResponse<'_>>(
        "rcl_interfaces/GetParameters_Response",
        "0001000009000000010100000000000000000000000000000000000001000000004cf377000000000000000000000000\
        000000000000000002000000f9ffffffffffffff00000000000000000100000000000000000000000000000000000000\
        00000000000000000300757c00000000000000009a9999999999a93f010000000051fb77000000000000000000000000\
        000000000000000004000000000000000000000000000000000000000a000000626173655f6c696e6b00640000000000\
        0000000000000000000000000000000005006c03000000000000000000000000000000000100000000036c0602000000\
        01ff64000000000000000000000000000000000006005a09010064000000000000000000000000000000000001000000\
        0000640000000000030000000100010000000000000000000000000007006c066d0e5a0e000000000000000000000000\
        000000000100000000105a10000000000000000002000000010064000100000000000000feffffffffffffff00000000\
        0000000008006c066d145a14000000000000000000000000000000000100000000185a18000000000000000000000000\
        03000000000000000000f03f0000000000000040000000000000e03f0000000009005a1c000000000000000000000000\
        0000000001000000001d6419000000000000000000000000000000000300000002000000610064240100000000026426\
        050000006f646f6d00",
        |response| {
            let values = response.values;
            assert_eq!(
                (values[1].integer_value, values[2].double_value, &*values[3].string_value),
                (-7, 0.05, "base_link")
            );
            assert_eq!(
                (values[4].byte_array_value, values[5].bool_array_value.to_vec()),
                (&[1, 255][..], vec![true, false, true])
            );
            assert_eq!(values[7].double_array_value.to_vec(), [1.0, 2.0, 0.5]);
            assert_eq!(
                (values[6].integer_array_value.to_vec(), &values[8].string_array_value[2]),
                (vec![1, -2], &"odom".into())
            );
        },
    );
    check::<GetParameterTypesResponse<'_>>(
        "rcl_interfaces/GetParameterTypes_Response",
        "0001000003000000030004",
        |response| {
            assert_eq!(response.types, [3, 0, 4]);
        },
    );
    let hex = "00010000020000000b0000007265736f6c7574696f6e0003020000006d000000050000006d6f72650001009b01000000\
        b0ca819bfca9f1d24d62503f0000000000002440000000000000000000000000020000006e0002000100000000550000\
        0100000000000000000000000100000000000000ffffffffffffffff05000000000000000100000000000000";
    check::<DescribeParametersResponse<'_>>("rcl_interfaces/DescribeParameters_Response", hex, |response| {
        let [resolution, n] = &response.descriptors[..] else { panic!("two") };
        assert_eq!((resolution.floating_point_range[0].from_value, resolution.read_only), (0.001, true));
        assert_eq!((n.integer_range[0].from_value, n.integer_range[0].step), (-1, 1));
    });
    check::<SetParametersResponse<'_>>(
        "rcl_interfaces/SetParameters_Response",
        "0001000002000000010000000100000000007469030000006e6f00",
        |response| {
            assert_eq!((response.results[0].successful, &*response.results[1].reason), (true, "no"));
        },
    );
    let hex = "0001000000550000030000006e6f00";
    check::<SetParametersAtomicallyResponse<'_>>("rcl_interfaces/SetParametersAtomically_Response", hex, |response| {
        assert_eq!(response.result.reason, "no");
    });
    check::<ListParametersRequest<'_>>(
        "rcl_interfaces/ListParameters_Request",
        "00010000010000000d000000696e697469616c5f706f7365006573700200000000000000",
        |request| {
            assert_eq!((request.depth, &*request.prefixes[0]), (2, "initial_pose"));
        },
    );
    check::<ListParametersResponse<'_>>(
        "rcl_interfaces/ListParameters_Response",
        "00010000020000000f000000696e697469616c5f706f73652e7800000b0000007265736f6c7574696f6e000001000000\
        0d000000696e697469616c5f706f736500",
        |response| {
            assert_eq!(response.result.prefixes, ["initial_pose"]);
        },
    );
    check::<ParameterEvent<'_>>(
        "rcl_interfaces/ParameterEvent",
        "0001000001000000050000000e0000002f736c616d5f746f6f6c626f780064b200000000010000000200000064000300\
        001d1f7c00000000000000009a9999999999a93f010000000040b5780000000000000000000000000000000000000000\
        00000000",
        |event| {
            assert_eq!((event.stamp, event.changed_parameters[0].value.double_value), (Stamp(1_000_000_005), 0.05));
        },
    );
}

#[test]
fn clocks_and_diagnostics_are_as_a_peer_writes_them() {
    check::<Clock>("rosgraph_msgs/Clock", "000100000100000005000000", |clock| {
        assert_eq!(clock.clock, Stamp(1_000_000_005))
    });
    check::<DiagnosticArray<'_>>(
        "diagnostic_msgs/DiagnosticArray",
        "0001000001000000050000000a000000626173655f6c696e6b0000000100000001000000110000006d61707772696768\
        743a202f7363616e00000000050000006c61746500000000020000007800000001000000080000006172726976656400\
        020000003500",
        |array| {
            let status = &array.status[0];
            assert_eq!((status.level, &*status.message, &*status.values[0].value), (1, "late", "5"));
        },
    );
}
