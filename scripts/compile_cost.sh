#!/usr/bin/env bash
# compile_cost.sh FOLDER [--save FILE] [--against FILE]: what the compilation of build/FOLDER costs. Prints the slowest 20 source files in processor
# seconds, and the 20 headers with the most text in all units after the preprocessor (of production code; about half a second a unit).
#   --save FILE     writes units, kilobytes and seconds of each target
#   --against FILE  prints the targets that have more than 5 % more bytes or 20 % more seconds a unit than in FILE
# Seconds are there where a build measured them: COTWIN_COMPILE_COST=1 CCACHE_RECACHE=1 scripts/build.sh FOLDER … (without CCACHE_RECACHE: those
# of the files that ccache did not have).
set -euo pipefail
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
if [[ $# == 0 || $1 == -* ]]; then sed -n '2,7s/^# //p' "$0" >&2; exit 2; fi
exec python3 "$here/compile_cost.py" "$@"
