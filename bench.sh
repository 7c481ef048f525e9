#!/usr/bin/env bash
# Installs what is missing, builds and runs the benchmarks whose name contains FILTER: ./bench.sh [--quick] [FILTER]
# Prints a table and writes build/benchmarks.json. --quick: each benchmark does as little as possible, to see that it still works and prints its
# rows; the last line is `N passed, N failed, N skipped`. COTWIN_BENCH_BUILD: another folder below build/, whose options are kept.
set -euo pipefail
root=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
quick=()
if [[ ${1:-} == --quick ]]; then
  quick=(--quick)
  shift
  source "$root/scripts/counts.sh"
fi
"$root/scripts/install.sh" build view test bench
build=${COTWIN_BENCH_BUILD:-bench}
options=(-DCOTWIN_BENCHMARKS=ON)
if [[ $build == bench ]]; then options+=(-DCMAKE_BUILD_TYPE=Release -DCOTWIN_TESTS=OFF); fi
"$root/scripts/build.sh" "$build" "${options[@]}"
"$root/build/$build/benchmarks/report" "${quick[@]}" "$root/build/$build/benchmarks" "$root/build/benchmarks.json" "${1:-}"
