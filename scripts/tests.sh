#!/usr/bin/env bash
# tests.sh FOLDER [options of ctest…]: runs the tests of a build, lists the slowest, and ends with the line `N passed, N failed, N skipped`.
# Tests with the label `clock` read a clock, sleep or hold several processes to the wall clock (a robot and its client, a bus and its master, a
# browser): they run one after the other, and one that fails is repeated up to twice, because a machine that others use may stand still in the
# middle. All others run side by side, once. With COTWIN_STOP_TIME (seconds since 1970) no test runs after this time; those that are left count
# as failed.
set -euo pipefail
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
source "$here/counts.sh"
folder=$(cd "$1" && pwd)
shift
results=$folder/test_results
rm -rf "$results"
mkdir -p "$results/suites"

code=0
# run_tests NAME OPTIONS…: runs the tests that the options select, unless there are none: then ctest would end with a line that reads like a failure.
run_tests() {
  local name=$1 stop=()
  shift
  ctest --test-dir "$folder" --show-only=json-v1 "$@" >"$results/$name.json"
  python3 "$here/test_results.py" names "$results/$name.json" >"$results/$name.txt"
  if [[ ! -s $results/$name.txt ]]; then return; fi
  if [[ $name == clock ]]; then
    echo "$(wc -l <"$results/$name.txt") tests that depend on a clock (label clock):"
    sed 's/^/  /' "$results/$name.txt"
  fi
  if [[ -n ${COTWIN_STOP_TIME:-} ]]; then
    if (($(date +%s) >= COTWIN_STOP_TIME)); then echo "no time is left for the tests: $name"; code=1; return; fi
    stop=(--stop-time "$(date -d "@$COTWIN_STOP_TIME" +%T)")
  fi
  ctest --test-dir "$folder" --output-on-failure --test-output-size-passed 100000 --output-junit "$results/$name.xml" "${stop[@]}" "$@" || code=$?
}
run_tests ordinary -LE '^clock$' -j "$(nproc)" "$@"
run_tests clock -L '^clock$' --repeat until-pass:3 "$@"

python3 "$here/test_results.py" summary "$results"
read -r passed failed skipped <"$results/counts"
add_counts "$passed" "$failed" "$skipped"
add_failures <"$results/failures" >/dev/null   # ctest has printed them
if ((passed + failed + skipped == 0)); then echo "no test was selected" >&2; exit 1; fi
exit "$code"
