#!/usr/bin/env python3
"""progress.py FOLDER TARGET…: builds with ninja and prints how many steps are done and how many minutes are left: on a terminal one line that changes
each second, elsewhere a line each half minute. Prints nothing if everything is up to date. ninja's output goes to FOLDER/build.log; if the build
fails, the part from the first failure on is printed, too. A step counts as its target's mean processor seconds in .ci/compile_cost.txt."""
import math
import os
import pathlib
import re
import select
import subprocess
import sys
import time

LINE_S = 30          # between two lines in a log
COMPILED_S = 5.0     # a compilation whose target is not in the table
OTHER_S = 0.2        # linking, copying
TRUSTED_S = 60       # processor seconds after which this machine's own speed counts as much as that of the table
STEP = re.compile(r"\[(\d+)/(\d+)\] (.*)")
ROOT = pathlib.Path(__file__).resolve().parent.parent


def table():
    rows = (line.split() for line in (ROOT / ".ci/compile_cost.txt").read_text().splitlines() if line and not line.startswith("#"))
    return {target: float(seconds) / int(units) for target, units, _, seconds in rows if float(seconds) > 0}


def cost(step, seconds_of):
    found = re.match(r"Building \S+ object (\S+)", step)
    if not found:
        return OTHER_S
    if found.group(1).startswith("tests/"):
        return seconds_of.get("tests", COMPILED_S)
    target = re.search(r"CMakeFiles/(.+?)\.dir/", found.group(1))
    return seconds_of.get(target.group(1), COMPILED_S) if target else COMPILED_S


def remaining(seconds):
    return "less than a minute left" if seconds < 60 else f"about {math.ceil(seconds / 60)} min left"


class Progress:
    def __init__(self, steps):
        self.seconds_of = table()
        self.count = len(steps)
        self.all_s = sum(cost(step, self.seconds_of) for step in steps)   # processor seconds by the table
        self.done, self.done_s = 0, 0.0
        self.begin = time.monotonic()
        self.end = self.begin + self.all_s / os.cpu_count()   # expected
        self.terminal = sys.stdout.isatty()
        self.printed = self.begin

    def finished(self, done, count, step):
        self.done, self.count = done, count
        self.done_s += cost(step, self.seconds_of)
        now = time.monotonic()
        spent_s = (now - self.begin) * os.cpu_count()
        slowness = (TRUSTED_S + spent_s) / (TRUSTED_S + self.done_s)
        self.end = now + max(0.0, self.all_s - self.done_s) / os.cpu_count() * slowness

    def print(self):
        now = time.monotonic()
        text = f"{self.done} of {self.count} steps, {remaining(self.end - now)}"
        if self.terminal:
            print(f"\r{text}\033[K", end="", flush=True)
        elif now - self.printed >= LINE_S:
            self.printed = now
            print(f"  {text}", flush=True)

    def close(self):
        minutes = (time.monotonic() - self.begin) / 60
        print(f"{chr(13) if self.terminal else '  '}{self.done} of {self.count} steps in {minutes:.1f} min{chr(27) + '[K' if self.terminal else ''}", flush=True)


def main():
    folder, *targets = sys.argv[1:]
    ninja = ["ninja", "-C", folder, *targets]
    environment = {**os.environ, "NINJA_STATUS": "[%f/%t] "}
    plan = subprocess.run([*ninja, "-n"], env=environment, capture_output=True, text=True)
    steps = [match.group(3) for match in map(STEP.match, plan.stdout.splitlines()) if match]
    if plan.returncode == 0 and not steps:
        return 0
    progress = Progress(steps)
    print(f"building {' '.join(targets)} in {folder}: {progress.count} steps, {remaining(progress.end - progress.begin)}", flush=True)
    log, rest = [], b""
    process = subprocess.Popen(ninja, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    with open(pathlib.Path(folder) / "build.log", "wb") as file:
        while True:
            progress.print()
            if not select.select([process.stdout], [], [], 1)[0]:
                continue
            part = os.read(process.stdout.fileno(), 1 << 16)
            if not part:
                break
            file.write(part)
            *lines, rest = (rest + part).split(b"\n")
            for line in lines:
                log.append(line.decode(errors="replace"))
                match = STEP.match(log[-1])
                if match:
                    progress.finished(int(match.group(1)), int(match.group(2)), match.group(3))
    code = process.wait()
    progress.close()
    if code != 0:
        first = next((i for i, line in enumerate(log) if line.startswith("FAILED:")), 0)
        print("\n".join(log[first:]) + f"\nfailed: the build of {' '.join(targets)} in {folder}", file=sys.stderr)
    return code


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
