#!/usr/bin/env python3
"""Writes files/*.db3 as rosbag2 does, with Python's sqlite3: write_files.py FOLDER"""
import pathlib
import sqlite3
import struct
import sys


class Cdr:
    def __init__(self, order):
        self.order, self.bytes = order, b""

    def number(self, kind, value):
        size = struct.calcsize(kind)
        self.bytes += b"\0" * (-len(self.bytes) % size) + struct.pack(self.order + kind, value)
        return self

    def text(self, value):
        self.number("I", len(value) + 1).bytes += value.encode() + b"\0"
        return self

    def reals(self, values):
        self.number("I", len(values))
        for value in values:
            self.number("d", value)
        return self

    def message(self):
        return (b"\0\1\0\0" if self.order == "<" else b"\0\0\0\0") + self.bytes


def stamped(order, ns):
    return Cdr(order).number("i", ns // 10**9).number("I", ns % 10**9).text("base")


def joint_state(i, ns):
    """As those of write_files.mjs; every third one is big-endian."""
    cdr = stamped(">" if i % 3 == 0 else "<", ns)
    names = ("arm", "lift") if i % 2 == 0 else ("lift", "arm")
    cdr.number("I", 2)
    for name in names:
        cdr.text(name)
    for arm, lift in ((0.1 * i, 0.001 * i), (25 + i, 0.25), (1 / (i + 1), -9.81)):
        cdr.reals([arm if name == "arm" else lift for name in names])
    return cdr.message()


def wrench(i, ns):
    cdr = stamped("<", ns)
    for value in (i, 2 * i, 3 * i, 0.5, 0.25, 0.125):
        cdr.number("d", value)
    return cdr.message()


def command(i):
    cdr = Cdr("<").number("I", 1).text("joints").number("I", 2).number("I", 2).number("I", 0)
    return cdr.reals([i, -i]).message()


def write(file, definitions, wal):
    file.unlink(missing_ok=True)
    bag = sqlite3.connect(file)
    if wal:
        bag.execute("PRAGMA journal_mode = WAL")
    bag.executescript("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
                      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
                      "CREATE INDEX timestamp_idx ON messages (timestamp ASC);")
    if definitions:
        bag.execute("CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT)")
        bag.execute("INSERT INTO message_definitions VALUES(1, 'own_msgs/msg/Level', 'ros2msg', 'float32 height\nuint8[<=4] flags', '')")
    topics = [("/joint_states", "sensor_msgs/msg/JointState"), ("/wrench", "geometry_msgs/msg/WrenchStamped"), ("/command", "std_msgs/msg/Float64MultiArray"),
              ("/level", "own_msgs/msg/Level")]
    bag.executemany("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", [(k + 1, *topic) for k, topic in enumerate(topics)])
    bag.commit()
    for k in range(60):
        i = (k * 37) % 60   # not in the order of time
        ns = 1700000000 * 10**9 + 4000000 * i
        add = lambda topic, data: bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", (topic, ns + 500, data))
        add(1, joint_state(i, ns))
        if i % 10 == 0:
            add(2, wrench(i, ns))
            add(3, command(i))
            add(4, Cdr("<").number("f", 0.5 + i).number("I", 2).number("B", 1).number("B", 7).message())
    if not wal:
        bag.commit()
        bag.execute("VACUUM")
        bag.close()
        return
    # As a recorder leaves it that was killed: the messages are in the log beside the file alone.
    bag.commit()
    log = pathlib.Path(str(file) + "-wal").read_bytes()
    before = file.read_bytes()
    bag.close()
    file.write_bytes(before)
    pathlib.Path(str(file) + "-wal").write_bytes(log)


folder = pathlib.Path(sys.argv[1])
write(folder / "humble.db3", False, False)
write(folder / "jazzy.db3", True, False)
write(folder / "killed.db3", False, True)
