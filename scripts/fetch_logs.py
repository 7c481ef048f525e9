#!/usr/bin/env python3
"""Fetches the measurements and the model of real robots that examples 03 and 06 use from the public repositories of their authors, checks them by
hash, and writes them in the form of examples/public_data.md.

fetch_logs.py [--tests] [--fmu] [FOLDER]

FOLDER: for models/, measurements/ and, in fetched/, the files as published; default: build/public_data, where the examples look for them. A file
that is already there is not fetched again, so that a machine without a network can be given a copy. --tests: also the files that only tests use,
which tests/public_data.txt lists. --fmu: only the Reference FMU of example 14, which examples/14_plant/reference_fmu.txt lists."""
import hashlib
import http.client
import pathlib
import sqlite3
import struct
import sys
import urllib.parse
import urllib.request
import xml.etree.ElementTree as ElementTree

ROOT = pathlib.Path(__file__).resolve().parents[1]
SOLVER = ("unisa-acg/inverse-dynamics-solver", "41e196de5ca340f2b48e443484a7c74a77533da4")          # BSD-3-Clause
ROBOTS = ("Gepetto/example-robot-data", "39aa94379908fa743da90b21dc9e1fb8308f746b")                 # BSD-3-Clause; panda_description: Apache-2.0
# name in fetched/: repository, path, SHA-256
FILES = {
    "panda_exciting_trajectory.db3": (*SOLVER, "franka_inria_inverse_dynamics_solver/bagfiles/panda_exciting_trajectory.db3", "6794c9dc89628d775bd77bfaee3ed73e0a7d7716401886e17e06d81ea3b7f299"),
    "ur10_exciting_trajectory.db3": (*SOLVER, "ur10_inverse_dynamics_solver/bagfiles/ur10_exciting_trajectory.db3", "14244fc39e9b42047039824f3c20ab984f9d1b28d5a67e9415cc1b3cc0ac3369"),
    "panda.urdf": (*ROBOTS, "robots/panda_description/urdf/panda.urdf", "63792d2679f22c4e41cda2c4d9d903644e628970ad0656b9eec8485113941555"),
}
WRITTEN = ("measurements/panda_unisa.csv", "measurements/ur10_unisa.csv", "models/panda_franka_ros.urdf")


def fetch(file, repository, commit, path, digest):
    """The bytes of a file; from the network if it does not exist."""
    if not file.exists():
        url = f"https://raw.githubusercontent.com/{repository}/{commit}/{path}"
        try:
            with urllib.request.urlopen(url, timeout=60) as answer:
                content = answer.read()
        except (OSError, http.client.HTTPException) as error:
            sys.exit(f"{url}: {error}; expected a network, or the file as {file}")
        if hashlib.sha256(content).hexdigest() == digest:
            file.parent.mkdir(parents=True, exist_ok=True)
            partial = file.with_suffix(".part")
            partial.write_bytes(content)
            partial.rename(file)
    else:
        content = file.read_bytes()
    found = hashlib.sha256(content).hexdigest()
    if found != digest:
        sys.exit(f"{file.name} of github.com/{repository} has the SHA-256 {found}, expected {digest}; it is not used")
    return content


class Cdr:
    """Reads the little-endian serialisation of ROS 2 messages (OMG CDR), which aligns numbers to their size."""

    def __init__(self, message):
        if message[:2] != b"\0\1":
            raise ValueError("a message is not little-endian CDR")
        self.bytes, self.at = message[4:], 0

    def number(self, kind, size):
        self.at += -self.at % size
        value = struct.unpack_from("<" + kind, self.bytes, self.at)[0]
        self.at += size
        return value

    def text(self):
        length = self.number("I", 4)
        value = self.bytes[self.at:self.at + length - 1].decode()
        self.at += length
        return value

    def texts(self):
        return [self.text() for _ in range(self.number("I", 4))]

    def reals(self):
        return [self.number("d", 8) for _ in range(self.number("I", 4))]


def joint_states(bag):
    """(joint names, rows of t from 0, q, q̇, τ) of the sensor_msgs/JointState messages of an SQLite bag of ROS 2. SI units."""
    names, rows = None, []
    with sqlite3.connect(f"{bag.resolve().as_uri()}?mode=ro", uri=True) as database:
        for (message,) in database.execute("SELECT data FROM messages JOIN topics ON topics.id = messages.topic_id "
                                           "WHERE topics.type = 'sensor_msgs/msg/JointState' ORDER BY messages.id"):
            cdr = Cdr(message)
            time = cdr.number("i", 4) + 1e-9 * cdr.number("I", 4)
            cdr.text()   # frame
            joints, q, dq, tau = cdr.texts(), cdr.reals(), cdr.reals(), cdr.reals()
            names = names or joints
            if joints != names or not len(q) == len(dq) == len(tau) == len(names):
                raise ValueError(f"{bag}: the messages have different joints")
            rows.append([time, *q, *dq, *tau])
    return names, [[row[0] - rows[0][0], *row[1:]] for row in rows]


def write_log(bag, csv):
    names, rows = joint_states(bag)
    joints = range(1, len(names) + 1)
    header = ["t"] + [f"{kind}{j}" for kind in ("q", "qd", "tau") for j in joints]
    csv.write_text("\n".join([",".join(header)] + [",".join(f"{x:.7g}" for x in row) for row in rows]) + "\n")
    print(f"{csv}: {len(rows)} samples of {', '.join(names)}")


def write_arm(urdf, target, tip):
    """Only the chain from the root to `tip`: without a hand that the measured robot did not carry, and without meshes."""
    robot = ElementTree.fromstring(urdf)
    joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}
    links, kept_joints = set(), []
    link = tip
    while link:
        links.add(link)
        joint = joints.get(link)
        kept_joints.append(joint)
        link = joint.find("parent").get("link") if joint is not None else None
    for child in list(robot):
        if not (child.tag == "link" and child.get("name") in links) and child not in kept_joints:
            robot.remove(child)
    for link in robot.findall("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    target.write_bytes(ElementTree.tostring(robot, encoding="utf-8") + b"\n")
    print(f"{target}: {len(links)} links to {tip}")


def fetch_listed(table, folder):
    """The files of a table of places below `folder` and sources."""
    lines = [line.split(" ") for line in table.read_text().splitlines() if not line.startswith("#")]
    files = {urllib.parse.unquote(name): source for name, *source in lines}
    missing = [name for name in files if not (folder / name).exists()]
    for name in missing:   # a set is whole or absent, also if the network breaks off
        fetch(folder / "fetched/tests" / name, *files[name])
    for name in missing:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "fetched/tests" / name).rename(folder / name)
    for name, source in files.items():
        fetch(folder / name, *source)


def main():
    arguments = [word for word in sys.argv[1:] if word not in ("--tests", "--fmu")]
    if len(arguments) > 1 or any(word.startswith("-") for word in arguments):
        sys.exit(__doc__)
    folder = pathlib.Path(arguments[0] if arguments else ROOT / "build/public_data")
    if "--fmu" in sys.argv:
        fetch_listed(ROOT / "examples/14_plant/reference_fmu.txt", folder)
        return
    if "--tests" in sys.argv:
        fetch_listed(ROOT / "tests/public_data.txt", folder)
        if all((folder / name).exists() for name in WRITTEN):
            return
    fetched, models, measurements = (folder / name for name in ("fetched", "models", "measurements"))
    contents = {name: fetch(fetched / name, *FILES[name]) for name in FILES}
    for each in (models, measurements):
        each.mkdir(exist_ok=True)
    for robot in ("panda", "ur10"):
        write_log(fetched / f"{robot}_exciting_trajectory.db3", measurements / f"{robot}_unisa.csv")
    write_arm(contents["panda.urdf"], models / "panda_franka_ros.urdf", "panda_link8")


if __name__ == "__main__":
    main()
