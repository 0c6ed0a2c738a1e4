"""A robot of ROS 2 beside `mapwright live`, and what it gets back: the figures of docs/decisions/0049-live.md.

    python scripts/live_peer.py [--seconds S] [--hertz HZ] [--beams N] [--pid PID] [--hanging N]

Needs rclpy with sensor_msgs and nav_msgs; with the package cyclonedds it hears /tf as well. It drives circles in a room with pillars, publishes
/scan and /odom, and prints one line of JSON. `--pid` is that of `mapwright live`, whose memory is read at a third of the way and at the end. `--hanging`: so many other readers of /tf (of CycloneDDS) stop
without a word at a quarter of the way.
"""
import argparse
import json
import math
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan

arguments = argparse.ArgumentParser()
arguments.add_argument("--seconds", type=float, default=30.0)
arguments.add_argument("--hertz", type=float, default=40.0)
arguments.add_argument("--beams", type=int, default=1440)
arguments.add_argument("--pid", type=int)
arguments.add_argument("--hanging", type=int, default=0)
arguments.add_argument("--read", action="store_true", help=argparse.SUPPRESS)
given = arguments.parse_args()

started = time.monotonic()
rclpy.init()
node = rclpy.create_node("robot")
sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
kept = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
scans, odometry = node.create_publisher(LaserScan, "/scan", sensor), node.create_publisher(Odometry, "/odom", 50)
sent, came, maps, links = {}, {}, [], []


def nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


node.create_subscription(
    PoseWithCovarianceStamped, "/pose", lambda m: came.setdefault(nanoseconds(m.header.stamp), time.monotonic()), 100
)
node.create_subscription(OccupancyGrid, "/map", lambda m: maps.append((m.info.width, m.info.height)), kept)

bearings = np.linspace(-math.pi, math.pi, given.beams, endpoint=False)
noise = np.random.default_rng(1)


def ranges(x, y, heading):
    c, s = np.cos(bearings + heading), np.sin(bearings + heading)
    with np.errstate(divide="ignore"):
        walls = np.minimum(np.where(c > 0, (6 - x) / c, (-6 - x) / c), np.where(s > 0, (4.5 - y) / s, (-4.5 - y) / s))
    for px, py, radius in ((1.0, 0.5, 0.4), (-3.5, -3.0, 0.6), (4.0, 2.5, 0.3)):
        dx, dy = px - x, py - y
        along = c * dx + s * dy
        inside = along * along - (dx * dx + dy * dy - radius * radius)
        hits = (inside > 0) & (along > 0)
        walls = np.minimum(walls, np.where(hits, along - np.sqrt(np.maximum(inside, 0)), np.inf))
    return (walls + noise.normal(0, 0.01, given.beams)).astype(np.float32)


def drive():
    begun, count = time.monotonic(), 0
    while time.monotonic() - begun < given.seconds:
        t = time.monotonic() - begun
        turn = 2 * math.pi / 30 * t
        x, y, heading = 2.5 * math.cos(turn) - 0.5, 2.5 * math.sin(turn) - 0.3, turn + math.pi / 2
        stamp = node.get_clock().now().to_msg()
        place = Odometry()
        place.header.stamp, place.header.frame_id, place.child_frame_id = stamp, "odom", "base_link"
        place.pose.pose.position.x, place.pose.pose.position.y = 1.01 * x, y
        place.pose.pose.orientation.z, place.pose.pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)
        odometry.publish(place)
        scan = LaserScan()
        scan.header.stamp, scan.header.frame_id = stamp, "base_link"
        scan.angle_min, scan.angle_increment = -math.pi, 2 * math.pi / given.beams
        scan.angle_max = math.pi - scan.angle_increment
        scan.range_min, scan.range_max, scan.ranges = 0.1, 30.0, ranges(x, y, heading).tolist()
        sent[nanoseconds(stamp)] = time.monotonic()
        scans.publish(scan)
        count += 1
        time.sleep(max(0.0, begun + count / given.hertz - time.monotonic()))


def resident_mb():
    if given.pid is None:
        return None
    with open(f"/proc/{given.pid}/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024


def hear_transforms(over):
    try:
        from cyclone_types import TFMessage
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration
    except ImportError:
        return

    import os

    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100))
    reader = DataReader(participant, Topic(participant, "rt/tf", TFMessage), qos=qos)
    while not over.is_set():
        for message in reader.take(100):
            links.extend(time.monotonic() for link in message.transforms if link.child_frame_id == "odom")
        time.sleep(0.001)


over = threading.Event()
if given.read:
    hear_transforms(over)
others = [subprocess.Popen([sys.executable, __file__, "--read"]) for _ in range(given.hanging)]
time.sleep(3 if others else 0)
listener = threading.Thread(target=hear_transforms, args=(over,))
listener.start()
end = time.monotonic() + 30
while scans.get_subscription_count() < 1 and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
driver = threading.Thread(target=drive)
begun, early_mb, stopped = time.monotonic(), None, []
driver.start()
while driver.is_alive():
    rclpy.spin_once(node, timeout_sec=0.05)
    if others and not stopped and time.monotonic() - begun > given.seconds / 4:
        stopped = [other.send_signal(signal.SIGSTOP) for other in others]
    if early_mb is None and time.monotonic() - begun > given.seconds / 3:
        early_mb = resident_mb()
end = time.monotonic() + 3
while time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
late_mb = resident_mb()
over.set()
listener.join()
for other in others:
    other.kill()
waits = sorted(1e3 * (came[stamp] - sent[stamp]) for stamp in came if stamp in sent)
gaps = [1e3 * (b - a) for a, b in zip(links, links[1:])]
print(json.dumps({
    "sent": len(sent),
    "mapped": len(waits),
    "pose_ms": {"median": waits[len(waits) // 2], "p99": waits[int(0.99 * len(waits))], "most": waits[-1]} if waits else None,
    "map_from_odom": {"hertz": 1e3 * len(gaps) / sum(gaps), "largest_gap_ms": max(gaps)} if gaps else None,
    "first_pose_s": min(came.values()) - started if came else None,
    "maps": len(maps),
    "last_map": maps[-1] if maps else None,
    "memory_mb": [early_mb, late_mb],
}), flush=True)
