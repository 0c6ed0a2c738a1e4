"""Small simulated drives, made with numpy alone."""

import pathlib

import numpy as np

BEAMS = 181
ANGLE_MIN = -np.pi / 2
ANGLE_STEP = np.pi / 180
RANGE_MAX = 30.0


def box(x0, y0, x1, y1):
    """The walls of a rectangle: starts and ends, 4 x 2 x 2."""
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


WALLS = np.concatenate([box(0, 0, 12, 9), box(4, 3.5, 8, 5.5), box(9.5, 7, 10.5, 8), box(1, 7.5, 2.2, 8.2)])


def ranges_from(pose, random):
    """What a laser sees from a pose: metres, one a beam."""
    x, y, yaw = pose
    bearings = yaw + ANGLE_MIN + ANGLE_STEP * np.arange(BEAMS)
    directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    start, along = WALLS[:, 0], WALLS[:, 1] - WALLS[:, 0]
    to_start = start - [x, y]
    cross = directions[:, :1] * along[None, :, 1] - directions[:, 1:] * along[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (to_start[:, 0] * along[:, 1] - to_start[:, 1] * along[:, 0]) / cross
        share = (to_start[None, :, 0] * directions[:, 1:] - to_start[None, :, 1] * directions[:, :1]) / cross
    is_hit = (distance > 0) & (share >= 0) & (share <= 1)
    nearest = np.where(is_hit, distance, np.inf).min(axis=1)
    return nearest + random.normal(0, 0.01, BEAMS)


def drive(scans=150, rounds=1.2, seed=1):
    """Time, ranges, true pose and odometry of each scan of a drive around the middle of the room; odometry drifts."""
    random = np.random.default_rng(seed)
    angles = np.linspace(0, 2 * np.pi * rounds, scans)
    # an ellipse around the block, along its tangent
    x, y = 6 + 4 * np.cos(angles), 4.5 + 2.9 * np.sin(angles)
    yaw = np.arctan2(2.9 * np.cos(angles), -4 * np.sin(angles))
    odometry = np.array([0.0, 0.0, 0.0])
    for k in range(scans):
        if k > 0:
            before, c, s = yaw[k - 1], np.cos(yaw[k - 1]), np.sin(yaw[k - 1])
            dx, dy = x[k] - x[k - 1], y[k] - y[k - 1]
            turn = (yaw[k] - before + np.pi) % (2 * np.pi) - np.pi
            ahead, left = (c * dx + s * dy) * 1.02, (-s * dx + c * dy)
            c, s = np.cos(odometry[2]), np.sin(odometry[2])
            odometry = odometry + [c * ahead - s * left, s * ahead + c * left, turn * 1.01]
        pose = np.array([x[k], y[k], yaw[k]])
        yield 0.2 * k, ranges_from(pose, random), pose, odometry.copy()


def write_carmen(path, scans=150, **how):
    """The same drive as a CARMEN log."""
    lines = [f"PARAM robot_front_laser_max {RANGE_MAX}"]
    for t, ranges, _, (x, y, yaw) in drive(scans, **how):
        numbers = " ".join(f"{value:.3f}" for value in ranges)
        pose = f"{x:.6f} {y:.6f} {yaw:.6f}"
        lines.append(f"FLASER {BEAMS} {numbers} {pose} {pose} {t:.6f} robot {t:.6f}")
    pathlib.Path(path).write_text("\n".join(lines) + "\n")


def cloud_from(x, y, yaw, random, rings=16, columns=180):
    """What a lidar sees in a hall of 14 x 10 x 4 m with two steps in its walls: N x 3, metres, in its own frame."""
    up, around = np.meshgrid(np.linspace(-0.4, 0.5, rings), np.linspace(-np.pi, np.pi, columns, endpoint=False))
    up, around = up.ravel(), around.ravel()
    local = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)
    c, s = np.cos(yaw), np.sin(yaw)
    world = local @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    place = np.array([x, y, 1.2])
    with np.errstate(divide="ignore"):
        low, high = (np.array([0, 0, 0.0]) - place) / world, (np.array([14, 10, 4.0]) - place) / world
    room = np.maximum(low, high).min(axis=1)
    for lowest, highest in [([6, 4, 0], [7.5, 5.5, 3]), ([0, 8, 0], [3, 10, 2]), ([11, 0, 0], [14, 1.5, 4])]:
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (np.array(lowest) - place) / world, (np.array(highest) - place) / world
        enters, leaves = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        room = np.where((enters > 0) & (enters < leaves), np.minimum(room, enters), room)
    return (local * (room + random.normal(0, 0.01, len(room)))[:, None]).astype(np.float32)


def clouds(count=30, seed=2):
    """Time, points and true pose of each cloud of a drive through the hall."""
    random = np.random.default_rng(seed)
    for k in range(count):
        x, y, yaw = 2 + 0.15 * k, 2.5 + 0.03 * k, 0.02 * k
        yield 0.1 * k, cloud_from(x, y, yaw, random), (x, y, yaw)


def write_plys(folder, count=30):
    """The same drive as a folder of PLY files."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for k, (_, points, _) in enumerate(clouds(count)):
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        head += "".join(f"property float {name}\n" for name in "xyz") + "end_header\n"
        (folder / f"{k:06}.ply").write_bytes(head.encode() + points.astype("<f4").tobytes())
