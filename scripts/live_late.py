"""How long nodes of ROS 2 that come later wait for a map that is kept for them; for docs/decisions/0049-live.md.

    python scripts/live_late.py COMMAND...

Starts the command, which tells a map on /map (such as `target/release/examples/latched 4`), and then five processes with rclpy one after the other, each
of which joins, subscribes and waits for it. Prints one line of JSON: the bytes of the map, and for each the seconds from `create_subscription` to the map.
"""
import json
import subprocess
import sys
import time

if sys.argv[1:] == ["--join"]:
    import rclpy
    from nav_msgs.msg import OccupancyGrid
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    rclpy.init()
    node = rclpy.create_node("late")
    kept = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    begun, got = time.monotonic(), []
    node.create_subscription(OccupancyGrid, "/map", lambda m: got.append((time.monotonic() - begun, len(m.data))), kept)
    while not got and time.monotonic() - begun < 60:
        rclpy.spin_once(node, timeout_sec=0.01)
    print(json.dumps(got[0] if got else [None, 0]))
    raise SystemExit

teller = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
time.sleep(2)
found = []
for _ in range(5):
    said = subprocess.run([sys.executable, __file__, "--join"], capture_output=True, text=True, check=True)
    found.append(json.loads(said.stdout))
teller.stdin.close()
teller.wait()
waits = [wait for wait, _ in found]
print(json.dumps({"bytes": found[0][1], "seconds": waits, "median": sorted(waits, key=lambda w: w or 1e9)[2]}))
