#!/usr/bin/env python3
"""A client of KUKA's FRI, written from the wire tables alone, with Python's standard library: the independent other side in tests of
the emulated controller.

    client.py lwr|1.11|1.14|1.15|1.16|2.5|2.7 [--bind ADDRESS:PORT] [--controller ADDRESS:PORT] [--seconds S] [--amplitude RAD]
                  [--joint I] [--frequency HZ] [--torque NM] [--moves N] [--limit S]

Writes "port N" first (of the bound socket), and at the end one line of JSON: what it received and what it sent. In the monitoring
states it mirrors the commanded position, in COMMANDING_WAIT the interpolator's, in COMMANDING_ACTIVE it adds a sine to the
interpolator's position, of `amplitude` from the first active cycle on, for S seconds of the controller's time; then it ends."""
import argparse
import json
import math
import socket
import struct
import sys
import zlib

STATES = ["IDLE", "MONITORING_WAIT", "MONITORING_READY", "COMMANDING_WAIT", "COMMANDING_ACTIVE"]


class Lwr:
    """FRI 1.0: packed structs of 916 and 376 bytes."""

    def __init__(self):
        self.sent = 0

    def monitoring(self, data):
        assert len(data) == 916, f"{len(data)} bytes, expected 916"
        count, reflected, size, identifier = struct.unpack_from("<4H", data, 0)
        assert size == 916 and identifier == 0x2006, (size, hex(identifier))
        time, state, quality, period = struct.unpack_from("<f2Hf", data, 140)
        q = [struct.unpack_from("<7f", data, at) for at in (216, 292, 320, 444, 472)]
        return {"counter": count, "reflected": reflected, "time": time, "period": period,
                "state": {1: 2 if quality >= 2 else 1, 2: 4}[state], "quality": quality, "measured": q[0], "ipo": q[1],
                "commanded": [a + b for a, b in zip(q[1], q[2])], "torque": q[3], "external": q[4],
                "krl": {"real": struct.unpack_from("<16f", data, 8), "integer": struct.unpack_from("<16i", data, 72),
                        "boolean": struct.unpack_from("<H", data, 136)[0]}}

    def command(self, answered, q, torque, krl):
        self.sent = (self.sent + 1) & 0xFFFF
        data = bytearray(376)
        struct.pack_into("<4H", data, 0, self.sent, answered, 376, 0x1005)
        struct.pack_into("<16f16iH", data, 8, *krl["real"], *krl["integer"], krl["boolean"])
        struct.pack_into("<I7f", data, 140, 0x0001 | (0x0004 if torque else 0), *q)
        if torque:
            struct.pack_into("<7f", data, 220, *torque)
        return bytes(data)


def varint(value):
    out = bytearray()
    while True:
        out.append((value & 0x7F) | (0x80 if value > 0x7F else 0))
        value >>= 7
        if not value:
            return bytes(out)


def fields(data):
    """(number, value) of every field; length-delimited values as bytes, fixed64 as a float."""
    at = 0

    def number():
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(data):
        key = number()
        if key & 7 == 0:
            yield key >> 3, number()
        elif key & 7 == 1:
            yield key >> 3, struct.unpack_from("<d", data, at)[0]
            at += 8
        else:
            assert key & 7 == 2, f"wire type {key & 7}"
            size = number()
            yield key >> 3, bytes(data[at:at + size])
            at += size
    assert at == len(data), "a field beyond the end"


class Sunrise:
    """FRI 1.x and 2.x: protobuf messages; 2.7 with length and checksum around them."""

    def __init__(self, version):
        self.version = version
        self.sent = -1

    def monitoring(self, data):
        if self.version == "2.7":
            size, = struct.unpack_from("<I", data, 0)
            assert len(data) == size + 8, f"{len(data)} bytes, expected {size + 8}"
            assert struct.unpack_from("<I", data, 4 + size)[0] == zlib.crc32(data[4:4 + size]), "wrong checksum"
            data = data[4:4 + size]
        message = dict(fields(data))
        header, monitor = dict(fields(message[1])), dict(fields(message[3]))
        connection, ipo = dict(fields(message[4])), dict(fields(message.get(5, b"")))
        assert header[1] == 0x245142, hex(header[1])

        def joints(part, field):
            return [value for _, value in fields(part[field])] if field in part else None

        stamp = dict(fields(monitor[15]))
        measured = joints(monitor, 1)
        result = {"counter": header[2], "reflected": header[3], "time": stamp[1] + 1e-9 * stamp[2], "period": 1e-3 * connection[3],
                  "state": connection[1], "quality": connection[2], "measured": measured, "torque": joints(monitor, 2),
                  "commanded": joints(monitor, 3), "external": joints(monitor, 5), "ipo": joints(ipo, 1)}
        assert result["state"] < 3 or result["ipo"] is not None, "no interpolator position in a commanding state"
        assert len(measured) == 7 and sum(1 for n, _ in fields(message[2]) if n == 5) == 7
        return result

    def command(self, answered, q, torque, _):
        self.sent += 1
        header = b"\x08" + varint(0x34001) + b"\x10" + varint(self.sent) + b"\x18" + varint(answered)
        data = b"\x0a" + varint(len(header)) + header

        def part(number, values):
            body = b"".join(b"\x09" + struct.pack("<d", value) for value in values)
            return bytes([number << 3 | 2]) + varint(len(body)) + body

        if q is not None:
            body = part(1, q) + (part(3, torque) if torque else b"")
            data += b"\x12" + varint(len(body)) + body
        return struct.pack("<I", len(data)) + data + struct.pack("<I", zlib.crc32(data)) if self.version == "2.7" else data


def place(text):
    address, port = text.rsplit(":", 1)
    return address, int(port)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("protocol", choices=["lwr", "1.11", "1.14", "1.15", "1.16", "2.5", "2.7"])
    parser.add_argument("--bind", type=place, default=("127.0.0.1", 0))
    parser.add_argument("--controller", type=place)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--amplitude", type=float, default=0.02)
    parser.add_argument("--frequency", type=float, default=1.0)
    parser.add_argument("--joint", type=int, default=4)
    parser.add_argument("--torque", type=float, default=0.0)
    parser.add_argument("--limit", type=float, default=60.0)
    a = parser.parse_args()
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(a.bind)
    link.settimeout(a.limit)
    print("port", link.getsockname()[1], flush=True)
    if a.controller:
        link.connect(a.controller)
    peer = Lwr() if a.protocol == "lwr" else Sunrise(a.protocol)
    krl = {"real": [0.5] + [0.0] * 15, "integer": [-7] + [0] * 15, "boolean": 0x8001}
    told = {"received": 0, "answered": 0, "gaps": 0, "wrong_reflections": 0, "states": [], "qualities": [], "largest": 0.0,
            "krl": None, "period": 0.0, "lag": 0.0}
    before = started = q = None
    try:
        while True:
            data, sender = link.recvfrom(2048)
            m = peer.monitoring(data)
            told["received"] += 1
            told["period"] = m["period"]
            told["krl"] = m.get("krl")
            if before is not None and m["counter"] != (before + 1) & (0xFFFF if a.protocol == "lwr" else 0xFFFFFFFF):
                told["gaps"] += 1
            if told["answered"] and m["reflected"] > peer.sent:
                told["wrong_reflections"] += 1
            before = m["counter"]
            for what, value in (("states", STATES[m["state"]]), ("qualities", m["quality"])):
                if not told[what] or told[what][-1] != value:
                    told[what].append(value)
            if m["state"] == 0:
                continue
            torque = None
            if m["state"] == 4:
                started = m["time"] if started is None else started
                t = m["time"] - started
                if t >= a.seconds:
                    break
                if q is not None:
                    told["lag"] = max(told["lag"], abs(q[a.joint - 1] - m["measured"][a.joint - 1]))
                q = list(m["ipo"])
                q[a.joint - 1] += a.amplitude * math.sin(2 * math.pi * a.frequency * t)
                if a.torque:
                    torque = [a.torque if j == a.joint - 1 else 0.0 for j in range(7)]
                told["largest"] = max(told["largest"], abs(m["measured"][a.joint - 1] - m["ipo"][a.joint - 1]))
            elif m["state"] == 3:
                q = list(m["ipo"])
            else:
                q, started = (list(m["commanded"]) if m["commanded"] else None), None
            send = peer.command(m["counter"], q, torque, krl)
            link.send(send) if a.controller else link.sendto(send, sender)
            told["answered"] += 1
    except socket.timeout:
        told["error"] = f"no message for {a.limit} s"
    print(json.dumps(told), flush=True)
    return 0 if "error" not in told else 1


sys.exit(main())
