#!/usr/bin/env python3
"""Reads what ctest writes.
names FILE.json: prints the names of the tests in the output of `ctest --show-only=json-v1`.
summary FOLDER: the tests listed in FOLDER/*.json with their results in FOLDER/*.xml (`--output-junit`). Prints the reasons of skipped tests and
the slowest tests, and writes PASSED FAILED SKIPPED to FOLDER/counts, and the end of what each failed test printed to FOLDER/failures. A listed
test without a result has failed: ctest ended before."""
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
    """passed, failed or skipped, and the reason of the latter."""
    status, text = case.get("status"), (case.findtext("system-out") or "").strip()
    if status == "run" and re.search(r"^\[=+\] 0 tests from 0 test suites ran", text, re.MULTILINE):
        print(f"failed, because the filter matches no test: {case.get('name')}")
        return "failed", ""
    if status == "run":
        return "passed", ""
    skipped = case.find("skipped")
    if status == "disabled":
        return "skipped", "disabled"
    if skipped is None or not skipped.get("message", "").startswith("SKIP_"):   # e.g. the program of the test is missing
        return "failed", ""
    reason = re.search(r"(?:skipped: |: Skipped\n)(.*)", text)
    return "skipped", reason.group(1).strip() if reason else text.split("\n")[-1]


def sanitized(build):
    cache = build / "CMakeCache.txt"
    return cache.exists() and re.search(r"^COTWIN_SANITIZE:\w+=.", cache.read_text(), re.MULTILINE) is not None


def summary(folder):
    labels, results, seconds, number = {}, {}, {}, collections.Counter()
    reasons = collections.defaultdict(list)
    failures = []
    for file in folder.glob("*.json"):
        labels.update(listed(file))
    for file in folder.glob("*.xml"):
        for case in ElementTree.parse(file).getroot().iter("testcase"):
            name = case.get("name")
            results[name], reason = outcome(case)
            seconds[name] = float(case.get("time", 0))
            inside = re.search(r"\[  SKIPPED \] (\d+) test", case.findtext("system-out") or "")
            if results[name] == "failed":
                failures += [f"{folder.parent.name}: {name}", *(case.findtext("system-out") or "").strip().split("\n")[-LINES:]]
            elif results[name] == "skipped":
                reasons[reason].append(name)
            elif inside:   # one process for many cases (TOGETHER)
                number["skipped"] += int(inside.group(1))
                why = sorted(set(re.findall(r": Skipped\n(.*)", case.findtext("system-out"))))
                reasons["; ".join(why)].append(f"{inside.group(1)} cases of {name}")
    for name in sorted(labels.keys() - results.keys()):
        failures.append(f"{folder.parent.name}: {name} did not run")
        results[name] = "failed"
    for reason, names in sorted(reasons.items()):
        print(f"skipped: {', '.join(sorted(names))}: {reason}")

    slowest = sorted(seconds, key=seconds.get, reverse=True)
    print(f"the {min(SLOWEST, len(slowest))} slowest tests, seconds of wall time:")
    for name in slowest[:SLOWEST]:
        print(f"  {seconds[name]:7.1f}  {name}{''.join(f' [{label}]' for label in labels.get(name, []))}")
    if not sanitized(folder.parent):
        for name in slowest:
            many = name.endswith(")") and "GetParam()" not in name   # many cases in one process (TOGETHER)
            if seconds[name] > LIMIT and not many and not {"long", "clock"} & set(labels.get(name, [])):
                print(f"notice: {name} took {seconds[name]:.1f} s, more than {LIMIT:g} s, and has no label long")

    number.update(results.values())
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
