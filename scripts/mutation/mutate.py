#!/usr/bin/env python3
"""Finds tests that cannot fail: changes places of the production code one at a time and sees whether a test fails.

mutate.py BUILD [--seed N] [--places N] [--room R]… [--seconds S] [--tree FOLDER]

BUILD is a built build with tests (build/release): its options, its compile commands and its list of tests are used. Places are drawn at random,
as many from each room (folder below models, components, fmu and master) as the square root of its lines: comparisons, + and -, * and /, signs and
numbers. All places are compiled at once, in FOLDER (default: build/mutation); scripts/mutation/switch.h chooses one by an environment variable. Places that do not
compile with the switch (constant expressions, types without arithmetic) are replaced by others. Then each test runs once and says which places it
reaches, and each place is changed while the tests that reach it run, quickest first, for at most S seconds of wall time, until one fails.
Tests with the label clock do not count. Writes tests/mutants.txt and prints the share of places that a test catches."""
import argparse
import concurrent.futures
import functools
import json
import math
import os
import pathlib
import random
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
FLOORS = ("models", "components", "fmu", "master")
# Nothing that a test of this platform could catch, or code whose bits another test compares as a whole.
LEFT_OUT = re.compile(r"windows|/kernels/|/view/|^master/python|_main\.cpp|/browser\.cpp|/interrupt\.cpp")
# Lines whose change nobody can see, or that are no arithmetic: messages, sizes that are reserved, declarations.
NO_PLACE = re.compile(r"\b(constexpr|static_assert|template|using|case|enum|requires|operator|reserve|throw|fail|Error|warn|note)\b|^\s*#|\"")
NUMBER = "cotwin_mutation::number({n}, {old})"
KINDS = [
    ("sign", re.compile(r"(?<=[\w)\]] )([+-])(?= [^=])"), "{old} cotwin_mutation::Sign{{{n}}} *"),
    ("sign", re.compile(r"(?:(?<=[=(,?:] )|(?<=return )|(?<=\())-(?=[a-zA-Z(])"), "-cotwin_mutation::Sign{{{n}}} * "),
    ("twice", re.compile(r"(?<=[\w)\]] )([*/])(?= )"), "{old} cotwin_mutation::Twice{{{n}}} {old}"),
    ("number", re.compile(r"(?<![\w.'\"])(\d+\.\d+(?:e[+-]?\d+)?|\d+(?:e[+-]?\d+)?)(?![\w.'])"), NUMBER),
] + [("comparison", re.compile(rf"(?<=[\w)\]] )({re.escape(op)})(?= [^=])"), code) for op, code in (
    ("<", "<cotwin_mutation::Less{{{n}}}>"), ("<=", "<cotwin_mutation::LessEqual{{{n}}}>"),
    (">", "<cotwin_mutation::Greater{{{n}}}>"), (">=", "<cotwin_mutation::GreaterEqual{{{n}}}>"),
    ("==", "==cotwin_mutation::Equal{{{n}}}=="), ("!=", "==cotwin_mutation::NotEqual{{{n}}}=="))]


@functools.cache
def lines_of(file):
    """The lines of a source as they were when they were first read, so that the tree may change while the mutants are tried."""
    return (ROOT / file).read_text().split("\n")


def without_comments(line):
    return re.sub(r"//.*", lambda m: " " * len(m.group()), line)


def places_of(file):
    """(line, column, length, kind, replacement) of each place of a source."""
    found = []
    for number, line in enumerate(lines_of(file)):
        code = without_comments(line)
        if NO_PLACE.search(code):
            continue
        for kind, pattern, replacement in KINDS:
            for match in pattern.finditer(code):
                found.append((number, match.start(), len(match.group()), kind, replacement))
    return found


def draw(seed, wanted, rooms_wanted):
    """The places in the order in which they are tried, by room, and how many each room gets."""
    files = subprocess.run(["git", "ls-files", *(f"{floor}/*.cpp" for floor in FLOORS)], cwd=ROOT, text=True, check=True,
                           capture_output=True).stdout.split()
    rooms = {}
    lines = {}
    for file in files:
        if LEFT_OUT.search(file):
            continue
        room = "/".join(file.split("/")[:2]) if file.count("/") > 1 else file.split("/")[0]
        if rooms_wanted and room not in rooms_wanted:
            continue
        rooms.setdefault(room, []).extend((file, *place) for place in places_of(file))
        lines[room] = lines.get(room, 0) + len(lines_of(file)) - 1
    source = random.Random(seed)
    total = sum(math.sqrt(n) for n in lines.values())
    share = {room: max(1, round(wanted * math.sqrt(lines[room]) / total)) for room in rooms}
    for places in rooms.values():
        by_kind = {}
        for place in sorted(places):
            by_kind.setdefault(place[4], []).append(place)
        for group in by_kind.values():
            source.shuffle(group)
        order = []   # the kinds take turns
        while any(by_kind.values()):
            order += [group.pop() for _, group in sorted(by_kind.items()) if group]
        places[:] = order
    return rooms, share


def mutated(file, places):
    """The source with its places, {number: place}, switched."""
    lines = list(lines_of(file))
    for number, (_, line, column, length, _, replacement) in sorted(places.items(), key=lambda p: (p[1][1], p[1][2]), reverse=True):
        text = lines[line]
        old = text[column:column + length]
        lines[line] = text[:column] + replacement.format(n=number, old=old) + text[column + length:]
    return '#include "scripts/mutation/switch.h"\n#line 1\n' + "\n".join(lines)


def compile_options(build):
    """The options of each source's compilation, from the unit that contains it."""
    options = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        words = shlex.split(entry["command"])
        kept, k = [], 0
        while k < len(words):
            if words[k] == "-isystem":
                kept += words[k:k + 2]
                k += 1
            elif re.match(r"-[ID]|-std=", words[k]):
                kept.append(words[k])
            k += 1
        unit = pathlib.Path(entry["file"])
        sources = re.findall(r'#include "(.*\.cpp)"', unit.read_text()) if unit.suffix == ".cxx" else [str(unit)]
        for source in sources:
            path = pathlib.Path(source)
            if path.is_relative_to(ROOT) and not path.is_relative_to(build):
                options.setdefault(str(path.relative_to(ROOT)), kept)
    return options


def check(file, places, options):
    """The numbers of the places that do not compile."""
    wrong = set()
    while True:
        left = {n: p for n, p in places.items() if n not in wrong}
        if not left:
            return wrong
        with tempfile.NamedTemporaryFile("w", suffix=".cpp") as source:
            source.write(mutated(file, left))
            source.flush()
            done = subprocess.run(["clang++-14", "-fsyntax-only", "-w", "-ferror-limit=0", *options, source.name], text=True,
                                  stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
        if done.returncode == 0:
            return wrong
        bad = {int(line) - 1 for line in re.findall(rf"^{re.escape(source.name)}:(\d+):\d+: (?:fatal )?(?:error|note)", done.stderr, re.MULTILINE)}
        new = {n for n, p in left.items() if p[1] in bad}
        wrong |= new or set(left)


def choose(rooms, share, options):
    """Draws until each room has its share of places that compile: {number: place}."""
    chosen, number = {}, 0
    missing = dict(share)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        while any(missing.values()):
            files, taken = {}, False
            for room, n in missing.items():
                take = rooms[room][:math.ceil(1.3 * n)] if n else []
                del rooms[room][:len(take)]
                taken = taken or bool(take)
                for place in take:
                    if place[0] in options:
                        number += 1
                        files.setdefault(place[0], {})[number] = place
            if not taken:
                break
            results = pool.map(lambda item: (item, check(item[0], item[1], options[item[0]])), files.items())
            for (file, places), wrong in results:
                room = "/".join(file.split("/")[:2]) if file.count("/") > 1 else file.split("/")[0]
                for n, place in places.items():
                    if n not in wrong and missing[room] > 0:
                        chosen[n] = place
                        missing[room] -= 1
            print(f"{len(chosen)} places compile, {sum(missing.values())} are missing", flush=True)
    return chosen


def build_mutants(chosen, build, tree):
    """Compiles a copy of the sources with all places, with the options of `build`, into TREE/build/release. The places that do not compile."""
    files = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, text=True, check=True, capture_output=True).stdout.split("\n")
    changed = {}
    for n, place in chosen.items():
        changed.setdefault(place[0], {})[n] = place
    for old in tree.rglob("*"):
        if old.is_file() and old.parts[len(tree.parts)] != "build" and str(old.relative_to(tree)) not in files:
            old.unlink()
    for file in filter(None, files):
        source, target = ROOT / file, tree / file
        if not source.is_file():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if file in changed:
            text = mutated(file, changed[file])
            if not target.exists() or target.read_text() != text:
                target.write_text(text)
        elif not target.exists() or target.read_bytes() != source.read_bytes():
            shutil.copy(source, target)
    cache = (build / "CMakeCache.txt").read_text()
    options = [f"-D{m}" for m in re.findall(r"^((?:COTWIN_\w+|CMAKE_BUILD_TYPE):(?:BOOL|STRING)=.*)$", cache, re.MULTILINE)
               if not m.startswith("COTWIN_WERROR")]
    done = subprocess.run([tree / "scripts/build.sh", "release", *options, "-DCOTWIN_BENCHMARKS=OFF"], cwd=tree, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if done.returncode == 0:
        return {}
    # The place of an error, or the line of ours from which a template of switch.h was instantiated.
    lines = {(m[0], int(m[1]) - 1) for m in re.findall(rf"{re.escape(str(tree))}/([\w/]+\.cpp):(\d+):\d+: +(?:(?:fatal )?error|required from here|note: in instantiation)", done.stdout)}
    wrong = {n: place for n, place in chosen.items() if (place[0], place[1]) in lines}
    if not wrong:
        sys.exit(done.stdout[-4000:])
    print(f"{len(wrong)} places do not compile with this compiler", flush=True)
    return wrong


def tests_of(build):
    """[(name, command, folder, environment)] of the tests that do not depend on a clock."""
    text = subprocess.run(["ctest", "--show-only=json-v1", "-LE", "^clock$"], cwd=build, text=True, check=True, capture_output=True).stdout
    tests = []
    for test in json.loads(text[text.index("{"):])["tests"]:
        properties = {p["name"]: p["value"] for p in test.get("properties", [])}
        if "command" in test:
            environment = dict(word.split("=", 1) for word in properties.get("ENVIRONMENT", []))
            tests.append((test["name"], test["command"], properties.get("WORKING_DIRECTORY", str(build)), environment))
    return tests


def run(test, environment, limit):
    """(whether it passed, seconds)"""
    _, command, folder, own = test
    begin = time.monotonic()
    with subprocess.Popen(command, cwd=folder, env={**os.environ, **own, **environment}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                          start_new_session=True) as process:
        try:
            code = process.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.wait()
            code = -9
    return code == 0, time.monotonic() - begin


def reach(tests, scratch):
    """What each test reaches, and how long it takes; without tests that fail although nothing is changed."""
    def one(indexed):
        k, test = indexed
        file = scratch / f"reached{k}"
        file.write_bytes(bytes(65536))
        passed, seconds = run(test, {"COTWIN_MUTANTS_REACHED": str(file)}, 900)
        reached = {n for n, byte in enumerate(file.read_bytes()) if byte}
        file.unlink()
        return test, passed, seconds, reached
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(one, enumerate(tests)))
    for test, passed, _, _ in results:
        if not passed:
            print(f"left out, because it fails without a change: {test[0]}")
    return [(test, seconds, reached) for test, passed, seconds, reached in results if passed]


def judge(number, reaching, seconds_each):
    """(verdict, test) of one place."""
    at_most = time.monotonic() + seconds_each
    candidates = sorted(((seconds, test) for test, seconds, reached in reaching if number in reached), key=lambda c: c[0])
    if not candidates:
        return "not reached", ""
    for k, (seconds, test) in enumerate(candidates):
        if k > 0 and time.monotonic() + seconds > at_most:
            return "survives", f"{k} of {len(candidates)} tests"
        passed, _ = run(test, {"COTWIN_MUTANT": str(number)}, 10 * seconds + 10)
        if not passed:
            return "caught", test[0]
    return "survives", f"{len(candidates)} of {len(candidates)} tests"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--places", type=int, default=200)
    parser.add_argument("--room", action="append", default=[])
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--tree", type=pathlib.Path, default=ROOT / "build/mutation")
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    rooms, share = draw(arguments.seed, arguments.places, arguments.room)
    chosen = choose(rooms, share, compile_options(build))
    tree = arguments.tree.resolve()
    while wrong := build_mutants(chosen, build, tree):
        for n in wrong:
            del chosen[n]
    mutants = tree / "build/release"
    with tempfile.TemporaryDirectory() as scratch:
        reaching = reach(tests_of(mutants), pathlib.Path(scratch))
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        verdicts = dict(zip(chosen, pool.map(lambda n: judge(n, reaching, arguments.seconds), chosen)))
    rows = []
    for n, (file, line, column, length, kind, _) in chosen.items():
        text = lines_of(file)[line]
        shown = f"{text[:column]}⟦{text[column:column + length]}⟧{text[column + length:]}".strip()
        rows.append((file, line + 1, kind, *verdicts[n], shown))
    caught = sum(row[3] == "caught" for row in rows)
    out = [f"# scripts/mutation/mutate.py --seed {arguments.seed} --places {arguments.places}: {caught} of {len(rows)} places are caught.",
           "# verdict | file | kind of change | the test that caught it, or how many were tried | the line, with the place in ⟦⟧"]
    out += [" | ".join((verdict, file, kind, by, shown)) for file, _, kind, verdict, by, shown in sorted(rows)]
    (ROOT / "tests/mutants.txt").write_text("\n".join(out) + "\n")
    print(f"{caught} of {len(rows)} places are caught; tests/mutants.txt lists them")
    return 0


if __name__ == "__main__":
    sys.exit(main())
