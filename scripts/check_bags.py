#!/usr/bin/env python3
"""Messages of recordings as the official readers see them, as JSON on stdout.

usage: check_bags.py READER PATH...     READER is rosbags (bags of ROS 1 and 2, as file or folder) or mcap
       check_bags.py write FOLDER       compressed bags by rosbags and mcap, each way they have, all with the same content

For each path an object: "connections" with topic, type, md5sum and definition; "messages" in the reader's order, each
[connection, stamp in ns, number of bytes, CRC-32]. Needs the wheels `rosbags` and `mcap` with `lz4` and `zstandard`.
"""

import json
import sys
import tempfile
import zlib
from pathlib import Path


def with_right_lengths(path, folder):
    """A copy in which index records are as long as their count says; rosbags refuses those of an old recorder."""
    bag, at = bytearray(path.read_bytes()), len(b"#ROSBAG V2.0\n")
    while at + 8 <= len(bag):
        header_end = at + 4 + int.from_bytes(bag[at : at + 4], "little")
        header, length = bytes(bag[at + 4 : header_end]), int.from_bytes(bag[header_end : header_end + 4], "little")
        if b"op=\x04" in header:
            place = header.index(b"count=") + len(b"count=")
            length = 12 * int.from_bytes(header[place : place + 4], "little")
            bag[header_end : header_end + 4] = length.to_bytes(4, "little")
        at = header_end + 4 + length
    copy = Path(folder) / path.name
    copy.write_bytes(bag)
    return copy


def read_rosbags(path):
    if path.suffix != ".bag":
        from rosbags.rosbag2 import Reader

        return all_messages(Reader(path))
    from rosbags.rosbag1 import Reader

    try:
        return all_messages(Reader(path))
    except AssertionError:
        with tempfile.TemporaryDirectory() as folder:
            return all_messages(Reader(with_right_lengths(path, folder)))


def all_messages(reader):
    with reader:
        # several may share topic and type: told apart by the id in the file
        order = {id(connection): place for place, connection in enumerate(reader.connections)}
        connections = [
            {"topic": c.topic, "type": c.msgtype, "md5sum": c.digest, "definition": c.msgdef.data}
            for c in reader.connections
        ]
        messages = [[order[id(c)], stamp, len(data), zlib.crc32(data)] for c, stamp, data in reader.messages()]
    return {"connections": connections, "messages": messages}


def read_mcap(path):
    from mcap.reader import make_reader

    connections, places, messages = [], {}, []
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in places:
                places[channel.id] = len(connections)
                connections.append(
                    {
                        "topic": channel.topic,
                        "type": schema.name if schema else "",
                        "md5sum": "",
                        "definition": schema.data.decode("utf-8", "replace") if schema else "",
                    }
                )
            data = bytes(message.data)
            messages.append([places[channel.id], message.log_time, len(data), zlib.crc32(data)])
        counted = summary.statistics.message_count if summary and summary.statistics else None
        profile = reader.get_header().profile
    return {"connections": connections, "messages": messages, "counted": counted, "profile": profile}


def made():
    """Topic, stamp and data of made-up messages."""
    for number in range(400):
        data = b"\0\1\0\0" + number.to_bytes(4, "little") + bytes((number * k) % 251 for k in range(number * 3))
        yield "/odd" if number % 2 else "/even", 1_600_000_000_000_000_000 + number * 1_000_000, data


def write_all(folder):
    from mcap.writer import CompressionType, Writer as McapWriter
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    name = "std_msgs/msg/String"
    for label in ["LZ4", "BZ2"]:
        writer = rosbag1.Writer(folder / f"{label}.bag")
        writer.set_compression(getattr(rosbag1.Writer.CompressionFormat, label))
        fill(writer, name, {"typestore": get_typestore(Stores.ROS1_NOETIC)})
    for plugin in ["SQLITE3", "MCAP"]:
        for mode in ["FILE", "MESSAGE"]:
            path = folder / f"{plugin}_{mode}"
            writer = rosbag2.Writer(path, version=9, storage_plugin=getattr(rosbag2.StoragePlugin, plugin))
            compression = rosbag2.CompressionMode, rosbag2.CompressionFormat
            writer.set_compression(getattr(compression[0], mode), compression[1].ZSTD)
            fill(writer, name, {"typestore": get_typestore(Stores.ROS2_HUMBLE)})
    for label in ["LZ4", "ZSTD", "NONE"]:
        with (folder / f"{label}.mcap").open("wb") as stream:
            writer = McapWriter(stream, chunk_size=20_000, compression=getattr(CompressionType, label))
            writer.start("ros2")
            schema = writer.register_schema(name, "ros2msg", b"string data")
            ids = {topic: writer.register_channel(topic, "cdr", schema) for topic in ["/even", "/odd"]}
            for topic, stamp, data in made():
                writer.add_message(ids[topic], stamp, data, stamp)
            writer.finish()


def fill(writer, name, options):
    with writer:
        connections = {topic: writer.add_connection(topic, name, **options) for topic in ["/even", "/odd"]}
        for topic, stamp, data in made():
            writer.write(connections[topic], stamp, data)


def main():
    if sys.argv[1] == "write":
        return write_all(Path(sys.argv[2]))
    read = {"rosbags": read_rosbags, "mcap": read_mcap}[sys.argv[1]]
    json.dump([read(Path(path)) for path in sys.argv[2:]], sys.stdout)


if __name__ == "__main__":
    main()
