#!/usr/bin/env bash
# Builds the fuzz targets with clang, address and undefined sanitizers, and runs each for SECONDS: scripts/fuzz.sh [SECONDS [NAME…]]
# Starts from tests/fuzz/corpus/<name>; what it finds new stays below build/fuzz. FUZZ_SEED, of the random numbers; 0 or none: another one each time.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
shift || true
scripts/install.sh build test ci
CC=clang-14 CXX=clang++-14 scripts/build.sh fuzz:fuzz_targets -DCMAKE_BUILD_TYPE=RelWithDebInfo "-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O1 -g1" -DCOTWIN_TESTS=OFF -DCOTWIN_FUZZ=ON \
  -DCOTWIN_SANITIZE=address,undefined

fuzz_one() {
  local name=$1 seconds=$2
  mkdir -p "build/fuzz/corpus/$name" "tests/fuzz/corpus/$name"
  if ! "build/fuzz/fuzz/${name}_fuzz" -max_total_time="$seconds" -seed="${FUZZ_SEED:-0}" -rss_limit_mb=2048 -timeout=10 -artifact_prefix="build/fuzz/" \
    "build/fuzz/corpus/$name" "tests/fuzz/corpus/$name" >"build/fuzz/$name.log" 2>&1; then
    tail -n 60 "build/fuzz/$name.log" >&2
    echo "fuzzing $name failed; the input is in build/fuzz" >&2
    return 1
  fi
  echo "$name: $(grep '^Done' "build/fuzz/$name.log")"
}
export -f fuzz_one

names=("$@")
if [ ${#names[@]} -eq 0 ]; then
  for program in build/fuzz/fuzz/*_fuzz; do names+=("$(basename "$program" _fuzz)"); done
fi
echo "fuzzing for $seconds s each: ${names[*]}"
printf '%s\n' "${names[@]}" | xargs -P "$(nproc)" -I{} bash -c 'fuzz_one {} '"$seconds"
