#!/usr/bin/env python3
"""compile_flags.py FILE… 3<DATABASE: reads the compilation database of a build (ninja -t compdb) and prints a line for each of these C++ files that the build
compiles, alone or with others (COTWIN_UNITY): its include folders and definitions, quoted for a shell, and the file. Fuzz targets, which only another
build compiles, have all include folders."""
import json
import pathlib
import re
import sys

FOLDERS, DEFINITIONS = r"-isystem \S+|-I\S+", r"-D\S+"
root = pathlib.Path(__file__).resolve().parent.parent
flags, folders = {}, {}
for entry in json.load(open(3)):
    source = pathlib.Path(entry["directory"], entry["file"])
    if source.suffix not in (".cpp", ".cxx"):
        continue
    folders.update(dict.fromkeys(re.findall(FOLDERS, entry["command"])))
    together = re.findall(r'^#include "(.+)"', source.read_text(), re.M) if "/Unity/" in str(source) else [source]
    for file in together:
        flags.setdefault(pathlib.Path(file), " ".join(re.findall(FOLDERS + "|" + DEFINITIONS, entry["command"])))
for name in sys.argv[1:]:
    used = " ".join(folders) if name.startswith("tests/fuzz/") else flags.get(root / name)
    if used is None:
        print("not checked, because this build does not compile it:", name, file=sys.stderr)
    else:
        print(used, name)
