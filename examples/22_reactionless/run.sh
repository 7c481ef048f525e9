#!/bin/sh
# Searches the motion that does not turn the satellite, and runs it beside the standard one: run.sh [OPTION…]; options are those of `cotwin run`.
# OUT: folder for the results; see ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/reactionless}

mkdir -p "$out"
out=$(cd "$out" && pwd)
"$COTWIN" ask reactionless --robot "$here/satellite.urdf" --from 0,0.5,0,-1.4,0,0.8,0 --to 0.4,-0.6,-0.1,-1.9,-0.9,-0.3,0.6 --duration 4 \
  --with '{"to_pose": {"directions": ["x", "y", "z"]}}' --detail verdict --motion "$out/motion.csv" > "$out/answer.json"
"$COTWIN" run "$here/reactionless.ssd" --set reactionless_motion.file="$out/motion.csv" --out "$out/run" "$@"
