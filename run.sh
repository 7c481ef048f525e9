#!/usr/bin/env bash
# Installs what is missing, builds the program, and runs the main example, which then can be seen in a browser; then builds the rest: the Python
# package, the C++ library and the libraries of FMUs. Or runs the scenario given: ./run.sh [SCENARIO.ssd [options of cotwin run…]]
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
build() { "$root/scripts/build.sh" "release$1" -DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=OFF; }
"$root/scripts/install.sh" build view
build :cotwin
cotwin=$root/build/release/bin/cotwin
[ $# -eq 0 ] || exec "$cotwin" run "$@"
"$cotwin" run "$root/examples/02_free_motion_lwr4/twin.ssd" --report
"$cotwin" view results/free_motion_lwr4 || true   # without the page, which needs the npm registry while it is built, it reports that
build ""
