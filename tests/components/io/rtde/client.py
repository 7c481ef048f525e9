#!/usr/bin/env python3
"""A client of UR's RTDE, written from its documentation alone, with Python's standard library.

client.py ADDRESS [--version 1|2] [--seconds S] [--amplitude A]
Moves joint 1 by a sine through the registers that follow.script reads, by the robot's time. Prints a JSON object with what it saw.
"""
import argparse
import json
import math
import socket
import struct
import time

SIZES = {"BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d", "VECTOR3D": "3d", "VECTOR6D": "6d",
         "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I"}
OUTPUTS = ["timestamp", "actual_q", "target_q", "runtime_state", "joint_mode", "actual_digital_output_bits", "speed_scaling",
           "output_int_register_24", "output_int_register_25"]
INPUTS = ["input_double_register_%d" % i for i in range(24, 30)] + ["input_int_register_24", "input_int_register_25"]
IO = ["standard_digital_output_mask", "standard_digital_output", "speed_slider_mask", "speed_slider_fraction"]


class Rtde:
    def __init__(self, address, version):
        end = time.monotonic() + 60
        while True:
            try:
                self.socket = socket.create_connection(address, timeout=30)
                break
            except ConnectionRefusedError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.05)
        self.version = version
        self.messages = []
        if version == 2:
            assert self.ask(b"V", struct.pack(">H", 2)) == b"\1"

    def send(self, kind, contents=b""):
        self.socket.sendall(struct.pack(">HB", 3 + len(contents), kind[0]) + contents)

    def exactly(self, size):
        data = b""
        while len(data) < size:
            piece = self.socket.recv(size - len(data))
            assert piece, "the controller has ended the connection"
            data += piece
        return data

    def package(self):
        size, kind = struct.unpack(">HB", self.exactly(3))
        return bytes([kind]), self.exactly(size - 3)

    def ask(self, kind, contents=b""):
        self.send(kind, contents)
        while True:
            got, answer = self.package()
            if got == kind:
                return answer
            if got == b"M":
                self.messages.append(answer)

    def outputs(self, names, frequency):
        answer = self.ask(b"O", (struct.pack(">d", frequency) if self.version == 2 else b"") + ",".join(names).encode())
        number, types = (answer[0], answer[1:]) if self.version == 2 else (None, answer)
        return number, types.decode().split(",")

    def inputs(self, names):
        answer = self.ask(b"I", ",".join(names).encode())
        return answer[0], answer[1:].decode().split(",")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("--version", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=1)
    parser.add_argument("--amplitude", type=float, default=0.05)
    a = parser.parse_args()
    host, port = a.address.split(":")
    rtde = Rtde((host, int(port)), a.version)
    told = {"controller": struct.unpack(">4I", rtde.ask(b"v"))}
    told["unknown"] = rtde.outputs(["timestamp", "no_such_field"], 125)
    number, types = rtde.outputs(OUTPUTS, 125)
    layout = ">" + "".join(SIZES[t] for t in types)
    registers, register_types = rtde.inputs(INPUTS)
    switches, switch_types = rtde.inputs(IO)
    other = Rtde((host, int(port)), 2)
    told["rival"] = other.inputs(INPUTS[:1])
    other.socket.close()
    command = ">B" + "".join(SIZES[t] for t in register_types)
    assert rtde.ask(b"S") == b"\1"
    rtde.send(b"U", struct.pack(">B" + "".join(SIZES[t] for t in switch_types), switches, 3, 2, 1, 0.75))
    begun = q0 = None
    told.update(packages=0, largest=0, states=[], wrong=0)
    counter = last = 0
    while True:
        kind, contents = rtde.package()
        if kind != b"U":
            continue
        if a.version == 2:
            assert contents[0] == number
            contents = contents[1:]
        values = list(struct.unpack(layout, contents))
        t, q, target = values[0], values[1:7], values[7:13]
        told["runtime"], told["joint_mode"], told["digital"] = values[13], values[14], values[20]
        told["speed"], reflected, state = values[21], values[22], values[23]
        told["packages"] += 1
        told["wrong"] += t <= last
        last = t
        if not told["states"] or told["states"][-1] != state:
            told["states"].append(state)
        if state == 2 and begun is None:
            begun, q0 = t, target
        wanted = list(target)
        if begun is not None:
            wanted = list(q0)
            wanted[0] += a.amplitude * math.sin(2 * math.pi * (t - begun) / a.seconds)
            told["largest"] = max(told["largest"], abs(q[0] - q0[0]))
            if t - begun >= a.seconds:
                break
        counter += 1
        rtde.send(b"U", struct.pack(command, registers, *wanted, counter, 1))
    told["reflected"] = counter - reflected
    told["pause"] = rtde.ask(b"P")[0]
    print(json.dumps(told))


main()
