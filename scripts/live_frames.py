"""Whether `map -> odom` with odometry's own transform is where `mapwright live` says that the robot is; for docs/decisions/0049-live.md.

    mapwright live -o out &
    cargo run -p mapwright-dds --features cyclone --example play -- LOG.mcap 2 &
    python scripts/live_frames.py [--domain 0] [--seconds 22]

Needs cyclonedds. Of each pose that is told, the next `map -> odom` is taken with the `odom -> base_link` of the pose's own stamp, as whoever uses the map looks
the robot up; prints for how many poses that was done, and by how much the two differ at most, metres and radians.
"""
import argparse
import math
import time

from cyclone_types import PoseWithCovarianceStamped, TFMessage
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

arguments = argparse.ArgumentParser()
arguments.add_argument("--domain", type=int, default=0)
arguments.add_argument("--seconds", type=float, default=22.0)
given = arguments.parse_args()
participant = DomainParticipant(given.domain)
kept = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(5000))


def reader(name, kind):
    return DataReader(participant, Topic(participant, name, kind, qos=kept), qos=kept)


def planar(place, quaternion):
    return place.x, place.y, 2 * math.atan2(quaternion.z, quaternion.w)


def nanoseconds(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


transforms, poses = reader("rt/tf", TFMessage), reader("rt/pose", PoseWithCovarianceStamped)
odom_from_robot, waiting, metres, radians = {}, None, [], []
end = time.monotonic() + given.seconds
while time.monotonic() < end:
    # what is no message says that whoever told has gone
    messages = [message for message in transforms.take(500) if isinstance(message, TFMessage)]
    for link in (link for message in messages for link in message.transforms):
        pose = planar(link.transform.translation, link.transform.rotation)
        if link.child_frame_id == "base_link":
            odom_from_robot[nanoseconds(link.header)] = pose
        # one that was sent after the pose
        elif link.child_frame_id == "odom" and waiting and time.monotonic() > waiting[2] + 0.03:
            (stamp, told, _), waiting = waiting, None
            if stamp in odom_from_robot:
                (x, y, turn), (odom_x, odom_y, heading) = pose, odom_from_robot[stamp]
                c, s = math.cos(turn), math.sin(turn)
                found = x + c * odom_x - s * odom_y, y + s * odom_x + c * odom_y
                metres.append(math.dist(found, told[:2]))
                radians.append(abs(math.remainder(turn + heading - told[2], 2 * math.pi)))
    for message in (message for message in poses.take(500) if isinstance(message, PoseWithCovarianceStamped)):
        robot = message.pose.pose
        waiting = nanoseconds(message.header), planar(robot.position, robot.orientation), time.monotonic()
    time.sleep(0.002)
print(f"{len(metres)} poses: {max(metres, default=math.nan):.1e} m, {max(radians, default=math.nan):.1e} rad at most")
