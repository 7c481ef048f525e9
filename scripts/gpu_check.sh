#!/usr/bin/env bash
# scripts/gpu_check.sh [BUILD]: on a machine with a GPU of NVIDIA, whether it gives the processor's figures, how many motions it judges a second beside all
# cores, and whether it keeps memory; about five minutes. Needs bin/cotwin and tests/optimisation_test in BUILD (build/release).
set -euo pipefail
shopt -s inherit_errexit
cd "$(dirname "$0")/.."
build=${1:-build/release}
export COTWIN_MODELS=$PWD/models

"$build/tests/optimisation_test" --gtest_brief=1 --gtest_filter='RealDevice.*'

# seconds DEVICE MOTIONS: of data growing with torque and energy of the LWR 4+, 50 samples
seconds() {
  local begun=$EPOCHREALTIME
  "$build/bin/cotwin" ask grow --robot lwr4 --from 0,0.5,0,-1,0,0.6,0 --to 1.2,-0.2,0.4,0.7,-0.5,-0.3,0.8 --device "$1" --detail verdict \
    --with '{"T_min_s": 1.5, "T_max_s": 4, "samples": 50, "cost": [{"name": "torque"}, {"name": "energy"}], "motions": '"$2"'}' >/dev/null
  awk -v begun="$begun" -v ended="$EPOCHREALTIME" 'BEGIN {print ended - begun}'
}
# rate DEVICE MOTIONS: motions a second beyond a tenth of them, so that the start does not count
rate() {
  local few many
  few=$(seconds "$1" $(($2 / 10)))
  many=$(seconds "$1" "$2")
  awk -v few="$few" -v many="$many" -v motions="$2" 'BEGIN {printf "%.2e motions a second; %.2f s before the first\n", 0.9 * motions / (many - few), few - (many - few) / 9}'
}
motions=${GPU_CHECK_MOTIONS:-1000000}
cores=$(rate cpu $((10 * motions)))
echo "$(nproc) cores: $cores"
gpu=$(rate gpu $((200 * motions)))
echo "GPU: $gpu"
