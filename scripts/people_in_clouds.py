#!/usr/bin/env python3
"""Puts people into a recording of clouds: people_in_clouds.py SRC OUT VARIANT...   (needs numpy, scipy, zstandard)

SRC: a folder in KITTI's layout with velodyne/*.bin or .bin.zst, times.txt and poses_tum.txt. Each variant becomes OUT/VARIANT in the same
layout, with its poses as truth.tum. Variants:
  coveredA-B-D   in clouds A to B - 1 people stand 1.8 to 2.4 m away in a sector of D degrees, another one in each cloud
  walkingN       N people of 0.6 m across walk within 6 m of the sensor, throughout"""

import re
import sys
from pathlib import Path

import numpy as np
import zstandard
from scipy.spatial.transform import Rotation

BODY_M = 0.3  # half as wide as a body
TALL_M = (-1.2, 0.6)  # from the sensor down to the floor and up to the head
AREA_M = 12.0  # people walk on a square of this side around the sensor


def load(path):
    data = path.read_bytes()
    if path.suffix == ".zst":
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=1 << 30)
    return np.frombuffer(data, "<f4").reshape(-1, 4).copy()


def shortened(points, ranges, is_hit, new):
    points[is_hit, :3] *= (new[is_hit] / np.maximum(ranges[is_hit], 1e-6))[:, None]
    return points


def covered(points, number, degrees):
    ranges = np.linalg.norm(points[:, :3], axis=1)
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    middle = 36.0 * (number % 4 - 1.5)
    is_hit = (np.abs((azimuth - middle + 180.0) % 360.0 - 180.0) < degrees / 2) & (ranges > 1.8)
    body = np.floor((azimuth + 180.0) / np.degrees(2 * BODY_M / 1.8)).astype(int)
    away = 1.8 + 0.6 * np.random.default_rng(number).random(1000)
    return shortened(points, ranges, is_hit, away[body % 1000])


def walking(points, number, pose, people):
    draw = np.random.default_rng(people)
    start, velocity = draw.uniform(0, AREA_M, (people, 2)), draw.normal(0, 0.3, (people, 2))
    ranges = np.linalg.norm(points[:, :3], axis=1)
    towards = points[:, :3] / np.maximum(ranges, 1e-6)[:, None]
    sensor_from_world, up = pose[:3, :3].T, pose[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    across = towards - np.outer(towards @ up, up)
    nearest = ranges.copy()
    for at in (start + velocity * number) % AREA_M - AREA_M / 2:
        axis = sensor_from_world @ np.array([*at, 0.0])
        axis -= up * (axis @ up)
        a, b, c = (across**2).sum(1), -2.0 * across @ axis, axis @ axis - BODY_M**2
        inside = b**2 - 4 * a * c
        is_met = (inside > 0) & (a > 1e-9)
        away = np.where(is_met, (-b - np.sqrt(np.maximum(inside, 0))) / (2 * np.maximum(a, 1e-9)), np.inf)
        height = (towards @ up) * np.where(is_met, away, 0.0)
        is_met &= (away > BODY_M) & (height > TALL_M[0]) & (height < TALL_M[1]) & (away < nearest)
        nearest = np.where(is_met, away, nearest)
    return shortened(points, ranges, nearest < ranges, nearest)


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    source, out = Path(sys.argv[1]), Path(sys.argv[2])
    files = sorted((source / "velodyne").glob("*.bin*"))
    tum = np.loadtxt(source / "poses_tum.txt", comments="#", ndmin=2)
    poses = np.tile(np.eye(4), (len(tum), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_quat(tum[:, 4:8]).as_matrix(), tum[:, 1:4]
    for variant in sys.argv[3:]:
        cover, walk = re.fullmatch(r"covered(\d+)-(\d+)-(\d+)", variant), re.fullmatch(r"walking(\d+)", variant)
        if not cover and not walk:
            sys.exit(f"unknown variant {variant}\n{__doc__}")
        folder = out / variant
        (folder / "velodyne").mkdir(parents=True, exist_ok=True)
        for number, path in enumerate(files):
            points = load(path)
            if walk:
                points = walking(points, number, poses[number], int(walk[1]))
            elif int(cover[1]) <= number < int(cover[2]):
                points = covered(points, number, float(cover[3]))
            points.astype("<f4").tofile(folder / "velodyne" / f"{number:06d}.bin")
        (folder / "times.txt").write_text((source / "times.txt").read_text())
        (folder / "truth.tum").write_text((source / "poses_tum.txt").read_text())


main()
