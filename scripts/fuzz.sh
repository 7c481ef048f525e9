#!/usr/bin/env bash
# Builds the fuzz targets with clang, address and undefined sanitizers, and runs each for SECONDS: scripts/fuzz.sh [SECONDS [NAME…]]
# Starts from tests/fuzz/corpus/<name>; what it finds new stays below build/fuzz.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
shift || true
scripts/install.sh build test ci
CC=clang-14 CXX=clang++-14 scripts/build.sh fuzz:fuzz_targets -DCMAKE_BUILD_TYPE=RelWithDebInfo "-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O1 -g1" -DCOTWIN_TESTS=OFF -DCOTWIN_FUZZ=ON \
  -DCOTWIN_SANITIZE=address,undefined

for program in build/fuzz/fuzz/*_fuzz; do
  name=$(basename "$program" _fuzz)
  if [ $# -gt 0 ] && [[ " $* " != *" $name "* ]]; then continue; fi
  echo "fuzzing $name for $seconds s"
  mkdir -p "build/fuzz/corpus/$name" "tests/fuzz/corpus/$name"
  "$program" -max_total_time="$seconds" -rss_limit_mb=2048 -timeout=10 -artifact_prefix="build/fuzz/" \
    "build/fuzz/corpus/$name" "tests/fuzz/corpus/$name" >"build/fuzz/$name.log" 2>&1 ||
    { tail -n 60 "build/fuzz/$name.log" >&2; echo "fuzzing $name failed; the input is in build/fuzz" >&2; exit 1; }
  grep '^Done' "build/fuzz/$name.log"
done
