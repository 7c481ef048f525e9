#!/usr/bin/env bash
# Installs what is missing, builds and runs the benchmarks whose name contains FILTER: ./bench.sh [--quick] [FILTER]
# Prints a table and writes build/benchmarks.csv. --quick: each benchmark does as little as possible, to see that it still works and prints its
# rows; the last line is `N passed, N failed, N skipped`.
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
quick=()
if [[ ${1:-} == --quick ]]; then
  quick=(--quick)
  shift
  source "$root/scripts/counts.sh"
fi
"$root/scripts/install.sh" build view test bench
"$root/scripts/build.sh" release:tests/benchmarks/all -DCMAKE_BUILD_TYPE=Release -DCOTWIN_BENCHMARKS=ON
"$root/build/release/benchmarks/report" "${quick[@]}" "$root/build/release/benchmarks" "$root/build/benchmarks.csv" "${1:-}"
