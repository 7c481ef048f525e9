#!/usr/bin/env bash
# Installs what is missing, builds and runs all tests: ./test.sh [options of ctest…]. Builds in the folder of ./run.sh, so that nothing is compiled
# twice. The last line is the sum, `N passed, N failed, N skipped`; a build that fails is one failure.
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
source "$root/scripts/counts.sh"
"$root/scripts/install.sh" build view test
"$root/scripts/fetch_logs.py" --tests || echo "tests that need this public data are skipped"
"$root/scripts/build.sh" release -DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=ON ${CI:+-DCOTWIN_WERROR=ON}
echo "running the tests of build/release"
"$root/scripts/tests.sh" "$root/build/release" "$@"
