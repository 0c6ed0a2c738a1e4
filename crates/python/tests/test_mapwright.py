"""The installed wheel: `python -m unittest discover crates/python/tests`.

MAPWRIGHT_COMMAND names the binary of the command, whose files are compared with; without it the wheel's own command is.
"""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import numpy as np

import mapwright as mw
import simulated

NOTEBOOK = pathlib.Path(__file__).parent.parent / "examples" / "first_map.ipynb"
DOCS = pathlib.Path(__file__).parents[3] / "docs" / "python.md"
PLANE = dict(range_max=simulated.RANGE_MAX, angle_min=simulated.ANGLE_MIN, angle_increment=simulated.ANGLE_STEP)
SAME_BYTES = ["session.mapwright", "trajectory.tum", "trajectory_online.tum", "graph.g2o", "report.json", "map.png"]


def command():
    binary = os.environ.get("MAPWRIGHT_COMMAND")
    return [binary] if binary else [sys.executable, "-m", "mapwright"]


class InFolder(unittest.TestCase):
    """Tests with a folder, a log of the plane and a recording of space."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="mapwright-test-"))
        cls.log = cls.folder / "room.clf"
        simulated.write_carmen(cls.log)
        cls.clouds = cls.folder / "hall"
        simulated.write_plys(cls.clouds)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)


@contextlib.contextmanager
def counting():
    """How far another thread of Python has counted."""
    count, is_over = [0], threading.Event()

    def run():
        while not is_over.is_set():
            count[0] += 1

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield lambda: count[0]
    finally:
        is_over.set()
        thread.join()


class Map(InFolder):
    def same_as_command(self, log, names, words=(), **how):
        out = self.folder / f"command-{log.name}"
        said = subprocess.run([*command(), "map", *words, "-o", str(out), str(log)], capture_output=True, text=True)
        self.assertIn(said.returncode, (0, 3), said.stderr)
        run = mw.map(log, self.folder / f"python-{log.name}", **how)
        for name in names:
            self.assertEqual((out / name).read_bytes(), (run.folder / name).read_bytes(), name)
        return run

    def test_same_bytes_as_the_command_in_the_plane(self):
        names = [*SAME_BYTES, "map.pgm", "map.yaml", "closures.json"]
        run = self.same_as_command(self.log, names)
        self.assertEqual(run.folder, self.folder / "python-room.clf")
        self.assertEqual(sorted(path.name for path in run.folder.iterdir() if path.name.endswith(".part")), [])

    def test_same_bytes_as_the_command_with_settings(self):
        words = ["--set", "map.resolution_m=0.1", "--set", "live.policy=everything", "--no-odometry"]
        how = dict(map_resolution_m=0.1, odometry=False, **{"live.policy": "everything"})
        run = self.same_as_command(self.log, SAME_BYTES, words, **how)
        self.assertEqual(run.grid.resolution, 0.1)

    def test_same_bytes_as_the_command_in_space(self):
        run = self.same_as_command(self.clouds, [*SAME_BYTES, "map.ply"], threads=2)
        self.assertEqual(run.trajectory.shape, (30, 8))
        np.testing.assert_allclose(np.linalg.norm(run.trajectory[:, 4:], axis=1), 1)
        self.assertAlmostEqual(run.trajectory[-1, 1], np.hypot(29 * 0.15, 29 * 0.03), delta=0.15)
        self.assertEqual((run.points.shape[1], run.points.dtype), (3, np.float32))
        self.assertGreater(len(run.points), 1000)
        with self.assertRaisesRegex(mw.Error, "of space"):
            run.grid

    def test_what_a_run_says(self):
        run = mw.map(str(self.log))
        self.assertEqual(run.trajectory.shape, (150, 4))
        self.assertEqual((run.trajectory.dtype, run.stamps.dtype), (np.float64, np.int64))
        np.testing.assert_allclose(run.stamps * 1e-9, run.trajectory[:, 0])
        tum = np.loadtxt(run.folder / "trajectory.tum")
        np.testing.assert_allclose(run.trajectory[:, :3], tum[:, :3], atol=1e-5)
        self.assertEqual(run.report, json.loads((run.folder / "report.json").read_text()))
        self.assertIn(run.verdict, ("good", "check", "unusable"))
        self.assertIsInstance(run.warnings, list)
        grid = run.grid
        self.assertEqual((grid.cells.dtype, grid.resolution), (np.int8, 0.05))
        self.assertEqual(set(np.unique(grid.cells)), {-1, 0, 100})
        self.assertTrue(9 < (grid.cells.shape[1] * 0.05) < 16 and len(grid.origin) == 3)
        with self.assertRaisesRegex(mw.Error, "of the plane"):
            run.points
        saved = run.save(self.folder / "saved")
        self.assertEqual(mw.Run(saved).verdict, run.verdict)
        self.assertIn("150 scans", repr(run))
        folder = run.folder
        del run, grid
        self.assertFalse(folder.exists(), "a temporary folder goes with its object")
        self.assertTrue((saved / "map.png").exists())

    def test_losses_are_warnings(self):
        torn = self.folder / "torn.clf"
        torn.write_text(self.log.read_text() + "FLASER 181 1.0 2.0\nFLASER x\n")
        run = mw.map(torn)
        self.assertTrue(any("dropped" in warning or "ends" in warning for warning in run.warnings), run.warnings)

    def test_several_logs_and_options(self):
        lines = self.log.read_text().splitlines(keepends=True)
        first, second = self.folder / "first.clf", self.folder / "second.clf"
        first.write_text("".join(lines[:101]))
        second.write_text("".join(lines[:1] + lines[101:]))
        run = mw.map([first, str(second)], options=["--stamps", "repaired"])
        self.assertEqual(len(run.trajectory), 150)
        with self.assertRaisesRegex(mw.Error, "cannot follow"):
            mw.map([second, first])
        run = mw.map(self.log, start=(1.0, -2.0, 0.5))
        np.testing.assert_allclose(run.trajectory[0, 1:], [1.0, -2.0, 0.5])

    def test_failures_have_the_commands_words(self):
        empty = self.folder / "empty.clf"
        empty.write_bytes(b"")
        noise = self.folder / "noise.bin"
        noise.write_bytes(bytes(np.random.default_rng(3).integers(0, 256, 10_000, dtype=np.uint8)))
        for log, words in [("nowhere.bag", "nowhere.bag"), (empty, "empty.clf"), (noise, "noise.bin")]:
            with self.assertRaises(mw.Error) as failed:
                mw.map(log)
            self.assertIn(words, str(failed.exception))
        said = subprocess.run([*command(), "map", str(empty)], capture_output=True, text=True, cwd=self.folder)
        with self.assertRaises(mw.Error) as failed:
            mw.map(empty)
        self.assertEqual(f"mapwright: {failed.exception}", said.stderr.strip())
        for kind, how in [
            (ValueError, dict(map_resolution_m=99)),
            (ValueError, dict(no_such_setting=1)),
            (ValueError, dict(map_resolution_m="wide")),
            (TypeError, dict(map_resolution_m=[1])),
            (ValueError, dict(options=["--no-such-option"])),
            (TypeError, dict(options="--space")),
            (ValueError, dict(threads=0)),
            (ValueError, dict(start=(1, 2))),
            (TypeError, dict(output=3)),
        ]:
            with self.assertRaises(kind, msg=str(how)):
                mw.map(self.log, **how)
        for logs in (3, [3], None):
            with self.assertRaises(TypeError):
                mw.map(logs)
        for logs in ([], ""):
            with self.assertRaises(ValueError):
                mw.map(logs)
        with self.assertRaises((mw.Error, ValueError)):
            mw.map("nul\0byte.bag")
        with self.assertRaises(mw.Error):
            mw.map(self.log, self.log)
        with self.assertRaises(mw.Error):
            mw.Run(self.folder)
        self.assertTrue(issubclass(mw.Error, RuntimeError))

    def test_other_threads_run_while_mapping(self):
        with counting() as count:
            before = count()
            mw.map(self.log)
            self.assertGreater(count() - before, 10_000)

    def test_ctrl_c(self):
        long = self.folder / "long.clf"
        simulated.write_carmen(long, scans=6000, rounds=50)
        before = signal.getsignal(signal.SIGINT)
        started = time.monotonic()
        timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            mw.map(long, self.folder / "cut")
        cut_s = time.monotonic() - started
        self.assertIn("interrupted", " ".join(mw.Run(self.folder / "cut").warnings))
        self.assertLess(len(mw.Run(self.folder / "cut").trajectory), 6000, f"cut after {cut_s} s")
        # Python's own handler is still there
        self.assertEqual(signal.getsignal(signal.SIGINT), before)
        with self.assertRaises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1)

    def test_the_command_is_installed(self):
        script = shutil.which("mapwright", path=str(pathlib.Path(sys.executable).parent))
        for words in ([script], [sys.executable, "-m", "mapwright"]):
            said = subprocess.run([*words, "--version"], capture_output=True, text=True)
            self.assertEqual((said.returncode, said.stdout.split()[0]), (0, "mapwright"), said.stderr)
            said = subprocess.run([*words, "map", "nowhere.bag"], capture_output=True, text=True)
            self.assertEqual(said.returncode, 1)
            self.assertIn("nowhere.bag", said.stderr)
        self.assertEqual(mw.main(["map", "--no-such-option"]), 2)


class Plane(InFolder):
    def mapped(self, scans=60, rounds=1.2, **how):
        mapper = mw.Mapper2(**{**PLANE, **how})
        updates = [mapper.add_scan(t, ranges, odom) for t, ranges, _, odom in simulated.drive(scans, rounds)]
        return mapper, updates

    def test_one_scan_at_a_time(self):
        mapper, updates = self.mapped(150)
        first, last = updates[0], updates[-1]
        self.assertEqual((first.keyframe, first.status, first.scan, last.scan), (0, "tracking", 0, 149))
        np.testing.assert_array_equal(first.pose, [0, 0, 0])
        self.assertEqual((last.covariance.shape, last.pose.shape, last.pose.dtype), ((3, 3), (3,), np.float64))
        np.testing.assert_allclose(last.covariance, last.covariance.T, atol=1e-12)
        self.assertTrue((np.linalg.eigvalsh(last.covariance) > 0).all())
        self.assertIsNone(last.refused)
        # Against the truth, in the frame of the first pose, after odometry that is 2 % long and turns 1 % too far.
        truth = [pose for _, _, pose, _ in simulated.drive(150)]
        c, s = np.cos(truth[0][2]), np.sin(truth[0][2])
        moved = truth[-1][:2] - truth[0][:2]
        there = [c * moved[0] + s * moved[1], -s * moved[0] + c * moved[1]]
        np.testing.assert_allclose(last.pose[:2], there, atol=0.05)
        trajectory = mapper.trajectory()
        self.assertEqual(trajectory.shape, (150, 4))
        np.testing.assert_allclose(trajectory[:, 0], mapper.stamps() * 1e-9)
        np.testing.assert_array_equal(mapper.trajectory()[-1, 1:], last.pose)
        self.assertIn("150 scans", repr(mapper))
        self.assertIn("tracking", repr(last))

    def test_closures_are_told(self):
        # without a local map that reaches back, coming round is a loop to be closed
        mapper, updates = self.mapped(300, rounds=2.2, live_gate_m=0.005)
        updates.append(mapper.finish())
        closures = [closure for update in updates for closure in update.closures]
        self.assertTrue(closures)
        self.assertTrue(any(update.moved for update in updates))
        for closure in closures:
            self.assertLess(closure.earlier, closure.later)
            self.assertEqual(closure.earlier_from_later.shape, (3,))

    def test_the_same_poses_as_the_command(self):
        run = mw.map(self.log)
        mapper = mw.Mapper2(**PLANE)
        for line in self.log.read_text().splitlines()[1:]:
            words = line.split()
            ranges, rest = np.array(words[2:183], dtype=np.float32), [float(word) for word in words[183:190]]
            mapper.add_scan(rest[6], ranges, rest[3:6])
        mapper.finish()
        np.testing.assert_allclose(mapper.trajectory(), run.trajectory, atol=0.02)

    def test_saved_and_gone_on_with(self):
        whole, _ = self.mapped(80)
        first, _ = self.mapped(50)
        first.save(self.folder / "half")
        second = mw.Mapper2(resume=self.folder / "half", **PLANE)
        for t, ranges, _, odom in list(simulated.drive(80))[50:]:
            # the whole drive is another one in 80 scans than in 50, and a mapper only asks for scans
            second.add_scan(t, ranges, odom)
        self.assertEqual(len(second.trajectory()), 80)
        saved = mw.Run(self.folder / "half")
        np.testing.assert_array_equal(saved.trajectory, first.trajectory())
        np.testing.assert_array_equal(saved.grid.cells, first.grid().cells)
        self.assertEqual(saved.grid.origin, first.grid().origin)
        self.assertTrue((saved.folder / "map.png").exists() and (saved.folder / "graph.g2o").exists())
        with self.assertRaisesRegex(mw.Error, "report"):
            saved.verdict
        said = subprocess.run([*command(), "explain", str(saved.folder)], capture_output=True, text=True)
        self.assertIn(said.returncode, (0, 3), said.stderr)
        with self.assertRaises(ValueError):
            mw.Mapper3(resume=self.folder / "half")
        with self.assertRaises(mw.Error):
            mw.Mapper2(resume=self.folder / "nowhere", **PLANE)

    def test_gone_on_with_to_the_same_bits(self):
        scans = list(simulated.drive(80))
        whole = mw.Mapper2(**PLANE)
        for t, ranges, _, odom in scans:
            whole.add_scan(t, ranges, odom)
        first = mw.Mapper2(**PLANE)
        for t, ranges, _, odom in scans[:50]:
            first.add_scan(t, ranges, odom)
        first.save(self.folder / "first")
        second = mw.Mapper2(resume=self.folder / "first", **PLANE)
        for t, ranges, _, odom in scans[50:]:
            second.add_scan(t, ranges, odom)
        np.testing.assert_array_equal(second.trajectory(), whole.trajectory())

    def test_layouts_of_arrays(self):
        ranges = next(simulated.drive(1))[1]
        single = ranges.astype(np.float32)
        twice = np.repeat(single, 2)
        layouts = [
            single,
            single.astype(np.float64),
            single.astype(">f4"),
            single.tolist(),
            tuple(single.tolist()),
            twice[::2],
            np.stack([single, single], axis=1)[:, 0],
            np.flip(np.flip(single)),
            np.ma.masked_array(single),
        ]
        unaligned = np.frombuffer(b"x" + single.tobytes(), dtype=np.uint8)[1:].view(np.float32)
        layouts.append(unaligned)
        read_only = single.copy()
        read_only.flags.writeable = False
        layouts.append(read_only)
        poses = []
        for layout in layouts:
            mapper = mw.Mapper2(**PLANE)
            mapper.add_scan(0.0, layout)
            mapper.add_scan(0.1, layout)
            poses.append(mapper.grid().cells)
        for cells in poses[1:]:
            np.testing.assert_array_equal(cells, poses[0])
        mapper = mw.Mapper2(**PLANE)
        for kind in (np.int32, np.uint8, np.float16, np.longdouble):
            mapper.add_scan(1.0, ranges.astype(kind))

    def test_wrong_arguments_are_refused_in_words(self):
        mapper = mw.Mapper2(**PLANE)
        good = np.full(181, 2.0)
        for kind, ranges, words in [
            (TypeError, None, "expected ranges.*found NoneType"),
            (TypeError, "abc", "expected ranges.*found str"),
            (TypeError, object(), "expected ranges.*found object"),
            (TypeError, np.array([True]), "bool"),
            (TypeError, np.array([1j]), "complex"),
            (TypeError, np.array(["2020-01-01"], dtype="datetime64[s]"), "datetime64"),
            (TypeError, {"a": 1}, "found dict"),
            (ValueError, [[1.0], [2.0, 3.0]], "expected ranges"),
            (ValueError, np.zeros((3, 4)), r"one row of numbers, found an array of shape \(3, 4\)"),
            (ValueError, 1.0, r"shape \(\)"),
        ]:
            with self.assertRaisesRegex(kind, words):
                mapper.add_scan(0.0, ranges)
        for t in (float("nan"), float("inf"), -1e300, 1e10):
            with self.assertRaisesRegex(ValueError, "time in seconds"):
                mapper.add_scan(t, good)
        for t in (None, "now", [1]):
            with self.assertRaises(TypeError):
                mapper.add_scan(t, good)
        for odom in ((1, 2), (1, 2, 3, 4), (np.nan, 0, 0), (0, np.inf, 0), [[1, 2, 3]], 5):
            with self.assertRaisesRegex(ValueError, "expected odom as x, y and yaw"):
                mapper.add_scan(0.0, good, odom)
            with self.assertRaisesRegex(ValueError, "expected odom as x, y and yaw"):
                mapper.add_odometry(0.0, odom)
        with self.assertRaisesRegex(TypeError, "expected odom"):
            mapper.add_scan(0.0, good, "home")
        for how in (dict(angle_min=np.nan), dict(angle_increment=np.inf), dict(angle_increment=1e6), dict(mount=(1e9, 0, 0))):
            with self.assertRaises(ValueError):
                mapper.add_scan(0.0, good, **how)
        with self.assertRaisesRegex(ValueError, "angle_min"):
            mw.Mapper2(range_max=10.0).add_scan(0.0, good)
        for how in (
            dict(range_max=np.nan),
            dict(mount=(1, 2)),
            dict(time_increment=np.nan),
            dict(loops_jobs="handed-out"),
            dict(map_resolution_m=-1),
            dict(map_resolution_m=np.nan),
            dict(keyframes_distance=1),
            dict(nothing=1),
        ):
            with self.assertRaises(ValueError, msg=str(how)):
                mw.Mapper2(**{**PLANE, **how})
        self.assertEqual(len(mapper.trajectory()), 0)
        self.assertEqual(mapper.grid().cells.size, 1)

    def test_settings_of_numpys_types(self):
        mapper = mw.Mapper2(map_passes_per_hit=np.int64(4), map_resolution_m=np.float32(0.125), motion_use_odometry=True, **PLANE)
        mapper.add_scan(0, np.full(181, 2.0))
        self.assertEqual(mapper.grid().resolution, 0.125)

    def test_any_numbers_are_survived(self):
        random = np.random.default_rng(5)
        odd = np.array([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-30, 1e30, 1e300, 29.9, 30.0, 1e9, 2.0])
        for scans in range(6):
            mapper = mw.Mapper2(**{**PLANE, "range_max": [30.0, np.inf, 0.0, -5.0, 1e9, 1e300][scans]})
            t = 0.0
            for _ in range(60):
                beams = random.choice([0, 1, 2, 181, 181, 181, 500])
                ranges = np.where(random.random(beams) < 0.5, random.choice(odd, beams), random.random(beams) * 5)
                odom = random.choice([0.0, 1.0, -1.0, 1e5, 1e7, 1e300, -1e308, 1e-300], 3) if random.random() < 0.5 else None
                t += random.choice([0.0, 0.1, 0.1, -1.0, 50.0, 1e6, -9e9 - t, 9e9 - t])
                update = mapper.add_scan(t, ranges, odom, angle_increment=random.choice([simulated.ANGLE_STEP, 0.0, -0.01, 0.1]))
                self.assertIn(update.status, ("tracking", "degraded", "lost"))
                self.assertTrue(np.isfinite(update.pose).all())
            mapper.finish()
            mapper.trajectory()
            mapper.grid()
        mapper.save(self.folder / "odd")
        self.assertEqual(len(mw.Run(self.folder / "odd").trajectory), 60)

    def test_several_lasers(self):
        mapper = mw.Mapper2(range_max=30.0)
        for t, ranges, _, odom in simulated.drive(20):
            how = dict(angle_min=simulated.ANGLE_MIN, angle_increment=simulated.ANGLE_STEP)
            mapper.add_scan(t, ranges, odom, laser="front", **how)
            mapper.add_odometry(t + 0.05, odom)
            mapper.add_scan(t + 0.1, ranges, odom, laser="rear", mount=(-0.3, 0, np.pi), **how)
        self.assertEqual(len(mapper.trajectory()), 40)

    def test_threads_share_a_mapper(self):
        mapper, scans = mw.Mapper2(**PLANE), list(simulated.drive(120))

        def run(part):
            for t, ranges, _, odom in part:
                mapper.add_scan(t, ranges, odom)

        threads = [threading.Thread(target=run, args=(scans[k::4],)) for k in range(4)]
        with counting() as count:
            before = count()
            [thread.start() for thread in threads]
            [thread.join() for thread in threads]
            self.assertGreater(count() - before, 1000)
        self.assertEqual(len(mapper.trajectory()), 120)

    def test_other_threads_run_during_one_call(self):
        mapper, _ = self.mapped(150)
        with counting() as count:
            before = count()
            mapper.save(self.folder / "counted")
            self.assertGreater(count() - before, 1000)


class Space(InFolder):
    def mapped(self, count=30, **how):
        mapper = mw.Mapper3(**how)
        updates = [mapper.add_cloud(t, points) for t, points, _ in simulated.clouds(count)]
        return mapper, updates

    def test_one_cloud_at_a_time(self):
        mapper, updates = self.mapped()
        last = updates[-1]
        self.assertEqual((last.pose.shape, last.covariance.shape), ((7,), (6, 6)))
        self.assertTrue((np.linalg.eigvalsh(last.covariance) > 0).all())
        np.testing.assert_allclose(last.pose[:3], [29 * 0.15, 29 * 0.03, 0], atol=0.1)
        self.assertEqual(mapper.trajectory().shape, (30, 8))
        points = mapper.points()
        self.assertEqual((points.shape[1], points.dtype), (3, np.float32))
        self.assertAlmostEqual(float(points[:, 2].min()), -1.2, delta=0.2)
        mapper.finish()
        mapper.save(self.folder / "space")
        saved = mw.Run(self.folder / "space")
        np.testing.assert_array_equal(saved.trajectory, mapper.trajectory())
        np.testing.assert_array_equal(saved.points, mapper.points())
        more = mw.Mapper3(resume=self.folder / "space")
        more.add_cloud(3.0, list(simulated.clouds(31))[-1][1])
        self.assertEqual(len(more.trajectory()), 31)
        with self.assertRaises(ValueError):
            mw.Mapper2(resume=self.folder / "space")

    def test_inertial_readings_and_times(self):
        mapper = mw.Mapper3(range_max=50.0, mount=(0, 0, 1, 0, 0, 0, 1))
        for t, points, _ in simulated.clouds(8):
            for k in range(10):
                self.assertEqual(mapper.add_imu(t + 0.01 * k, (0, 0, 0.2), [0, 0, 9.81]), "kept")
            times = np.linspace(0, 0.09, len(points))
            update = mapper.add_cloud(t, points, times, odom=(0.15 * t, 0, 0, 0, 0, 0, 1))
        self.assertEqual(update.scan, 7)
        self.assertEqual(mapper.add_imu(1.0, (np.nan, 0, 0)), "unsound")
        self.assertEqual(mapper.add_imu(1.0, (0, 0, 0), (1e9, 0, 0)), "unsound")

    def test_layouts_of_points(self):
        points = next(simulated.clouds(1))[1]
        wide = np.zeros((len(points), 5), dtype=np.float32)
        wide[:, 1:4] = points
        for layout in (np.asfortranarray(points), wide[:, 1:4], points.astype(">f8"), points.tolist(), points[::1]):
            mapper = mw.Mapper3()
            mapper.add_cloud(0.0, layout)
            np.testing.assert_allclose(np.sort(mapper.points(), axis=0), np.sort(self.once(points), axis=0), atol=1e-5)

    def once(self, points):
        mapper = mw.Mapper3()
        mapper.add_cloud(0.0, points)
        return mapper.points()

    def test_wrong_arguments_are_refused_in_words(self):
        mapper = mw.Mapper3()
        for kind, points, words in [
            (TypeError, None, "expected points.*NoneType"),
            (TypeError, "abc", "found str"),
            (ValueError, np.zeros((4, 2)), r"N rows of x, y and z, found an array of shape \(4, 2\)"),
            (ValueError, np.zeros((4, 4)), r"shape \(4, 4\)"),
            (ValueError, np.zeros(12), r"shape \(12,\)"),
            (ValueError, np.zeros((2, 2, 3)), "shape"),
        ]:
            with self.assertRaisesRegex(kind, words):
                mapper.add_cloud(0.0, points)
        with self.assertRaisesRegex(ValueError, "a time for each of 4 points, found 3"):
            mapper.add_cloud(0.0, np.zeros((4, 3)), [1, 2, 3])
        with self.assertRaisesRegex(ValueError, "quaternion of length zero"):
            mapper.add_cloud(0.0, np.zeros((4, 3)), odom=(0, 0, 0, 0, 0, 0, 0))
        for gyro in ((1, 2), None, "abc", [[1, 2, 3]]):
            with self.assertRaises((TypeError, ValueError)):
                mapper.add_imu(0.0, gyro)
        for how in (dict(sensor="radar"), dict(range_max=np.nan), dict(range_sigma=-1.0), dict(mount=(0, 0, 0)), dict(space_resolution_m=99)):
            with self.assertRaises(ValueError, msg=str(how)):
                mw.Mapper3(**how)

    def test_any_numbers_are_survived(self):
        random = np.random.default_rng(6)
        odd = np.array([np.nan, np.inf, -np.inf, 0.0, 1e-30, 1e30, 1e300, 5.0, -3.0], dtype=np.float64)
        base = next(simulated.clouds(1))[1].astype(float)
        mapper, t = mw.Mapper3(), 0.0
        for _ in range(25):
            count = random.choice([0, 1, 99, 100, len(base)])
            points = base[:count].copy()
            is_odd = random.random(points.shape) < random.choice([0.0, 0.1, 1.0])
            points[is_odd] = random.choice(odd, is_odd.sum())
            times = random.choice(odd, count) if random.random() < 0.3 else None
            odom = [*random.choice([0.0, 1e300, -1e7, 2.0], 3), 0, 0, 0, random.choice([1.0, 1e300, 1e-3])] if random.random() < 0.3 else None
            t += random.choice([0.1, 0.0, -1.0, 100.0, 9e9 - t])
            mapper.add_imu(t, random.choice(odd, 3), random.choice(odd, 3))
            try:
                update = mapper.add_cloud(t, points, times, odom=odom)
                self.assertTrue(np.isfinite(update.pose).all())
            except ValueError as refused:  # a quaternion too long to be one
                self.assertIn("quaternion", str(refused))
        mapper.add_cloud(1.0, [])
        mapper.finish()
        mapper.points()
        mapper.save(self.folder / "odd-space")


class Docs(unittest.TestCase):
    def test_examples_run(self):
        if not DOCS.exists():
            self.skipTest("not in a checkout")
        examples = [part.split("```")[0] for part in DOCS.read_text().split("```python\n")[1:]]
        self.assertEqual(len(examples), 3)
        # the first one is of somebody's log
        for program in examples[1:]:
            said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
            self.assertEqual(said.returncode, 0, said.stderr)

    def test_stubs_name_what_there_is(self):
        stubs = pathlib.Path(mw.__file__).with_name("_mapwright.pyi").read_text()
        for kind in (mw.Mapper2, mw.Mapper3, mw.Update, mw.Closure, mw.Grid):
            self.assertTrue(kind.__doc__)
            told = stubs.split(f"class {kind.__name__}:")[1].split("\nclass ")[0]
            for name in (name for name in vars(kind) if not name.startswith("__")):
                self.assertIn(f"def {name}(", told, kind)
                self.assertTrue(getattr(kind, name).__doc__, name)
        self.assertTrue(pathlib.Path(mw.__file__).with_name("py.typed").exists())


class Notebook(unittest.TestCase):
    def test_its_cells_run(self):
        cells = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
        program = "\n\n".join("".join(cell["source"]) for cell in cells)
        with tempfile.TemporaryDirectory() as folder:
            said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=folder)
        self.assertEqual(said.returncode, 0, said.stderr)


if __name__ == "__main__":
    unittest.main()
