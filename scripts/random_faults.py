"""Random combinations of faults in real logs: whether the verdict of a map is right about them (docs/decisions/0027-verdict.md).

    cargo build --release -p mapwright-cli
    python3 scripts/random_faults.py ../shared/data --logs intel,fr079,derived_intel --seed 1 --runs 100

Each run writes a log with one to four faults, of kinds, places and sizes that its seed draws, maps it with defaults and scores the relations
whose two scans are in the file. A run is silently wrong where its map is called good and is off by more than 3 times the log without
faults, or where fewer than half of those relations have poses; or where a run ends with exit code 0 without a map. A crash is any other exit
code than 0, 1 and 3. Runs that are silently wrong, and crashes, keep their files in target/figures/faults and are named with how to repeat them;
the exit code then is 1.

derived_intel is 180 s of intel as a ROS 1 bag. The binary is target/release/mapwright, or what MAPWRIGHT names. No package is needed.
"""

import argparse
import bisect
import bz2
import collections
import concurrent.futures
import json
import math
import os
import random
import shutil
import struct
import subprocess
import sys
from pathlib import Path

BINARY = os.environ.get("MAPWRIGHT", "target/release/mapwright")
WORK = Path("target/figures/faults")
SECOND = 1_000_000_000
# A map is silently wrong beyond so many times the error without faults, or with poses for less than this share of the relations.
TIMES, SHARE = 3.0, 0.5
MOST_FAULTS = 4


# --- logs -----------------------------------------------------------------------------------------------------------------------------


class Event:
    """A scan, or a reading of odometry. Times in nanoseconds; `truth_ns` is the stamp that the relations know."""

    def __init__(self, is_scan, stamp_ns, recorded_ns, pose, ranges=None):
        self.is_scan, self.stamp_ns, self.recorded_ns, self.pose, self.ranges = is_scan, stamp_ns, recorded_ns, pose, ranges
        self.truth_ns = stamp_ns if is_scan else None

    def copy(self):
        new = Event(self.is_scan, self.stamp_ns, self.recorded_ns, self.pose, self.ranges)
        new.truth_ns = self.truth_ns
        return new


class Laser:
    """What a head says: degrees and metres."""

    def __init__(self, first, last, step, range_max, mount):
        self.first, self.last, self.step, self.range_max, self.mount = first, last, step, range_max, mount


class Log:
    def __init__(self, name, events, laser, is_bag):
        self.name, self.events, self.laser, self.is_bag = name, events, laser, is_bag
        # CARMEN: whether heads are written, and whether odometry is
        self.has_heads, self.has_odometry = False, True
        # done to the file: (what, how often or where)
        self.to_bytes = []

    def copy(self):
        new = Log(self.name, [event.copy() for event in self.events], Laser(**vars(self.laser)), self.is_bag)
        return new

    def scans(self):
        return [event for event in self.events if event.is_scan]


def nanoseconds(text):
    whole, _, part = text.partition(".")
    return int(whole) * SECOND + int((part + "000000000")[:9])


def carmen(path, name):
    events, x = [], 0.0
    with bz2.open(path, "rt", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:2] == ["PARAM", "robot_frontlaser_offset"]:
                x = float(words[2])
            elif words[:1] == ["ODOM"]:
                stamp_ns = nanoseconds(words[7])
                events.append(Event(False, stamp_ns, stamp_ns, tuple(map(float, words[1:4]))))
            elif words[:1] == ["FLASER"]:
                count = int(words[1])
                stamp_ns = nanoseconds(words[count + 8])
                pose = tuple(map(float, words[count + 5 : count + 8]))
                events.append(Event(True, stamp_ns, stamp_ns, pose, words[2 : count + 2]))
    beams = len(next(event for event in events if event.is_scan).ranges)
    step = 180.0 / beams
    return Log(name, events, Laser(-90.0, 90.0 - step, step, 81.0, [x, 0.0, 0.0]), False)


def records(data, at=0):
    """Records of a ROS 1 bag: fields and body."""
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        header, end, fields = at + 4, at + 4 + length, {}
        while header < end:
            (size,) = struct.unpack_from("<I", data, header)
            key, _, value = data[header + 4 : header + 4 + size].partition(b"=")
            fields[key.decode()] = value
            header += 4 + size
        (size,) = struct.unpack_from("<I", data, end)
        yield fields, data[end + 4 : end + 4 + size]
        at = end + 4 + size


def time_ns(data, at=0):
    seconds, ns = struct.unpack_from("<II", data, at)
    return seconds * SECOND + ns


DEFINITIONS = {}


def bag(path, name):
    """Scans on /scan and odometry on /odom of an uncompressed bag; what /tf says is in /odom as well, and is made of it again."""
    data, events, laser = path.read_bytes(), [], None
    for fields, body in records(data, 13):
        if fields["op"] != b"\5":
            continue
        for inner, message in records(body):
            topic = inner.get("conn")
            if inner["op"] == b"\7":
                DEFINITIONS[inner["topic"].decode()] = message
                continue
            (kind,) = struct.unpack("<I", topic)
            recorded_ns, stamp_ns = time_ns(inner["time"]), time_ns(message, 4)
            (length,) = struct.unpack_from("<I", message, 12)
            at = 16 + length
            if kind == 0:
                first, last, step, _, _, _, range_max, count = struct.unpack_from("<7fI", message, at)
                if laser is None:
                    laser = Laser(*map(math.degrees, (first, last, step)), range_max, [0.0, 0.0, 0.0])
                events.append(Event(True, stamp_ns, recorded_ns, None, list(struct.unpack_from(f"<{count}f", message, at + 32))))
            elif kind == 1:
                (child,) = struct.unpack_from("<I", message, at)
                x, y, _, _, _, z, w = struct.unpack_from("<7d", message, at + 4 + child)
                events.append(Event(False, stamp_ns, recorded_ns, (x, y, 2.0 * math.atan2(z, w))))
    return Log(name, events, laser, True)


# --- writing --------------------------------------------------------------------------------------------------------------------------


def seconds_text(stamp_ns):
    us = microseconds(stamp_ns)
    return f"{us // 1_000_000}.{us % 1_000_000:06d}"


def compose(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def inverse(a):
    c, s = math.cos(a[2]), math.sin(a[2])
    return -c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2]


def wrapped(angle):
    return math.atan2(math.sin(angle), math.cos(angle))


def range_text(value):
    return value if isinstance(value, str) else f"{value:.2f}"


def pose_text(pose):
    return f"{pose[0]:.6f} {pose[1]:.6f} {wrapped(pose[2]):.6f}"


def carmen_lines(log):
    """Lines of a CARMEN log, and the scan that each is of."""
    laser = log.laser
    x, y, yaw = laser.mount
    if not log.has_heads:
        said = (("offset", x), ("side_offset", y), ("angular_offset", yaw))
        for key, value in said:
            if value != 0.0:
                yield f"PARAM robot_frontlaser_{key} {value:.6f} nohost 0\n", None
    for event in log.events:
        stamp = seconds_text(event.stamp_ns)
        end = f"{stamp} nohost {stamp}\n"
        if not event.is_scan:
            if log.has_odometry:
                yield f"ODOM {pose_text(event.pose)} 0 0 0 {end}", None
            continue
        ranges = f"{len(event.ranges)} {' '.join(map(range_text, event.ranges))}"
        first, last, step = map(math.radians, (laser.first, laser.last, laser.step))
        head = f"0 {first:.8f} {last - first:.8f} {step:.8f} {laser.range_max} 0.01 0 {ranges} 0"
        if not log.has_odometry:
            yield f"RAWLASER1 {head} {end}", event
        elif log.has_heads:
            poses = f"{pose_text(compose(event.pose, laser.mount))} {pose_text(event.pose)}"
            yield f"ROBOTLASER1 {head} {poses} 0 0 0 0 0 {end}", event
        else:
            poses = f"{pose_text(compose(event.pose, laser.mount))} {pose_text(event.pose)}"
            yield f"FLASER {ranges} {poses} {end}", event


def field(key, value):
    return struct.pack("<I", len(key) + 1 + len(value)) + key.encode() + b"=" + value


def record(fields, body):
    header = b"".join(field(key, value) for key, value in fields)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(body)) + body


def time_bytes(stamp_ns):
    return struct.pack("<II", stamp_ns // SECOND, stamp_ns % SECOND)


def text(words):
    return struct.pack("<I", len(words)) + words.encode()


def quaternion(yaw):
    return struct.pack("<4d", 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def transform(number, stamp_ns, parent, child, pose):
    head = struct.pack("<I", number) + time_bytes(stamp_ns) + text(parent) + text(child)
    return struct.pack("<I", 1) + head + struct.pack("<3d", pose[0], pose[1], 0.0) + quaternion(pose[2])


def float32(value):
    value = float(value)
    return value if abs(value) < 3e38 or not math.isfinite(value) else math.copysign(3e38, value)


def messages(log):
    """Topic, time of recording, content and scan of each message."""
    laser = log.laser
    for number, event in enumerate(log.events):
        head = struct.pack("<I", number) + time_bytes(event.stamp_ns)
        if event.is_scan:
            angles = [math.radians(angle) for angle in (laser.first, laser.last, laser.step)]
            said = struct.pack("<7f", *angles, 0.0, 0.0, 0.02, laser.range_max)
            count = len(event.ranges)
            ranges = struct.pack(f"<I{count}f", count, *map(float32, event.ranges))
            yield "/scan", event.recorded_ns, head + text("laser") + said + ranges + struct.pack("<I", 0), event
        elif log.has_odometry:
            pose = struct.pack("<3d", event.pose[0], event.pose[1], 0.0) + quaternion(event.pose[2])
            body = head + text("odom") + text("base_link") + pose + bytes(36 * 8) + bytes(6 * 8 + 36 * 8)
            yield "/odom", event.recorded_ns, body, None
            yield "/tf", event.recorded_ns, transform(number, event.stamp_ns, "odom", "base_link", event.pose), None
        if log.laser.mount != [0.0, 0.0, 0.0] and number % 50 == 0:
            yield "/tf", event.recorded_ns, transform(number, event.stamp_ns, "base_link", "laser", log.laser.mount), None


CHUNK_BYTES = 200_000


def bag_bytes(log):
    """A bag of chunks, with its index; and where in it each scan's chunk ends."""
    ids = {topic: struct.pack("<I", k) for k, topic in enumerate(DEFINITIONS)}
    connection = {topic: record([("op", b"\7"), ("conn", ids[topic]), ("topic", topic.encode())], DEFINITIONS[topic]) for topic in ids}
    out, infos, ends = bytearray(b"#ROSBAG V2.0\n"), [], []
    out += bytes(4096 + 8)  # the head, when the index's place is known
    chunk, index, waiting, known = bytearray(), {}, [], set()

    def close():
        nonlocal chunk, index, waiting
        if not chunk:
            return
        place = len(out)
        out.extend(record([("op", b"\5"), ("compression", b"none"), ("size", struct.pack("<I", len(chunk)))], bytes(chunk)))
        ends.extend((len(out), event) for event in waiting)
        for topic, entries in index.items():
            body = b"".join(time_bytes(when) + struct.pack("<I", at) for when, at in entries)
            head = [("op", b"\4"), ("ver", struct.pack("<I", 1)), ("conn", ids[topic]), ("count", struct.pack("<I", len(entries)))]
            out.extend(record(head, body))
        times = [when for entries in index.values() for when, _ in entries]
        counts = b"".join(ids[topic] + struct.pack("<I", len(entries)) for topic, entries in index.items())
        head = [("op", b"\6"), ("ver", struct.pack("<I", 1)), ("chunk_pos", struct.pack("<Q", place))]
        head += [("start_time", time_bytes(min(times))), ("end_time", time_bytes(max(times)))]
        infos.append(record(head + [("count", struct.pack("<I", len(index)))], counts))
        chunk, index, waiting = bytearray(), {}, []

    for topic, when, body, event in messages(log):
        if topic not in known:
            known.add(topic)
            chunk += connection[topic]
        index.setdefault(topic, []).append((when, len(chunk)))
        chunk += record([("op", b"\2"), ("conn", ids[topic]), ("time", time_bytes(when))], body)
        if event is not None:
            waiting.append(event)
        if len(chunk) > CHUNK_BYTES:
            close()
    close()
    place = len(out)
    for topic in sorted(known, key=lambda topic: ids[topic]):
        out += connection[topic]
    for info in infos:
        out += info
    head = [("op", b"\3"), ("index_pos", struct.pack("<Q", place)), ("conn_count", struct.pack("<I", len(known)))]
    head = b"".join(field(key, value) for key, value in head + [("chunk_count", struct.pack("<I", len(infos)))])
    out[13 : 13 + 4 + len(head)] = struct.pack("<I", len(head)) + head
    rest = 4096 + 8 - 4 - len(head) - 4
    out[13 + 4 + len(head) : 13 + 4096 + 8] = struct.pack("<I", rest) + b" " * rest
    return bytes(out), ends


BAD_LINES = (
    "FLASER 180 1.0 2.0\n", "ODOM a b c 0 0 0 1 host 1\n", "\0\1\2\377\n", "FLASER -3 1 2 3 0 0 0 0 0 0 1 h 1\n", "ODOM\n",
    "segmentation fault (core dumped)\n", "FLASER 99999999 1.0\n", "ODOM nan inf 0 0 0 0 976052900.0 host 0\n",
)  # fmt: skip


def write(log, folder, rng):
    """Writes a log; its path and the scans that are in it."""
    if log.is_bag:
        data, ends = bag_bytes(log)
        path = folder / "log.bag"
    else:
        parts, ends, at = [], [], 0
        bad = dict(log.to_bytes).get("bad lines")
        for line, event in carmen_lines(log):
            if bad and rng.random() < bad:
                parts.append(rng.choice(BAD_LINES).encode("latin-1"))
                at += len(parts[-1])
            parts.append(line.encode())
            at += len(parts[-1])
            if event is not None:
                ends.append((at, event))
        data, path = b"".join(parts), folder / "log.clf"
    for what, size in log.to_bytes:
        if what == "truncated":
            length = int(size * len(data))
            data, ends = data[:length], [(end, event) for end, event in ends if end <= length]
        elif what == "flipped bytes":
            data = bytearray(data)
            for _ in range(size):
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)
    return path, [event for _, event in ends]


# --- faults: each changes a log by what its generator draws, and says what it did ---------------------------------------------------------


def span(log):
    return log.events[0].recorded_ns, log.events[-1].recorded_ns


def place(log, rng):
    begin, end = span(log)
    return begin + int(rng.uniform(0.1, 0.9) * (end - begin))


def window(log, rng, least_s, most_s):
    begin = place(log, rng)
    return begin, begin + int(rng.uniform(least_s, most_s) * SECOND)


def change_poses(log, change):
    for event in log.events:
        if event.pose is not None:
            event.pose = change(event)


def odometry_anew(log, rng):
    times = sorted(place(log, rng) for _ in range(rng.randint(1, 3)))
    starts = {}
    for event in log.events:
        if event.pose is not None:
            epoch = bisect.bisect_right(times, event.recorded_ns)
            start = starts.setdefault(epoch, (0.0, 0.0, 0.0) if epoch == 0 else event.pose)
            event.pose = compose(inverse(start), event.pose)
    return f"odometry begins anew {len(times)} times"


def odometry_identity(log, rng):
    change_poses(log, lambda event: (0.0, 0.0, 0.0))
    return "odometry never moves"


def odometry_none(log, rng):
    log.has_odometry = False
    return "no odometry"


def odometry_utm(log, rng):
    east, north = rng.uniform(2e5, 8e5), rng.uniform(1e6, 9e6)
    change_poses(log, lambda event: (event.pose[0] + east, event.pose[1] + north, event.pose[2]))
    return "odometry in UTM"


def steps_changed(log, change):
    """Odometry anew of changed steps, for odometry's readings and scans that carry it in the order of the log."""
    said = made = None
    for event in log.events:
        if event.pose is not None:
            before, said = said, event.pose
            made = said if before is None else compose(made, change(compose(inverse(before), said)))
            event.pose = made


def odometry_scaled(log, rng):
    way, turn = rng.uniform(0.7, 1.4), rng.choice([1.0, rng.uniform(0.8, 1.25)])
    steps_changed(log, lambda step: (way * step[0], way * step[1], turn * wrapped(step[2])))
    return f"odometry times {way:.2f} in way, {turn:.2f} in turns"


def odometry_noise(log, rng):
    share = rng.uniform(0.05, 0.5)

    def change(step):
        noise = lambda: 1.0 + share * rng.gauss(0.0, 1.0)
        return step[0] * noise(), step[1] * noise(), wrapped(step[2]) * noise() + 0.1 * share * rng.gauss(0.0, 1.0) * math.hypot(*step[:2])

    steps_changed(log, change)
    return f"odometry with {100 * share:.0f} % noise"


def clock_step(log, rng):
    at, by_s = place(log, rng), rng.choice([-1, 1]) * 10 ** rng.uniform(0.0, 3.5)
    whose = rng.choice(["scans", "odometry", "both"])
    with_recorder = log.is_bag and rng.random() < 0.5
    for event in log.events:
        if event.recorded_ns >= at:
            if whose == "both" or (whose == "scans") == event.is_scan:
                event.stamp_ns += int(by_s * SECOND)
                if with_recorder:
                    event.late_ns = int(by_s * SECOND)
    if with_recorder:
        for event in log.events:
            event.recorded_ns += getattr(event, "late_ns", 0)
    return f"clock of {whose} set by {by_s:+.1f} s" + (" with the recorder's" if with_recorder else "")


def gap(log, rng):
    begin, end = window(log, rng, 5.0, 120.0)
    whose = rng.choice(["everything", "scans", "odometry"])

    def stays(event):
        inside = begin <= event.recorded_ns < end
        return not inside or (whose == "scans" and not event.is_scan) or (whose == "odometry" and event.is_scan)

    log.events = [event for event in log.events if stays(event)]
    return f"{whose} missing for {(end - begin) / SECOND:.0f} s"


def recorded_late(log, rng):
    late_s, whose = rng.uniform(0.05, 2.0), rng.choice([True, False])
    for event in log.events:
        if event.is_scan == whose:
            event.recorded_ns += int(rng.uniform(0.0, late_s) * SECOND)
    log.events.sort(key=lambda event: event.recorded_ns)
    return f"{'scans' if whose else 'odometry'} recorded up to {late_s:.1f} s late"


def stamps_jitter(log, rng):
    sigma_s = rng.uniform(0.005, 0.1)
    for event in log.events:
        event.stamp_ns += int(rng.gauss(0.0, sigma_s) * SECOND)
    return f"stamps off by {sigma_s:.3f} s"


def mount_turned(log, rng):
    by = rng.choice([rng.uniform(0.1, 0.5), rng.uniform(0.5, math.pi)]) * rng.choice([-1, 1])
    log.laser.mount = [*log.laser.mount[:2], log.laser.mount[2] + by]
    return f"mount wrong by {math.degrees(by):.0f} deg"


def mount_shifted(log, rng):
    angle = rng.uniform(-math.pi, math.pi)
    x, y, yaw = log.laser.mount
    log.laser.mount = [x + 0.2 * math.cos(angle), y + 0.2 * math.sin(angle), yaw]
    return f"mount 0.2 m off, towards {math.degrees(angle):.0f} deg"


def mount_missing(log, rng):
    log.laser.mount = [0.0, 0.0, 0.0]
    return "mount missing"


def upside_down(log, rng):
    for event in log.scans():
        event.ranges = event.ranges[::-1]
    return "laser upside down, unsaid"


def head_step(log, rng):
    log.has_heads = True
    by = rng.choice([-1.0, rng.uniform(0.7, 0.95), rng.uniform(1.05, 1.4)])
    log.laser.step *= by
    return f"angle step times {by:.2f}"


def head_view(log, rng):
    log.has_heads = True
    by = rng.choice([-1.0, rng.uniform(0.7, 0.95), rng.uniform(1.05, 1.4)])
    log.laser.first, log.laser.last, log.laser.step = by * log.laser.first, by * log.laser.last, by * log.laser.step
    return f"all angles of the head times {by:.2f}"


def head_start(log, rng):
    log.has_heads = True
    by = rng.uniform(-60.0, 60.0)
    log.laser.first += by
    log.laser.last += by
    return f"angles of the head off by {by:.0f} deg"


def change_ranges(log, change):
    for event in log.scans():
        event.ranges = [change(float(value)) for value in event.ranges]


def millimetres(log, rng):
    change_ranges(log, lambda value: 1000.0 * value)
    if rng.random() < 0.5:
        log.has_heads, log.laser.range_max = True, 1000.0 * log.laser.range_max
    return "ranges in millimetres"


def ranges_scaled(log, rng):
    by = rng.choice([rng.uniform(0.7, 0.95), rng.uniform(1.05, 1.4)])
    change_ranges(log, lambda value: by * value)
    return f"ranges times {by:.2f}"


def range_max_none(log, rng):
    log.has_heads, log.laser.range_max = True, 0.0
    return "maximum range 0"


def blind(log, rng):
    begin, end = window(log, rng, 5.0, 60.0)
    how = rng.choice(["empty", "0", "inf"])
    for event in log.scans():
        if begin <= event.recorded_ns < end:
            event.ranges = [] if how == "empty" else [float(how)] * len(event.ranges)
    return f"scans {'empty' if how == 'empty' else 'all ' + how} for {(end - begin) / SECOND:.0f} s"


def odd_values(log, rng):
    share, value = rng.uniform(0.02, 0.5), rng.choice([math.nan, math.inf, -1.0, 1e30, -math.inf])
    for event in log.scans():
        event.ranges = [f"{value:g}" if rng.random() < share else old for old in event.ranges]
    return f"{100 * share:.0f} % of the ranges {value:g}"


def random_beams(log, rng):
    share = rng.uniform(0.05, 0.4)
    for event in log.scans():
        event.ranges = [rng.uniform(0.1, 20.0) if rng.random() < share else old for old in event.ranges]
    return f"{100 * share:.0f} % random beams"


def duplicated(log, rng):
    share, events = rng.uniform(0.02, 0.5), []
    for event in log.events:
        events.append(event)
        if event.is_scan and rng.random() < share:
            again = event.copy()
            again.truth_ns = None
            events.append(again)
    log.events = events
    return f"{100 * share:.0f} % of the scans twice"


def dropped(log, rng):
    share = rng.uniform(0.1, 0.9)
    log.events = [event for event in log.events if not event.is_scan or rng.random() >= share]
    return f"{100 * share:.0f} % of the scans missing"


def truncated(log, rng):
    share = rng.uniform(0.3, 0.98)
    log.to_bytes.append(("truncated", share))
    return f"cut off at {100 * share:.0f} %"


def flipped(log, rng):
    count = int(10 ** rng.uniform(0.0, 2.3))
    log.to_bytes.append(("flipped bytes", count))
    return f"{count} bits flipped"


def bad_lines(log, rng):
    if log.is_bag:
        return flipped(log, rng)
    share = 10 ** rng.uniform(-3.5, -1.0)
    log.to_bytes.append(("bad lines", share))
    return f"{100 * share:.2f} % bad lines"


FAULTS = (
    odometry_anew, odometry_identity, odometry_none, odometry_utm, odometry_scaled, odometry_noise, clock_step, gap, recorded_late,
    stamps_jitter, mount_turned, mount_shifted, mount_missing, upside_down, head_step, head_view, head_start, millimetres, ranges_scaled,
    range_max_none, blind, odd_values, random_beams, duplicated, dropped, truncated, flipped, bad_lines,
)  # fmt: skip
# What only odometry can contradict: not drawn with a log that has none.
NEED_ODOMETRY = {mount_turned, mount_shifted, mount_missing, upside_down, head_view, head_start, ranges_scaled}
WITHOUT_ODOMETRY = {odometry_none, odometry_identity}


def drawn(rng):
    faults = rng.sample(FAULTS, rng.randint(1, MOST_FAULTS))
    if WITHOUT_ODOMETRY & set(faults):
        faults = [fault for fault in faults if fault not in NEED_ODOMETRY]
    return faults


# --- runs -----------------------------------------------------------------------------------------------------------------------------


def poses_of(path):
    """Stamps, rounded to microseconds, and the rest of each line of a trajectory."""
    rows = []
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            stamp, rest = line.split(maxsplit=1)
            rows.append((nanoseconds(stamp), rest))
    return rows


def microseconds(stamp_ns):
    return (stamp_ns + 500) // 1000


def by_truth(rows, scans):
    """The trajectory under the stamps that relations know, scan by scan: by the stamp as it was written, of those that have the same in their order."""
    truth = collections.defaultdict(collections.deque)
    for event in scans:
        truth[microseconds(event.stamp_ns)].append(event.truth_ns)
    pairs = []
    for stamp_ns, rest in rows:
        same = truth[microseconds(stamp_ns)]
        pairs.append((same.popleft() if same else None, rest))
    if len(rows) == len(scans) and any(same for same in truth.values()):
        # stamps were not kept as they were written
        pairs = [(event.truth_ns, rest) for (_, rest), event in zip(rows, scans)]
    return [(truth_ns, rest) for truth_ns, rest in pairs if truth_ns is not None]


def evaluate(out, scans, relations):
    """Mean error, metres, of the relations that can be measured, and the share of those whose scans are in the file."""
    known = {microseconds(event.truth_ns) for event in scans if event.truth_ns is not None}
    lines = [line for line in relations if all(microseconds(nanoseconds(word)) in known for word in line.split()[:2])]
    if not lines:
        return math.nan, 1.0
    (out / "truth.relations").write_text("\n".join(lines) + "\n")
    rows = by_truth(poses_of(out / "trajectory.tum"), scans)
    (out / "truth.tum").write_text("".join(f"{ns // SECOND}.{ns % SECOND:09d} {rest}\n" for ns, rest in rows))
    run = subprocess.run(
        [BINARY, "eval", out / "truth.tum", "--relations", out / "truth.relations", "--json"], capture_output=True, text=True
    )
    if run.returncode not in (0, 3):
        return math.nan, 0.0
    (value,) = json.loads(run.stdout)
    mean_m = value["all"]["translation_m"]["mean"] if value["all"] else math.nan
    return mean_m, value["used"] / len(lines)


LOGS = {}
RELATIONS = {}


def load(data, names):
    for name in names:
        known = "intel" if name == "derived_intel" else name
        RELATIONS[name] = (data / f"2d_benchmark/{known}.relations").read_text().splitlines()
        if name == "derived_intel":
            LOGS[name] = bag(data / "ros_bags/derived_intel/intel_180s.bag", name)
        else:
            LOGS[name] = carmen(data / f"2d_benchmark/{name}.clf.bz2", name)


def one(name, seed, clean_m):
    """One run: the log of this seed, or without faults where that is none."""
    # of the log's name as well: the same seed draws others for each
    rng = random.Random(f"{name} {seed}")
    log, did = LOGS[name].copy(), []
    if seed is not None:
        did = [fault(log, rng) for fault in drawn(rng)]
    folder = WORK / f"{name}_{'clean' if seed is None else seed}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path, scans = write(log, folder, rng)
    out = folder / "out"
    run = subprocess.run([BINARY, "map", path, "-o", out, "--json"], capture_output=True, text=True)
    (folder / "stderr").write_text(run.stderr)
    result = {"log": name, "seed": seed, "faults": did, "exit": run.returncode, "word": "refused", "error_m": math.nan, "share": 0.0}
    if run.returncode in (0, 3):
        report = json.loads((out / "report.json").read_text())
        verdict = report["verdict"]
        result |= {"word": verdict["word"], "why": verdict["words"], "expected_m": verdict["expected_error_m"]}
        result["error_m"], result["share"] = evaluate(out, scans, RELATIONS[name])
    else:
        result["why"] = run.stderr.strip().splitlines()[-1:] or [""]
    result["clean_m"] = result["error_m"] if clean_m is None else clean_m
    result["times"] = result["error_m"] / result["clean_m"]
    wrong = result["share"] < SHARE or result["times"] > TIMES
    result["silent"] = result["word"] == "good" and wrong
    result["crash"] = run.returncode not in (0, 1, 3)
    if not (result["silent"] or result["crash"]) and not KEEP:
        shutil.rmtree(folder)
    return result


def line(result):
    mark = "CRASH" if result["crash"] else "WRONG" if result["silent"] else ""
    return (
        f"{result['log']:14}{result['seed']!s:>6}  {result['word']:9}{result['error_m']:8.3f} m {result['times']:7.1f} times "
        f"{100 * result['share']:4.0f} %  {mark:6}{'; '.join(result['faults'])}"
    )


def table(results):
    print(f"\n{'log':14}  runs  good  check  unusable  refused  good beyond {TIMES:g} times  crashes")
    for name in [*LOGS, "all"]:
        of = [result for result in results if name in (result["log"], "all")]
        words = collections.Counter(result["word"] for result in of)
        silent, crashes = (sum(result[what] for result in of) for what in ("silent", "crash"))
        print(
            f"{name:14}{len(of):6}{words['good']:6}{words['check']:7}{words['unusable']:10}{words['refused']:9}{silent:20}{crashes:9}"
        )
    fits = [result for result in results if result["word"] in ("check", "unusable") and result["times"] <= TIMES]
    blind = [result for result in results if result["word"] == "good" and math.isnan(result["error_m"])]
    print(f"good, but no relation has both scans: {len(blind)}")
    print(f"check or unusable, though within {TIMES:g} times: {len(fits)}")


KEEP = False


def main():
    global KEEP
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--logs", default="intel,fr079,derived_intel")
    parser.add_argument("--seed", type=int, default=1, help="of the first run")
    parser.add_argument("--runs", type=int, default=100, help="for each log")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="the files of every run")
    parser.add_argument("--json", type=Path, help="a line for each run")
    args = parser.parse_args()
    KEEP = args.keep
    load(args.data, args.logs.split(","))
    clean = {name: one(name, None, None) for name in LOGS}
    for result in clean.values():
        print(line(result), flush=True)
    seeds = range(args.seed, args.seed + args.runs)
    with concurrent.futures.ProcessPoolExecutor(args.threads) as pool:
        jobs = [pool.submit(one, name, seed, clean[name]["error_m"]) for name in LOGS for seed in seeds]
        results = []
        for job in jobs:
            results.append(job.result())
            print(line(results[-1]), flush=True)
    if args.json:
        args.json.write_text("".join(json.dumps(result) + "\n" for result in results))
    table(results)
    sys.exit(1 if any(result["silent"] or result["crash"] for result in results) else 0)


if __name__ == "__main__":
    main()
