#!/usr/bin/env python3
"""Tries `cotwin new` on 100 public URDFs (robots.txt), in all three kinds, and writes the table of docs/interoperability.md.

robots.py --cotwin PROGRAM [--files FOLDER] [--mirrors FOLDER] [--jobs N] [--only TEXT] [--kinds WORD,…] [--json FILE]

--files     where the URDFs and their meshes are put (default: build/public_robots); what is there is not fetched again
--mirrors   clones of the repositories, as FOLDER/OWNER+NAME, FOLDER/OWNER+NAME/repo or with /.git; others are cloned from GitHub
--only      only the URDFs whose repository and path contain TEXT
--json      all answers of the program, for a closer look

Each scenario is written by `cotwin new`, run to its end by `cotwin run`, and compared with what its introduction promises: drives follow the
compliant motion, deviations are tau_e / S_a, the force at rest is the one that is named. Where `new` refuses a robot and names options
("it runs with: …", also where units are a guess: "if its numbers are in these units it runs with: …; if they are in SI: …"), it is asked again
with these options, once."""
import argparse
import collections
import concurrent.futures
import csv
import json
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
KINDS = ("motion", "compliance", "contact")
MESHES = (".urdf", ".stl", ".dae", ".obj", "package.xml")


def listed():
    """Commits by repository, and the URDFs as pairs of repository and path."""
    commits, robots = {}, []
    for line in (HERE / "robots.txt").read_text().splitlines():
        if line.startswith("@ "):
            _, repository, commit = line.split()
            commits[repository] = commit
        elif line and not line.startswith("#"):
            robots.append(tuple(line.split(" ", 1)))
    return commits, robots


def git(folder, *words, **more):
    return subprocess.run(["git", f"--git-dir={folder}", *words], check=True, capture_output=True, **more)


def clone_of(repository, mirrors, files):
    """The git folder of a repository."""
    name = repository.replace("/", "+")
    for folder in (mirrors / name, mirrors / name / "repo", mirrors / name / ".git", mirrors / name / "repo" / ".git") if mirrors else ():
        if (folder / "HEAD").exists():
            return folder
    folder = files / ".git" / name
    if not (folder / "HEAD").exists():
        subprocess.run(["git", "clone", "--quiet", "--bare", f"https://github.com/{repository}", folder], check=True)
    return folder


def fetch(repository, commit, mirrors, files):
    """Puts the robots and meshes of a repository below `files`."""
    target = files / repository.replace("/", "+")
    if (target / commit).exists():
        return
    folder = clone_of(repository, mirrors, files)
    with subprocess.Popen(["git", f"--git-dir={folder}", "cat-file", "--batch"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as pipe:
        for entry in git(folder, "ls-tree", "-r", commit, text=True).stdout.splitlines():
            about, path = entry.split("\t")
            mode, _, blob = about.split()
            if mode == "120000" or "random_urdfs" in path or not path.lower().endswith(MESHES):
                continue
            pipe.stdin.write(f"{blob}\n".encode())
            pipe.stdin.flush()
            header = pipe.stdout.readline().split()
            if header[1] == b"missing":  # of a clone without its largest files
                continue
            content = pipe.stdout.read(int(header[2]))
            pipe.stdout.read(1)
            place = target / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
    (target / commit).touch()


def columns_of(file):
    with open(file, newline="") as text:
        rows = [row for row in csv.reader(text) if not row[0].startswith("#")]
    return {name: [float(row[k]) for row in rows[1:]] for k, name in enumerate(rows[0])}


def vector(columns, name):
    """Its elements, each a series."""
    if name in columns:
        return [columns[name]]
    elements = []
    while f"{name}[{len(elements) + 1}]" in columns:
        elements.append(columns[f"{name}[{len(elements) + 1}]"])
    return elements


def broken_promise(kind, folder, results):
    """What of the introduction of the scenario is not so; "" if all is."""
    columns = columns_of(results / "signals.csv")
    time = columns["time"]
    q, q_c, q_d = (vector(columns, name) for name in ("drive.q", "compliance.q_c", "motion.q_d"))
    worst = max(abs(a - b) for x, y in zip(q, q_c) for a, b in zip(x, y))
    if worst > 5e-3:
        return f"the drives are up to {worst:.2g} rad or m away from the compliant motion"
    if kind == "compliance":
        at = lambda t: min(range(len(time)), key=lambda k: abs(time[k] - t))
        push = vector(columns, "drive.tau_e")
        for joint, (a, b, p) in enumerate(zip(q, q_d, push)):
            first, second = (a[at(t)] - b[at(t)] for t in (3.9, 9.9))
            if p[at(3.9)] != 0 and abs(second - first / 2) > 0.1 * abs(first) + 1e-5:
                return f"joint {joint + 1} gives way by {first:.3g} and {second:.3g}, expected half of it"
    if kind == "contact":
        text = (folder / "twin.ssd").read_text()
        promised = float(re.search(r"force at rest is about ([-+.e\d]+) N", text).group(1))
        rows = [line.split(",") for line in (folder / "waypoints.csv").read_text().splitlines() if line[0] not in "#t"]
        end = float(rows[1][0]) + float(rows[1][-1]) - 0.1
        row = next(k for k, t in enumerate(time) if t >= end)
        force = sum(part[row] ** 2 for part in vector(columns, "world.f_c")) ** 0.5
        if abs(force - promised) > 0.1 * promised:
            return f"the force at rest is {force:.3g} N, promised {promised:.3g} N"
    return ""


def attempt(program, robot, kind, options, folder):
    """(what happened: runs, refused, fails, wrong; the reason)"""
    command = [program, "new", "--robot", str(robot), "--kind", kind, "--out", str(folder / "own"), *options]
    try:
        new = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder)
        if new.returncode != 0:
            return "refused", new.stderr.strip()
        run = subprocess.run([program, "run", str(folder / "own/twin.ssd"), "--out", str(folder / "results"), "--quiet"],
                             capture_output=True, text=True, timeout=600, cwd=folder)
    except subprocess.TimeoutExpired as late:
        return "fails", f"no end after {late.timeout:.0f} s"
    if run.returncode != 0:
        return "fails", run.stderr.strip()
    broken = broken_promise(kind, folder / "own", folder / "results")
    return ("wrong", broken) if broken else ("runs", "")


def trial(program, robot, kind):
    with tempfile.TemporaryDirectory() as place:
        place = pathlib.Path(place)
        (place / "first").mkdir()
        outcome, reason = attempt(program, robot, kind, [], place / "first")
        named = re.search(r"it runs with: ([^;\n]*)", reason)
        if outcome != "refused" or not named:
            return outcome, "", reason
        (place / "second").mkdir()
        again, why = attempt(program, robot, kind, shlex.split(named.group(1)), place / "second")
        return again, named.group(1), why if again != "runs" else reason


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--cotwin", required=True)
    arguments.add_argument("--files", type=pathlib.Path, default=HERE.parents[1] / "build/public_robots")
    arguments.add_argument("--mirrors", type=pathlib.Path)
    arguments.add_argument("--jobs", type=int, default=2)
    arguments.add_argument("--only", default="")
    arguments.add_argument("--kinds", default=",".join(KINDS))
    arguments.add_argument("--json", type=pathlib.Path)
    given = arguments.parse_args()
    program = str(pathlib.Path(given.cotwin).resolve())
    commits, robots = listed()
    for repository, commit in commits.items():
        fetch(repository, commit, given.mirrors, given.files)
    kinds = given.kinds.split(",")
    trials = [(repository, path, kind) for repository, path in robots for kind in kinds if given.only in f"{repository} {path}"]
    answers = []
    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        futures = {pool.submit(trial, program, (given.files / r.replace("/", "+") / p).resolve(), k): (r, p, k) for r, p, k in trials}
        for future in concurrent.futures.as_completed(futures):
            repository, path, kind = futures[future]
            outcome, options, reason = future.result()
            answers.append({"repository": repository, "path": path, "kind": kind, "outcome": outcome, "options": options, "reason": reason})
            print(f"{len(answers)}/{len(trials)} {outcome} {kind} {path} {options}", file=sys.stderr)
    answers.sort(key=lambda a: (a["repository"], a["path"], kinds.index(a["kind"])))
    if given.json:
        given.json.write_text(json.dumps(answers, indent=1))
    print("| kind | robots | run as written | run with the option that was named | refused | fail or break their promise |\n|---|---|---|---|---|---|")
    for kind in kinds:
        of = collections.Counter((a["outcome"], bool(a["options"])) for a in answers if a["kind"] == kind)
        print(f"| {kind} | {sum(of.values())} | {of['runs', False]} | {of['runs', True]} | {of['refused', False] + of['refused', True]} | "
              f"{sum(n for (outcome, _), n in of.items() if outcome in ('fails', 'wrong'))} |")
    print()
    for a in answers:
        if a["outcome"] != "runs":
            print(f"* {a['path']}, {a['kind']}: {a['outcome']}: {' '.join(a['reason'].split())}")


if __name__ == "__main__":
    main()
