#!/usr/bin/env bash
# Installs what is missing, builds the program, and runs the main example, which then can be seen in a browser; then builds the rest: the Python
# package, the C++ library and the libraries of FMUs. Or runs the scenario given: ./run.sh [SCENARIO.ssd [options of cotwin run…]]
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
options=(-DCMAKE_BUILD_TYPE=Release)
if [[ ! -f $root/build/release/CMakeCache.txt ]]; then options+=(-DCOTWIN_TESTS=OFF); fi   # ./test.sh adds the tests to this folder
build() { "$root/scripts/build.sh" "release:$1" "${options[@]}"; }
"$root/scripts/install.sh" build view
build cotwin
cotwin=$root/build/release/bin/cotwin
[ $# -eq 0 ] || exec "$cotwin" run "$@"
"$cotwin" run "$root/examples/02_free_motion_lwr4/twin.ssd" --report
"$cotwin" view results/free_motion_lwr4 || true   # without the page, which needs the npm registry while it is built, it reports that
build models/all,components/all,fmu/all,master/all
