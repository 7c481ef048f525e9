#!/usr/bin/env bash
# sensitivity.sh TESTS EXAMPLE [NAME=VALUE…]: by how much the figures of an example change between instruction sets and with small changes of
# the scenario (`--set NAME=VALUE`, one run each). TESTS: the program examples_test; EXAMPLE: its folder, e.g. 04_peg_in_hole.
# Prints for each test and figure the least and the largest value, and the largest difference from the unchanged run.
# A bound should be at least ten such differences away from the worst value.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,5s/^# //p' "$0" >&2; exit 2; }
tests=$1 example=$2
shift 2
run() {  # CPU SETTING
  COTWIN_PRINT_FIGURES=1 ${1:+env COTWIN_CPU="$1"} ${2:+env COTWIN_EXAMPLE_SET="$2"} "$tests" --gtest_filter="*/$example*" |
    awk -F'\t' -v OFS='\t' '/^\[ RUN/ {split($0, part, "/"); name = part[3]} $1 == "figure" {print name, $2, $3, $4}'
}
{
  run "" ""
  for cpu in x86-64-v2 x86-64-v3 x86-64-v4; do run "$cpu" "" || true; done
  for setting in "$@"; do run "" "$setting"; done
} | awk -F'\t' '
  function abs(x) {return x < 0 ? -x : x}
  {
    key = $1 "\t" $2
    if (!(key in first_least)) {order[++n] = key; first_least[key] = least[key] = $3; first_most[key] = most[key] = $4; moved[key] = 0}
    if ($3 < least[key]) least[key] = $3
    if ($4 > most[key]) most[key] = $4
    d = abs($3 - first_least[key]); if (d > moved[key]) moved[key] = d
    d = abs($4 - first_most[key]); if (d > moved[key]) moved[key] = d
  }
  END {
    for (i = 1; i <= n; ++i) printf "%s\t%.5g to %.5g\tmoved by %.2g\n", order[i], least[order[i]], most[order[i]], moved[order[i]]
  }'
