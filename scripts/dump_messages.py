"""Dumps every message of ROS bags with a checksum of all its fields, as the `rosbags` package (PyPI) reads them.

    python scripts/dump_messages.py OUT BAG...
    python scripts/dump_messages.py --check OUT

The second reads the messages of such a file itself and compares the checksums.
The test `agreement` of crates/ros reads OUT and compares. OUT is a sequence of records, each a line and a body:
    C <type> <ros1|cdr> <ros1msg|ros2msg|none> <bytes> <topic>     then the definition
    M <bytes> <md5 of the canonical text>                           then the message; of the last C's channel
The canonical text has a line `path=value` for each field in order: numbers as hexadecimal digits, most significant byte
first, and arrays of numbers as `[count]digits`; texts as they are; list elements and messages by their paths.
"""

import bz2
import hashlib
import re
import struct
import sys
from pathlib import Path

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "byte": "B", "char": "B", "octet": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}


def scalar(kind, value):
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).hex()
    if kind in ("octet", "byte"):
        value = int(value) & 0xFF  # rosbags gives it a sign, the standard has none
    return struct.pack(">" + CODES[kind], value).hex()


def element(store, desc, path, value, lines):
    if desc[0] == Nodetype.NAME:
        message(store, desc[1], path + ".", value, lines)
    elif desc[1][0] in ("string", "wstring"):
        lines.append(f"{path}={value}")
    else:
        lines.append(f"{path}={scalar(desc[1][0], value)}")


def message(store, kind, prefix, value, lines):
    for name, desc in store.fielddefs[kind][1]:
        path, item = prefix + name, getattr(value, name)
        if desc[0] in (Nodetype.NAME, Nodetype.BASE):
            element(store, desc, path, item, lines)
        elif desc[1][0][0] == Nodetype.BASE and desc[1][0][1][0] not in ("string", "wstring"):
            array = np.asarray(item)
            lines.append(f"{path}=[{len(array)}]{array.astype(array.dtype.newbyteorder('>')).tobytes().hex()}")
        else:
            for index, one in enumerate(item):
                element(store, desc[1][0], f"{path}[{index}]", one, lines)


class Dump:
    def __init__(self, out):
        self.out, self.last, self.count, self.stores = out, None, 0, {}

    def message(self, channel, raw):
        kind, encoding, form, text, topic = channel
        if channel != self.last:
            body = text.encode()
            self.out.write(f"C {kind} {encoding} {form} {len(body)} {topic}\n".encode() + body + b"\n")
            self.last = channel
        self.out.write(f"M {len(raw)} {self.canonical_digest(channel, raw)}\n".encode() + bytes(raw) + b"\n")
        self.count += 1

    def canonical_digest(self, channel, raw):
        return hashlib.md5(self.canonical(channel, raw).encode()).hexdigest()

    def canonical(self, channel, raw):
        kind, encoding, form, text, _ = channel
        store = self.store(kind, form, text)
        read = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
        lines = []
        message(store, kind, "", read(raw, kind), lines)
        return "\n".join(lines)

    def store(self, kind, form, text):
        key = (kind, form, text)
        if key not in self.stores:
            store = get_typestore(Stores.ROS2_HUMBLE if form == "none" else Stores.EMPTY)
            if form != "none":
                text = re.sub(r"^(=+\nMSG: )roslib/Header$", r"\1std_msgs/Header", text, flags=re.M)
                store.register(get_types_from_msg(text, kind))
            self.stores[key] = store
        return self.stores[key]


def dump_reader(reader, dump, encoding):
    for connection, _, raw in reader.messages():
        text = connection.msgdef.data if connection.msgdef.format.name != "NONE" else ""
        form = "none" if not text else "ros1msg" if encoding == "ros1" else "ros2msg"
        dump.message((connection.msgtype, encoding, form, text, connection.topic), raw)


def records(data):
    """Records of a ROS 1 bag's bytes: header fields and body; none behind a tear."""
    at = 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        header, end, fields = at + 4, at + 4 + length, {}
        while header < end:
            (size,) = struct.unpack_from("<I", data, header)
            name, _, value = data[header + 4 : header + 4 + size].partition(b"=")
            fields[name] = value
            header += 4 + size
        (size,) = struct.unpack_from("<I", data, end)
        if fields.get(b"op") == b"\4":  # an index whose length is wrong in laser_scan_matcher_demo.bag
            size = 12 * struct.unpack("<I", fields[b"count"])[0]
        body = data[end + 4 : end + 4 + size]
        at = end + 4 + size
        if len(body) == size:
            yield fields, body


def dump_raw_ros1(path, dump):
    """For bags whose index the package does not accept: chunk by chunk."""
    channels = {}

    def take(fields, body):
        op = fields[b"op"][0]
        if op == 5:
            data = bz2.decompress(body) if fields[b"compression"] == b"bz2" else body
            assert fields[b"compression"] in (b"bz2", b"none"), fields[b"compression"]
            for inner in records(data):
                take(*inner)
        elif op == 7:
            head = next(records(struct.pack("<I", len(body)) + body + b"\0\0\0\0"))[0]
            kind = head[b"type"].decode().replace("/", "/msg/")
            text = head[b"message_definition"].decode()
            channels[fields[b"conn"]] = (kind, "ros1", "ros1msg", text, fields[b"topic"].decode())
        elif op == 2:
            dump.message(channels[fields[b"conn"]], body)

    data = path.read_bytes()
    for fields, body in records(data[data.index(b"\n") + 1 :]):
        take(fields, body)


def dump_bag(path, dump):
    if path.suffix != ".bag":
        with Reader2(path) as reader:
            return dump_reader(reader, dump, "cdr")
    try:
        reader = Reader1(path)
        reader.open()
    except AssertionError:
        return dump_raw_ros1(path, dump)
    try:
        return dump_reader(reader, dump, "ros1")
    finally:
        reader.close()


def check(path):
    """Messages whose checksum is another, at most ten of them."""
    data, dump, wrong, channel, at = path.read_bytes(), Dump(None), [], None, 0
    while at < len(data):
        end = data.index(b"\n", at)
        words = data[at:end].decode().split(" ")
        size = int(words[4 if words[0] == "C" else 1])
        body = data[end + 1 : end + 1 + size]
        at = end + size + 2
        if words[0] == "C":
            channel = (words[1], words[2], words[3], body.decode(), words[5])
        elif dump.canonical_digest(channel, body) != words[2]:
            wrong.append(f"{channel[0]} {channel[1]}: {body.hex()[:200]}\n{dump.canonical(channel, body)}")
    return wrong[:10]


def main():
    if sys.argv[1] == "--check":
        sys.exit("\n".join(check(Path(sys.argv[2]))) or None)
    with open(sys.argv[1], "wb") as out:
        dump = Dump(out)
        for bag in sys.argv[2:]:
            before = dump.count
            dump_bag(Path(bag), dump)
            print(f"{bag}: {dump.count - before} messages")


if __name__ == "__main__":
    main()
