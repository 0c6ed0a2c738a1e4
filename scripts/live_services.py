"""How soon `mapwright live` answers what nodes of ROS 2 ask of it; for docs/decisions/0049-live.md.

    python scripts/live_services.py [NODE]

Needs rclpy with lifecycle_msgs, rcl_interfaces, std_srvs and nav_msgs. Asks each service of those types five times, and prints for each how long the
first answer took and the slowest of the others, in milliseconds, or that there was none within ten seconds.
"""
import sys
import time

import rclpy
from lifecycle_msgs.srv import GetAvailableStates, GetAvailableTransitions, GetState
from nav_msgs.srv import GetMap
from rcl_interfaces.srv import DescribeParameters, GetParameters, GetParameterTypes, ListParameters, SetParameters
from rcl_interfaces.srv import SetParametersAtomically
from std_srvs.srv import Empty

node_name = sys.argv[1] if len(sys.argv) > 1 else "mapwright"
rclpy.init()
node = rclpy.create_node("asks")
own = f"/{node_name}/"
names = ["resolution", "no_such_parameter"]
asked = [
    (own + "get_state", GetState, GetState.Request()),
    (own + "get_available_states", GetAvailableStates, GetAvailableStates.Request()),
    (own + "get_available_transitions", GetAvailableTransitions, GetAvailableTransitions.Request()),
    (own + "get_transition_graph", GetAvailableTransitions, GetAvailableTransitions.Request()),
    (own + "list_parameters", ListParameters, ListParameters.Request()),
    (own + "get_parameters", GetParameters, GetParameters.Request(names=names[:1])),
    (own + "get_parameter_types", GetParameterTypes, GetParameterTypes.Request(names=names)),
    (own + "describe_parameters", DescribeParameters, DescribeParameters.Request(names=names[:1])),
    (own + "set_parameters", SetParameters, SetParameters.Request()),
    (own + "set_parameters_atomically", SetParametersAtomically, SetParametersAtomically.Request()),
    (own + "dynamic_map", GetMap, GetMap.Request()),
    ("/reinitialize_global_localization", Empty, Empty.Request()),
    ("/request_nomotion_update", Empty, Empty.Request()),
]
for name, kind, request in asked:
    client = node.create_client(kind, name)
    if not client.wait_for_service(timeout_sec=5.0):
        print(f"{name}: not there")
        continue
    waits = []
    for _ in range(5):
        begun = time.monotonic()
        future = client.call_async(request)
        while not future.done() and time.monotonic() < begun + 10:
            rclpy.spin_once(node, timeout_sec=0.01)
        waits.append(1e3 * (time.monotonic() - begun) if future.done() else None)
    answered = [wait for wait in waits if wait is not None]
    if len(answered) < len(waits):
        print(f"{name}: {len(answered)} of {len(waits)} answered")
    else:
        print(f"{name}: first {waits[0]:.1f} ms, the others within {max(waits[1:]):.1f} ms")
