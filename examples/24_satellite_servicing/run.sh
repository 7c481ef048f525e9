#!/bin/sh
# Runs the fixed cell and its free twins, then the capture with a motion that does not turn the base: run.sh [OPTION…]; options are those of `cotwin run`.
# OUT: folder for the results; see ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/servicing}

mkdir -p "$out"
out=$(cd "$out" && pwd)
# Postures of plan.csv without the time before and the dwell after: at the start, and at the capture.
posture() { sed -n "$1s/^[^,]*,\(.*\),[^,]*\$/\1/p" "$here/plan.csv"; }
"$COTWIN" ask reaction --robot "$here/servicer.urdf" --from "$(posture 2)" --to "$(posture 3)" --duration 4 > "$out/predicted.json"
"$COTWIN" ask reactionless --robot "$here/servicer.urdf" --from "$(posture 2)" --to "$(posture 3)" --duration 4 \
  --with '{"to_pose": {"frame": "left_gripper"}}' --detail verdict --motion "$out/motion.csv" > "$out/corrected.json"
"$COTWIN" run "$here/servicing.ssd" --out "$out/run" "$@"
"$COTWIN" run "$here/corrected.ssd" --set motion.file="$out/motion.csv" --out "$out/corrected" "$@"
