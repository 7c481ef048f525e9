#!/usr/bin/env bash
# tests.sh FOLDER [options of ctest…]: runs the tests of a build. Those with the label `clock` hold several processes to the wall clock (a robot and
# its client, a bus and its master, a browser): one after the other, and one that fails is repeated up to twice, because a machine that others use may
# stand still in the middle. All others run side by side, once.
set -uo pipefail
folder=$1
shift
ctest --test-dir "$folder" --output-on-failure -LE '^clock$' -j "$(nproc)" "$@"
code=$?
echo "the tests that go by the clock"
ctest --test-dir "$folder" --output-on-failure -L '^clock$' --repeat until-pass:3 "$@" || code=$?
exit "$code"
