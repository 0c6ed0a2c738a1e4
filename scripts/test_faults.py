"""Tests of the scripts that put faults into logs. From the repository's root:

    python3 -m unittest discover --start-directory scripts
"""

import bz2
import math
import random
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import random_faults as faults
import space_faults

BEAMS = 8


def small_log(folder, scans=200):
    """A drive along an arc, as a CARMEN log that was read."""
    lines = ["PARAM robot_frontlaser_offset 0.1 nohost 0\n"]
    for k in range(scans):
        angle = 0.01 * k
        pose = f"{10 * math.sin(angle):.6f} {10 * (1 - math.cos(angle)):.6f} {angle:.6f}"
        ranges = " ".join(f"{3 + 0.1 * ((k + beam) % 7):.2f}" for beam in range(BEAMS))
        lines.append(f"ODOM {pose} 0 0 0 {1000 + k - 0.4:.6f} nohost 0\n")
        lines.append(f"FLASER {BEAMS} {ranges} {pose} {pose} {1000 + k:.6f} nohost 0\n")
    path = Path(folder) / "small.clf.bz2"
    path.write_bytes(bz2.compress("".join(lines).encode()))
    return faults.carmen(path, "small")


class RandomFaults(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.log = small_log(folder.name)

    def test_what_is_written_without_faults_is_what_was_read(self):
        path, scans = faults.write(self.log.copy(), self.folder, random.Random(1))
        (self.folder / "again.clf.bz2").write_bytes(bz2.compress(path.read_bytes()))
        again = faults.carmen(self.folder / "again.clf.bz2", "again")
        self.assertEqual(len(scans), 200)
        self.assertEqual([event.stamp_ns for event in again.events], [event.stamp_ns for event in self.log.events])
        self.assertEqual([event.ranges for event in again.events], [event.ranges for event in self.log.events])
        self.assertEqual(again.laser.mount, self.log.laser.mount)
        for one, other in zip(again.events, self.log.events):
            self.assertLess(math.dist(one.pose, other.pose), 1e-5)

    def test_every_fault_changes_the_file_and_says_what_it_did(self):
        clean = faults.write(self.log.copy(), self.folder, random.Random(1))[0].read_bytes()
        for fault in faults.FAULTS:
            changed = False
            for seed in range(20):
                log = self.log.copy()
                words = fault(log, random.Random(seed))
                self.assertTrue(words, fault.__name__)
                path, scans = faults.write(log, self.folder, random.Random(seed))
                changed |= path.read_bytes() != clean
                self.assertLessEqual(len({event.truth_ns for event in scans} - {None}), 200)
            self.assertTrue(changed, fault.__name__)

    def test_faults_are_the_same_for_a_seed(self):
        drawn = [[fault.__name__ for fault in faults.drawn(random.Random(seed))] for seed in (3, 3, 4)]
        self.assertEqual(drawn[0], drawn[1])
        for seed in range(200):
            names = faults.drawn(random.Random(seed))
            self.assertTrue(len(names) <= faults.MOST_FAULTS)
            self.assertFalse(set(names) & faults.WITHOUT_ODOMETRY and set(names) & set(faults.NEED_ODOMETRY))

    def test_poses_are_told_by_their_stamps_whatever_their_order(self):
        scans = self.log.copy().scans()[:4]
        for scan, truth_ns in zip(scans, (10, 20, 30, 40)):
            scan.truth_ns = truth_ns
        row = lambda scan, rest: (scan.stamp_ns, rest)
        rows = [row(scans[2], "c"), row(scans[0], "a"), row(scans[1], "b"), row(scans[3], "d")]
        self.assertEqual(faults.by_truth(rows, scans), [(30, "c"), (10, "a"), (20, "b"), (40, "d")])
        # one that has no pose
        self.assertEqual(faults.by_truth(rows[1:], scans), [(10, "a"), (20, "b"), (40, "d")])
        # stamps that repeat count in their order
        scans[1].stamp_ns = scans[0].stamp_ns
        rows = [row(scan, rest) for scan, rest in zip(scans, "abcd")]
        self.assertEqual([truth_ns for truth_ns, _ in faults.by_truth(rows, scans)], [10, 20, 30, 40])
        # stamps that were not kept: scan by scan
        rows = [(5 * faults.SECOND + k, rest) for k, rest in enumerate("abcd")]
        self.assertEqual([truth_ns for truth_ns, _ in faults.by_truth(rows, scans)], [10, 20, 30, 40])


class SpaceFaults(unittest.TestCase):
    def test_every_selection_keeps_some_clouds_in_their_order(self):
        selections = [(name, list(kept)) for name, kept in space_faults.variants(85)]
        self.assertEqual(selections[0], ("all", list(range(85))))
        self.assertEqual(len({name for name, _ in selections}), len(selections))
        for name, kept in selections:
            self.assertEqual(kept, sorted(set(kept)), name)
            self.assertTrue(6 < len(kept) <= 85 and kept[-1] < 85, name)


if __name__ == "__main__":
    unittest.main()
