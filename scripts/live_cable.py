"""A recording of an LD06's bytes through a pseudo-terminal into `mapwright live`, with the cable pulled out in the middle and put back.

    python scripts/live_cable.py MAPWRIGHT OUTPUT [BYTES]

BYTES is crates/lidars/tests/data/ld06-2.bin unless another file is named. Prints what the command says.
"""
import os
import pty
import signal
import subprocess
import sys
import tempfile
import time
import tty

command, output = sys.argv[1:3]
data = sys.argv[3] if len(sys.argv) > 3 else os.path.join(os.path.dirname(__file__), "../crates/lidars/tests/data/ld06-2.bin")
with open(data, "rb") as file:
    recorded = file.read()
cable = os.path.join(tempfile.mkdtemp(), "lidar")


def plug_in():
    master, slave = pty.openpty()
    tty.setraw(slave)
    if os.path.lexists(cable):
        os.unlink(cable)
    os.symlink(os.ttyname(slave), cable)
    return master, slave


def send(master, piece):
    for at in range(0, len(piece), 369):
        os.write(master, piece[at : at + 369])
        time.sleep(0.016)


ends = plug_in()
live = subprocess.Popen([command, "live", "--lidar", f"ld06:{cable}", "-o", output], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
time.sleep(1.5)
send(ends[0], recorded[: 23040 * 6])
os.unlink(cable)
for end in ends:
    os.close(end)
time.sleep(3)
ends = plug_in()
time.sleep(2)
send(ends[0], recorded[23040 * 6 : 23040 * 12])
live.send_signal(signal.SIGINT)
said, _ = live.communicate()
print(said + f"exit {live.returncode}")
