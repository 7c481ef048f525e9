#!/usr/bin/env bash
# Installs what is missing, builds and runs the benchmarks whose name contains FILTER: ./bench.sh [FILTER]
# Prints a table and writes build/benchmarks.json.
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
"$root/scripts/install.sh" build view test bench
"$root/scripts/build.sh" bench -DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=OFF -DCOTWIN_BENCHMARKS=ON
exec "$root/build/bench/benchmarks/report" "$root/build/bench/benchmarks" "$root/build/benchmarks.json" "${1:-}"
