#!/usr/bin/env python3
"""See compile_cost.sh."""
import collections
import json
import multiprocessing
import pathlib
import re
import shlex
import statistics
import subprocess
import sys

MOST = 20
BYTES_GROWTH, SECONDS_GROWTH = 1.05, 1.20
BYTES_GRAIN = 10   # kB: a unit of a few lines, which the table has as 0 kB, may grow by this
ROOT = pathlib.Path(__file__).resolve().parent.parent
ROOMS = ("models", "components", "fmu", "master")   # tests and benchmarks change too often to be compared


def target_of(object_file):
    found = re.search(r"CMakeFiles/(.+?)\.dir/", object_file)
    return found.group(1) if found else "?"


def shorter(path):
    try:
        return str(pathlib.Path(path).resolve().relative_to(ROOT))
    except ValueError:
        return str(path)


def units_of(build):
    """(target, source, command, folder) of each unit of the production code."""
    units = []
    for entry in json.loads((build / "compile_commands.json").read_text()):
        command = shlex.split(entry["command"])
        output = command[command.index("-o") + 1]
        if output.split("/")[0] in ROOMS:
            units.append((target_of(output), entry["file"], command, entry["directory"]))
    return units


def preprocess(unit):
    """The bytes of a unit after the preprocessor, without blank lines and line markers, and those below each header that a file of this
    repository includes: with all that the header includes for the first time."""
    _, source, command, folder = unit
    at = command.index("-o")
    text = subprocess.run([*command[:at], *command[at + 2:], "-E"], cwd=folder, check=True, capture_output=True).stdout
    ours = str(ROOT).encode() + b"/"
    stack, total = [], 0
    below = collections.Counter()   # bytes below each header
    marker = re.compile(rb'# \d+ "(.*?)"((?: \d)*)$')
    begun = []                      # the total when a file was entered
    for line in text.split(b"\n"):
        if line.startswith(b"# "):
            found = marker.match(line)
            flags = found.group(2).split() if found else []
            if b"1" in flags:
                stack.append(found.group(1))
                begun.append(total)
            elif b"2" in flags and stack:
                name, since = stack.pop(), begun.pop()
                parent = stack[-1] if stack else source.encode()
                if name.startswith(ours) or parent.startswith(ours):
                    below[name.decode()] += total - since
        elif line.strip():
            total += len(line) + 1
    return total, below


def seconds_of(build):
    """The last processor time of each unit: {object: (seconds, source)}."""
    file = build / "compile_seconds.txt"
    times = {}
    for line in file.read_text().splitlines() if file.exists() else []:
        seconds, object_file, source = line.split(" ", 2)
        times[object_file] = (float(seconds), str((build / source).resolve()))
    return times


def read(file):
    rows = (line.split() for line in pathlib.Path(file).read_text().splitlines() if line and not line.startswith("#"))
    return {target: (int(units), float(kilobytes), float(seconds)) for target, units, kilobytes, seconds in rows}


def compare(now, file):
    """Prints what has grown per unit. Seconds are compared with the median of all targets, so that another machine does not count."""
    before = read(file)
    common = sorted(now.keys() & before.keys())
    grown = 0
    speeds = {t: now[t][2] / now[t][0] / (before[t][2] / before[t][0]) for t in common if now[t][2] > 0 and before[t][2] > 0}
    usual = statistics.median(speeds.values()) if speeds else 1
    for target in common:
        units, kilobytes, _ = now[target]
        size, size_before = kilobytes / units, before[target][1] / before[target][0]
        if size > BYTES_GROWTH * size_before + BYTES_GRAIN:
            grown += 1
            print(f"notice: {target}: {size:.0f} kB a unit after the preprocessor, {size_before:.0f} in {shorter(file)}")
        if target in speeds and speeds[target] / usual > SECONDS_GROWTH:
            grown += 1
            print(f"notice: {target}: {now[target][2] / units:.1f} s a unit, {100 * (speeds[target] / usual - 1):.0f} % more than in {shorter(file)}, "
                  f"relative to all targets")
    print(f"{len(common)} targets compared ({len(speeds)} with times), {grown} notices")


def main():
    arguments = sys.argv[1:]
    build = (ROOT / "build" / arguments[0]).resolve()
    units, times = units_of(build), seconds_of(build)
    with multiprocessing.Pool() as pool:
        results = pool.map(preprocess, units, chunksize=1)

    print(f"the {min(MOST, len(times))} slowest files of {len(times)} compiled, processor seconds:")
    for seconds, source in sorted(times.values(), reverse=True)[:MOST]:
        print(f"  {seconds:6.1f}  {shorter(source)}")
    if not times:
        print("  none: build with COTWIN_COMPILE_COST=1 CCACHE_RECACHE=1 scripts/build.sh …")
    total, count = collections.Counter(), collections.Counter()
    for _, below in results:
        total.update(below)
        count.update(below.keys())
    print(f"the {MOST} heaviest headers: MB after the preprocessor in all units, number of units, kB in each")
    for header, size in total.most_common(MOST):
        print(f"  {size / 1e6:7.1f} {count[header]:5d} {size / 1e3 / count[header]:7.0f}  {shorter(header)}")

    kilobytes, number, seconds, timed = (collections.Counter() for _ in range(4))
    for (target, *_), (size, _) in zip(units, results):
        number[target] += 1
        kilobytes[target] += size / 1e3
    for object_file, (time, _) in times.items():
        seconds[target_of(object_file)] += time
        timed[target_of(object_file)] += 1
    # A target of which ccache had some objects has no time.
    rows = {t: (number[t], kilobytes[t], seconds[t] if timed[t] == number[t] else 0) for t in sorted(number)}
    tests = [s for object_file, (s, _) in times.items() if object_file.startswith("tests/")]
    if tests:   # one row, for scripts/progress.py
        rows["tests"] = (len(tests), 0, sum(tests))
    print(f"{sum(number.values())} units, {sum(kilobytes.values()) / 1e3:.0f} MB after the preprocessor, {sum(s for s, _ in times.values()):.0f} s in all files")
    if "--save" in arguments:
        file = pathlib.Path(arguments[arguments.index("--save") + 1])
        file.write_text("# target, units, kB after the preprocessor, processor seconds (0: not measured): scripts/compile_cost.sh\n" +
                        "".join(f"{t} {n} {k:.0f} {s:.1f}\n" for t, (n, k, s) in rows.items()))
    if "--against" in arguments:
        compare(rows, arguments[arguments.index("--against") + 1])


if __name__ == "__main__":
    main()
