#!/usr/bin/env bash
# Installs what is missing, builds and runs all tests: ./test.sh [options of ctest…]
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
"$root/scripts/install.sh" build view test
"$root/scripts/build.sh" test -DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=ON ${CI:+-DCOTWIN_WERROR=ON}
echo "running the tests of build/test"
exec "$root/scripts/tests.sh" "$root/build/test" "$@"
