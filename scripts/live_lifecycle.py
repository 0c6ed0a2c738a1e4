"""What Nav2's lifecycle manager does with a node: configures and activates it, and keeps a bond with it; for docs/decisions/0049-live.md.

    mapwright live --managed -o out &
    python scripts/live_lifecycle.py [--node mapwright] [--seconds 10]

Needs rclpy with lifecycle_msgs, and cyclonedds for the bond, whose messages are on no package index. Prints how long the two transitions took, when the bond
was there from both sides, the longest silence of the node's side and its states; then takes the node down again, and says whether its side of the bond ended.
"""
import argparse
import time
import uuid

import rclpy
from cyclone_types import BondStatus, Header, Time
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

arguments = argparse.ArgumentParser()
arguments.add_argument("--node", default="mapwright")
arguments.add_argument("--seconds", type=float, default=10.0)
arguments.add_argument("--domain", type=int, default=0)
given = arguments.parse_args()


participant = DomainParticipant(given.domain)
kept = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100))
topic = Topic(participant, "rt/bond", BondStatus, qos=kept)
writer, reader = DataWriter(participant, topic, qos=kept), DataReader(participant, topic, qos=kept)
ours = str(uuid.uuid4())
rclpy.init()
node = rclpy.create_node("manager")
change = node.create_client(ChangeState, f"/{given.node}/change_state")
state = node.create_client(GetState, f"/{given.node}/get_state")


def ask(client, request):
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    assert future.done(), "no answer within 10 s"
    return future.result()


def go(transition, label):
    begun = time.monotonic()
    accepted = ask(change, ChangeState.Request(transition=Transition(id=transition))).success
    label_now = ask(state, GetState.Request()).current_state.label
    print(f"{label}: {'accepted' if accepted else 'refused'}, {label_now} after {1e3 * (time.monotonic() - begun):.1f} ms")


def status(active):
    return BondStatus(Header(Time(0, 0), ""), given.node, ours, active, 4.0, 0.25)


assert change.wait_for_service(timeout_sec=10.0) and state.wait_for_service(timeout_sec=10.0), "the node is not there"
go(Transition.TRANSITION_CONFIGURE, "configure")
go(Transition.TRANSITION_ACTIVATE, "activate")
begun = time.monotonic()
heard, next_at = [], begun
while time.monotonic() < begun + given.seconds:
    if time.monotonic() >= next_at:
        writer.write(status(True))
        next_at += 0.25
    theirs = [one for one in reader.take(100) if one.id == given.node and one.instance_id != ours]
    heard += [(time.monotonic() - begun, one.active) for one in theirs]
    time.sleep(0.005)
times = [at for at, active in heard if active]
gaps = [after - before for before, after in zip(times, times[1:])]
print(f"bond: first heard {times[0] if times else None} s after the node was active, {len(times)} heartbeats, longest silence {max(gaps, default=0.0):.3f} s")
go(Transition.TRANSITION_DEACTIVATE, "deactivate")
end = time.monotonic() + 3
ended = False
while time.monotonic() < end and not ended:
    ended = any(one.id == given.node and one.instance_id != ours and not one.active for one in reader.take(100))
    time.sleep(0.005)
writer.write(status(False))
print("the node's side of the bond", "ended" if ended else "did not end")
go(Transition.TRANSITION_ACTIVATE, "activate")
