"""Clouds and depth images of ../shared/data with their poses, as from_clouds.rs reads them.

clouds.py hall|seven OUT [EVERY [TRAJECTORY.tum]]    (numpy, scipy, pillow, zstandard)

With a trajectory, a pose for each cloud in their order, such as mapwright's own, the folder's poses are not used.
"""
import glob
import struct
import sys

import numpy as np
import zstandard
from PIL import Image
from scipy.spatial.transform import Rotation

DATA = "../shared/data/"


def write(out, points, rotation, translation, colours=None):
    out.write(struct.pack("<II", len(points), 0 if colours is None else 1))
    out.write(struct.pack("<7d", *translation, *Rotation.from_matrix(rotation).as_quat()))
    out.write(struct.pack("<3f", 0, 0, 0))
    out.write(points.astype("<f4").tobytes())
    if colours is not None:
        out.write(colours.astype("u1").tobytes())


def trajectory(path):
    rows = np.loadtxt(path)
    poses = np.zeros((len(rows), 3, 4))
    poses[:, :, :3] = Rotation.from_quat(rows[:, 4:8]).as_matrix()
    poses[:, :, 3] = rows[:, 1:4]
    return poses


def hall(out, every, own):
    poses = np.loadtxt(DATA + "3d_os0_hall/poses_kitti.txt").reshape(-1, 3, 4) if own is None else own
    files = sorted(glob.glob(DATA + "3d_os0_hall/velodyne/*.zst"))
    for pose, path in list(zip(poses, files))[::every]:
        with open(path, "rb") as file:
            raw = zstandard.ZstdDecompressor().decompressobj().decompress(file.read())
        write(out, np.frombuffer(raw, "<f4").reshape(-1, 4)[:, :3], pose[:, :3], pose[:, 3])


def seven(out, every, own):
    v, u = np.mgrid[0:480, 0:640]
    for number in range(0, 300, every):
        name = DATA + "rgbd_7scenes/frame-%06d" % number
        depth = np.array(Image.open(name + ".depth.png")).astype(float)
        seen = (depth > 0) & (depth < 65535)
        z = depth / 1000
        points = np.stack([(u - 320) * z / 585, (v - 240) * z / 585, z], -1)[seen]
        colours = np.array(Image.open(name + ".color.jpg").convert("RGB"))[seen]
        pose = np.loadtxt(name + ".pose.txt") if own is None else own[number]
        write(out, points, pose[:3, :3], pose[:3, 3], colours)


if __name__ == "__main__":
    with open(sys.argv[2], "wb") as out:
        {"hall": hall, "seven": seven}[sys.argv[1]](
            out, int(sys.argv[3]) if len(sys.argv) > 3 else 1, trajectory(sys.argv[4]) if len(sys.argv) > 4 else None
        )
