"""What whole revolutions of an LD06's bytes add up to, by a decoder of its own: `python3 check_ld06.py data/ld06-2.bin`."""

import struct
import sys


def crc(packet):
    crc = 0
    for byte in packet:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x4D) & 0xFF if crc & 0x80 else crc << 1
    return crc


def packets(data):
    at = 0
    while at + 47 <= len(data):
        if data[at : at + 2] == b"\x54\x2c" and crc(data[at : at + 47]) == 0:
            yield data[at : at + 47]
            at += 47
        else:
            at += 1


def points(packet):
    start, end = struct.unpack_from("<H", packet, 4)[0], struct.unpack_from("<H", packet, 42)[0]
    span = (end - start) % 36000
    for k in range(12):
        distance, intensity = struct.unpack_from("<HB", packet, 6 + 3 * k)
        # hundredths of a degree in 11ths
        yield (11 * start + span * k) % 396000, distance, intensity


data = open(sys.argv[1], "rb").read()
count, revolutions, whole, last, before = 0, [], None, None, None
for packet in packets(data):
    count += 1
    # more than a turn was lost: what is on either side is no revolution
    said = struct.unpack_from("<H", packet, 44)[0]
    if before is not None and (said - before) % 30000 > 100:
        whole, last = None, None
    before = said
    for point in points(packet):
        if last is not None and point[0] < last - 198000:
            if whole is not None:
                revolutions.append(whole)
            whole = []
        if whole is not None:
            whole.append(point)
        last = point[0]
sums = [sum(point[column] for turn in revolutions for point in turn) for column in range(3)]
print(f"{count} packets, {len(revolutions)} whole revolutions, sums {[sum(map(len, revolutions))] + sums}")
