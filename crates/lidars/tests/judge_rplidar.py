"""What others read of an RPLIDAR on a serial port: `python3 judge_rplidar.py roboticia|pyrplidar standard|express|ultra|dense PORT`.

`roboticia` is the package rplidar-roboticia (0.9.5), `pyrplidar` the package of that name (0.1.2). A line a reading: whether a revolution begins,
quality, degrees clockwise, millimetres, the same degrees where known faults are put right, and degrees from
reading to reading as they were spread (zero where a reading has its own angle). Known faults:

- roboticia puts the first reading of an express capsule one step behind its start, and takes the upper bit of the angle that corrects a reading
  for a sign (https://github.com/Roboticia/RPLidar/pull/4);
- pyrplidar takes the bytes of a dense capsule's distances in the wrong order (changed here before it reads).

It ends where nothing comes for a second.
"""

import contextlib
import io
import math
import sys
import time

import serial


class Silence(Exception):
    """Nothing has come for a second."""


def of_roboticia(mode, port):
    import rplidar

    class Judge(rplidar.RPLidar):
        def _read_response(self, dsize):
            until = time.monotonic() + 1.0
            while self._serial.in_waiting < dsize:
                if time.monotonic() > until:
                    raise Silence
                time.sleep(0.001)
            return self._serial.read(dsize)

    lidar = Judge(port, timeout=1)
    # a pseudo-terminal has no DTR
    lidar._serial._update_dtr_state = lambda: None
    lidar.stop()
    kind = {"standard": "normal", "express": "express"}[mode]
    while True:
        try:
            for new, quality, angle, distance in lidar.iter_measures(kind, max_buf_meas=False):
                yield new, quality or 0, angle, distance, *righted(lidar, mode, angle)
        except Silence:
            return
        except ValueError:
            # a damaged capsule: its readers begin with the next one
            lidar.express_trame, lidar.express_data = 32, False


def righted(lidar, mode, angle):
    if mode == "standard":
        return angle, 0.0
    old, place = lidar.express_old_data, lidar.express_trame
    step = ((lidar.express_data.start_angle - old.start_angle) % 360) / 32
    taken = old.angle[place - 1]
    back = 4 + abs(taken) if math.copysign(1, taken) < 0 else taken
    return (old.start_angle + step * (place - 1) - back) % 360, step


def of_pyrplidar(mode, port):
    import pyrplidar

    lidar = pyrplidar.PyRPlidar()
    lidar.connect(port=port, baudrate=115200, timeout=1)
    if mode == "dense":
        receive = lidar.lidar_serial.receive_data

        def swapped(size):
            data = receive(size)
            if size != 84 or len(data) != 84:
                return data
            return data[:4] + bytes(data[at ^ 1] for at in range(4, 84))

        lidar.lidar_serial.receive_data = swapped
    scan = lidar.start_scan() if mode == "standard" else lidar.start_scan_express(0 if mode == "express" else 1)
    try:
        for one in scan():
            yield one.start_flag, one.quality, one.angle, one.distance, one.angle, 0.0
    except (IndexError, pyrplidar.PyRPlidarProtocolError):
        return


judge, mode, port = sys.argv[1:]
with contextlib.redirect_stdout(io.StringIO()):
    readings = list({"roboticia": of_roboticia, "pyrplidar": of_pyrplidar}[judge](mode, port))
for new, quality, *numbers in readings:
    print(int(new), quality, *(repr(float(number)) for number in numbers))
