#!/usr/bin/env python3
"""Writes the CTest tests of a GoogleTest program: one for each suite, and one for each test with a label.
list_tests.py PROGRAM FILE --results FOLDER --timeout S [--serial] [--only PATTERN…] [--long PATTERN…] [--clock PATTERN…]
Patterns are those of --gtest_filter. Each CTest test writes what its tests gave to FOLDER/<its name>.xml, which scripts/test_results.py reads."""
import argparse
import fnmatch
import pathlib
import re
import subprocess


def matches(name, patterns):
    return any(fnmatch.fnmatchcase(name, p.replace("[", "[[]")) for pattern in patterns for p in pattern.split(":"))


def tests_of(program):
    """The names of the tests of each suite."""
    suites, names = {}, None
    listed = subprocess.run([program, "--gtest_list_tests"], text=True, check=True, capture_output=True).stdout
    for line in listed.split("\n"):
        word = line.split("#")[0].strip()   # after it a comment with the type or the value of the parameter
        if line.startswith("  "):
            names.append(word)
        elif re.fullmatch(r"[\w/]+\.", word):
            names = suites.setdefault(word[:-1], [])
    return suites


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("file", type=pathlib.Path)
    parser.add_argument("--results", type=pathlib.Path)
    parser.add_argument("--timeout")
    parser.add_argument("--serial", action="store_true")
    for option in ("--only", "--long", "--clock"):
        parser.add_argument(option, nargs="*", default=None if option == "--only" else [])
    given = parser.parse_args()
    program = pathlib.Path(given.program).name
    text = ""

    def add(name, gtest_filter, label=""):
        nonlocal text
        file = given.results / (re.sub(r"[^\w.]", "_", f"{program}.{name}") + ".xml")
        text += f'add_test([==[{program}.{name}]==] [==[{given.program}]==] --gtest_brief=1 [==[--gtest_filter={gtest_filter}]==] [==[--gtest_output=xml:{file}]==])\n'
        properties = f"TIMEOUT {given.timeout}" + " RUN_SERIAL ON" * given.serial + f" LABELS {label}" * bool(label) + " COST 100" * (label == "long")
        text += f"set_tests_properties([==[{program}.{name}]==] PROPERTIES {properties})\n"

    for suite, names in tests_of(given.program).items():
        every = [f"{suite}.{name}" for name in names if not name.startswith("DISABLED_")]
        chosen = [test for test in every if given.only is None or matches(test, given.only)]
        alone = {test: label for label in ("long", "clock") for test in chosen if matches(test, getattr(given, label))}
        together = [test for test in chosen if test not in alone]
        for test, label in alone.items():
            add(test, test, label)
        if len(together) == len(every):
            add(suite, f"{suite}.*")
        elif together and chosen == every:
            add(suite, f"{suite}.*-{':'.join(alone)}")
        elif together:
            add(suite, ":".join(together))
    given.file.write_text(text)


if __name__ == "__main__":
    main()
