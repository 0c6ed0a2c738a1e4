"""Maps of space beside kiss-icp, small_gicp and OctoMap, on the same clouds in the same run, as one table.

    cargo build --release -p mapwright-cli
    cargo build --release -p mapwright-voxel --example occupancy
    apt-get install octomap-tools
    python3 scripts/compare_3d.py target/release ../shared/data

The first folder holds the binaries, the second 3d_os0_hall and 3d_kitti00_first16; both are decompressed into target/compare_3d, or
the folder that COMPARE_3D names. Python's packages are those of the interpreter if it has them, otherwise of a virtual environment that is
made there. COMPARE_3D_ROUNDS is how often each is run, in turn (3). A third argument, odometry or occupancy, asks for that part alone, and
COMPARE_3D_PEERS for some of the peers in the hall alone (kiss-icp:50,kiss-icp:100,small_gicp, the number being max_range).

What is compared is odometry, each tool with what it does by default:
- kiss-icp: its KissICP class and default configuration, with max_range as the data need (voxels are 1/100 of it): 100 m, its
  default, for KITTI; for the hall, where hardly a point lies beyond 50 m, 50 m, and 100 m as well. Clouds without times are not
  undistorted.
- small_gicp: scan to model as in its example kitti_odometry.py, points of 0.25 m against a GaussianVoxelMap of 1 m.
- OctoMap: graph2tree -res 0.1 -m 60 -discretize, at the poses that mapwright's example is given: the hall's reference poses.

Time is user and system time, all tools on one thread, the median of the rounds. Of the peers only the calls that take a cloud are
counted, of mapwright the whole process: reading, keyframes, loops, and writing the map, its picture and the session.
ATE, RPE and corrections are what `mapwright eval` says of each trajectory.
"""

import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

WORK = Path(os.environ.get("COMPARE_3D", "target/compare_3d"))
PEERS = os.environ.get("COMPARE_3D_PEERS", "kiss-icp:50,kiss-icp:100,small_gicp").split(",")
ROUNDS = int(os.environ.get("COMPARE_3D_ROUNDS", "3"))
MODULES = {"numpy": "numpy", "zstandard": "zstandard", "kiss_icp": "kiss-icp", "small_gicp": "small_gicp"}
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
# The hall is driven through once: clouds 60 scans apart lie 8 m and more apart.
REVISITS = ["--apart", "60", "--within", "12"]
RESOLUTION_M, OCCUPANCY_RANGE_M = "0.1", "60"


# What runs in a process of its own.


def clouds_of(folder):
    import numpy

    return [numpy.fromfile(path, numpy.float32).reshape(-1, 4)[:, :3] for path in sorted(Path(folder).glob("*.bin"))]


class Kiss:
    """kiss-icp, on one thread."""

    def __init__(self, max_range_m):
        from kiss_icp.config import load_config
        from kiss_icp.kiss_icp import KissICP

        config = load_config(None)
        config.data.max_range = float(max_range_m)
        config.mapping.voxel_size = config.data.max_range / 100.0
        config.registration.max_num_threads = 1
        self.odometry = KissICP(config=config)

    def estimate(self, points):
        import numpy

        self.odometry.register_frame(points.astype(numpy.float64), numpy.array([]))
        return self.odometry.last_pose.copy()


class Gicp:
    """small_gicp, scan to model, on one thread."""

    def __init__(self):
        import numpy
        import small_gicp

        self.last_from_current, self.world_from_lidar = numpy.identity(4), numpy.identity(4)
        self.target = small_gicp.GaussianVoxelMap(1.0)
        self.target.set_lru(horizon=100, clear_cycle=10)

    def estimate(self, points):
        import numpy
        import small_gicp

        source, _ = small_gicp.preprocess_points(points, 0.25, num_threads=1)
        if self.target.size() > 0:
            guess = self.world_from_lidar @ self.last_from_current
            world_from_lidar = small_gicp.align(self.target, source, guess, num_threads=1).T_target_source
            self.last_from_current = numpy.linalg.inv(self.world_from_lidar) @ world_from_lidar
            self.world_from_lidar = world_from_lidar
        self.target.insert(source, self.world_from_lidar)
        return self.world_from_lidar.copy()


def run_peer(name, folder, stamps, out):
    """Runs a peer's odometry: a TUM file with these stamps, and on the standard output CPU seconds a cloud."""
    import time

    peer = Gicp() if name == "small_gicp" else Kiss(name.split(":")[1])
    clouds, poses, cpu_s = clouds_of(folder), [], 0.0
    for points in clouds:
        began_s = time.process_time()
        poses.append(peer.estimate(points))
        cpu_s += time.process_time() - began_s
    rows = zip(Path(stamps).read_text().split(), poses, strict=True)
    Path(out).write_text("".join(tum_row(stamp, pose) for stamp, pose in rows))
    print(cpu_s / len(clouds))


def tum_row(stamp, pose):
    numbers = [*pose[:3, 3], *quaternion(pose[:3, :3])]
    return " ".join([stamp, *(f"{value:.9f}" for value in numbers)]) + "\n"


def quaternion(rotation):
    """x, y, z, w: the eigenvector of the greatest eigenvalue (Bar-Itzhack 2000)."""
    import numpy

    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    half = numpy.array(
        [
            [xx - yy - zz, 0, 0, 0],
            [yx + xy, yy - xx - zz, 0, 0],
            [zx + xz, zy + yz, zz - xx - yy, 0],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    values, vectors = numpy.linalg.eigh(half, UPLO="L")
    return vectors[:, numpy.argmax(values)]


# What runs them.


def python():
    """An interpreter that has the packages; a virtual environment is made for it where this one has not."""
    if all(importlib.util.find_spec(module) for module in MODULES):
        return sys.executable
    interpreter = WORK / "venv/bin/python"
    if not interpreter.exists():
        subprocess.run([sys.executable, "-m", "venv", WORK / "venv"], check=True)
    subprocess.run([interpreter, "-m", "pip", "install", "-q", *MODULES.values()], check=True)
    return str(interpreter)


def measured(command):
    """Runs: what it printed, CPU seconds, and at most how many MB it took."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as remarks:
        arguments = [str(argument) for argument in command]
        child = subprocess.Popen(arguments, stdout=out, stderr=remarks, env=os.environ | ONE_THREAD)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0), remarks.seek(0)
        said, remarked = out.read(), remarks.read()
    if child.returncode != 0:
        sys.exit(f"{' '.join(arguments)}: expected exit code 0, found {child.returncode}\n{remarked}")
    return said, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e6


def recording(name, source, every=1):
    """A recording decompressed into a folder of its own: every so many of its clouds, numbered anew, with their times."""
    import zstandard

    folder = WORK / f"{name}_{every}"
    (folder / "velodyne").mkdir(parents=True, exist_ok=True)
    for number, path in enumerate(sorted((source / "velodyne").glob("*.bin.zst"))[::every]):
        cloud = folder / "velodyne" / f"{number:06}.bin"
        if not cloud.exists():
            with path.open("rb") as packed:
                part = cloud.with_suffix(".part")
                part.write_bytes(zstandard.ZstdDecompressor().stream_reader(packed).read())
                part.rename(cloud)
    times = source / "times.txt"
    if times.exists():
        (folder / "times.txt").write_text("\n".join(times.read_text().split()[::every]) + "\n")
    return folder


def evaluated(binaries, *arguments):
    said, _, _ = measured([binaries / "mapwright", "eval", *arguments, "--json"])
    return json.loads(said)[0]


class Compared:
    """A recording, and each tool's trajectory and CPU seconds a cloud on it."""

    def __init__(self, binaries, folder, peers):
        self.binaries, self.folder, self.peers = binaries, folder, peers
        self.results = folder / "mapwright"
        self.cpu_s = {name: [] for name in ["mapwright", *peers]}

    def trajectory(self, name):
        return self.results / "trajectory.tum" if name == "mapwright" else self.folder / f"{name.replace(':', '_')}.tum"

    def run(self):
        """All of them once."""
        clouds = len(list((self.folder / "velodyne").glob("*.bin")))
        command = ["map", self.folder, "-o", self.results, "--threads", "1", "--quiet"]
        _, cpu_s, _ = measured([self.binaries / "mapwright", *command])
        self.cpu_s["mapwright"].append(cpu_s / clouds)
        stamps = self.folder / "stamps.txt"
        rows = self.trajectory("mapwright").read_text().splitlines()
        stamps.write_text("\n".join(row.split()[0] for row in rows))
        for name in self.peers:
            own = ["--peer", name, self.folder / "velodyne", stamps, self.trajectory(name)]
            said, _, _ = measured([sys.executable, __file__, *own])
            self.cpu_s[name].append(float(said.split()[-1]))

    def ms(self, name):
        return 1e3 * statistics.median(self.cpu_s[name])

    def errors(self, name, reference):
        return evaluated(self.binaries, self.trajectory(name), "--reference", reference)

    def revisits(self, trajectory):
        own = ["--trajectory", trajectory]
        return evaluated(self.binaries, self.results, "--revisits", *REVISITS, *own)


def scan_graph(folder, poses, path):
    """OctoMap's binary graph of scans: of each the points, its pose (position, quaternion w x y z) and its number; no edges."""
    import numpy

    clouds, rows = clouds_of(folder), [row.split() for row in poses.read_text().splitlines() if not row.startswith("#")]
    vector = lambda values: numpy.uint32(len(values)).tobytes() + numpy.array(values, numpy.float64).tobytes()
    with path.open("wb") as graph:
        graph.write(numpy.uint32(len(clouds)).tobytes())
        for number, (points, row) in enumerate(zip(clouds, rows, strict=True)):
            packed = numpy.empty(len(points), numpy.dtype([("size", "<u4"), ("at", "<f8", 3)]))
            packed["size"], packed["at"] = 3, points
            x, y, z, qx, qy, qz, qw = (float(value) for value in row[1:8])
            graph.write(numpy.uint32(len(points)).tobytes() + packed.tobytes())
            graph.write(vector([x, y, z]) + vector([qw, qx, qy, qz]) + numpy.uint32(number).tobytes())
        graph.write(numpy.uint32(0).tobytes())


def occupancy_rows(binaries, folder, poses):
    """CPU seconds, MB and bytes of the octree of both."""
    trees = {name: WORK / f"hall_{name}.bt" for name in ("mapwright", "octomap")}
    own = [folder / "velodyne", poses, RESOLUTION_M, OCCUPANCY_RANGE_M, trees["mapwright"]]
    runs = [measured([binaries / "examples/occupancy", *own]) for _ in range(ROUNDS)]
    cost = {"mapwright": [statistics.median(run[k] for run in runs) for k in (1, 2)]}
    graph = WORK / "hall.graph"
    scan_graph(folder / "velodyne", poses, graph)
    arguments = ["-i", graph, "-o", trees["octomap"], "-res", RESOLUTION_M, "-m", OCCUPANCY_RANGE_M, "-discretize"]
    try:
        cost["octomap"] = measured(["graph2tree", *arguments])[1:]
    except FileNotFoundError:
        print("graph2tree is not installed (apt-get install octomap-tools): OctoMap left out")
    rows = []
    for name, (cpu_s, peak_mb) in cost.items():
        rows.append(["hall, occupancy at 10 cm", name, f"{cpu_s:.2f} s CPU, {peak_mb:.0f} MB, {trees[name].stat().st_size:,} bytes"])
    return rows


def odometry_rows(binaries, data, reference):
    hall = {every: Compared(binaries, recording("hall", reference.parent, every), PEERS) for every in (1, 2, 3)}
    kitti = Compared(binaries, recording("kitti", data / "3d_kitti00_first16"), ["kiss-icp:100", "small_gicp"])
    for _ in range(ROUNDS):
        for compared in [*hall.values(), kitti]:
            compared.run()
    return hall_rows(hall, reference) + revisit_rows(hall[1], reference) + kitti_rows(kitti)


def hall_rows(hall, reference):
    rows = []
    for every, compared in hall.items():
        which = {1: "every cloud", 2: "every 2nd", 3: "every 3rd"}[every]
        for name in compared.cpu_s:
            errors = compared.errors(name, reference)
            ate, rpe = (errors[what]["translation_m"] for what in ("ate", "rpe"))
            found = f"ATE {ate['rmse']:.4f} m, RPE {rpe['rmse']:.4f} m (median {rpe['median']:.4f})"
            rows.append([f"hall, {which}", name, f"{found}, {compared.ms(name):.1f} ms"])
    return rows


def revisit_rows(compared, reference):
    rows = []
    judged = {name: compared.trajectory(name) for name in compared.cpu_s} | {"reference": reference}
    for name, trajectory in judged.items():
        asked = compared.revisits(trajectory)
        found = f"{asked['pairs']} pairs, {asked['not_fitting'] + asked['loose']} not registered"
        if asked["corrections"]:
            moved, turned = (asked["corrections"][what]["median"] for what in ("translation_m", "rotation_deg"))
            found = f"{moved:.4f} m, {turned:.3f} deg, 90 % within {asked['percentile_90_m']:.4f} m ({found})"
        rows.append(["hall, median correction of revisits", name, found])
    return rows


def kitti_rows(compared):
    rows, kiss = [], "kiss-icp:100"
    for name in compared.cpu_s:
        rpe = compared.errors(name, compared.trajectory(kiss))["rpe"]["translation_m"]
        steps = "" if name == kiss else f"steps {rpe['rmse']:.4f} m rms from kiss-icp's, "
        rows.append(["KITTI 00, 0 to 15", name, f"{steps}{compared.ms(name):.1f} ms"])
    return rows


def main(binaries, data, part="all"):
    binaries, data = Path(binaries), Path(data)
    reference = data / "3d_os0_hall/poses_tum.txt"
    needed = [binaries / "mapwright", reference] + ([] if part == "odometry" else [binaries / "examples/occupancy"])
    missing = [str(path) for path in needed if not path.exists()]
    if missing:
        sys.exit(f"{', '.join(missing)}: not there; how they are made stands at the top of {__file__}")
    rows = []
    if part in ("all", "odometry"):
        rows += odometry_rows(binaries, data, reference)
    if part in ("all", "occupancy"):
        rows += occupancy_rows(binaries, recording("hall", reference.parent), reference)
    print("| data | tool | result |\n|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--peer"]:
        run_peer(*sys.argv[2:])
    elif len(sys.argv) not in (3, 4) or sys.argv[3:] not in ([], ["odometry"], ["occupancy"]):
        sys.exit(__doc__)
    else:
        WORK.mkdir(parents=True, exist_ok=True)
        interpreter = python()
        if Path(interpreter) != Path(sys.executable):
            os.execv(interpreter, [interpreter, *sys.argv])
        main(*sys.argv[1:])
