#!/usr/bin/env bash
# Installs what is missing, builds, and runs the main example, or the scenario given: ./run.sh [SCENARIO.ssd [options of cotwin run…]]
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
"$root/scripts/install.sh" build
"$root/scripts/build.sh" release -DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=OFF
[ $# -gt 0 ] || set -- "$root/examples/02_free_motion_lwr4/twin.ssd" --report
exec "$root/build/release/bin/cotwin" run "$@"
