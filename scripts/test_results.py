#!/usr/bin/env python3
"""Reads what ctest writes.
names FILE.json: prints the names of the tests in the output of `ctest --show-only=json-v1`.
summary FOLDER: the tests listed in FOLDER/*.json with their results in FOLDER/*.xml (`--output-junit`). A test of CTest that is a suite of GoogleTest
counts as the tests in FOLDER/suites/<its name>.xml (scripts/list_tests.py). Prints the reasons of skipped tests and the slowest tests, and writes
PASSED FAILED SKIPPED to FOLDER/counts, and the end of what each failed test printed to FOLDER/failures. A listed test without a result has failed:
ctest ended before."""
import collections
import json
import pathlib
import re
import sys
import xml.etree.ElementTree as ElementTree

SLOWEST = 20
LIMIT = 10.0  # seconds of a test that has no label `long`
LINES = 40    # of the output of a failed test


def listed(file):
    """The labels of each test by its name."""
    text = file.read_text()
    tests = json.loads(text[text.index("{"):])["tests"]
    labels = {}
    for test in tests:
        properties = {p["name"]: p["value"] for p in test.get("properties", [])}
        labels[test["name"]] = properties.get("LABELS", [])
    return labels


def outcome(case):
    """passed, failed or skipped, and the reason of the latter, of a test of CTest."""
    status, text = case.get("status"), (case.findtext("system-out") or "").strip()
    if status == "run":
        return "passed", ""
    if status == "disabled":
        return "skipped", "disabled"
    skipped = case.find("skipped")
    if skipped is None or not skipped.get("message", "").startswith("SKIP_"):   # e.g. the program of the test is missing
        return "failed", ""
    reason = re.search(r"skipped: (.*)", text)
    return "skipped", reason.group(1).strip() if reason else text.split("\n")[-1]


def suite(file, name):
    """The tests that a suite has run: name, passed, failed or skipped, seconds, and the reason where skipped. None where it did not end."""
    try:
        cases = [c for c in ElementTree.parse(file).getroot().iter("testcase") if c.get("status") == "run"]
    except (OSError, ElementTree.ParseError):
        return None
    tests = []
    for case in cases:
        skipped = case.find("skipped")
        kind = "failed" if case.find("failure") is not None else "skipped" if skipped is not None else "passed"
        reason = "" if skipped is None else " ".join(re.sub(r"^\S+:\d+\n", "", skipped.get("message", "")).split())
        tests.append((f"{name}.{case.get('classname')}.{case.get('name')}", kind, float(case.get("time", 0)), reason))
    return tests


def sanitized(build):
    cache = build / "CMakeCache.txt"
    return cache.exists() and re.search(r"^COTWIN_SANITIZE:\w+=.", cache.read_text(), re.MULTILINE) is not None


def summary(folder):
    labels, results, seconds, tests_of = {}, {}, [], {}
    reasons = collections.defaultdict(list)
    number = collections.Counter()
    failures = []
    for file in folder.glob("*.json"):
        labels.update(listed(file))
    for file in folder.glob("*.xml"):
        for case in ElementTree.parse(file).getroot().iter("testcase"):
            name = case.get("name")
            kind, reason = results[name] = outcome(case)
            program = name.split(".")[0]
            of_suite = (folder.parent / "tests" / program).is_file()
            tests = suite(folder / "suites" / (re.sub(r"[^\w.]", "_", name) + ".xml"), program) if of_suite else None
            if not tests or kind == "failed" and all(t[1] != "failed" for t in tests):   # no test of GoogleTest, or one that did not end
                if of_suite and kind == "passed":
                    kind = "failed"
                    print(f"failed, because it has run no test: {name}")
                tests = [*(tests or []), (name, kind, float(case.get("time", 0)), reason)]
            if any(t[1] == "failed" for t in tests):
                failed = [t[0] for t in tests if t[1] == "failed"]
                failures += [f"{folder.parent.name}: {', '.join(failed)}", *(case.findtext("system-out") or "").strip().split("\n")[-LINES:]]
            for test, kind, time, reason in tests:
                number[kind] += 1
                seconds.append((time, test, labels.get(name, [])))
                if kind == "skipped":
                    reasons[reason].append(test)
    for name in sorted(labels.keys() - results.keys()):
        failures.append(f"{folder.parent.name}: {name} did not run")
        number["failed"] += 1
    for reason, names in sorted(reasons.items()):
        print(f"skipped: {', '.join(sorted(names))}: {reason}")

    seconds.sort(key=lambda s: s[0], reverse=True)
    print(f"the {min(SLOWEST, len(seconds))} slowest tests, seconds of wall time:")
    for time, name, marks in seconds[:SLOWEST]:
        print(f"  {time:7.1f}  {name}{''.join(f' [{mark}]' for mark in marks)}")
    if not sanitized(folder.parent):
        for time, name, marks in seconds:
            if time > LIMIT and not {"long", "clock", "install"} & set(marks):
                print(f"notice: {name} took {time:.1f} s, more than {LIMIT:g} s, and has no label long")

    print(f"{folder.parent.name}: passed {number['passed']}, failed {number['failed']}, skipped {number['skipped']}")
    (folder / "failures").write_text("".join(f"{line}\n" for line in failures))
    (folder / "counts").write_text(f"{number['passed']} {number['failed']} {number['skipped']}\n")


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in ("names", "summary"):
        sys.exit(__doc__)
    path = pathlib.Path(sys.argv[2])
    if sys.argv[1] == "names":
        print("".join(f"{name}\n" for name in listed(path)), end="")
    else:
        summary(path)
