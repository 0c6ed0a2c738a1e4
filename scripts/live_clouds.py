"""A lidar of ROS 2 beside `mapwright live --points /points`: large clouds, and how many of them arrive; for docs/decisions/0049-live.md.

    python scripts/live_clouds.py [--seconds S] [--hertz HZ] [--points N] [--best-effort] [--pid PID]

Needs rclpy with sensor_msgs, diagnostic_msgs and geometry_msgs. It stands in a room and turns a little, publishes /points (16 bytes a point) and /odom,
and prints one line of JSON: what was sent, what /diagnostics says arrived and was used, and the memory of `--pid` at a third of the way and at the end.
"""
import argparse
import json
import math
import threading
import time

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

arguments = argparse.ArgumentParser()
arguments.add_argument("--seconds", type=float, default=20.0)
arguments.add_argument("--hertz", type=float, default=10.0)
arguments.add_argument("--points", type=int, default=131072)
arguments.add_argument("--best-effort", action="store_true")
arguments.add_argument("--pid", type=int)
given = arguments.parse_args()

rclpy.init()
node = rclpy.create_node("lidar")
reliability = ReliabilityPolicy.BEST_EFFORT if given.best_effort else ReliabilityPolicy.RELIABLE
clouds = node.create_publisher(PointCloud2, "/points", QoSProfile(depth=5, reliability=reliability))
odometry = node.create_publisher(Odometry, "/odom", 50)
reports, poses, maps = [], [], []
node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 10)
node.create_subscription(PoseWithCovarianceStamped, "/pose", poses.append, 100)
kept = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(PointCloud2, "/map_points", lambda m: maps.append(m.width), kept)

rows = 64
columns = given.points // rows
azimuth, elevation = np.meshgrid(np.linspace(-math.pi, math.pi, columns, endpoint=False), np.linspace(-0.4, 0.4, rows))
noise = np.random.default_rng(1)


def cloud(heading):
    a = azimuth + heading
    ray = np.stack([np.cos(elevation) * np.cos(a), np.cos(elevation) * np.sin(a), np.sin(elevation)], -1)
    with np.errstate(divide="ignore"):
        along = np.where(ray > 0, [12, 8, 3], [-9, -6, -1.2]) / ray
    ranges = along.min(-1) + noise.normal(0, 0.01, a.shape)
    seen = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    points = np.zeros(a.shape + (4,), np.float32)
    points[..., :3] = ranges[..., None] * seen
    return points.tobytes()


kinds = [cloud(0.02 * k) for k in range(8)]
fields = [PointField(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate(["x", "y", "z", "intensity"])]
sent = []


def drive():
    begun = time.monotonic()
    while time.monotonic() - begun < given.seconds:
        stamp = node.get_clock().now().to_msg()
        kind = len(sent) % len(kinds)
        place = Odometry()
        place.header.stamp, place.header.frame_id, place.child_frame_id = stamp, "odom", "base_link"
        place.pose.pose.orientation.z, place.pose.pose.orientation.w = math.sin(0.01 * kind), math.cos(0.01 * kind)
        odometry.publish(place)
        message = PointCloud2(height=1, width=rows * columns, fields=fields, point_step=16, row_step=16 * rows * columns)
        message.header.stamp, message.header.frame_id, message.is_dense = stamp, "base_link", True
        message.data.frombytes(kinds[kind])
        clouds.publish(message)
        sent.append(time.monotonic())
        time.sleep(max(0.0, begun + len(sent) / given.hertz - time.monotonic()))


def resident_mb():
    if given.pid is None:
        return None
    with open(f"/proc/{given.pid}/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024


end = time.monotonic() + 30
while clouds.get_subscription_count() < 1 and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
driver = threading.Thread(target=drive)
begun, early_mb = time.monotonic(), None
driver.start()
while driver.is_alive():
    rclpy.spin_once(node, timeout_sec=0.05)
    if early_mb is None and time.monotonic() - begun > given.seconds / 3:
        early_mb = resident_mb()
end = time.monotonic() + 5
while time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
told = {}
for status in reports[-1].status if reports else []:
    told[status.name] = {value.key: value.value for value in status.values}
print(json.dumps({
    "sent": len(sent),
    "bytes": 16 * rows * columns,
    "hertz": (len(sent) - 1) / (sent[-1] - sent[0]),
    "poses": len(poses),
    "diagnostics": told,
    "map_points": maps[-1] if maps else None,
    "memory_mb": [early_mb, resident_mb()],
}))
