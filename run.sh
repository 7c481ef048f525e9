#!/usr/bin/env bash
# Installs what is missing, builds, and runs the main example, which then can be seen in a browser; or runs the scenario given:
# ./run.sh [SCENARIO.ssd [options of cotwin run…]]
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
"$root/scripts/install.sh" build view
"$root/scripts/build.sh" release -DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=OFF
cotwin=$root/build/release/bin/cotwin
[ $# -eq 0 ] || exec "$cotwin" run "$@"
"$cotwin" run "$root/examples/02_free_motion_lwr4/twin.ssd" --report
"$cotwin" view results/free_motion_lwr4 || true   # without the page, which needs the npm registry while it is built, it reports that
