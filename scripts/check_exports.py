#!/usr/bin/env python3
"""An exported MCAP file as official readers see it, as JSON on stdout.

usage: check_exports.py FILE

Reads with the wheel `mcap`, decodes by the schemas in the file with `mcap-ros2-support` and, for comparison, by its own
definitions with `rosbags`. Says for each topic its type, count and durability, and how far map -> odom -> base_link is
off the pose at each stamp: in the plane, and in space (`worst_in_space`).
"""

import json
import math
import struct
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore


def planar(translation, q):
    return (translation.x, translation.y, math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2)))


def compose(a, b):
    s, c = math.sin(a[2]), math.cos(a[2])
    return (a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2])


def off(a, b):
    turn = (a[2] - b[2] + math.pi) % (2 * math.pi) - math.pi
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]), abs(turn))


def in_space(translation, q):
    """The upper three rows of the pose's matrix."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation.x),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation.y),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation.z),
    )


def compose_in_space(a, b):
    b = (*b, (0.0, 0.0, 0.0, 1.0))
    return tuple(tuple(sum(row[k] * b[k][column] for k in range(4)) for column in range(4)) for row in a)


def off_in_space(a, b):
    return max(abs(x - y) for p, q in zip(a, b) for x, y in zip(p, q))


def first_point(cloud):
    """Its numbers by their names; a colour as red, green and blue."""
    point = {}
    for field in cloud.fields:
        at = bytes(cloud.data[field.offset : field.offset + 4])
        point[field.name] = list(at[2::-1]) if field.name == "rgb" else struct.unpack("<f", at)[0]
    return point


def main(path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    topics, transforms, matrices, last, worst, worst_in_space, found = {}, {}, {}, 0, 0.0, 0.0, {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        profile = reader.get_header().profile
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            qos = channel.metadata["offered_qos_profiles"]
            topic = topics.setdefault(
                channel.topic,
                {"type": schema.name, "count": 0, "latched": "durability: 1" in qos, "encoding": channel.message_encoding},
            )
            topic["count"] += 1
            assert message.log_time >= last, "messages out of order"
            last = message.log_time
            other = store.deserialize_cdr(message.data, schema.name)
            if schema.name == "sensor_msgs/msg/LaserScan":
                assert len(other.ranges) == len(decoded.ranges) and other.header.frame_id == decoded.header.frame_id
                found["ranges"] = len(decoded.ranges)
                found["scan_frame"] = decoded.header.frame_id
            elif schema.name == "nav_msgs/msg/OccupancyGrid":
                assert len(other.data) == len(decoded.data) == decoded.info.width * decoded.info.height
                found["map"] = [decoded.info.width, decoded.info.height, round(decoded.info.resolution, 6)]
                found["occupied"] = sum(1 for cell in decoded.data if cell >= 65)
            elif schema.name == "sensor_msgs/msg/PointCloud2":
                assert bytes(other.data) == bytes(decoded.data)
                assert len(decoded.data) == decoded.row_step == decoded.width * decoded.point_step
                found["points"] = [decoded.width, decoded.height, decoded.header.frame_id]
                found["first_point"] = first_point(decoded) if decoded.width else None
            elif schema.name == "nav_msgs/msg/Path":
                assert len(other.poses) == len(decoded.poses)
                found["path"] = len(decoded.poses)
            elif schema.name == "visualization_msgs/msg/MarkerArray":
                assert [len(m.points) for m in other.markers] == [len(m.points) for m in decoded.markers]
                found["markers"] = [[m.ns, m.type, len(m.points)] for m in decoded.markers]
            elif schema.name == "tf2_msgs/msg/TFMessage":
                assert len(other.transforms) == len(decoded.transforms)
                for t in decoded.transforms:
                    key = (t.header.frame_id, t.child_frame_id)
                    transforms[key] = planar(t.transform.translation, t.transform.rotation)
                    matrices[key] = in_space(t.transform.translation, t.transform.rotation)
            elif schema.name == "geometry_msgs/msg/PoseStamped":
                robot = compose(transforms["map", "odom"], transforms["odom", "base_link"])
                worst = max(worst, off(robot, planar(decoded.pose.position, decoded.pose.orientation)))
                robot = compose_in_space(matrices["map", "odom"], matrices["odom", "base_link"])
                told = in_space(decoded.pose.position, decoded.pose.orientation)
                worst_in_space = max(worst_in_space, off_in_space(robot, told))
    links = sorted(f"{parent}->{child}" for parent, child in transforms)
    told = {"profile": profile, "topics": topics, "links": links, "worst": worst, "worst_in_space": worst_in_space}
    print(json.dumps({**told, **found}))


main(sys.argv[1])
