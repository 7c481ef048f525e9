#!/usr/bin/env bash
# Builds the fuzz targets with clang, address and undefined sanitizers, and runs each for SECONDS: scripts/fuzz.sh [SECONDS [NAME…]]
# Starts from tests/fuzz/corpus/<name>; new inputs are kept below build/fuzz. FUZZ_SEED: seed of the random numbers; 0 or none: a new one each time.
# With FUZZ_RUNS each target reads that many inputs instead, for at most 45 s: the same mutations of its corpus each time.
# The last line is `N passed, N failed, 0 skipped`, in targets.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/counts.sh
export FUZZ_RUNS=${FUZZ_RUNS:-0}
seconds=${1:-60}
shift || true
scripts/install.sh build test ci
CC=clang-14 CXX=clang++-14 scripts/build.sh fuzz:fuzz_targets -DCMAKE_BUILD_TYPE=RelWithDebInfo "-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O1 -g1" -DCOTWIN_TESTS=OFF -DCOTWIN_FUZZ=ON \
  -DCOTWIN_SANITIZE=address,undefined

fuzz_one() {
  local name=$1 seconds=$2
  local log=build/fuzz/$name.log corpus=build/fuzz/corpus/$name seed=${FUZZ_SEED:-0} limit=(-max_total_time="$seconds")
  if ((FUZZ_RUNS > 0)); then
    corpus=$(mktemp -d)
    seed=${FUZZ_SEED:-1}
    limit=(-runs="$FUZZ_RUNS" -max_total_time=45)
  fi
  mkdir -p "$corpus" "tests/fuzz/corpus/$name"
  if ! "build/fuzz/fuzz/${name}_fuzz" "${limit[@]}" -seed="$seed" -rss_limit_mb=2048 -timeout=10 -artifact_prefix="build/fuzz/" \
    "$corpus" "tests/fuzz/corpus/$name" >"$log" 2>&1; then
    { echo "fuzzing $name failed; the input is in build/fuzz"; tail -n 60 "$log"; } | add_failures >&2
    add_counts 0 1 0
    return 1
  fi
  if ((FUZZ_RUNS > 0)); then rm -rf "$corpus"; fi
  echo "$name: $(grep '^Done' "$log")"
  add_counts 1 0 0
}
export -f fuzz_one

names=("$@")
if [ ${#names[@]} -eq 0 ]; then
  for program in build/fuzz/fuzz/*_fuzz; do names+=("$(basename "$program" _fuzz)"); done
fi
if ((FUZZ_RUNS > 0)); then echo "fuzzing with $FUZZ_RUNS inputs each: ${names[*]}"; else echo "fuzzing for $seconds s each: ${names[*]}"; fi
printf '%s\n' "${names[@]}" | xargs -P "$(nproc)" -I{} bash -c 'fuzz_one {} '"$seconds"
